"""From a URDF to a robot whose torques are linear in its inertial parameters.

Comes in: the text of a URDF. Goes out: a `Robot`, which computes the rigid regressor of any motion.
Start with `frischid.robot.robot`, which uses `urdf_reading`, `mimics`, `joint_limits` and `pinocchio_model`.
"""
