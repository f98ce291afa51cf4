"""Bursts that return with the state of their joint are no contacts, and bursts that come once are."""

from types import SimpleNamespace

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis import contacts_that_return
from frischid.diagnosis.contacts_that_return import returning_share
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA
from frischid.diagnosis.situation import cross_validator

MACHINE = fr.Robot.load("planar2")
BUMP = (4.0, 5.0)  # s


def log_with(seed, torque):
    """A log with a torque on joint 2 that depends on the log's number, on time and on the joint's position."""
    motion = fr.random_fourier(MACHINE, 20, seed=seed)
    log = fr.simulate(MACHINE, motion, rate=50, noise=fr.Noise(q=1e-6, tau=0.02), seed=seed)
    tau = np.array(log.tau)
    tau[:, 1] += torque(seed, log.t, log.q[:, 1])
    return fr.Log(log.t, log.joints, log.q, tau=tau, source=f"log {seed}")


def share_of(torque):
    logs = [log_with(seed, torque) for seed in (1, 2)]
    validator, _ = cross_validator(fr.identify(MACHINE, logs, recursion="none").model, logs)
    bursts = [("log 1", *BUMP)]
    return returning_share(validator, validator.without(bursts), bursts)


def test_a_torque_that_depends_on_the_joint_returns_with_its_state():
    q = log_with(1, lambda k, t, q: 0 * t).q[:, 1]
    here = float(q[(np.linspace(0, 20, len(q)) > BUMP[0]) & (np.linspace(0, 20, len(q)) < BUMP[1])].mean())
    assert share_of(lambda k, t, q: 3.0 * np.exp(-20 * (q - here) ** 2)) > 0.3


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_a_push_does_not(size):
    assert (
        share_of(lambda k, t, q: size * ((t > BUMP[0] + 0.2) & (t < BUMP[1] - 0.2)) * (k == 1))
        < DIAGNOSIS_CRITERIA.returning_share
    )


def test_without_bursts_nothing_returns():
    logs = [log_with(1, lambda k, t, q: 0 * t)]
    validator, _ = cross_validator(fr.identify(MACHINE, logs, recursion="none").model, logs)
    assert returning_share(validator, validator, []) == 0.0


def test_pushes_of_one_direction_do_not_predict_one_another():
    """Where a fifth of the time is pushed, a fifth of any neighbours is, and the mean of all times predicts as much."""
    times = [(3.0, 4.5), (9.0, 10.5), (15.0, 16.5)]
    logs = [log_with(k, lambda k, t, q: 3.0 * sum((t > a) & (t < b) for a, b in times)) for k in (1, 2)]
    validator, _ = cross_validator(fr.identify(MACHINE, logs, recursion="none").model, logs)
    bursts = [(f"log {k}", a, b) for k in (1, 2) for a, b in times]
    assert returning_share(validator, validator.without(bursts), bursts) < DIAGNOSIS_CRITERIA.returning_share


@pytest.mark.parametrize(("beside", "returns"), [([0.1] * 6, True), ([0.9, 0.9, 0.9, -0.3, -0.3, -0.3], False)])
def test_bursts_of_which_some_meet_by_chance_do_not_return(monkeypatch, beside, returns):
    """Both shares are above the limit. In the second, half of the bursts are predicted, and the other half wrongly."""
    count = 2 * contacts_that_return.NEIGHBOURS
    burst = np.repeat([*range(6), *[-1] * 6], count)
    states = np.repeat([*range(6), *range(6)], count)[:, None] + np.zeros((1, 4))
    sign = np.array([1.0, -1.0] * 3)  # then the mean of all times is about zero
    residual = np.repeat([*sign, *sign * beside], count)
    monkeypatch.setattr(contacts_that_return, "_rows", lambda *_: (states, residual, burst, np.full(len(burst), -1)))
    fit = SimpleNamespace(spread=np.ones(1), theta=None)
    share = returning_share(fit, fit, [("log", 0.0, 1.0)] * 6)
    assert (share > DIAGNOSIS_CRITERIA.returning_share) == returns
