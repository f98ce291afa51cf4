"""Dry friction that changes its direction earlier or later than the model says, beside a delay in doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.core.types import Column
from frischid.effects import State
from frischid.effects.commands import CommandDelay
from frischid.model.friction_lead import lead_effects, without_columns
from frischid.regression.moment_blocks import Blocks, total
from frischid.regression.moments import Gram

KP, KD, LATE = 300.0, 9.0, 0.02
TRUTH = {"fv1": 0.5, "fv2": 0.3, "fc1": 1.6, "fc2": 0.8, "Ia1": 0.05, "Ia2": 0.03}


def commanded(lead: float) -> fr.Log:
    """A log of commands that act 20 ms late, of joints whose dry friction changes `lead` s ahead of the motion."""
    robot = fr.Robot.load("planar2")
    effects = fr.parse_effects(f"viscous, coulomb(width=0.005, lead={lead}), offset, rotor_inertia")
    log = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=1), rate=200.0, parameters=TRUTH, effects=effects)
    assert log.tau is not None
    assert log.v is not None
    acts = log.q + (log.tau + KD * log.v) / KP
    stamped = np.column_stack([np.interp(log.t + LATE, log.t, x) for x in acts.T])
    keep = log.t < log.t[-1] - LATE
    noisy = log.q + 1e-5 * np.random.default_rng(1).standard_normal(log.q.shape)
    return fr.Log(log.t[keep], robot.joints, q=noisy[keep], qcmd=stamped[keep], source="servo")


def test_friction_that_changes_early_is_no_delay() -> None:
    """Named effects keep the lead at zero, 4 ms wrong: ranges of the delay and of viscous friction hold the truth."""
    told = fr.PDController(KP, KD, delay=LATE, delay_doubt=0.003)
    effects = fr.parse_effects("viscous, coulomb(width=0.005), offset, rotor_inertia")
    model = fr.identify(
        fr.Robot.load("planar2"), [commanded(0.004)], effects=effects, controller=told, recursion="none"
    ).model
    assert not any(c.name.startswith("early") for c in model.estimate.columns)
    found = {(x.joint, x.quantity): x for x in fr.drive_parameters(model)}
    for joint, viscous in (("joint1", 0.5), ("joint2", 0.3)):
        assert found[joint, "viscous"].lower <= viscous <= found[joint, "viscous"].upper
        delay = found[joint, "delay"]
        assert delay.lower <= LATE <= delay.upper
        assert abs(delay.value - LATE) < 2e-4


def test_the_column_is_the_slope_of_the_sign_by_the_lead() -> None:
    robot, rng = fr.Robot.load("planar2"), np.random.default_rng(0)
    q, v, a = rng.uniform(-0.05, 0.05, (3, 50, 2))
    none = np.zeros_like(q)
    state = State(robot, np.arange(50) * 1e-6, q, v, a, none, none)
    dry = fr.effects.Coulomb(width=0.02, lead=0.01)
    motion = type("Motion", (), {"step": 1e-6, "at_poses": False})()
    (nuisance,) = lead_effects([dry, CommandDelay()], [motion])
    assert lead_effects([dry], [motion]) == ()
    for k, term in enumerate(nuisance.terms(state)):
        after, before = (replace(dry, lead=0.01 + h).sign(state, k) for h in (1e-6, -1e-6))
        np.testing.assert_allclose(term.rows[k], (after - before) / 2e-6, atol=1e-6)


@pytest.mark.parametrize("empty", [False, True])
def test_columns_taken_out_leave_the_fit_of_the_others(empty: bool) -> None:
    rng = np.random.default_rng(0)
    names = tuple(Column(n, "", "joint1", "x", 0) for n in ("a", "b", "n"))
    rows = rng.normal(size=(40, 4))
    rows[:, 2] = 0.0 if empty else rows[:, 2] + rows[:, 0]
    rows[:, 3] += rows[:, 0] + 0.5 * rows[:, 2]
    parts = [
        Gram(names, ("joint1",), (z.T @ z)[None], z.sum(axis=0)[None], np.array([float(len(z))]))
        for z in (rows[:20], rows[20:])
    ]
    left = total(without_columns(Blocks(parts), 1))
    whole = np.linalg.lstsq(rows[:, :3], rows[:, 3], rcond=None)[0]
    theta = np.linalg.solve(left.moments[0, :2, :2], left.moments[0, :2, 2])
    np.testing.assert_allclose(theta, whole[:2])
    squares = float(((rows[:, 3] - rows[:, :3] @ whole) ** 2).sum())
    assert left.residual_ss(theta)[0] == pytest.approx(squares)
    assert [c.name for c in left.columns] == ["a", "b"]
