"""Torques outside the catalogue: beside an effect on another joint, and in place of an effect that resembles them."""

import re
from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.effect_findings import find_effects
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.rivals import sentence_of
from frischid.diagnosis.situation import cross_validator
from frischid.diagnosis.unmodelled_terms import unmodelled_term

PLANAR2 = fr.Robot.load("planar2")
DRY = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}


def logs_of(strange: float) -> list[fr.Log]:
    """Logs of an arm with a weak spring on joint 2; the direction of joint 2 brakes joint 1, N·m."""
    logs = []
    for seed in (1, 2):
        log = fr.simulate(
            PLANAR2,
            fr.random_fourier(PLANAR2, 25.0, seed=seed, scale=0.8),
            rate=100.0,
            effects=(*fr.BASELINE, *fr.parse_effects("joint_spring@joint2")),
            parameters=DRY | {"ks2": 0.1},
            noise=fr.Noise(q=1e-6, tau=0.01),
            seed=seed,
            name=f"log {seed}",
        )
        tau = np.array(log.tau)
        tau[:, 0] += strange * np.sign(log.v[:, 1])
        logs.append(replace(log, tau=tau))
    return logs


@pytest.mark.parametrize("strange", [0.0, 1.2])
def test_the_joint_with_the_largest_error_is_asked_too(strange):
    logs = logs_of(strange)
    found = fr.diagnose(fr.identify(PLANAR2, logs, recursion="none").model, logs)
    best = max(found.probabilities, key=lambda name: found.probabilities[name])
    if not strange:
        assert (found.verdict, best) == ("effect", "joint_spring")
        return
    assert (found.verdict, best) == ("unknown", "outside"), "the verdict and the most probable answer agree"
    assert found.probabilities["outside"] > 0.9
    said = "on joint1 'sign(v2)' explains more error than joint_spring does, so joint_spring is not the main cause"
    assert said in found.notes
    assert found.findings[0].to_dict()["withheld"] == "", "a verdict is not withheld"
    assert not sentence_of(found.findings, found.probabilities, PLANAR2), "nothing is left to tell apart"


def test_on_another_joint_only_more_error_than_a_healthy_robot_has_asks_for_a_term():
    """A healthy xArm7 was said to miss something outside the catalogue (99 %): jumps that followed the twin's error."""
    logs = logs_of(1.2)
    validator = cross_validator(fr.identify(PLANAR2, logs, recursion="none").model, logs)[0]
    _, ranked, noise = find_effects(validator, Floor.of(validator), "always", ["joint_spring"])
    found = unmodelled_term(ranked, noise, noise)
    assert found is not None
    assert (found.row, found.on_another_joint) == (0, True)
    healthy = ranked.full.predictive_nrmse() * ranked.full.spread
    assert unmodelled_term(ranked, noise, np.array([healthy[0], noise[1]])) is None


def rubbing(friction) -> fr.Diagnosis:
    """Diagnosis of an arm whose first joint has more dry friction: a function of angle and load, N·m."""
    logs = []
    for seed in (1, 2):
        log = fr.simulate(
            PLANAR2,
            fr.random_fourier(PLANAR2, 25.0, seed=seed, scale=0.8),
            rate=100.0,
            effects=fr.BASELINE,
            parameters=DRY,
            noise=fr.Noise(q=1e-6, tau=0.01),
            seed=seed,
            name=f"log {seed}",
        )
        tau = np.array(log.tau)
        tau[:, 0] += friction(log.q[:, 0], np.abs(tau[:, 0])) * np.sign(log.v[:, 0])
        logs.append(replace(log, tau=tau))
    return fr.diagnose(fr.identify(PLANAR2, logs, recursion="none").model, logs)


def test_a_bearing_worn_at_one_angle_is_not_called_friction_that_grows_with_the_load():
    """The arm hangs at the worn angle, where gravity's load is zero, so both are functions of the angle."""
    found = rubbing(lambda q, load: 4.0 * np.exp(-((q / 0.25) ** 2) / 2))
    assert found.verdict == "unknown"
    assert found.probabilities["outside"] > 0.9
    said = (
        "dry friction that changes with q1 explains far more than load_friction does, so load_friction is not the cause"
    )
    assert f"on joint1 {said}" in found.notes


@pytest.mark.parametrize(
    ("friction", "name"),
    [(lambda q, load: 0.08 * load, "load_friction"), (lambda q, load: 1.5 * q, "position_friction")],
)
def test_friction_that_grows_with_load_or_angle_keeps_its_name(friction, name):
    found = rubbing(friction)
    assert (found.verdict, found.findings[0].effect) == ("effect", name)
    assert found.probabilities[name] > 0.9


def diagnosed(row: int, scale) -> tuple[fr.Diagnosis, str]:
    """Diagnosis and most probable answer for a healthy arm; scale(q, τ) multiplies the torque of one joint's log."""
    logs = []
    for seed in (1, 2):
        motion, noise = fr.random_fourier(PLANAR2, 25.0, seed=seed, scale=0.8), fr.Noise(q=1e-6, tau=0.01)
        log = fr.simulate(PLANAR2, motion, rate=100.0, parameters=DRY, noise=noise, seed=seed, name=f"log {seed}")
        tau = np.array(log.tau)
        tau[:, row] *= scale(log.q[:, row], tau[:, row])
        logs.append(replace(log, tau=tau))
    found = fr.diagnose(fr.identify(PLANAR2, logs, recursion="none").model, logs)
    return found, max(found.probabilities, key=lambda name: found.probabilities[name])


@pytest.mark.parametrize("bend", [0.0, 0.25])
def test_a_motor_that_saturates_is_no_constant_scale(bend):
    """The log holds current times a constant; at a high current the motor gives less torque per ampere."""
    found, best = diagnosed(1, lambda _, tau: 1.0 + bend * (tau / np.abs(tau).max()) ** 2 if bend else 1.1)
    if bend:
        assert (found.verdict, best) == ("unknown", "outside")
        assert any("as of a motor that saturates, explains" in note for note in found.notes)
    else:
        assert (found.verdict, best) == ("effect", "drive_gain")


@pytest.mark.parametrize("waves", [1, 2])
def test_a_gear_out_of_centre_is_no_spring(waves):
    """The torque's scale changes by 10 % with the angle; where the load is that of gravity, a spring resembles this."""
    found, best = diagnosed(0, lambda q, _: 1.0 + 0.1 * np.sin(waves * q + 0.7))
    assert (found.verdict, best) == ("unknown", "outside")
    assert any("changes with q1, as of a gear or a pulley out of centre, explains" in note for note in found.notes)


def test_the_torques_of_an_excavator_are_not_too_large_for_a_diagnosis(tmp_path):
    """The square of 3e5 N·m is above the largest value of a formula: `diagnose` ended in an error."""
    factor, dry = 3e3, {name: 3e3 * value for name, value in DRY.items()}
    text = PLANAR2.urdf
    for key in ("mass value", "ixx", "iyy", "izz"):
        text = re.sub(rf'{key}="([^"]*)"', lambda found, key=key: f'{key}="{factor * float(found[1]):g}"', text)
    (tmp_path / "heavy.urdf").write_text(text)
    heavy, logs = fr.Robot.load(tmp_path / "heavy.urdf"), []
    for seed in (1, 2):
        motion, noise = fr.random_fourier(heavy, 25.0, seed=seed, scale=0.8), fr.Noise(q=1e-6, tau=0.01)
        log = fr.simulate(heavy, motion, rate=100.0, parameters=dry, noise=noise, seed=seed, name=f"log {seed}")
        tau = np.array(log.tau)
        tau[:, 1] *= 1.0 + 0.25 * (tau[:, 1] / np.abs(tau[:, 1]).max()) ** 2
        logs.append(replace(log, tau=tau))
    assert max(np.abs(log.tau).max() for log in logs) > 1e5
    found = fr.diagnose(fr.identify(heavy, logs, recursion="none").model, logs)
    assert any("as of a motor that saturates, explains" in note for note in found.notes)
