"""The width and lead of dry friction's sign are read off the data."""

import numpy as np
import pytest

from frischid.effects import Coulomb, parse_effects
from frischid.estimators.friction_smoothing import baseline, dry_friction
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

PLANAR = Robot.load("planar2")


def log_of(width, seconds=20.0, lead=0.0, scale=0.7):
    """A log of an arm whose dry friction has this width and lead."""
    effects = parse_effects(f"viscous, coulomb(width={width}, lead={lead}), offset, rotor_inertia")
    values = {"fv1": 0.5, "fv2": 0.5, "fc1": 1.0, "fc2": 0.6, "Ia1": 0.1, "Ia2": 0.1}
    motion = random_fourier(PLANAR, seconds, seed=3, scale=scale)
    noise = Noise(q=1e-5, tau=0.003)
    return simulate(PLANAR, motion, rate=200, effects=effects, parameters=values, noise=noise, channels=(), seed=1)


@pytest.mark.parametrize(("width", "lower", "upper"), [(2e-4, 0.0, 0.001), (0.02, 0.016, 0.025), (0.065, 0.05, 0.08)])
def test_the_width_is_found(width, lower, upper):
    found = identify(PLANAR, [log_of(width)], recursion="none")
    friction = next(e for e in found.model.effects if e.id == "coulomb")
    assert lower < friction.width <= upper
    assert friction.lead == 0
    assert any("chosen by cross-validation" in note for note in found.notes)


def test_a_slow_robot_gets_a_sharp_sign():
    """At a tenth of a rad/s, a sign of 0.001 rad/s is a ramp that a log shows: it must not pass for another effect."""
    log = log_of(1e-4, seconds=60.0, scale=0.02)
    assert np.abs(np.diff(log.q, axis=0)).max() / 0.005 < 0.1
    found = identify(PLANAR, [log], recursion="none")
    friction = next(e for e in found.model.effects if e.id == "coulomb")
    assert friction.width < 0.0006
    assert friction.lead == 0


LIFT = """<robot name="lift"><link name="base"/><link name="slide"><inertial><origin xyz="0 0 0"/><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="z" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="0 0 1"/>
<limit lower="-0.2" upper="0" effort="300" velocity="1"/></joint></robot>"""


def lifted(robot, rng, spring):
    """A vertical axis that goes from stop to stop, with the jerk as small as possible, and rests at each."""
    t = np.arange(0, 30, 0.004)
    q, v, a = np.zeros((3, len(t)))
    at, x = 0.0, -0.1
    while at < 30:
        y, lasts, rest = -0.1 + 0.09 * rng.uniform(-1, 1), rng.uniform(0.6, 2.0), rng.uniform(0.1, 0.5)
        on, still = (t >= at) & (t < at + lasts), (t >= at + lasts) & (t < at + lasts + rest)
        s = (t[on] - at) / lasts
        q[on] = x + (y - x) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        v[on] = (y - x) * (30 * s**2 - 60 * s**3 + 30 * s**4) / lasts
        a[on] = (y - x) * (60 * s - 180 * s**2 + 120 * s**3) / lasts**2
        q[still] = x = y
        at += lasts + rest
    tau = 8 * a + 18.6 + 60 * v + 22 * np.tanh(v / 2e-4) + spring * q + 2 * rng.standard_normal(len(t))
    q += 1e-7 * rng.standard_normal(len(t))
    return Log(t=t, q=q[:, None], tau=tau[:, None], joints=robot.joints)


@pytest.mark.parametrize("spring", [0.0, 180.0, 400.0])
def test_a_missing_spring_does_not_widen_the_sign(tmp_path, spring):
    """At the stops the spring's torque is largest and dry friction changes: the width had been 0.05 and 0.1 m/s."""
    (tmp_path / "lift.urdf").write_text(LIFT, encoding="utf-8")
    robot = Robot.load(tmp_path / "lift.urdf")
    for seed in (1, 2):
        found = identify(robot, [lifted(robot, np.random.default_rng(seed), spring)], recursion="none")
        friction = next(e for e in found.model.effects if e.id == "coulomb")
        assert friction.width <= 0.002


def test_the_lead_is_found():
    # That of MuJoCo's frictionloss, as it is by default.
    found = identify(PLANAR, [log_of(0.002, lead=0.0095)], recursion="none")
    friction = next(e for e in found.model.effects if e.id == "coulomb")
    assert 0.008 < friction.lead < 0.011
    assert any("ms ahead of the motion" in note for note in found.notes)


def test_too_little_data_leaves_the_choice_open():
    log = log_of(0.01, 3.0)
    lowpass = choose_lowpass([log], log.joints)
    motions = [m.part(slice(0, 40)) for m in prepare(log, lowpass).motions]
    reduction = structure(Regressor(PLANAR, baseline(Coulomb(width=0.01))), PLANAR.joints)
    assert dry_friction(PLANAR, motions, lowpass, PLANAR.joints, reduction) is None
    assert np.isclose(baseline(Coulomb(width=0.03))[1].width, 0.03)
