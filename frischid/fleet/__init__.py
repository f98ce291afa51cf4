"""Many equal robots: each alone, all together, and which one differs.

Comes in: the paths of many logs. Goes out: parameters of each robot and of all, and
which robots differ.
Start with `frischid.fleet.fleet`.
"""
