"""A model taken home: physical links, URDF, MJCF, code for a control loop, drive gains.

Comes in: a model. Goes out: files that were checked against the model before they appear.
Start with `frischid.export.urdf`.
"""
