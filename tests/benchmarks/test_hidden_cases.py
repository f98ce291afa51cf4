"""The hidden-effect benchmark: its simulator gives what it says, and its scoring counts what it should."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frischid.diagnosis.diagnosis import diagnose
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

import second_cases
from calibration import right_answers
from hidden_cases import CHANGES, EFFECTS, GRADES, Truth, build, cases
from hidden_effects import Outcome, run, run_all, score, tables
from hidden_physics import arm, direction, motion, perturbed
from hidden_shapes import lugre
from planted_answers import judged, judged_alone
from planted_effects import planted

SPECS = cases(0)


def quick(spec):
    """Make a case that costs little: a small arm and a short motion."""
    simulator = spec.simulator if spec.simulator == "two_mass" else "rnea"
    return replace(spec, arm="elbow3", duration=10.0, simulator=simulator, background=0.0)


def first(**wanted):
    return next(s for s in SPECS if all(getattr(s, k) == v for k, v in wanted.items()))


def test_the_benchmark_is_as_large_as_it_should_be():
    kinds = [s.kind for s in SPECS]
    assert kinds.count("single") >= 200
    assert [kinds.count(k) for k in ("healthy", "unknown", "contact", "pair")] == [40, 20, 20, 40]
    assert {(s.effects[0], s.grade) for s in SPECS if s.kind == "single"} == {(e, g) for e in EFFECTS for g in GRADES}
    assert len({s.arm for s in SPECS}) >= 5
    assert 0.4 < np.mean([s.background > 0 for s in SPECS]) < 0.6
    assert 0.12 < np.mean([s.simulator == "mujoco" for s in SPECS]) < 0.25
    for kind in set(kinds):
        assert 0.35 < np.mean([s.background > 0 for s in SPECS if s.kind == kind]) < 0.65
    assert all(len(set(s.effects)) == 2 for s in SPECS if s.kind == "pair")


def test_fewer_cases_are_spread_over_all_kinds():
    assert {s.kind for s in cases(0, 30)} == {s.kind for s in SPECS}
    assert all("cogging" in s.effects for s in cases(0, only="cogging"))
    assert cases(1) != SPECS


def test_a_case_is_the_same_every_time():
    spec = quick(first(kind="single", effects=("hysteresis",), grade=2))
    one, two = build(spec), build(spec)
    assert one.truth == two.truth
    for a, b in zip(one.fit + one.valid, two.fit + two.valid, strict=True):
        assert a.to_table().keys() == b.to_table().keys()
        assert all(np.array_equal(x, b.to_table()[n]) for n, x in a.to_table().items())


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_has_the_size_of_its_grade(effect):
    spec = quick(first(kind="single", effects=(effect,), grade=1 + EFFECTS.index(effect) % 3))
    case = build(spec)
    low, high = GRADES[spec.grade]
    assert low < case.truth.sizes[0] < high
    assert 0 < case.truth.visible[0] < 1.6 * high
    assert case.truth.effects == (effect,)
    assert set(case.truth.joints[0]) <= set(case.robot.joints)
    assert len(case.fit) == len(case.valid) == 1
    assert len(case.reference) == (effect in CHANGES)
    for log in case.fit + case.valid + case.reference:
        assert log.joints == case.robot.joints
        assert log.duration > 9
        assert log.has("tau").all()


def test_the_baseline_explains_a_healthy_robot_and_not_a_changed_one():
    spec = quick(first(kind="single", effects=("cogging",), grade=1))
    spec = replace(spec, sensors=replace(spec.sensors, rate=250.0, channels="", jitter=0.0), pauses=0)
    errors = {}
    for name, effects, kind in (("healthy", (), "healthy"), ("cogging", ("cogging",), "single")):
        case = build(replace(spec, effects=effects, kind=kind))
        model = identify(case.robot, case.fit, recursion="none").model
        errors[name] = compare(model, case.valid).nrmse
    assert errors["healthy"] < 0.02
    assert errors["cogging"] > 2 * errors["healthy"]


def test_mujoco_agrees_with_inverse_dynamics_while_joints_move():
    pytest.importorskip("mujoco")
    from hidden_mujoco import followed
    from hidden_physics import Drive, prescribed, rnea

    rng = np.random.default_rng(0)
    robot = arm("elbow3")
    model = perturbed(robot.model, rng)
    plan = motion(robot, "fourier", 6.0, 1, 0.7)
    drive = Drive.plausible(rng, plan, rnea(model, robot, plan))
    simulated = followed(model, robot, plan, drive, 0)
    expected = prescribed(model, robot, simulated.path, drive, 0, simulated.sign)
    moving = (np.abs(simulated.path.v) > 0.05) & (plan.t[:, None] > 0.5)
    error = np.abs(simulated.base - expected.base)[moving] / expected.base.std()
    assert np.percentile(error, 99) < 2e-3


def test_a_healthy_robot_in_mujoco_needs_no_effect():
    # As MuJoCo has it by default, dry friction brakes a joint over timeconst · dmax / 2 = 9.5 ms before it turns.
    pytest.importorskip("mujoco")
    spec = first(kind="healthy", background=0.0)
    sensors = replace(spec.sensors, rate=250.0, channels="", jitter=0.0)
    case = build(replace(spec, number=0, arm="elbow3", simulator="mujoco", duration=20.0, pauses=0, sensors=sensors))
    model = identify(case.robot, case.fit, recursion="none").model
    dry = next(e for e in model.effects if e.id == "coulomb")
    assert 0.007 < dry.lead < 0.012
    assert diagnose(model, [*case.fit, *case.valid]).verdict == "none"


def test_friction_has_memory():
    t = np.arange(4000) * 1e-3
    v = 0.2 * np.sin(2 * np.pi * 0.5 * t)
    torque, sign = lugre(v, 0.02, 0.0, 0.05), direction(v[:, None])[:, 0]
    k = 1050  # just after the reversal at 1 s dry friction has turned, bristles have not
    assert sign[k] < -0.9
    assert torque[k] > 0.5
    assert abs(torque[1900] + 1) < 0.15


def test_play_with_friction_behind_it_is_named_and_measured():
    case = build(quick(first(kind="single", effects=("backlash",), grade=1)))
    found = diagnose(identify(case.robot, case.fit, recursion="none").model, [*case.fit, *case.valid])
    best = found.findings[0]
    assert (found.verdict, best.effect, best.joints) == ("effect", "backlash", case.truth.joints[0])
    assert best.error_after < 0.2 * found.error, "0.4 if friction is taken to follow the motor"
    (gap,) = (value for name, value in best.parameters.items() if name.startswith("gap"))
    assert gap == pytest.approx(float(case.truth.details[0].split("gap=")[1]), rel=0.15)
    assert best.parameters["rubbing"] == pytest.approx(0.5, abs=0.2)


@pytest.mark.parametrize("name", ["planar2", "panda"])
def test_true_bodies_are_possible_and_off_the_nominal_ones(name):
    robot = arm(name)
    other = perturbed(robot.model, np.random.default_rng(0))
    for i in range(1, robot.model.njoints):
        spread = np.linalg.eigvalsh(0.5 * np.trace(other.inertias[i].inertia) * np.eye(3) - other.inertias[i].inertia)
        nominal = robot.model.inertias[i]
        before = np.linalg.eigvalsh(0.5 * np.trace(nominal.inertia) * np.eye(3) - nominal.inertia)
        assert spread.min() > 0 or before.min() <= 0
        assert 0.04 < abs(other.inertias[i].mass / robot.model.inertias[i].mass - 1) < 0.21


def truth(*effects, joints=(("a",),), background=()):
    share = 0.01 if background else 0.0
    sizes = (0.1,) * len(effects)
    return Truth(effects, joints, 1, sizes, sizes, ("",), share, share, background, "planar2", "rnea", "")


def test_scoring():
    hit = Outcome("effect", (("stribeck", "cogging"), ("payload",)), (("a",), ()), (0.1, 0.2), 0.3, 0.09)
    assert score("single", truth("cogging"), hit)["first"]
    assert score("single", truth("cogging"), hit)["joints"]
    assert score("single", truth("cogging"), hit)["after"] == 0.1
    missed = score("single", truth("payload"), hit)
    assert (missed["first"], missed["top"], missed["said"]) == (False, True, "stribeck")
    quiet = replace(hit, verdict="none")
    assert not score("single", truth("cogging"), quiet)["first"]
    assert score("healthy", truth(), quiet)["first"]
    assert not score("healthy", truth(), hit)["first"]
    assert score("healthy", truth(background=("stribeck",)), hit)["first"]
    assert score("unknown", truth("unknown"), Outcome("unknown", (("unknown",),)))["first"]
    assert score("contact", truth("contact"), Outcome("contact", (("contact",),)))["first"]
    pair = truth("payload", "cogging", joints=((), ("a",)))
    assert score("pair", pair, replace(hit, added=(("stribeck", "cogging"), ("payload",))))["first"]
    assert score("pair", pair, replace(hit, added=(("payload",),)))["one"]


def oracle(case):
    """Diagnose perfectly."""
    effects = case.truth.effects
    verdict = {"healthy": "none", "contact": "contact", "unknown": "unknown"}.get(case.spec.kind, "effect")
    names = tuple((e,) for e in effects)
    return Outcome(verdict, names, case.truth.joints, (0.01,) * len(effects), 0.1, 0.01, names)


def crash(case):
    raise ValueError("no")


def test_tables_of_a_perfect_diagnosis_and_of_one_that_crashes():
    specs = [quick(s) for s in cases(0, 9) if s.simulator != "two_mass"]
    rows = run_all(specs, 1, oracle)
    assert all(row["first"] for row in rows)
    printed = tables(rows)
    assert all(row["wrong"] == 0 for row in printed["Wrong answers"])
    crashed = run(specs[0], crash)
    assert not crashed["first"]
    assert "ValueError" in crashed["error"]


@pytest.mark.parametrize("kind", ["stribeck", "drive_gain", "time_delay", "contact", "chirp", "none"])
def test_what_is_planted_in_a_log_has_its_size(kind):
    robot = Robot.load("ur5")
    logs = [simulate(robot, random_fourier(robot, 8.0, seed=s), rate=200.0, channels=(), seed=s) for s in (1, 2)]
    altered, detail = planted(kind, 0.1, logs, robot, [1, 2, 3], np.random.default_rng(0))
    added = [b.tau - a.tau for a, b in zip(logs, altered, strict=True)]
    share = np.concatenate(added)[:, 1:4].std(axis=0) / np.concatenate([log.tau for log in logs])[:, 1:4].std(axis=0)
    if kind == "none":
        assert not any(x.any() for x in added)
    elif kind == "time_delay":
        assert detail == "10 ms"
        assert 0.01 < share.max() < 0.2
    else:
        assert 0.08 < share.max() < 0.12
    assert all(np.array_equal(a.q, b.q) for a, b in zip(logs, altered, strict=True))


# ---------------------------------------------------------------------- the second generator


SECOND = second_cases.cases(0)


def test_the_second_generator_has_every_effect_and_worse_sensors():
    singles = [s for s in SECOND if s.kind == "single"]
    assert {(s.effects[0], s.grade) for s in singles} == {(e, g) for e in second_cases.SINGLE for g in GRADES}
    assert 0.2 < np.mean([s.sensors.bits < 16 for s in SECOND]) < 0.5
    assert 0.3 < np.mean([s.sensors.memory > 0 for s in SECOND]) < 0.7
    assert 0.1 < np.mean([s.sensors.jitter > 0 for s in SECOND]) < 0.4


@pytest.mark.parametrize("effect", ["gear_play", "hysteresis", "elasticity"])
def test_an_effect_of_the_second_generator_has_its_size_and_is_the_same_every_time(effect):
    spec = next(s for s in SECOND if s.effects == (effect,) and s.grade == 2)
    spec = replace(spec, arm="elbow3", duration=10.0, background=0.0, sensors=replace(spec.sensors, rate=100.0))
    one, two = second_cases.build(spec), second_cases.build(spec)
    assert one.truth == two.truth
    np.testing.assert_array_equal(one.fit[0].tau, two.fit[0].tau)
    low, high = GRADES[2]
    assert low <= one.truth.sizes[0] <= high
    assert one.fit[0].v is None


def test_what_counts_as_right():
    truth = Truth(
        ("stribeck",), (("joint1",),), 3, (0.01,), (0.01,), ("",), 0.02, 0.01, ("cogging",), "ur5", "rnea", ""
    )
    assert right_answers("single", truth) == ["stribeck", "cogging", "several"]
    assert right_answers("single", replace(truth, background=0.005)) == ["stribeck", "cogging"]
    assert right_answers("single", replace(truth, effects=("backlash",), background=0.0, background_effects=())) == [
        "backlash",
        "gear_play",
    ]
    assert right_answers("healthy", replace(truth, effects=(), sizes=())) == ["cogging", "several"]
    assert right_answers("healthy", replace(truth, background=0.0, background_effects=())) == ["none"]
    assert right_answers("contact", truth) == ["contact"]
    beside = replace(truth, background_effects=("crosstalk", "cable", "backlash"))  # the catalogue lacks the first two
    assert right_answers("single", beside) == ["stribeck", "outside", "backlash", "gear_play", "several"]
    assert right_answers("unknown", beside)[0] == "outside"


def test_an_answer_that_stands_there_without_a_planted_effect_is_neither_right_nor_wrong():
    def row(kind, answer, robot="arm"):
        return {"robot": robot, "situation": "changed", "kind": kind, "truth": kind, "answer": answer} | {
            "probability": 0.4, "said": [["load_friction"]],
        }  # fmt: skip

    own = row("none", "load_friction")
    rows = [own, row("payload", "load_friction"), row("load_friction", "load_friction"), row("payload", "contact")]
    assert [right for *_, right in judged(rows)] == [True, True, False]
    assert [right for *_, right in judged_alone(rows)] == [True, False]
    assert [right for *_, right in judged_alone([*rows, row("payload", "load_friction", "other")])] == [
        True,
        False,
        False,
    ]
