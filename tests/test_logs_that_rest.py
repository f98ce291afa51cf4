"""Logs in which joints rest, through check, identify, compare and diagnose: what each kind can and cannot say."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import robot

import frischid as fr
from frischid.errors import InputError
from frischid.logs.poses import is_static, poses_of
from frischid.model.log_quality import quality

ARM = robot("planar2")
COULOMB, VISCOUS = np.array([0.4, 0.2]), np.array([0.6, 0.3])
RATE, HOME, POSE = 100.0, np.array([0.4, -0.7]), 100


def recorded(t, q, hold, rng, source, more=0.0):
    """A log of an arm whose dry friction holds a joint at rest with the share `hold` of its size."""
    v = np.gradient(q, 1 / RATE, axis=0)
    a = np.gradient(v, 1 / RATE, axis=0)
    friction = VISCOUS * v + COULOMB * np.where(np.abs(v) > 1e-4, np.sign(v), hold)
    tau = ARM.inverse_dynamics(q, v, a) + friction + more
    noise = rng.standard_normal((2, *q.shape))
    return fr.Log(t, ARM.joints, q + 1e-5 * noise[0], tau=tau + 0.02 * noise[1], source=source)


def jointwise(seed=0, seconds=10.0):
    """One joint after another moves, the other rests."""
    rng = np.random.default_rng(seed)
    s = np.arange(int(seconds * RATE)) / RATE
    ramp = np.clip(np.minimum(s, seconds - s), 0, 1)
    ramp = 10 * ramp**3 - 15 * ramp**4 + 6 * ramp**5
    q = np.tile(HOME, (2 * len(s), 1))
    for j, part in enumerate((q[: len(s)], q[len(s) :])):
        waves = [rng.uniform(0.2, 0.5) * np.sin(2 * np.pi * f * s + rng.uniform(0, 6)) for f in (0.23, 0.57, 0.91)]
        part[:, j] += ramp * sum(waves)
    hold = np.repeat(rng.uniform(-1, 1, (2, 2)), len(s), axis=0)
    return recorded(np.arange(len(q)) / RATE, q, hold, rng, "jointwise")


def static(seed=0, count=12, reach=1.5):
    """Poses, one second each; the ways between them are not recorded."""
    rng = np.random.default_rng(seed)
    logs = []
    for k in range(count):
        q = np.tile(HOME + rng.uniform(-reach, reach, 2), (POSE, 1))
        logs.append(recorded(11.0 * k + np.arange(POSE) / RATE, q, rng.uniform(-1, 1, 2), rng, "static"))
    columns = {name: np.concatenate([getattr(log, name) for log in logs]) for name in ("t", "q", "tau")}
    return fr.Log(columns["t"], ARM.joints, columns["q"], tau=columns["tau"], source="static")


def pushed(seed=0, torque=2.0):
    """An arm that stands still for 10 s; somebody leans on it at 5 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(1000) / RATE
    push = torque * np.exp(-0.5 * ((t - 5) / 0.4) ** 2)[:, None] * np.array([1.0, 0.5])
    return recorded(t, np.tile(HOME, (len(t), 1)), rng.uniform(-0.5, 0.5, 2), rng, "push", push)


@cache
def of_motion():
    return fr.identify(ARM, [jointwise(1)])


@cache
def of_poses():
    return fr.identify(ARM, [static(1)])


def write_csv(path, columns):
    np.savetxt(path, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
    return path


def rows(log, kept, factor=1.0):
    return fr.Log(log.t[kept], log.joints, log.q[kept], tau=factor * log.tau[kept], source=f"{log.source} {kept}")


def kinds(log):
    return [issue.kind for issue in fr.check(ARM, [log])[0].issues]


# ---- jointwise: every joint has its own motion


def test_jointwise_logs_are_checked_and_fitted():
    assert kinds(jointwise()) == []
    found = of_motion()
    assert found.warnings == ()
    friction = found.model.parameters
    for j in range(2):
        assert friction[f"fc{j + 1}"].value == pytest.approx(COULOMB[j], rel=0.1)
        assert friction[f"fv{j + 1}"].value == pytest.approx(VISCOUS[j], rel=0.1)


def test_jointwise_logs_are_cross_validated_joint_by_joint():
    # Left out as one stretch of time, all rows of a joint would be missing, and its friction unknown.
    assert max(of_motion().cross_validation.values()) < 0.01


def test_jointwise_logs_are_compared_and_diagnosed():
    model, log = of_motion().model, jointwise(5)
    comparison = fr.compare(model, [log])
    assert comparison.nrmse < 0.01
    assert comparison.alarms == ()
    assert comparison.not_compared == ()
    assert fr.diagnose(model, [log]).verdict == "none"


def test_one_log_a_joint_is_diagnosed_too():
    model, log = of_motion().model, jointwise(6)
    halves = [rows(log, slice(0, 1000)), rows(log, slice(1000, 2000))]
    assert fr.diagnose(model, halves).verdict == "none"


# ---- static poses: gravity, and dry friction as an interval


def test_poses_are_one_sample_each():
    log = static()
    poses = poses_of(log)
    assert is_static(log)
    assert len(poses.t) == 12
    np.testing.assert_allclose(poses.q, log.q[POSE // 2 :: POSE], atol=1e-4)
    assert not is_static(jointwise())


def test_static_logs_are_checked():
    (report,) = fr.check(ARM, [static()])
    (issue,) = report.issues
    assert report.facts["poses"] == 12
    assert issue.kind == "standstill"
    assert not issue.blocks
    assert "gravity can be fitted (identify) and compared (compare); inertia and friction cannot" in str(issue)


def test_static_logs_give_gravity_and_say_what_they_do_not():
    found = of_poses()
    q = np.random.default_rng(9).uniform(-1.5, 1.5, (50, 2))
    gravity = ARM.inverse_dynamics(q, 0 * q, 0 * q)
    error = found.model.predict(q, 0 * q, 0 * q)[0] - gravity
    assert (np.sqrt((error**2).mean(axis=0)) < COULOMB).all()  # the friction that held is below the break-away
    assert any("Inertia and viscous friction are not fitted" in note for note in found.notes)


def test_static_logs_are_compared_up_to_the_dry_friction():
    near = static(5, reach=0.4)  # where the model's own log was
    comparison = fr.compare(of_motion().model, [near])
    assert comparison.poses == comparison.samples == 12
    # Friction held with up to its own size: no alarm, and a floor that says so.
    assert comparison.alarms == ()
    held = COULOMB / np.sqrt(3)
    for joint, torque in zip(comparison.joints, held, strict=True):
        assert joint.noise_floor * joint.std == pytest.approx(torque, rel=0.5)
    heavy = fr.compare(of_motion().model, [rows(near, slice(None), 1.2)])
    assert "unlike-the-fitted-logs" in [alarm.id for alarm in heavy.alarms]


def test_the_quality_of_a_static_log_is_that_of_its_poses():
    model = fr.identify(ARM, [jointwise()], recursion="none").model
    (found,) = quality(model, [static()])
    assert found.kept == pytest.approx(12 * (POSE - 1) / RATE)


def test_static_logs_show_no_effect():
    result = fr.diagnose(of_motion().model, [static(5)])
    assert result.verdict == "none"
    assert result.contacts == ()
    assert result.fit is None
    assert any("at standstill no effect can be found" in note for note in result.notes)
    with pytest.raises(InputError, match="at standstill no effect can be found"):
        fr.improve(of_motion().model, [static(5)])


def test_too_few_poses_are_refused_with_what_to_record():
    with pytest.raises(InputError, match="at 3 poses: gravity needs at least 5 different poses"):
        fr.identify(ARM, [static(count=3)])


# ---- a file whose time starts anew for each pose


def test_time_that_starts_anew_is_continued(tmp_path):
    log = static()
    columns = {"t": np.tile(np.arange(POSE) / RATE, 12)}
    columns |= {f"q_{n}": log.q[:, j] for j, n in enumerate(log.joints)}
    columns |= {f"tau_{n}": log.tau[:, j] for j, n in enumerate(log.joints)}
    read = fr.read_log(write_csv(tmp_path / "poses.csv", columns))
    assert any("t starts anew 11 times" in note for note in read.notes)
    assert len(poses_of(read).t) == 12
    np.testing.assert_allclose(
        fr.identify(ARM, [read]).model.estimate.theta, fr.identify(ARM, [log]).model.estimate.theta, rtol=1e-6
    )


def test_a_step_back_that_is_no_start_stays_an_error(tmp_path):
    t = np.arange(2 * POSE) / RATE
    t[POSE:] -= 0.5  # falls back to the middle of the first part
    columns = {"t": t} | {f"q_{n}": np.sin(t) for n in ARM.joints} | {f"tau_{n}": np.cos(t) for n in ARM.joints}
    with pytest.raises(InputError, match="time does not increase"):
        fr.read_log(write_csv(tmp_path / "log.csv", columns))


# ---- a push against a still arm


def test_a_push_against_a_still_arm_is_a_contact():
    (report,) = fr.check(ARM, [pushed()])
    assert [issue.kind for issue in report.issues] == ["standstill", "contact"]
    result = fr.diagnose(of_motion().model, [pushed()])
    assert result.verdict == "contact"
    (contact,) = result.contacts
    assert contact.start < 5 < contact.stop
    assert contact.joints == list(ARM.joints)
    assert contact.start == pytest.approx(5, abs=1.5)
    assert contact.stop == pytest.approx(5, abs=1.5)


def test_times_of_a_push_count_from_the_first_sample_as_those_of_cut_do():
    """The stamps of a ROS bag count from 1970, and `frischid cut` counts from the first sample."""
    log = pushed()
    later = replace(log, t=log.t + 1.7e9)
    (report,) = fr.check(ARM, [later])
    said = report.issues[1].what
    (contact,) = fr.diagnose(of_motion().model, [later]).contacts
    for start, stop in (re.search(r"from ([\d.]+) to ([\d.]+) s", x).groups() for x in (said, contact.when)):
        assert float(start) == pytest.approx(5, abs=1.5)
        assert float(stop) == pytest.approx(5, abs=1.5)
    assert contact.start - contact.log_start == pytest.approx(float(start), abs=0.01)


def test_a_still_arm_without_a_push_is_no_contact():
    assert kinds(pushed(torque=0.0)) == ["standstill"]
    assert fr.diagnose(of_motion().model, [pushed(torque=0.0)]).verdict == "none"


def test_a_torque_that_builds_up_until_the_log_ends_is_no_push():
    """The log ends between the command of the next motion and the moment at which dry friction breaks away."""
    log = pushed(torque=0.0)
    more = 3.0 * np.clip((log.t - log.t[-1] + 0.4) / 0.4, 0, 1)
    assert kinds(replace(log, tau=log.tau + more[:, None])) == ["standstill"]


def test_a_push_is_no_log_to_fit_or_to_compare():
    with pytest.raises(InputError, match="at 1 pose: gravity needs at least 5 different poses"):
        fr.identify(ARM, [pushed()])
    with pytest.raises(InputError, match="give the files of several poses together"):
        fr.compare(of_motion().model, [pushed()])


def test_a_push_is_found_beside_a_log_in_motion():
    result = fr.diagnose(of_motion().model, [jointwise(5), pushed()])
    assert [contact.source for contact in result.contacts] == ["push"]
    assert any("push: the arm stands still, so only contacts are searched there" in note for note in result.notes)


def test_a_dead_position_beside_a_live_torque_is_no_sure_contact():
    """Joint 2 moves, its position column does not: its torque need not come from a push."""
    arm, t = fr.Robot.load("planar2"), np.arange(0, 30, 0.01)
    s = [np.clip((t - begin) / 1.0, 0, 1) for begin in (3, 22, 12, 14)]
    step = [0.5 * (10 * x**3 - 15 * x**4 + 6 * x**5) for x in s]
    q = np.column_stack([step[0] - step[1], step[2] - step[3]])
    v = np.gradient(q, t, axis=0)
    rng = np.random.default_rng(0)
    tau = arm.inverse_dynamics(q, v, np.gradient(v, t, axis=0)) + 0.05 * rng.normal(size=q.shape)
    seen = q + 1e-5 * rng.normal(size=q.shape)
    seen[:, 1] = 0.0
    (report,) = fr.check(arm, [fr.Log(t, arm.joints, seen, tau=tau)])
    found = {issue.kind: issue for issue in report.issues}
    assert found["no motion"].sure == "certain"
    assert found["contact"].sure == "possible"
    assert "joint2 moves and the position was not recorded" in found["contact"].what
