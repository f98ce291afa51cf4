"""A robot read from MJCF moves and is limited as MuJoCo has it."""

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.errors import InputError
from frischid.logs.readers import write_log
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.mjcf_reading import unread_forces
from frischid.robot.robot import Robot

MJCF = """<mujoco model="arm"><compiler angle="degree"/><option gravity="0 1 -9"/><worldbody>
<body name="a" pos="0 0 1" euler="10 20 30"><inertial pos="0.1 0 0" mass="2" diaginertia="0.1 0.2 0.15"/>
<joint name="turn" axis="0 1 1" pos="0.05 0.02 0" {turn} range="-0.9 0.8"/>
<body name="b" pos="0.4 0 0"><inertial pos="0 0.1 0.1" mass="1" fullinertia="0.1 0.1 0.1 0.01 0.02 0.03"/>
<joint name="slide" type="slide" axis="1 0 1" {slide} range="-0.3 0.4"/>
</body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("angle", ["degree", "radian"])
@pytest.mark.parametrize(("turn", "slide"), [("", ""), ('ref="-0.2"', 'ref="0.1"')])
def test_positions_and_limits_are_those_of_mujoco(turn, slide, angle, tmp_path):
    """Limits of a joint with `ref` had been counted from there, and a slide's limits had been taken for degrees."""
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.format(turn=turn, slide=slide).replace("degree", angle), encoding="utf-8")
    arm, model = Robot.load(path), mujoco.MjModel.from_xml_path(str(path))
    np.testing.assert_allclose([arm.limits.lower, arm.limits.upper], model.jnt_range.T)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    data, (q, v, a) = mujoco.MjData(model), np.random.default_rng(0).uniform(-0.3, 0.3, (3, 5, 2))
    expected = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, v, a, strict=True):
        mujoco.mj_inverse(model, data)
        expected.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(arm.inverse_dynamics(q, v, a), expected, atol=1e-9)


def test_a_second_robot_in_the_world_is_not_lost_silently(tmp_path):
    """Pinocchio reads the first body of the world only; the other arm had been left out without a word."""
    path = tmp_path / "two.xml"
    arm = '<body name="{0}"><joint name="{0} turn" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/></body>'
    both = "".join(map(arm.format, ("left", "right")))
    path.write_text(f"<mujoco><worldbody>{both}</worldbody></mujoco>", encoding="utf-8")
    with pytest.raises(InputError, match="does not read the joints right turn"):
        Robot.load(path)
    path.write_text(f'<mujoco><worldbody><body name="table">{both}</body></worldbody></mujoco>', encoding="utf-8")
    assert set(Robot.load(path).joints) == {"left turn", "right turn"}


@pytest.mark.parametrize("setting", ["settotalmass", "inertiagrouprange"])
def test_masses_that_pinocchio_would_read_otherwise_are_refused(setting, tmp_path):
    """The torque of an arm had been that of shapes that do not count."""
    path, value = tmp_path / "arm.xml", {"settotalmass": "7", "inertiagrouprange": "0 1"}[setting]
    body = '<body name="a"><joint name="turn" axis="0 1 0"/>{}<geom size="0.1" pos="0.1 0 0" group="3"/></body>'
    text = f'<mujoco><compiler {setting}="{value}"/><worldbody>{body}</worldbody></mujoco>'
    path.write_text(text.format('<geom size="0.1" group="0"/>'), encoding="utf-8")
    with pytest.raises(InputError, match=f"does not read {setting}"):
        Robot.load(path)
    inertial = '<inertial pos="0.1 0 0" mass="2" diaginertia="0.1 0.2 0.15"/>'
    path.write_text(text.format(inertial), encoding="utf-8")
    if setting == "inertiagrouprange":  # inertials that are stated stay
        assert Robot.load(path).nominal[0] == 2.0


UNREAD = {
    "none": ("", "", ()),
    "springs": ('<joint stiffness="3"/>', "", ("springs of joints",)),
    "springs by time": ('<joint springdamper="0.1 1"/>', "", ("springs of joints",)),
    "no spring": ('<joint stiffness="0 0.0"/>', "", ()),
    "all": (
        '<joint stiffness="3"/>',
        '<equality><joint joint1="turn" polycoef="0.1 0 0 0 0"/></equality>',
        ("springs of joints", "gravity compensation", "equality constraints"),
    ),
}


@pytest.mark.parametrize("case", UNREAD)
def test_forces_that_a_urdf_cannot_state_are_told(case, tmp_path):
    """They had been ignored without a word, and the diagnosis found them missing in a model of the same file."""
    default, after, expected = UNREAD[case]
    path, log = tmp_path / "arm.xml", tmp_path / "log.csv"
    text = MJCF.format(turn="", slide="").replace("<worldbody>", f"<default>{default}</default><worldbody>")
    if case == "all":
        text = text.replace('name="b"', 'name="b" gravcomp="1"')
    path.write_text(text.replace("</worldbody>", f"</worldbody>{after}"), encoding="utf-8")
    arm = Robot.load(path)
    assert set(unread_forces(arm.urdf)) == set(expected)
    write_log(simulate(arm, random_fourier(arm, 5, seed=1), rate=50, noise=Noise(tau=0.05)), log)
    for words in (["info", str(path)], ["identify", str(path), str(log), "--json"]):
        told = CliRunner().invoke(main, words).output
        assert all(force in told for force in expected)
        assert ("not read" in told) == bool(expected)
