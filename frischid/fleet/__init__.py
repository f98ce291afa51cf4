"""Many equal robots: parameters of each robot and of all together, and the robots that differ.

Comes in: the paths of many logs. Goes out: parameters of each robot and of all, and the robots that differ.
Start with `frischid.fleet.fleet`: `jobs` run where the logs are, `shared_job` and `shared_fit` serve all robots, and
`deviation` finds those that differ.
"""
