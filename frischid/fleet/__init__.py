"""Many equal robots: each alone, all together, and which one differs.

Start with `frischid.fleet.fleet`.
"""
