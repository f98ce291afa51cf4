"""A URDF becomes a robot whose torques are linear in its inertial parameters.

Comes in: the text of a URDF. Goes out: a `Robot`, which gives the rigid regressor of any motion.
Start with `frischid.robot.robot`; `urdf_reading`, `mimics`, `joint_limits` and `pinocchio_model` are the parts it is
made of.
"""
