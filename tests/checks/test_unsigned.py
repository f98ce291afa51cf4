"""Torques without their sign are named, and torques that only have one sign are not."""

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.checks.log_issue import Notebook
from frischid.checks.unsigned import check_unsigned

UR5 = fr.Robot.load("ur5")
DRY = {f"{name}{k}": value for k in range(1, 7) for name, value in (("fv", 1.0), ("fc", 2.0))}


def log_of(change) -> fr.Log:
    noise = fr.Noise(q=1e-5, tau=0.05)
    log = fr.simulate(UR5, fr.random_fourier(UR5, 40.0, seed=3), rate=100.0, parameters=DRY, noise=noise, seed=3)
    return replace(log, tau=change(np.array(log.tau)))


def told(log: fr.Log) -> list[tuple[str, bool]]:
    notes = Notebook(log.joints)
    check_unsigned(log, notes)
    return [(issue.kind, issue.blocks) for issue in notes.issues]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_magnitudes_are_named_before_any_other_fault(sign):
    """Currents of servos without a sign: `check` had said that they have the wrong sign (0.84)."""
    log = log_of(lambda tau: sign * np.abs(tau))
    assert told(log) == [("unsigned torque", True)]
    (report,) = fr.check(UR5, [log])
    assert [issue.kind for issue in report.issues] == ["unsigned torque"]


@pytest.mark.parametrize(
    "change",
    [
        lambda tau: tau,
        lambda tau: tau - tau.min(axis=0) + 0.5,  # one sign by its load, as of a joint that gravity pulls one way
        lambda tau: np.maximum(tau, 0.0),  # a meter that is zero in the other direction
        lambda tau: np.maximum(tau, 0.0) + 0.05 * np.random.default_rng(0).standard_normal(tau.shape),
        lambda tau: np.round(np.abs(tau) / 5.0) * 5.0,  # too coarse to tell
    ],
)
def test_torques_of_one_sign_and_coarse_ones_are_not(change):
    assert told(log_of(change)) == []


@pytest.mark.parametrize("rate", [50.0, 1000.0])
@pytest.mark.parametrize("dip", [3.0, 4.0])
def test_a_torque_that_comes_near_zero_in_every_period_keeps_its_sign(rate, dip):
    """The smallest of many noisy samples of a visit is far below the torque: this was surely a magnitude."""
    t = np.arange(0.0, 60.0, 1 / rate)
    for seed in range(20):
        noise = 0.1 * np.random.default_rng(seed).standard_normal(len(t))
        x = 5 * (1 - np.cos(np.pi * t)) + 0.1 * dip + noise
        if (x > 0).all():
            assert told(fr.Log(t, ("j",), q=np.sin(t)[:, None], tau=x[:, None])) == []
