"""Tools that every stage uses and no stage owns: types, files, text, arrays on disk, work on several cores.

Nothing comes in and nothing goes out: these are tools. Nothing here knows robots or regressions. Start with
`frischid.core.types`.
"""
