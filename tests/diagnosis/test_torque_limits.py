"""A torque at its limit is neither a contact nor an effect: the stretches are named and left out."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import frischid as fr
from frischid.diagnosis.change_prior import weak_urdf_prior
from frischid.diagnosis.clause import missing
from frischid.diagnosis.cross_validation import CrossValidator

ARM = fr.Robot.load("planar2")
SIZES = {"fv1": 0.8, "fv2": 0.4, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.2, "Ia2": 0.1}
NOISE = np.array([0.1, 0.03])  # N·m


@cache
def recorded(kind: str, share: float = 0.8) -> fr.Log:
    """A log of an arm whose first torque has a limit, as a share of the largest torque of the motion."""
    motion = fr.random_fourier(ARM, 20.0, seed=4)
    log = fr.simulate(ARM, motion, rate=100.0, effects=fr.BASELINE, parameters=SIZES, channels=())
    limit = share * np.abs(log.tau[:, 0]).max()
    rng = np.random.default_rng(2)
    if kind == "command":
        log = _with_weak_drive(log, limit)
    tau = np.array(log.tau)
    if kind == "sensor":
        tau[:, 0] = np.clip(tau[:, 0], -limit, limit)
    noisy = tau + NOISE * rng.normal(size=tau.shape)
    return replace(log, q=log.q + 1e-6 * rng.normal(size=log.q.shape), tau=noisy, source=kind)


def _with_weak_drive(log: fr.Log, limit: float, substeps: int = 20) -> fr.Log:
    """The motion under a controller whose first drive gives less than commanded; the log holds the commands."""
    model, data = ARM.model.copy(), ARM.model.createData()
    model.armature = np.array([SIZES["Ia1"], SIZES["Ia2"]])
    viscous, dry = (np.array([SIZES[f"{f}1"], SIZES[f"{f}2"]]) for f in ("fv", "fc"))
    step = float(log.t[1] - log.t[0]) / substeps
    fine = np.arange(len(log.t) * substeps) * step + log.t[0]
    goal = np.stack([np.interp(fine, log.t, x) for x in log.q.T], axis=1)
    speed = np.gradient(goal, step, axis=0)
    wanted = np.stack([np.interp(fine, log.t, x) for x in log.tau.T], axis=1)
    q, v, positions, commands = log.q[0].copy(), speed[0].copy(), [], []
    for k in range(len(fine)):
        command = wanted[k] + 400.0 * (goal[k] - q) + 40.0 * (speed[k] - v)
        if k % substeps == 0:
            positions.append(q.copy())
            commands.append(command)
        given = np.clip(command, [-limit, -np.inf], [limit, np.inf])
        v = v + step * pin.aba(model, data, q, v, given - viscous * v - dry * np.tanh(v / 0.01))
        q = q + step * v
    return replace(log, q=np.array(positions), tau=np.array(commands), v=None, a=None)


def diagnosed(log: fr.Log) -> fr.Diagnosis:
    return fr.diagnose(fr.identify(ARM, [log], recursion="none").model, [log])


@pytest.mark.parametrize("kind", ["sensor", "command"])
def test_a_torque_at_its_limit_is_named_and_left_out(kind):
    """It had been a contact (98 %), a drive gain (90 %) or a delay."""
    log = replace(recorded(kind), t=recorded(kind).t + 1000.0)
    found = diagnosed(log)
    (limit,) = found.limits
    assert (limit.joint, limit.commanded) == ("joint1", kind == "command")
    truth = 0.8 * np.abs(recorded("none").tau[:, 0]).max()
    assert limit.limit == pytest.approx(truth, rel=0.05)
    assert found.verdict == "none"
    assert found.contacts == ()
    assert max(found.probabilities, key=lambda name: found.probabilities[name]) == "none"
    assert found.remainder.startswith("the torque of joint1 is at its limit for a while; in the rest of the logs, no")
    assert any("the model was fitted with torques at their limit" in note for note in found.notes)
    assert str(limit) in found.notes
    told = [float(x) for x in re.findall(r"from ([\d.]+) to", str(limit))]  # from the first sample, as `frischid cut`
    assert told == pytest.approx([start - 1000.0 for _, start, _ in limit.stretches[: len(told)]], abs=0.01)
    assert found.to_dict()["limits"][0]["stretches"][0]["source"] == kind
    assert found.left_out("joint1") == {"torque at its limit": list(limit.stretches)}
    assert found.left_out("joint2") == {}
    said = missing(replace(found, verdict="unknown"))
    assert said.endswith("; the torque of joint1 is at its limit for a while (left out of the search)")


def test_a_healthy_arm_has_no_limit():
    assert diagnosed(recorded("none")).limits == ()


def test_a_push_is_no_limit():
    """It turns both joints, and the torque below the limit too."""
    log = recorded("none")
    tau = np.array(log.tau)
    top = log.t[np.argmax(np.abs(tau[:, 0]))]
    tau[np.abs(log.t - top) < 0.4] += [15.0, 6.0]
    found = diagnosed(replace(log, tau=tau, source="pushed"))
    assert found.limits == ()
    assert found.verdict == "contact"


@pytest.mark.parametrize(("seed", "mass", "dropped"), [(5, 4.0, 8.0), (6, 2.0, 12.0), (6, 8.0, 12.0)])
def test_a_load_that_is_dropped_during_the_log_is_no_limit(seed, mass, dropped):
    """A drive that gives no more was named, with a limit that the torque passed with the load and not without it."""
    usual = dict(zip(ARM.all_names, ARM.nominal, strict=True))
    body = {"m2": mass, "mx2": 0.9 * mass, "Izz2": 0.81 * mass}
    motion = fr.random_fourier(ARM, 24.0, seed=seed)
    loaded, bare = (
        fr.simulate(ARM, motion, rate=100.0, effects=fr.BASELINE, parameters=SIZES | links, channels=())
        for links in ({name: usual[name] + x for name, x in body.items()}, {})
    )
    rng = np.random.default_rng(2)
    tau = np.where(loaded.t[:, None] < dropped, loaded.tau, bare.tau) + NOISE * rng.normal(size=loaded.tau.shape)
    q = loaded.q + 1e-6 * rng.normal(size=loaded.q.shape)
    assert not diagnosed(replace(loaded, q=q, tau=tau, source="dropped")).limits


@pytest.mark.parametrize(
    ("effect", "value"), [("joint_spring@joint1", {"ks1": 8.0}), ("drive_gain@joint1", {"gain1": 0.2})]
)
def test_an_effect_of_the_catalogue_that_grows_with_the_torque_is_no_limit(effect, value):
    motion = fr.random_fourier(ARM, 20.0, seed=4)
    hidden = (*fr.BASELINE, *fr.parse_effects(effect))
    log = fr.simulate(
        ARM, motion, rate=100.0, effects=hidden, parameters=SIZES | value, noise=fr.Noise(q=1e-6, tau=0.05), channels=()
    )
    assert diagnosed(log).limits == ()


def clipped(effects: str, values: dict[str, float], levels: dict[int, float]) -> fr.Log:
    """A log with a hidden effect, of sensors with limits: a quantile of each joint's torque."""
    motion, hidden = fr.random_fourier(ARM, 20.0, seed=4), fr.parse_effects(effects) if effects else ()
    log = fr.simulate(ARM, motion, rate=100.0, effects=(*fr.BASELINE, *hidden), parameters=SIZES | values, channels=())
    tau, rng = np.array(log.tau), np.random.default_rng(2)
    for joint, level in levels.items():
        most = np.quantile(np.abs(tau[:, joint]), level)
        tau[:, joint] = np.clip(tau[:, joint], -most, most)
    noisy = tau + NOISE * rng.normal(size=tau.shape)
    return replace(log, q=log.q + 1e-6 * rng.normal(size=log.q.shape), tau=noisy, source="clipped")


def test_two_joints_at_their_limits_are_both_named():
    found = diagnosed(clipped("", {}, {0: 0.9, 1: 0.9}))
    assert [limit.joint for limit in found.limits] == ["joint1", "joint2"]
    assert found.remainder.startswith("the torques of joint1 and joint2 are at their limits for a while; in the rest")
    assert (found.verdict, found.contacts) == ("none", ())


def test_an_effect_on_another_joint_hides_no_limit():
    found = diagnosed(clipped("joint_spring@joint2", {"ks2": 3.0}, {0: 0.9}))
    assert [limit.joint for limit in found.limits] == ["joint1"]
    assert (found.verdict, found.findings[0].effect) == ("effect", "joint_spring")


def test_stretches_without_which_a_joint_never_moves_are_not_left_out():
    """A fit without them had ended the command."""
    log = recorded("none")
    moving = (log.t > 6.0) & (log.t < 12.0)
    q = np.array(log.q)
    q[:, 1] = np.interp(log.t, log.t[moving], q[moving, 1])  # elsewhere joint2 rests
    rested = replace(log, q=q, source="rested")
    model = fr.identify(ARM, [rested], recursion="none").model
    validator = CrossValidator.of(model, [rested], weak_urdf_prior(model))
    assert validator.may_leave_out([("rested", 4.0, 9.0)])
    assert not validator.may_leave_out([("rested", 4.0, 13.0)]), "less than half of the log, but all that joint2 moves"
    assert not validator.may_leave_out([("rested", 0.0, 6.0), ("rested", 14.0, 19.0)]), "more than half of the log"
