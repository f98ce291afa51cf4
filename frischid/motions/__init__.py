"""Motions to run on a robot: trajectories, what a robot may do, and how much a motion tells.

Comes in: a robot and its limits. Goes out: a planned motion, or the log of a simulated robot.
Start with `frischid.motions.plan`.
"""
