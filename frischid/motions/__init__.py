"""Motions to run on a robot: trajectories, their limits, and the criteria of good motions.

Comes in: a robot and its limits. Goes out: a planned motion, or the log of a simulated robot.
Start with `frischid.motions.plan`.
"""
