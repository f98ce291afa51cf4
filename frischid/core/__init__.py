"""What every stage uses and no stage owns: types, files, text, work on several cores.

Nothing here knows robots or regressions.
"""
