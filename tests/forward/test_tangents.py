"""Derivatives of simulated motions: those of the analytic tangents are the differences of simulations."""

from __future__ import annotations

import numpy as np
import pytest

import frischid as fr
from frischid.forward.forward_dynamics import ForwardDynamics
from frischid.forward.simulated_motion import Starts
from frischid.forward.tangents import Tangents
from frischid.forward.torque_sources import PositionController, RecordedTorque

TRUTH = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}
ROBOT = fr.Robot.load("planar2")
HORIZON = np.linspace(0.0, 0.4, 9)
STEP = 1e-4
"""Of the differences, in standard errors of the parameters."""


def recorded() -> fr.Log:
    motion = fr.random_fourier(ROBOT, 6.0, seed=1)
    return fr.simulate(ROBOT, motion, rate=200.0, parameters=TRUTH, noise=fr.Noise(q=1e-6, tau=0.01))


def derivatives(model, source, begin, step=0.002):
    """Tangents, and central differences, (S, N, J, P) each, with every parameter of the model as a direction."""
    log = recorded()
    D = np.zeros((len(model.full_theta), len(model.base)))
    D[list(model.base)] = np.diag(np.sqrt(np.diag(model.estimate.covariance)))
    P, S, theta = D.shape[1], len(begin), model.full_theta

    def simulated(thetas, follower=None):
        forward = ForwardDynamics(model, thetas)
        q, v = (np.tile(x[begin], (len(thetas), 1)) for x in (log.q, log.v))
        z = [np.tile(x, (len(thetas), 1)) for x in forward.remembered(log.t, log.v, begin)]
        starts = Starts(q, v, np.tile(log.t[begin], len(thetas)), np.repeat(np.arange(len(thetas)), S), z)
        return forward.simulate(source, starts, HORIZON, step=step, follower=follower).q

    tangents = Tangents(ForwardDynamics(model, theta[None]), D, source, S)
    simulated(theta[None], tangents)
    both = simulated(np.concatenate([theta + STEP * D.T, theta - STEP * D.T])).reshape(2, P, S, len(HORIZON), 2)
    found = np.stack(tangents.noted, axis=1)
    return found, np.moveaxis((both[0] - both[1]) / (2 * STEP), 0, -1)[:, 1:]


def check(model, source, begin=(100, 250, 500, 800), **options):
    found, differences = derivatives(model, source, np.array(begin), **options)
    size = np.abs(differences).max(axis=(0, 1), keepdims=True) + 1e-9
    assert np.abs((found - differences) / size).max() < 2e-3


@pytest.mark.parametrize(
    "effects",
    [
        "viscous, offset",
        "viscous, coulomb, offset, rotor_inertia",
        "viscous, coulomb, stribeck, joint_spring@joint2",
        "viscous, coulomb, hysteresis@joint2",
        "viscous, coulomb, cable_hose@joint2",
        "viscous, coulomb, time_delay",
        "viscous, coulomb, load_friction",
        "viscous, coulomb, drive_gain@joint1",
        "viscous, joint_coupling@joint1+joint2",
    ],
)
def test_under_a_recorded_torque(effects):
    log = recorded()
    model = fr.identify(ROBOT, [log], effects=fr.parse_effects(effects), recursion="none").model
    check(model, RecordedTorque(log.t, log.tau))


@pytest.mark.parametrize("effects", ["viscous, coulomb, offset, rotor_inertia", "viscous, coulomb, load_friction"])
@pytest.mark.parametrize("delay", [0.0, 0.0053])
def test_under_a_controller(effects, delay):
    log = recorded()
    model = fr.identify(ROBOT, [log], effects=fr.parse_effects(effects), recursion="none").model
    wanted = log.q + (log.tau + 4.0 * log.v) / 200.0
    source = PositionController(log.t, wanted, np.full(2, 200.0), np.full(2, 4.0), delay=delay, dead_band=1e-3)
    check(model, source)
