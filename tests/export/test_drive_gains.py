"""Drive gains: recovered where they are known, with bounds that hold, and the weight recovered from given ones."""

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import exact_log, random_values, robot
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.effects import BASELINE, Payload
from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.drive_gain_ls import total_least_squares
from frischid.export.drive_gain_problem import KnownPayload
from frischid.export.drive_gains import find_gains
from frischid.motions.simulation import Noise

DATA = os.environ.get("FRISCHID_DATA")
NAME = "ur10"
MASS, CENTRE = 5.0, np.array([0.05, 0.1, 0.03])
PAYLOAD = KnownPayload(MASS)
GAINS = np.array([12.0, 13.0, 9.0, 4.0, 5.0, 6.0])


def payload():
    """Parameters of a brick."""
    inertia = np.diag([0.02, 0.03, 0.025]) + MASS * (CENTRE @ CENTRE * np.eye(3) - np.outer(CENTRE, CENTRE))
    xx, xy, xz, yy, yz, zz = inertia[np.triu_indices(3)]
    return dict(zip(("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
                    (MASS, *(MASS * CENTRE), xx, xy, yy, xz, yz, zz), strict=True))  # fmt: skip


@cache
def logs(noise=0.02, seconds=30.0):
    machine = robot(NAME)
    values = random_values(machine, BASELINE)
    effect = Payload(full=True)
    carried = {f"d{k}6": x for k, x in payload().items() if f"d{k}6" in {c.name for c in effect.columns(machine)}}
    unloaded = exact_log(machine, BASELINE, values, seconds=seconds, noise=Noise(tau=noise))
    loaded = exact_log(machine, (*BASELINE, effect), values | carried, seconds=seconds, noise=Noise(tau=noise), seed=2)
    return tuple(replace(log, tau=None, current=log.tau / GAINS) for log in (unloaded, loaded))


def found(centre=None, **options):
    unloaded, loaded = logs()
    return find_gains(robot(NAME), [unloaded], [loaded], KnownPayload(MASS, centre), **options)


@pytest.mark.parametrize("centre", [None, CENTRE])
def test_gains_are_recovered_within_their_bounds(centre):
    result = found(centre=centre)
    assert result.channel == "current"
    assert (np.abs(result.gains - GAINS) < 4 * result.stderr).all()
    assert (result.stderr[1:] < 0.05 * GAINS[1:]).all()
    np.testing.assert_allclose(result.total_least_squares, GAINS, rtol=0.1)
    assert (np.abs(result.constrained - GAINS) < 4 * result.stderr).all()
    assert result.payload is None


def test_exact_logs_give_exact_gains():
    unloaded, loaded = logs(noise=1e-6, seconds=20.0)
    result = find_gains(robot(NAME), [unloaded], [loaded], PAYLOAD, cutoff=None)
    for gains in (result.gains, result.total_least_squares, result.constrained):
        np.testing.assert_allclose(gains, GAINS, rtol=1e-3)


def test_given_gains_weigh_the_payload():
    result = found(given=dict(zip(robot(NAME).joints, GAINS, strict=True)))
    assert abs(result.payload.mass - MASS) < 4 * result.payload.mass_stderr
    assert result.payload.mass == pytest.approx(MASS, rel=0.03)
    np.testing.assert_allclose(result.payload.centre, CENTRE, atol=0.02)


def test_a_mis_scaled_torque_channel_is_found():
    scaled = [replace(log, tau=log.current * GAINS * [1, 1, 0.8, 1, 1, 1], current=None) for log in logs()]
    result = find_gains(robot(NAME), scaled[:1], scaled[1:], PAYLOAD)
    assert result.channel == "tau"
    np.testing.assert_array_equal(result.given, 1.0)
    assert result.gains[2] == pytest.approx(1.25, rel=0.05)
    assert result.gains[1] == pytest.approx(1.0, rel=0.05)


def test_knowing_the_centre_helps():
    assert (found(centre=CENTRE).stderr < 1.05 * found().stderr).all()


KP = np.array([3000.0, 3000.0, 2000.0, 400.0, 400.0, 400.0])


def commands(late=0.0, velocities=False):
    """The logs as those of position servos: what they were commanded, and nothing of their torque."""
    kd, written = 0.02 * KP, []
    for log in logs():
        wanted = np.sin(np.outer(log.t, 1.0 + np.arange(6.0))) * velocities
        acts = log.q + (log.current * GAINS + kd * (log.v - wanted)) / KP
        keep = log.t <= log.t[-1] - late
        stamped = np.column_stack([np.interp(log.t + late, log.t, x) for x in acts.T])
        vcmd = wanted[keep] if velocities else None
        written.append(fr.Log(log.t[keep], log.joints, q=log.q[keep], v=log.v[keep], qcmd=stamped[keep], vcmd=vcmd))
    return written


@pytest.mark.parametrize("velocities", [False, True])
def test_a_weight_gives_the_kp_of_position_servos(velocities):
    unloaded, loaded = commands(velocities=velocities)
    result = find_gains(robot(NAME), [unloaded], [loaded], PAYLOAD, controller=fr.PDController())
    assert result.channel == "qcmd"
    assert (np.abs(result.gains - KP) < 4 * result.stderr).all()
    np.testing.assert_allclose(result.gains[1:], KP[1:], rtol=0.05)


def test_an_unknown_delay_of_commands_is_found_first():
    unloaded, loaded = commands(late=0.02)
    result = find_gains(robot(NAME), [unloaded], [loaded], PAYLOAD, controller=fr.PDController(delay=None))
    assert any("commands act 2" in note or "commands act 19" in note for note in result.notes)
    np.testing.assert_allclose(result.gains[1:], KP[1:], rtol=0.05)


def test_a_named_kp_weighs_the_payload():
    unloaded, loaded = commands()
    named = fr.PDController(dict(zip(robot(NAME).joints, KP, strict=True)))
    result = find_gains(robot(NAME), [unloaded], [loaded], PAYLOAD, controller=named)
    assert result.payload.mass == pytest.approx(MASS, rel=0.03)


def test_commands_that_give_no_kp():
    unloaded, loaded = commands()
    machine, pd = robot(NAME), fr.PDController()
    with pytest.raises(InputError, match="no commanded position qcmd_<joint> of shoulder_pan_joint"):
        find_gains(machine, [unloaded], [replace(logs()[1], current=None)], PAYLOAD, controller=pd)
    with pytest.raises(InputError, match="leave --effort-limit out"):
        find_gains(machine, [unloaded], [loaded], PAYLOAD, controller=fr.PDController(limit=100.0))
    pushed = replace(loaded, tauff=np.ones_like(loaded.q))
    with pytest.raises(InputError, match="without feed-forward"):
        find_gains(machine, [unloaded], [pushed], PAYLOAD, controller=pd)


def test_what_cannot_be():
    unloaded, loaded = logs()
    machine = robot(NAME)
    with pytest.raises(InputError, match="positive number of kg"):
        KnownPayload(0.0)
    with pytest.raises(InputError, match="gains are given for some joints only"):
        find_gains(machine, [unloaded], [loaded], PAYLOAD, given={"elbow_joint": 1.0})
    with pytest.raises(UnknownNameError, match="elbow"):
        find_gains(machine, [unloaded], [loaded], KnownPayload(MASS, carrier="elbow"))
    with pytest.raises(InputError, match="three finite numbers"):
        KnownPayload(MASS, centre=[0.0, 1.0])
    with pytest.raises(InputError, match="neither current_<joint> nor tau_<joint>"):
        find_gains(machine, [unloaded], [replace(loaded, current=None)], PAYLOAD)
    with pytest.raises(IdentifiabilityError, match="logs with and without the payload exchanged"):
        find_gains(machine, [loaded], [unloaded], PAYLOAD)
    with pytest.raises(IdentifiabilityError):  # nothing was loaded
        find_gains(machine, [unloaded], [], PAYLOAD)


def test_a_joint_that_never_moves_is_named():
    """Before, NumPy's IndexError ended the command."""
    machine = robot("planar2")
    resting = []
    for log in (exact_log(machine, BASELINE, random_values(machine, BASELINE), seed=k) for k in (1, 2)):
        q = log.q.copy()
        q[:, 1] = 0.3
        resting.append(fr.Log(log.t, log.joints, q, current=log.tau))
    with pytest.raises(IdentifiabilityError, match=r"joint2: at standstill.*--lock"):
        find_gains(machine, resting[:1], resting[1:], KnownPayload(2.0))


def test_a_payload_without_torque_fixes_nothing():
    M = np.zeros((1, 3, 3))
    M[0, 0, 0] = M[0, 2, 2] = 1.0
    with pytest.raises(IdentifiabilityError, match="causes no torque"):
        total_least_squares(M, np.array([10.0]))


def test_command(tmp_path):
    for log, name in zip(logs(), ("unloaded", "loaded"), strict=True):
        fr.write_log(log, tmp_path / f"{name}.parquet")
    table = "\n".join(f"{n} = {g}" for n, g in zip(robot(NAME).joints, GAINS, strict=True))
    (tmp_path / "map.toml").write_text(f"[current_gain]\n{table}\n")
    arguments = ["gains", NAME, "--unloaded", str(tmp_path / "unloaded.parquet"), "--loaded",
                 str(tmp_path / "loaded.parquet"), "--payload", str(MASS)]  # fmt: skip
    text = CliRunner().invoke(main, [*arguments, "--map", str(tmp_path / "map.toml")]).output
    assert "drive gains: torque per ampere" in text
    assert "with the given gains the payload would be" in text
    data = json.loads(CliRunner().invoke(main, [*arguments, "--json", "--com", "0.05", "0.1", "0.03"]).output)
    assert data["payload"] is None
    assert data["joints"][2]["gain"] == pytest.approx(9.0, rel=0.05)
    for log, name in zip(commands(), ("unloaded", "loaded"), strict=True):
        (tmp_path / f"{name}.parquet").unlink()
        fr.write_log(log, tmp_path / f"{name}.parquet")
    text = CliRunner().invoke(main, [*arguments, "--controller", "pd"]).output
    assert "kp, torque per position error" in text
    assert "to use these gains: frischid identify ROBOT LOGS --controller pd --kp shoulder_pan_joint=" in " ".join(
        text.split()
    )
    done = CliRunner().invoke(main, [*arguments[:-1], "-1"])
    assert done.exit_code == 2


@pytest.mark.skipif(DATA is None, reason="FRISCHID_DATA is not set")
def test_the_weight_of_a_real_payload_and_the_gains_it_gives():
    card = {"shoulder_pan_joint": 11.97, "shoulder_lift_joint": 11.98, "elbow_joint": 9.84, "wrist_1_joint": 10.75,
            "wrist_2_joint": 10.69, "wrist_3_joint": 10.68}  # fmt: skip
    folder = Path(DATA) / "ur10e"
    machine = fr.Robot.load(folder / "ur10e.urdf")
    names = ("unloaded_50s_14harm", "loaded_2805g_50s_14harm")
    unloaded, loaded = (
        fr.read_log(folder / f"logs/{n}.parquet", machine.joints, {"current_gain": card}) for n in names
    )
    result = find_gains(machine, [unloaded], [loaded], KnownPayload(2.805), given=card)
    assert result.payload.mass == pytest.approx(2.805, rel=0.03)
    expected = np.array(list(card.values()))
    assert (np.abs(result.gains - expected) < 4 * result.stderr).all()
    np.testing.assert_allclose(result.gains[1:], expected[1:], rtol=0.08)
