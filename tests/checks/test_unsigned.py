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
