"""Many equal robots: parameters of each robot and of all together, and the robots that differ.

Comes in: the paths of many logs. Goes out: parameters of each robot and of all, and the robots that differ.
Start with `frischid.fleet.fleet`.
"""
