"""A URDF becomes a robot whose torques are linear in its inertial parameters.

Start with `frischid.robot.robot`: `Robot.load` reads the URDF and gives the rigid regressor.
"""
