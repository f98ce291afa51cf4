"""Freely fitted parameters speak against a fault that the log does not have, whatever the URDF's links weigh."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from large_arm import DRIVES, large, log_of_large

from frischid.checks import inspect
from frischid.checks.excitation import free_fit
from frischid.checks.faults import Fault
from frischid.checks.hypothesis import POSITION_KINDS, hypothesis_of, parts_of, separable, without
from frischid.checks.kinematic_evidence import KinematicEvidence
from frischid.checks.position_faults import JOINT_ZERO, position_faults
from frischid.checks.sketch import Sketch
from frischid.core.types import Array
from frischid.effects import BASELINE, parse_effects
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

UR5 = Robot.load("ur5")
DRY = {f"fv{i}": 3.0 for i in range(1, 7)} | {f"fc{i}": 2.0 for i in range(1, 7)} | {f"Ia{i}": 0.3 for i in range(1, 7)}


@cache
def right() -> Log:
    return simulate(
        UR5,
        random_fourier(UR5, 40.0, seed=3, scale=0.8),
        rate=100.0,
        effects=BASELINE,
        parameters=DRY,
        noise=Noise(q=1e-5, tau=0.01),
        channels=(),
        seed=3,
    )


def reversed_elbow(log: Log) -> Log:
    q = log.q.copy()
    q[:, 2] *= -1
    return replace(log, q=q)


def swapped_shoulder_and_elbow(log: Log) -> Log:
    return replace(log, q=log.q[:, [0, 2, 1, 3, 4, 5]])


def shoulder_turned(log: Log) -> Log:
    q = log.q.copy()
    q[:, 1] += np.pi / 2
    return replace(log, q=q)


def elbow_turned(log: Log) -> Log:
    q = log.q.copy()
    q[:, 2] += np.pi / 2
    return replace(log, q=q)


FAULTS = [reversed_elbow, swapped_shoulder_and_elbow, elbow_turned]


def sketch_of(log: Log) -> Sketch:
    lowpass = LowPass(5.0)
    return Sketch.of(UR5, prepare(log, lowpass).motions, lowpass, UR5.joints)


@cache
def free(sketch: Sketch) -> Array:
    found = free_fit(sketch, structure(Regressor(UR5, BASELINE), UR5.joints))
    return np.full(len(sketch.rows), np.nan) if found is None else found.errors


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_that_the_log_does_not_have_is_contradicted(fault):
    evidence = KinematicEvidence(sketch_of(right()), free)
    assert evidence.contradicts(sketch_of(fault(right())))
    assert not evidence.contradicts(sketch_of(right()))


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_that_the_log_has_is_not(fault):
    evidence = KinematicEvidence(sketch_of(fault(right())), free)
    assert not evidence.contradicts(sketch_of(right()))


def test_what_only_the_links_know_is_not_contradicted():
    """A shoulder that is zeroed elsewhere turns gravity, and links that are free turn with it."""
    turned = sketch_of(shoulder_turned(right()))
    assert not KinematicEvidence(turned, free).contradicts(sketch_of(right()))


def test_a_log_too_short_to_fit_contradicts_nothing():
    short = sketch_of(right())
    assert not KinematicEvidence(short, lambda s: np.full(len(s.rows), np.nan)).contradicts(short)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_no_joint_is_reversed_for_links_that_somebody_guessed(seed, tmp_path):
    """With masses that are thirty times too small, the best hypothesis had a reversed joint, and `identify` stopped."""
    robot, guessed = large(tmp_path, "stated"), large(tmp_path, "guessed")
    log = log_of_large(robot, seed, 60.0)
    report = inspect(guessed, log, lambda: structure(Regressor(guessed, BASELINE), guessed.joints))
    assert {issue.kind for issue in report.issues} & {"wrong robot", "torque scale"}
    assert not [issue.kind for issue in report.issues if issue.kind in POSITION_KINDS or issue.blocks]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_spring_that_is_real_does_not_vouch_for_a_zero_that_is_not(seed, tmp_path):
    """The forearm's centre of mass is elsewhere. With the spring, a shifted elbow explained more than other links."""
    robot = large(tmp_path, "stated")
    own = dict(zip(robot.all_names, robot.nominal, strict=True))
    cos, sin = np.cos(np.deg2rad(25)), np.sin(np.deg2rad(25))
    links = {"mx3": cos * own["mx3"] + sin * own["mz3"], "mz3": cos * own["mz3"] - sin * own["mx3"]}
    log = simulate(
        robot,
        random_fourier(robot, 40.0, seed=seed, scale=0.8),
        rate=50.0,
        effects=(*BASELINE, *parse_effects("joint_spring@a2")),
        parameters=DRIVES | links | {"ks2": 4000.0},
        noise=Noise(q=2e-5, tau=0.01),
        channels=(),
        seed=seed,
    )
    report = inspect(robot, log, lambda: structure(Regressor(robot, BASELINE), robot.joints))
    assert [(issue.kind, issue.where) for issue in report.issues] == [("spring", ("a2",))]


def test_faults_are_taken_back_to_the_log_as_it_is():
    asis = sketch_of(elbow_turned(right()))
    zero = next(
        x
        for x in position_faults(asis)
        if (x.fault.kind, x.fault.where) == (JOINT_ZERO, (UR5.joints[2],)) and not x.fault.discrete
    )
    spring = Fault("spring", "", (UR5.joints[1],), "", 1.0, torque=np.eye(6)[1] * np.sin(asis.q[:, 1:2]))
    both = replace(zero.sketch, given_nominal=zero.sketch.nominal + spring.torque)
    hypothesis = hypothesis_of((zero.fault, spring), both)
    assert {part.key for part in parts_of(hypothesis)} == {hypothesis.key - part for part in subsets(hypothesis.key)}
    nothing = without(hypothesis, hypothesis.faults).sketch
    assert np.allclose(nothing.nominal, asis.nominal, atol=1e-3 * np.abs(asis.nominal).max())
    (alone,) = (part for part in parts_of(hypothesis) if part.faults == (spring,))
    assert np.allclose(alone.sketch.nominal - nothing.nominal, spring.torque)
    assert separable(replace(hypothesis, faults=(*hypothesis.faults, replace(zero.fault, kind="degrees")))) == [spring]


def subsets(key):
    return [frozenset(part) for n in range(1, len(key) + 1) for part in combinations(key, n)]
