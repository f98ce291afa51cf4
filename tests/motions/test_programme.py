"""A planned motion as a robot runs it: ways from home and back, within the limits, in the formats that robots take."""

import ast
import contextlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.cli.pages.motions import unsafe
from frischid.errors import InputError
from frischid.logs.readers import read_log
from frischid.motions.collision import Clearance
from frischid.motions.limits import MotionLimits, Violation, nominal_torque
from frischid.motions.programme import programme
from frischid.motions.programme_files import save
from frischid.motions.trajectory import Quintic

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]


@pytest.fixture(scope="module")
def ur10():
    robot = fr.Robot.load("ur10")
    plan = fr.plan(robot, options=fr.PlanOptions(duration=5.0, budget=40, samples=40, seed=0))
    return robot, plan, programme(robot, plan, HOME)


def test_the_ways_start_and_end_at_home_at_rest(ur10):
    _, plan, motion = ur10
    t = np.cumsum([0.0] + [part.duration for part in motion.parts])
    q, v, a = motion(t)
    np.testing.assert_allclose(q[[0, -1]], [HOME, HOME], atol=1e-9)
    np.testing.assert_allclose(v, 0.0, atol=1e-9)
    np.testing.assert_allclose(a, 0.0, atol=1e-7)
    assert motion.duration == pytest.approx(motion.approach + plan.trajectory.duration + motion.back)
    inside = motion(motion.approach + np.array([0.3, 2.2]))[0]
    np.testing.assert_allclose(inside, plan.trajectory(np.array([0.3, 2.2]))[0], atol=1e-9)


def test_every_sample_keeps_the_limits_and_the_peaks_are_the_largest(ur10):
    robot, _, motion = ur10
    limits, clearance = MotionLimits.of(robot, 0.9), Clearance.of(robot)
    t = np.linspace(0.0, motion.duration, 3000)
    q, v, a = motion(t)
    torque = nominal_torque(robot, q, v, a)
    sampled = {
        "position": np.abs(q - limits.middle),
        "speed": np.abs(v),
        "acceleration": np.abs(a),
        "torque": np.abs(torque),
    }
    for peak in motion.peaks:
        largest = sampled[peak.kind][:, robot.joints.index(peak.joint)].max()
        assert largest <= peak.value * 1.001 + 1e-9
        assert peak.value <= peak.limit * (1 + 1e-6)
        assert largest >= 0.98 * peak.value
    assert not np.isfinite(clearance.nearest(q[::10])[0]).any()
    assert motion.nearest.distance > motion.nearest.margin


def test_a_way_leads_around_what_is_in_between(ur10):
    robot, plan, _ = ur10
    clearance = Clearance.of(robot)
    rng = np.random.default_rng(5)
    limits = MotionLimits.of(robot, 0.9)
    start = plan.trajectory(np.zeros(1))[0][0]
    for _ in range(400):  # a free pose from which the straight way touches
        pose = rng.uniform(limits.lower, limits.upper)
        straight = start + np.linspace(0.0, 1.0, 40)[:, None] * (pose - start)
        hits = np.isfinite(clearance.nearest(straight)[0])
        if hits[5:-5].any() and not (hits[:5].any() or hits[-5:].any()):
            with contextlib.suppress(InputError):  # one more pose does not help everywhere
                motion = programme(robot, plan, pose)
                break
    assert len(motion.parts) > 3
    assert not np.isfinite(clearance.nearest(motion(np.arange(0.0, motion.duration, 0.05))[0])[0]).any()


def test_a_motion_may_run_again_between_the_ways(ur10):
    robot, plan, once = ur10
    twice = programme(robot, plan, HOME, repeat=2)
    assert twice.duration == pytest.approx(once.duration + plan.trajectory.duration)
    t = once.approach + np.array([0.4, 3.1])
    np.testing.assert_allclose(twice(t)[0], twice(t + plan.trajectory.duration)[0], atol=1e-9)
    with pytest.raises(InputError, match="1 to 1000 times"):
        programme(robot, plan, HOME, repeat=0)


def test_what_is_wrong_with_a_home_pose_is_said(ur10):
    robot, plan, _ = ur10
    with pytest.raises(InputError, match="has 2 numbers, but ur10 has 6 joints: shoulder_pan_joint"):
        programme(robot, plan, [0.0, 0.0])
    with pytest.raises(InputError, match="elbow_joint at 4, outside of its limits"):
        programme(robot, plan, [0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"no way from the pose .* give another home pose"):
        programme(robot, plan, [0.0, 1.57, 0.0, 0.0, 0.0, 0.0])  # the arm in the floor


def test_a_home_pose_may_be_beyond_half_a_turn(ur10):
    """Before, a UR arm turned by -270 degrees was "outside of its limits -3.142 to 3.142"."""
    robot, plan, _ = ur10
    home = np.array([-4.71, -1.57, 0.0, -1.57, 0.0, 6.2])
    motion = programme(robot, plan, home.tolist())
    np.testing.assert_allclose(motion(np.array([0.0, motion.duration]))[0], [home, home], atol=1e-9)
    with pytest.raises(InputError, match=r"wrist_3_joint at 6\.3, outside of its limits -6\.283 to 6\.283"):
        programme(robot, plan, [0.0, -1.57, 0.0, -1.57, 0.0, 6.3])
    endless = fr.Robot.load("double_pendulum_continuous")
    assert (MotionLimits.whole_range(endless).upper == 2 * np.pi).all()


def test_files_hold_the_motion(ur10, tmp_path):
    robot, _, motion = ur10
    log = motion.to_log(50.0)
    save(motion, tmp_path / "m.yaml", 50.0)
    written = yaml.safe_load((tmp_path / "m.yaml").read_text(encoding="utf-8"))
    assert written["joint_names"] == list(robot.joints)
    stamps = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in written["points"]]
    np.testing.assert_allclose(stamps, log.t, atol=1e-8)
    for key, wanted in (("positions", log.q), ("velocities", log.v), ("accelerations", log.a)):
        np.testing.assert_allclose([p[key] for p in written["points"]], wanted, rtol=1e-7, atol=1e-12)
    save(motion, tmp_path / "m.csv", 50.0)
    np.testing.assert_allclose(read_log(tmp_path / "m.csv", robot.joints).q, log.q, atol=1e-9)
    save(motion, tmp_path / "m.script", 50.0)
    script = (tmp_path / "m.script").read_text(encoding="utf-8")
    rows = [ast.literal_eval(x) for x in re.findall(r"servoj\((\[.*?\])", script)]
    np.testing.assert_allclose(rows, log.q, rtol=1e-7, atol=1e-12)
    assert script.startswith("def frischid_excite():\n")
    with pytest.raises(InputError, match="at most 500 positions"):
        save(motion, tmp_path / "m.script", 1000.0)


def test_names_stay_names(tmp_path):
    odd = ['a\n"]\nend\nset_digital_out(0, True)', "b: [x]\u2028"]
    zero = np.zeros((2, 2))
    part = Quintic(np.array([0.0, 1.0]), np.array([[0.0, 0.0], [1.0, 1.0]]), zero, zero)
    robot = fr.Robot.load("planar2")
    plan = fr.plan(robot, options=fr.PlanOptions(duration=4.0, budget=20, seed=0))
    motion = replace(programme(robot, plan), joints=tuple(odd), parts=(part,))
    save(motion, tmp_path / "m.yaml", 10.0)
    assert yaml.safe_load((tmp_path / "m.yaml").read_text(encoding="utf-8"))["joint_names"] == odd
    with pytest.raises(InputError, match="URScript is for arms of 6 joints, this robot has 2"):
        save(motion, tmp_path / "m.script")


def test_a_home_pose_near_the_end_of_its_range_is_said_to_be_beyond_the_plans_limits(tmp_path):
    run = ["excite", "planar2", "-o", str(tmp_path / "m.csv"), "--duration", "4", "--budget", "20"]
    said = {}
    for pose in ("0,0", "0,2.9"):
        done = CliRunner().invoke(main, [*run, "--home", pose])
        assert done.exit_code == 0, done.output
        said[pose] = " ".join(done.output.split())
    assert "the ways use the URDF's whole range of joint2" in said["0,2.9"]
    assert "whole range" not in said["0,0"]


def test_the_command_shows_peaks_and_says_what_is_checked(tmp_path):
    out = str(tmp_path / "m.yaml")
    run = ["excite", "planar2", "-o", out, "--duration", "4", "--budget", "20", "--home", "zero", "--rate", "20"]
    done = CliRunner().invoke(main, run, catch_exceptions=False)
    assert done.exit_code == 0
    for said in ("largest values, of the limits", "from the home pose to the motion", "no usable collision shape", out):
        assert said in " ".join(done.output.split())
    data = json.loads(CliRunner().invoke(main, [*run, "--json"]).stdout)
    assert {p["kind"] for p in data["peaks"]} == {"position", "speed", "acceleration", "torque"}
    assert data["approach_seconds"] > 0
    text = CliRunner().invoke(main, ["excite", "--help"]).output
    assert "touch neither one another nor the floor" in " ".join(text.split())


@pytest.mark.parametrize(
    ("output", "options", "said"),
    [
        ("m.txt", (), "cannot write a motion as a file '.txt'; use one of .csv, .parquet, .npz, .yaml, .script"),
        ("m.script", (), "URScript is for arms of 6 joints, this robot has 2"),
        ("m.csv", ("--home", "0"), "the home pose has 1 numbers"),
        ("m.csv", ("--home", "0,4"), "joint2 at 4, outside of its limits"),
        ("m.csv", ("--family", "bspline", "--repeat", "2"), "plan with the family fourier"),
        ("m.csv", ("--family", "points", "--repeat", "2"), "plan with the family fourier"),
    ],
)
def test_a_motion_that_nobody_could_run_is_refused_before_the_search(tmp_path, monkeypatch, output, options, said):
    def search(*_, **__):
        raise AssertionError("the search ran first")

    monkeypatch.setattr("frischid.motions.plan.plan", search)
    done = CliRunner().invoke(main, ["excite", "planar2", "-o", str(tmp_path / output), *options])
    assert done.exit_code != 0
    assert said in " ".join(done.output.split())


def test_an_arm_too_weak_to_stand_is_no_matter_of_the_search(ur10):
    _, plan, _ = ur10
    weak = replace(plan, violations=(Violation("torque", "elbow_joint", 0.0, 9.0, 1.0),))
    (alarm,) = unsafe(weak)
    assert "--limits" in alarm.remedy
    assert "--floor" not in alarm.remedy
