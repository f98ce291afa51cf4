"""Edits of a URDF's text."""

import numpy as np
from cases import joint, link, made, urdf

from frischid.robot.urdf_edit import UrdfText


def test_a_zero_is_moved_at_a_pitch_of_a_quarter_turn():
    """Two of the three angles turn about one axis there. scipy's warning of it had gone to the user."""
    limit = '<limit lower="-2" upper="2" velocity="3" effort="50"/>'
    text = urdf(
        link("base"),
        link("arm", 2.0),
        joint("turn", "base", "arm", rpy="0.3 1.5707963267948966 0", axis="1 0 0", inside=limit),
    )
    moved = UrdfText(text).with_joints({"turn": (1.0, 0.4)}, {})
    q, none = np.linspace(-1, 1, 5)[:, None], np.zeros((5, 1))
    for base in ((0.0, 0.0, -9.81), (9.81, 0.0, 0.0), (0.0, 9.81, 0.0)):
        expected = made(text, gravity=base).inverse_dynamics(q + 0.4, none, none)
        np.testing.assert_allclose(made(moved, gravity=base).inverse_dynamics(q, none, none), expected, atol=1e-9)
