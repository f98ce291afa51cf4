"""The paper frischid began with, computed again in its order: equations, tables, figures, ours beside the printed ones.

In comes a file with the authors' 100 points; out come a `Reproduction` and one page that opens offline. Each result is
there twice: as published (eq. 16 as printed, the arms and the rules of the authors' code) and as corrected. Start at
`reproduction.reproduce_paper`; `docs/understand/paper.md` tells the story. The folder is called `paper` and the
function `reproduce_paper`, because a folder would hide a function of its name.
"""
