"""Forward dynamics: the motion that a model makes of a torque, and parameters from that motion.

Comes in: a model and a source of torque (a recorded torque, or a controller with its commands). Goes out: the simulated
motion, its distance from the measured motion, and parameters that make this distance small. Start with
`frischid.forward.forward_dynamics`; `frischid.forward.torque_sources` has the torques.
"""
