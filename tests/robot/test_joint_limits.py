"""Ranges of joints that are far from zero, or that are placeholders."""

import numpy as np
import pytest

import frischid as fr
from frischid.motions.collision import Clearance
from frischid.motions.limits import MotionLimits
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" '
    'ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><sphere radius="0.01"/></geometry></collision></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="{4}" upper="{5}" velocity="1" effort="100"/></joint>'
)


@pytest.fixture
def robot(tmp_path):
    """A robot whose first joint has a given type and range; two more follow, so that bodies can meet."""

    def made(kind, lower, upper):
        joints = [JOINT.format("first", kind, "base", "one", lower, upper)]
        joints += [JOINT.format("second", "revolute", "one", "two", -1, 1)]
        joints += [JOINT.format("third", "revolute", "two", "three", -1, 1)]
        links = '<link name="base"/>' + "".join(LINK.format(name) for name in ("one", "two", "three"))
        path = tmp_path / "far.urdf"
        path.write_text(f'<robot name="far">{links}{"".join(joints)}</robot>', encoding="utf-8")
        return fr.Robot.load(path)

    return made


@pytest.mark.parametrize(
    ("kind", "lower", "upper"), [("revolute", 4.0, 5.0), ("revolute", -9.0, -4.0), ("prismatic", 5.0, 8.0)]
)
def test_a_range_far_from_zero_is_kept(robot, kind, lower, upper):
    far = robot(kind, lower, upper)
    structure(Regressor(far, fr.BASELINE), far.joints)
    assert Clearance.of(far).names
    low, high = far.limits.within(np.pi)
    motion = fr.random_fourier(far, 5.0, seed=0)(np.linspace(0.0, 5.0, 500))[0][:, 0]
    planned = MotionLimits.of(far, 1.0)
    for some in ((low[0], high[0]), (motion.min(), motion.max()), (planned.lower[0], planned.upper[0])):
        assert lower <= some[0] < some[1] <= upper


@pytest.mark.parametrize(("lower", "upper", "planned"), [(-1e16, 1e16, (-0.5, 0.5)), (-0.2, 1e9, (-0.2, 0.5))])
def test_a_placeholder_is_no_range(robot, lower, upper, planned):
    slide = robot("prismatic", lower, upper)
    limits = MotionLimits.of(slide, 1.0)
    assert (limits.lower[0], limits.upper[0]) == pytest.approx(planned)
