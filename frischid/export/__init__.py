"""A model taken home: URDF, MJCF, code, physical links, drive gains.

Start with `frischid.export.urdf`.
"""
