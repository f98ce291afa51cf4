"""Motions to run on a robot: trajectories, the limits they keep, and how exciting they are.

Comes in: a robot and its limits. Goes out: a planned motion, or the log of a simulated robot.
Start with `frischid.motions.plan`.
"""
