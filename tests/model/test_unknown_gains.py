"""Logs in amperes whose gains nobody knows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import frischid as fr
from frischid.errors import InputError

GAINS = {"joint1": 12.0, "joint2": -4.0}
"""N·m/A; the second drive counts its current backwards."""
FRICTION = {"fv1": 5.0, "fv2": 3.0, "fc1": 8.0, "fc2": 4.0, "Ia1": 0.05, "Ia2": 0.03}


def amperes(seed: int = 1, *, keep: tuple[str, ...] = ()) -> fr.Log:
    """A log of currents; the joints of `keep` have their torque instead."""
    robot = fr.Robot.load("planar2")
    motion = fr.random_fourier(robot, 12.0, seed=seed)
    log = fr.simulate(robot, motion, rate=100.0, parameters=FRICTION, noise=fr.Noise(q=1e-5, tau=0.01), seed=seed)
    assert log.tau is not None
    torque = np.array([n in keep for n in robot.joints])
    current = np.where(torque, np.nan, log.tau / list(GAINS.values()))
    return replace(log, tau=np.where(torque, log.tau, np.nan), current=current, sha256=None)


@cache
def in_amperes() -> fr.Identification:
    """The identification of a log of currents with no gain known."""
    return fr.identify(fr.Robot.load("planar2"), [amperes()], recursion="none")


def test_gains_and_their_signs_come_from_the_masses() -> None:
    robot = fr.Robot.load("planar2")
    found = fr.identify(robot, [amperes()], valid=[amperes(2)], recursion="none")
    currents = found.model.currents
    assert currents is not None
    for joint, truth in GAINS.items():
        assert 0.01 < currents.doubt[joint] < 0.5
        assert abs(currents.gain[joint] / truth - 1) < 2 * currents.doubt[joint]
    assert found.comparison is not None
    assert found.comparison.nrmse < 0.02
    assert [alarm.id for alarm in found.alarms] == ["gains-from-masses"]
    assert any("ratios between the joints' torques" in note and "frischid gains" in note for note in found.notes)


def test_a_voltage_is_a_signal_like_a_current() -> None:
    """V = (τ + k_b q̇) / k: the gain is found in N·m/V, and viscous friction holds the back-EMF k_b."""
    robot = fr.Robot.load("planar2")
    back, gain = np.array([6.0, 2.5]), np.array([12.0, 5.0])
    log = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=1), rate=100.0, parameters=FRICTION)
    assert log.tau is not None
    assert log.v is not None
    volts = replace(log, tau=None, current=(log.tau + back * log.v) / gain, sha256=None)
    found = fr.identify(robot, [volts], recursion="none")
    assert found.amperes is not None
    for k, joint in enumerate(found.amperes):
        assert joint.viscous[0] == pytest.approx((FRICTION[f"fv{k + 1}"] + back[k]) / gain[k], rel=0.02)
    assert found.model.currents is not None
    assert found.model.currents.gain["joint1"] == pytest.approx(12.0, rel=0.36)


def test_friction_in_amperes_is_sharper_than_the_gains() -> None:
    found = in_amperes()
    assert found.model.currents is not None
    for k, (drawn, gain) in enumerate(zip(found.amperes, GAINS.values(), strict=True), start=1):
        for pair, name in ((drawn.viscous, "fv"), (drawn.coulomb, "fc")):
            assert pair is not None
            assert pair[0] == pytest.approx(FRICTION[f"{name}{k}"] / abs(gain), rel=0.03)
            assert pair[1] / pair[0] < 0.2 * found.model.currents.doubt[drawn.joint]
    rows = {(x.joint, x.quantity): x for x in fr.drive_parameters(found.model)}
    assert rows["joint2", "torque_per_ampere"].lower < -4.0 < rows["joint2", "torque_per_ampere"].upper
    assert rows["joint2", "coulomb"].known == "as a ratio"


def test_holding_current_is_that_of_gravity() -> None:
    robot, log = fr.Robot.load("planar2"), amperes()
    found = in_amperes()
    zero = np.zeros_like(log.q)
    true = robot.inverse_dynamics(log.q, zero, zero) / list(GAINS.values())
    for j, drawn in enumerate(found.amperes):
        low, high = drawn.holding
        reach = np.ptp(true[:, j])
        assert low == pytest.approx(true[:, j].min(), abs=0.1 * reach)
        assert high == pytest.approx(true[:, j].max(), abs=0.1 * reach)


def test_torques_beside_currents_are_a_scale() -> None:
    robot = fr.Robot.load("planar2")
    alone = in_amperes().model.currents
    beside = fr.identify(robot, [amperes(keep=("joint1",))], recursion="none").model.currents
    assert alone is not None
    assert beside is not None
    assert set(beside.gain) == {"joint2"}
    assert beside.doubt["joint2"] < alone.doubt["joint2"]


def test_a_joint_that_its_link_hardly_loads_is_named(tmp_path: Path) -> None:
    urdf = fr.Robot.load("planar2").urdf
    light = urdf.replace(urdf[urdf.rindex("<inertial>") : urdf.rindex("</inertial>")], _LIGHT)
    (tmp_path / "light.urdf").write_text(light, encoding="utf-8")
    robot = fr.Robot.load(tmp_path / "light.urdf")
    log = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=1), rate=100.0, parameters={"fc2": 2.0, "fc1": 2.0})
    assert log.tau is not None
    found = fr.identify(robot, [replace(log, tau=None, current=log.tau / 10.0)], recursion="none")
    currents = found.model.currents
    assert currents is not None
    assert currents.doubt["joint2"] == 1.0
    named = [note for note in found.notes if note.startswith("torque per ampere of ") and "is unknown" in note]
    assert len(named) == 1
    assert "joint2" in named[0].partition(" is unknown")[0]
    assert found.amperes[1].coulomb is not None
    assert found.amperes[1].coulomb[0] == pytest.approx(0.2, rel=0.1)


_LIGHT = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1e-4"/>'
    '<inertia ixx="1e-7" iyy="1e-7" izz="1e-7" ixy="0" ixz="0" iyz="0"/>'
)


def test_every_command_takes_the_model_and_its_logs(tmp_path: Path) -> None:
    robot, log, other = fr.Robot.load("planar2"), amperes(), amperes(2)
    fr.identify(robot, [log], recursion="none").model.save(tmp_path / "model.json")
    model = fr.Model.load(tmp_path / "model.json")
    assert fr.compare(model, [other]).nrmse < 0.02
    assert "gains-from-masses" in {alarm.id for alarm in fr.diagnose(model, [log]).headline.alarms}
    assert "gains-from-masses" in {alarm.id for alarm in fr.report(model, [other], tmp_path / "r.html").headline.alarms}


def test_given_gains_are_kept() -> None:
    given = fr.CurrentGains(GAINS)
    found = fr.identify(fr.Robot.load("planar2"), [amperes()], currents=given, recursion="none")
    assert found.model.currents == given
    assert found.alarms == ()


@pytest.mark.parametrize(
    ("gain", "doubt", "said"),
    [({"a": 0.0}, {}, "of a must be a number other than 0"), ({"a": 1.0}, {"a": -1.0}, "at least 0"),
     ({"a": 1.0}, {"b": 0.1}, "and no gain; give the gain too")],
)  # fmt: skip
def test_impossible_gains_are_refused(gain: dict[str, float], doubt: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        fr.CurrentGains(gain, doubt)


def test_effects_that_read_channels_or_remember_have_currents_too() -> None:
    robot, log = fr.Robot.load("planar2"), amperes()
    warm = {f"temperature_{n}": 25.0 + 0.1 * log.t for n in robot.joints}
    effects = fr.parse_effects("viscous, coulomb, offset, torque_drift(by=temperature), elasticity")
    plain = fr.parse_effects("viscous, coulomb, offset")
    found, usual = (
        fr.identify(robot, [replace(log, extra=warm)], effects=some, recursion="none") for some in (effects, plain)
    )
    for one, other in zip(found.amperes, usual.amperes, strict=True):
        assert one.holding == pytest.approx(other.holding, rel=0.05)
