"""A stretch that a trimmed fit cannot predict is no contact: its residual has the variance of the prediction too."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special

import frischid as fr
from frischid.diagnosis.contacts import _of_motion, find_contacts
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.robust_fit import robust_parameters
from frischid.diagnosis.situation import cross_validator
from frischid.diagnosis.start_states import without_memory
from frischid.motions.trajectory import Fourier

UR5 = fr.Robot.load("ur5")
DRY = {f"{name}{i}": 0.5 for name in ("fv", "fc") for i in range(1, 7)}


@dataclass(frozen=True)
class Hurried:
    """A motion that runs five times as fast for two seconds: time s(t) = t + 4 ∫ bell, with bell of width 0.8 s."""

    path: Fourier
    duration: float = 30.0

    def __call__(self, t):
        x = (t - 14.0) / 0.8
        bell, area = np.exp(-(x**2)), 0.8 * np.sqrt(np.pi) / 2 * (special.erf(x) + 1)
        q, v, a = self.path(t + 4 * area)
        rate, slope = (1 + 4 * bell)[:, None], (-8 * x / 0.8 * bell)[:, None]
        return q, v * rate, a * rate**2 + v * slope


def bursts(effects, push=0.0, hurried=True, **values):
    """Contacts that are found in two slow logs, one of which may have a fast stretch."""
    hidden = (*fr.BASELINE, *fr.parse_effects(effects)) if effects else fr.BASELINE
    logs = []
    for seed in (1, 2):
        path = fr.random_fourier(UR5, 60, seed=seed)
        motion = Hurried(path) if hurried and seed == 1 else path
        log = fr.simulate(
            UR5, motion, rate=100, effects=hidden, parameters=DRY | values, noise=fr.Noise(q=1e-5, tau=0.03), seed=seed
        )
        tau = np.array(log.tau)
        tau += np.multiply(push, ((log.t > 20) & (log.t < 21) & (seed == 1))[:, None])
        logs.append(fr.Log(log.t, log.joints, log.q, tau=tau, source=f"log {seed}"))
    validator, _ = cross_validator(fr.identify(UR5, logs, recursion="none").model, logs)
    return [burst.contact for burst in find_contacts(validator, Floor.of(validator).noise)]


def test_a_spring_that_the_model_lacks_is_no_contact():
    assert bursts("joint_spring@shoulder_lift_joint", ks2=2.0) == []


@pytest.mark.parametrize(("effect", "name"), [("quadratic_viscous", "fvv2"), ("cubic_viscous", "fvvv2")])
def test_a_fast_stretch_shows_only_on_the_joint_that_misses_something(effect, name):
    """Its other joints are predicted as badly as the rows of the slow motion allow."""
    found = bursts(f"{effect}@shoulder_lift_joint", **{name: 1.0})
    assert {joint for contact in found for joint in contact.joints} <= {"shoulder_lift_joint"}


def test_a_push_in_an_ordinary_stretch_is_one():
    found = bursts("", push=3.0)
    assert [(round(c.start), round(c.stop)) for c in found] == [(20, 21)]
    assert len(found[0].joints) == 6


def test_a_push_on_a_middle_link_shows_beside_effects_that_the_model_lacks():
    """It turns the joints before the touched link only. The errors of the wrists are larger together."""
    missing = ",".join(f"joint_spring@wrist_{i}_joint" for i in (1, 2, 3))
    found = bursts(missing, push=[4.0, 4.0, 4.0, 0, 0, 0], hurried=False, ks4=0.5, ks5=0.5, ks6=0.5)
    assert [(round(c.start), round(c.stop)) for c in found] == [(20, 21)]


def test_a_push_on_a_slow_joint_is_larger_than_its_friction():
    """At reversals dry friction is undetermined, but no larger than at other times."""
    machine = fr.Robot.load("planar2")
    motion = fr.random_fourier(machine, 30, seed=3)
    log = fr.simulate(machine, motion, rate=100, parameters={"fc1": 0.2}, noise=fr.Noise(q=1e-6, tau=0.01), seed=3)
    slow = np.abs(motion(log.t)[1][:, 0])
    middle = log.t[200 + np.argmin(np.convolve(slow, np.ones(40), "same")[200:-200])]
    tau = np.array(log.tau)
    tau[:, 0] += 2.0 * np.exp(-(((log.t - middle) / 0.15) ** 2))
    logs = [fr.Log(log.t, log.joints, log.q, tau=tau, source="pushed")]
    validator, _ = cross_validator(fr.identify(machine, logs, recursion="none").model, logs)
    (burst,) = find_contacts(validator, Floor.of(validator).noise)
    assert burst.start < middle < burst.stop


@pytest.mark.parametrize(("speed", "count"), [(0.1, 0), (0.6, 1)])
@pytest.mark.parametrize("others", [0.3, 1.0, 1.5])
def test_the_noise_of_other_joints_does_not_hide_that_a_burst_is_at_a_reversal(speed, count, others):
    """On a healthy Z1, two spikes where joint 6 reversed were contacts: five other joints were in motion."""
    t = np.arange(0.0, 10.0, 0.02)
    squares, relative = np.full((len(t), 24), others), np.ones((len(t), 24))
    push = (t > 4.0) & (t < 4.5)
    squares[push, 5], relative[push, 5] = 40.0, speed
    names = [f"joint{k}" for k in range(24)]
    judge = SimpleNamespace(criteria=DiagnosisCriteria(), joints=names)
    found = _of_motion("log", t, squares, np.full_like(squares, 60.0), relative, 3, judge)
    assert [burst.contact.joints for burst in found] == [["joint5"]] * count


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_pushes_that_bias_the_whole_fit_are_found(share):
    """A push of one direction, again and again: least squares spreads its error over the whole log."""
    machine, logs = fr.Robot.load("planar2"), []
    for seed in (1, 2):
        motion = fr.random_fourier(machine, 25, seed=seed)
        log = fr.simulate(machine, motion, rate=100, noise=fr.Noise(q=1e-6, tau=0.02), seed=seed)
        tau = np.array(log.tau)
        tau[:, 1] += 0.4 * tau[:, 1].std() * (np.mod(log.t, 7.0) < 7.0 * share)
        logs.append(fr.Log(log.t, log.joints, log.q, tau=tau, source=f"log {seed}"))
    found = fr.diagnose(fr.identify(machine, logs, recursion="none").model, logs)
    assert found.verdict == "contact"
    assert {joint for contact in found.contacts for joint in contact.joints} == {"joint2"}
    whole = [c for c in found.contacts if c.start > 1]
    assert {round(c.start) % 7 for c in whole} == {0}
    assert all(abs(c.stop - c.start - 7 * share) < 0.6 for c in whole)
    assert any("the model was fitted with these contacts" in note for note in found.notes)


def test_a_robust_fit_hardly_sees_a_push():
    machine = fr.Robot.load("planar2")
    log = fr.simulate(machine, fr.random_fourier(machine, 25, seed=3), rate=100, noise=fr.Noise(tau=0.02), seed=3)
    pushed = log.tau + np.array([0.0, 3.0]) * ((log.t > 8) & (log.t < 11))[:, None]
    model = fr.identify(machine, [log], recursion="none").model
    calm, touched = (
        cross_validator(model, [fr.Log(log.t, log.joints, log.q, tau=tau, source="log")], "always")[0]
        for tau in (log.tau, pushed)
    )
    unit = Floor.of(calm).noise
    sse = [
        sum(calm.squares(row, theta) for row in (0, 1)) for theta in (touched.theta, robust_parameters(touched, unit))
    ]
    least = sum(calm.squares(row, calm.theta) for row in (0, 1))
    assert sse[1] < 1.2 * least < 0.5 * sse[0]


@pytest.mark.parametrize("push", [0.0, 20.0])
def test_a_hose_that_was_bent_before_the_log_is_no_contact(push):
    """Both logs begin just after the elbow reversed, so the hose's friction still points the other way for a while."""
    hose = (*fr.BASELINE, *fr.parse_effects("cable_hose(distance=0.3)@elbow_joint"))
    logs = []
    for seed in (1, 2):
        log = fr.simulate(
            UR5,
            fr.random_fourier(UR5, 60, seed=seed),
            rate=100,
            effects=hose,
            parameters=DRY | {"kh3": 10.0, "fz3": 10.0},
            noise=fr.Noise(q=1e-5, tau=0.01),
            seed=seed,
        )
        turns = np.flatnonzero(np.diff(np.sign(log.v[:, 2])))
        first = int(turns[turns > 500][0]) + 5
        tau = np.array(log.tau[first:])
        tau += np.multiply(push, ((log.t > 30) & (log.t < 31) & (seed == 1))[first:, None])
        logs.append(fr.Log(log.t[first:], log.joints, log.q[first:], tau=tau, source=f"log {seed}"))
    model = fr.identify(UR5, logs, effects=hose, recursion="none").model
    validator, _ = cross_validator(model, logs)
    found = [burst.contact for burst in find_contacts(validator, Floor.of(validator).noise)]
    assert [round(contact.start) for contact in found] == ([30] if push else [])


def test_what_a_state_before_the_log_explains_is_hardly_a_push():
    """A joint that covers little way still holds its first state: the error is estimated, and a push stays visible."""
    rng, n = np.random.default_rng(0), 6000
    torque = 10 * np.exp(-np.linspace(0, 0.3, n))[:, None]  # beta b of a hose of 10 N·m
    push = 20.0 * ((np.arange(n) > 3000) & (np.arange(n) < 3100))
    error = 1.5 * torque[:, 0] + push + rng.normal(0, 0.1, n)
    rest, variance = without_memory(error, np.full(n, 0.1**2), torque)
    assert np.abs(rest[:2900]).max() < 1.0
    assert rest[3050] > 19.0
    assert np.sqrt(variance).max() < 0.11


class Trapezoids:
    """Both joints of a planar arm to and fro in trapezoidal motions, whose corners lie between samples."""

    duration, speed, acceleration = 30.0, 0.6, 3.0

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.starts = 1 + 3.5 * np.arange(8) + rng.uniform(0, 0.01, 8)
        self.ways = rng.uniform(0.5, 1.2, (8, 2)) * np.where(np.arange(8) % 2, -1.0, 1.0)[:, None]

    def __call__(self, t):
        q, v, a = np.zeros((3, len(t), 2))
        ramp = self.speed / self.acceleration
        for start, way in zip(self.starts, self.ways, strict=True):
            length = np.abs(way) / self.speed + ramp
            x = np.clip((t - start)[:, None], 0, length)
            rising, braking = np.minimum(x, ramp), np.maximum(x - length + ramp, 0)
            q += np.sign(way) * (self.acceleration / 2 * (rising**2 - braking**2) + self.speed * (x - rising))
            v += np.sign(way) * self.acceleration * (rising - braking)
            moving = (x > 0) & (x < length)
            a += np.sign(way) * self.acceleration * moving * ((x < ramp) * 1.0 - (x > length - ramp))
        return q, v, a


@pytest.mark.parametrize("seed", range(3))
def test_corners_of_trapezoids_between_two_samples_are_neither_contacts_nor_a_missing_effect(seed):
    robot = fr.Robot.load("planar2")
    values = {"fv1": 0.5, "fc1": 1.0, "fv2": 0.3, "fc2": 0.6, "Ia1": 0.3, "Ia2": 0.2}
    log = fr.simulate(
        robot,
        Trapezoids(seed),
        rate=100.0,
        parameters=values,
        noise=fr.Noise(q=1e-6, tau=0.003),
        channels=(),
        seed=seed,
    )
    diagnosis = fr.diagnose(fr.identify(robot, [log]).model, [log])
    assert diagnosis.verdict == "none"
    assert not diagnosis.contacts


@pytest.mark.parametrize("height", [0.04, 0.1])
def test_a_push_in_a_smooth_motion_at_20_hz_is_one(height):
    """A steep torque is no jump between two samples."""
    robot = fr.Robot.load("planar2")
    values = {"fv1": 0.5, "fc1": 1.0, "fv2": 0.3, "fc2": 0.6, "Ia1": 0.3, "Ia2": 0.2}
    motion, noise = fr.random_fourier(robot, 30.0, seed=2), fr.Noise(q=1e-6, tau=0.003)
    log = fr.simulate(robot, motion, rate=20.0, parameters=values, noise=noise, channels=(), seed=2)
    model = fr.identify(robot, [log]).model
    pushed = np.where(((log.t > 12) & (log.t < 12.4))[:, None], height * log.tau.std(axis=0), 0.0)
    (contact,) = fr.diagnose(model, [replace(log, tau=log.tau + pushed)]).contacts
    assert contact.start == pytest.approx(12.0, abs=0.2)
