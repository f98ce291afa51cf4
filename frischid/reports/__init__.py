"""The report: one HTML file that can be sent to a colleague and opens offline.

Comes in: a model and logs. `study.study` computes the whole content once, and `page.report` writes the file. The
chapters arrange numbers and compute none. Start reading at `page.report`. The folder has a plural name because
`frischid.report` is the function; a folder of the same name would hide the function.
"""
