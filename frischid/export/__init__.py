"""A model for other programs: physical links, URDF, MJCF, code for a control loop; and drive gains.

Comes in: a model. Goes out: files that were compared with the model before they appear.
Start with `frischid.export.export`.
"""
