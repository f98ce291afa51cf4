"""What the logs leave open is free: moved to the ends of its range, the simulated motion stays where it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.core.types import Array
from frischid.forward.commanded_motion import moved

KP, KD, COUNT = 300.0, 9.0, 2 * np.pi / 4096
TRUE = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}
SYMBOLS = {"viscous": "fv", "coulomb": "fc", "armature": "Ia"}


@pytest.fixture(scope="module")
def log() -> fr.Log:
    """Commands that the drives follow, and positions of an encoder with 4096 counts per turn."""
    robot = fr.Robot.load("planar2")
    whole = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=1), rate=100.0, parameters=TRUE)
    assert whole.tau is not None
    assert whole.v is not None
    commands = whole.q + (whole.tau + KD * whole.v) / KP
    return fr.Log(whole.t, robot.joints, q=np.round(whole.q / COUNT) * COUNT, qcmd=commands, source="servo")


@pytest.fixture(scope="module")
def model(log: fr.Log) -> fr.Model:
    """A model whose user knows the delay to 3 ms."""
    controller = fr.PDController(KP, KD, delay_doubt=0.003)
    return fr.identify(fr.Robot.load("planar2"), [log], controller=controller, recursion="none").model


def positions(model: fr.Model, log: fr.Log, thetas: list[Array]) -> Array:
    """Simulated positions (P, N, J) with each of P sets of base parameters, all in one simulation."""
    changed = [replace(model, estimate=replace(model.estimate, theta=theta), standard=None) for theta in thetas]
    ((motion, source),) = moved(model, [log])
    extra = {n: (motion.t, x) for n, x in motion.extra.items()}
    forward = fr.ForwardDynamics(model, np.array([one.full_theta for one in changed]), extra=extra)
    which = np.arange(len(thetas))
    starts = fr.Starts(*(np.repeat(x[:1], len(thetas), axis=0) for x in (motion.q, motion.v, motion.t)), which=which)
    return np.asarray(forward.simulate(source, starts, motion.t - motion.t[0], step=0.002).q)


def test_an_open_value_is_free_and_a_known_one_is_not(model: fr.Model, log: fr.Log) -> None:
    e, names = model.estimate, [c.name for c in model.estimate.columns]
    known = {
        f"{SYMBOLS[x.quantity]}{model.robot.numbers[x.joint]}": x.known
        for x in fr.drive_parameters(model)
        if x.quantity in SYMBOLS
    }
    tried: list[tuple[str, Array]] = []
    for name, state in known.items():
        if name not in names or state not in ("open", "roughly"):
            continue
        k = names.index(name)
        along = e.covariance[:, k] / np.sqrt(e.covariance[k, k])  # the others follow, as the logs say
        alone = np.eye(len(names))[k] * e.theta[k]
        for side in (-1.0, 1.0):
            step = side * 1.96 * along if state == "open" else side * 0.5 * alone
            tried.append((state, step))
    here, *there = positions(model, log, [e.theta, *(e.theta + step for _, step in tried)])
    shifts: dict[str, list[float]] = {"open": [], "roughly": []}
    for (state, _), q in zip(tried, there, strict=True):
        shifts[state].append(float(np.sqrt(((q - here) ** 2).mean())))
    assert shifts["open"]
    assert shifts["roughly"]
    assert max(shifts["open"]) < COUNT
    assert min(shifts["roughly"]) > 3 * max(shifts["open"])


def test_a_value_in_a_sum_is_free_within_the_sum(model: fr.Model, log: fr.Log) -> None:
    """Armature of the first joint and inertia of its link move it alike."""
    found = fr.identify(model.robot, [log], controller=model.controller, recursion="none")
    row = next(x for x in fr.drive_parameters(model) if (x.joint, x.quantity) == ("joint1", "armature"))
    assert row.known == "in a sum"
    columns = [c.name for c in fr.effects.columns_of(model.robot, model.effects)]
    mapping = found.reduction.mapping
    shift = mapping[:, columns.index("Ia1")] - mapping[:, columns.index("Izz1")]
    np.testing.assert_allclose(shift, 0.0, atol=1e-12)  # the base parameters, and so the motion, are the same
