"""The body that a robot carries: mass, centre and inertia, with bounds that hold."""

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.logs.log import Log
from frischid.logs.readers import read_log, write_log
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.payload_identification import payload
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.inertia import is_physical, pseudo_inertia
from frischid.robot.robot import Robot

UR = Robot.load("ur5")
NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
BODY = dict(zip(NAMES, (2.0, 0.04, 0, 0.2, 0.04, 0, 0.04, -0.004, 0, 0.01), strict=True))
NOISE = Noise(q=1e-5, tau=0.01)


@cache
def bare():
    return identify(UR, [simulate(UR, random_fourier(UR, 15, seed=1), rate=100, noise=NOISE)], recursion="none").model


@cache
def loaded(factor=1.0):
    own = dict(zip(UR.all_names, UR.nominal, strict=True))
    values = {f"{n}6": own[f"{n}6"] + factor * x for n, x in BODY.items()}
    return simulate(UR, random_fourier(UR, 15, seed=2), rate=100, noise=NOISE, parameters=values)


@cache
def weighed(frame=None):
    return payload(bare(), [loaded()], frame=frame)


def test_the_body_is_weighed_with_bounds_that_hold():
    found = weighed("wrist_3_link")
    for value, truth, name in ((found.mass, 2.0, "mass"), *zip(found.centre, (0.02, 0.0, 0.1), "xyz", strict=True)):
        # bounds of 95 % are two standard errors; among four numbers one may be outside, none by as much again
        assert abs(value - truth) <= 2 * found.bound[name]
    assert found.bound["mass"] < 0.1
    assert found.error < 0.3 * found.error_without
    assert all(0 <= share <= 1 for share in found.from_log.values())


def test_a_body_on_another_link_is_not_weighed_at_the_flange_in_silence():
    """A pump of 4 kg on a link before the flange got 2.63 ± 0.09 kg, and no alarm said a word."""
    own = dict(zip(UR.all_names, UR.nominal, strict=True))
    values = {f"{n}4": own[f"{n}4"] + x for n, x in zip(NAMES[:4], (3.0, 0.0, 0.0, 0.2), strict=True)}
    log = simulate(UR, random_fourier(UR, 15, seed=2), rate=100, noise=NOISE, parameters=values)
    (alarm,) = (a for a in payload(bare(), [log]).alarms if a.id == "other-carrier")
    assert alarm.joints[0] == "wrist_1_joint"
    assert not payload(bare(), [log], carrier="wrist_1_joint").alarms
    assert not weighed().alarms


def test_the_frame_only_moves_the_numbers():
    here, there = weighed("wrist_3_link"), weighed()
    assert there.frame == "tool0"
    placement = next(f.placement for f in UR.model.frames if f.name == "tool0")
    np.testing.assert_allclose(placement.act(there.centre), here.centre, atol=1e-6)
    R = placement.rotation
    assert there.mass == pytest.approx(here.mass, rel=1e-3)
    np.testing.assert_allclose(R @ there.inertia @ R.T, here.inertia, atol=2e-3 * np.abs(here.inertia).max() + 1e-5)


def test_texts_to_enter():
    found = weighed()
    franka = json.loads(found.franka())
    assert franka["mass"] == pytest.approx(found.mass, rel=1e-3)
    assert len(franka["load_inertia"]) == 9
    assert found.ur().startswith(f"set_target_payload({franka['mass']}, [")
    assert f"Z {1e3 * franka['center_of_mass'][2]:.4g}" in found.kuka()
    P = np.concatenate([[found.mass], found.mass * found.centre, np.zeros(6)])
    assert pseudo_inertia(P).shape == (4, 4)
    assert np.linalg.eigvalsh(found.inertia)[0] > 0
    assert is_physical(UR.nominal[-10:])


@pytest.mark.parametrize("seed", range(3, 9))
def test_a_bare_robot_carries_no_body(seed):
    """Whatever sign the noise gives the mass: no controller gets a body that is not there."""
    with pytest.raises(IdentifiabilityError, match="no body"):
        payload(bare(), [simulate(UR, random_fourier(UR, 15, seed=seed), rate=100, noise=NOISE, seed=seed)])


def test_what_cannot_be_done_is_said():
    with pytest.raises(UnknownNameError, match="tool9"):
        payload(bare(), [loaded()], frame="tool9")
    with pytest.raises(InputError, match="no log"):
        payload(bare(), [])


def test_a_body_whose_mass_acts_on_no_joint_is_not_weighed():
    """Before, an arm with one joint carried "no body: less than 0.36 kg", a figure of the prior alone."""
    arm = Robot.load("planar2").keep(["joint1"])
    logs = [simulate(arm, random_fourier(arm, 8, seed=k), rate=100, noise=NOISE, seed=k) for k in (1, 2)]
    with pytest.raises(IdentifiabilityError, match="the mass of a body on the link of joint1 changes no torque"):
        payload(identify(arm, logs[:1], recursion="none").model, logs[1:])


def test_logs_of_which_some_are_without_the_body_are_refused():
    """Half of 2 kg, with a bound of a tenth of that, was the answer."""
    own = simulate(UR, random_fourier(UR, 15, seed=1), rate=100, noise=NOISE)
    assert bare().made_from(own)
    with pytest.raises(InputError, match=r"was fitted to simulated \(2\), and all logs .* same body; leave it out"):
        payload(bare(), [loaded(), own])


def test_a_log_that_is_given_twice_is_refused():
    """It had counted twice, so the bounds were those of twice as many samples."""
    again = simulate(UR, random_fourier(UR, 15, seed=1), rate=100, noise=NOISE)
    for call in (
        lambda: payload(bare(), [loaded(), loaded()]),
        lambda: identify(UR, [again, replace(again, source="copy")]),
    ):
        with pytest.raises(InputError, match="the same log is given twice"):
            call()


def test_a_log_that_no_body_explains_raises_an_alarm():
    """Torques that were 1.2 times too large had given 2.4 ± 0.02 kg for a body of 1.5 kg, and nothing was said."""
    assert weighed().alarms == ()
    scaled = payload(bare(), [replace(loaded(), tau=1.2 * loaded().tau, source="scaled")])
    assert abs(scaled.mass - 2.0) > 2 * scaled.bound["mass"]
    assert [(alarm.id, alarm.severity) for alarm in scaled.alarms] == [("unlike-the-fitted-logs", "severe")]
    turned = payload(bare(), [replace(loaded(), tau=loaded().tau * [1, 1, -1, 1, 1, 1], source="turned")])
    assert [alarm.id for alarm in turned.alarms] == ["faulty-log", "unlike-the-fitted-logs"]


def test_a_bare_robot_with_a_reversed_torque_carries_no_body_but_differs():
    log = simulate(UR, random_fourier(UR, 15, seed=3), rate=100, noise=NOISE)
    with pytest.raises(IdentifiabilityError, match=r"no body.*differ from the model in another way"):
        payload(bare(), [replace(log, tau=log.tau * [1, 1, -1, 1, 1, 1], source="turned")])


def test_the_command(tmp_path):
    bare().save(tmp_path / "model.json")
    write_log(loaded(), tmp_path / "log.parquet")
    files = [str(tmp_path / name) for name in ("model.json", "log.parquet", "tool.json")]
    result = CliRunner().invoke(main, ["payload", files[0], files[1], "-o", files[2]])
    assert result.exit_code == 0, result.output
    assert "set_target_payload" in result.output
    written = json.loads((tmp_path / "tool.json").read_text())
    assert written["mass"] == pytest.approx(2.0, abs=written["bound_95"]["mass"])


def test_ur10e_with_a_known_load():
    if not (folder := os.environ.get("FRISCHID_DATA")):
        pytest.skip("FRISCHID_DATA is not set")
    data = Path(folder) / "ur10e"
    robot = Robot.load(data / "ur10e.urdf")
    gains = dict(zip(robot.joints, [11.97, 11.98, 9.84, 10.75, 10.69, 10.68], strict=True))
    form = {"current_gain": gains}
    model = identify(
        robot, [read_log(data / "logs/ident_30s_12harm.parquet", robot.joints, form)], recursion="none"
    ).model
    found = payload(model, [read_log(data / "logs/loaded_2805g_50s_14harm.parquet", robot.joints, form)])
    assert abs(found.mass / 2.805 - 1) < 0.03
    assert abs(found.mass - 2.805) <= found.bound["mass"]


def test_a_body_of_which_four_numbers_act_is_judged_by_four():
    """On a planar arm, χ² of ten numbers had hidden 13 g ± 0.054/1.96 kg beside its centre and inertia."""
    arm = Robot.load("planar2")
    motions = [random_fourier(arm, 6.0, seed=seed) for seed in (1, 2)]
    model = identify(arm, [simulate(arm, motions[0], rate=100, noise=Noise(tau=0.02))], recursion="none").model
    own = dict(zip(arm.all_names, arm.nominal, strict=True))
    heavier = {name: own[name] + 0.013 * x for name, x in (("m2", 1.0), ("mx2", 0.5), ("Izz2", 0.25))}
    found = payload(model, [simulate(arm, motions[1], rate=100, parameters=heavier, noise=Noise(tau=0.02))])
    assert abs(found.mass - 0.013) < found.bound["mass"]


def test_numbers_that_the_log_does_not_determine_are_no_measurement():
    """On a planar arm, the height of the body acts on no joint; a command to enter 0 m was printed."""
    arm = Robot.load("planar2")
    logs = [
        simulate(arm, random_fourier(arm, 20.0, seed=seed), rate=100, noise=Noise(tau=0.02), parameters=values)
        for seed, values in ((1, {}), (2, _heavier(arm, 2.0)))
    ]
    found = payload(identify(arm, logs[:1], recursion="none").model, logs[1:])
    assert min(found.from_log[name] for name in ("mass", "x", "y", "Izz")) > 0.5
    (said,) = (note for note in found.notes if "no measurement" in note)
    assert said.startswith("the log hardly determines z, Ixx, Ixy, Iyy, Ixz and Iyz: these values are")


def _heavier(arm, mass):
    own = dict(zip(arm.all_names, arm.nominal, strict=True))
    return {name: own[name] + mass * x for name, x in (("m2", 1.0), ("mx2", 0.5), ("Izz2", 0.25))}


def test_a_joint_that_rests_is_no_joint_without_error():
    """Its error of zero had halved the mean of the error without the body."""
    arm, t = Robot.load("planar2"), np.arange(0, 6, 0.01)
    noise = np.random.default_rng(0).standard_normal((2, len(t), 2))

    def recorded(phase, mass=0.0):
        q, v, a = (np.stack([x, 0 * t], axis=1) for x in (np.sin(2 * t + phase), 2 * np.cos(2 * t + phase), 0 * t))
        a[:, 0] = -4 * q[:, 0]
        q[:, 1] = 0.5
        tau = arm.inverse_dynamics(q, v, a) * (1 + mass) + 0.05 * noise[0]
        return Log(t, arm.joints, q + 1e-6 * noise[1], tau=tau, source=f"{phase}")

    model = identify(arm, [recorded(0.0)], recursion="none").model
    log = recorded(1.0, 0.3)
    found = payload(model, [log])
    assert found.error_without == pytest.approx(compare(model, [log]).nrmse, rel=0.01)
