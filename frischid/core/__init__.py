"""Tools that every stage uses: types, files, text, arrays on disk, work on several cores.

No data pass through this folder, and nothing here depends on robots or regressions. Start with `frischid.core.types`.
"""
