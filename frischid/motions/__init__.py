"""Motions to run on a robot: trajectories, what they may do, and how much they tell.

Comes in: a robot and its limits. Goes out: a planned motion or a simulated log. Start with `frischid.motions.plan`.
"""
