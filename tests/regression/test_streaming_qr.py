"""Streaming QR: as exact as a dense one, where moments are not."""

import numpy as np
import pytest

import frischid as fr
from frischid.errors import IdentifiabilityError
from frischid.estimators.normal_equations import NormalEquations
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.regression.accumulation import accumulate, streaming_qr
from frischid.regression.block import stack
from frischid.regression.regressor import Regressor
from frischid.regression.streaming_qr import SAFE_CONDITION, StreamingQR, solve
from frischid.regression.structure import structure

ROBOT = fr.Robot.load("planar2")


def rows_of(condition, count=4000, p=12, seed=0):
    """Rows of [Y τ] whose Y has a given condition number."""
    rng = np.random.default_rng(seed)
    U, V = (np.linalg.qr(rng.normal(size=shape))[0] for shape in ((count, p), (p, p)))
    Y = U @ np.diag(np.geomspace(1.0, 1.0 / condition, p)) @ V.T
    return np.column_stack([Y, Y @ rng.normal(size=p) + 1e-6 * rng.normal(size=count)])


@pytest.mark.parametrize("condition", [1e3, 1e5, 1e6])
def test_chunks_agree_with_one_dense_qr(condition):
    rows, which = rows_of(condition), np.arange(4000) % 3
    qr = StreamingQR(3, 12)
    for start in range(0, 4000, 128):
        part = slice(start, start + 128)
        for joint in range(3):
            qr.add(joint, rows[part][which[part] == joint])
    dense = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0]
    error = np.linalg.norm(qr.solve(np.ones(3)) - dense) / np.linalg.norm(dense)
    assert error < 1e-8
    moments = NormalEquations(rows.T @ rows, [f"x{i}" for i in range(12)]).theta if condition < 1e6 else None
    if condition == 1e5:  # what the moments lose there is why this exists
        assert np.linalg.norm(moments - dense) / np.linalg.norm(dense) > 100 * error


def test_an_arm_that_hardly_moves():
    """Small motions about one posture: the moments lose digits, identify notices and keeps them."""
    t = np.arange(6000) / 200.0
    rng = np.random.default_rng(0)
    phase = rng.uniform(0, 6, (2, 5))
    q = np.stack([sum(np.sin(2 * np.pi * 0.15 * (k + 1) * t + p) for k, p in enumerate(row)) for row in phase], axis=1)
    small = 0.4 + 0.003 * q
    effects = fr.parse_effects("viscous, offset")
    exact = Log(t, ROBOT.joints, small, tau=np.ones_like(small))
    lowpass = LowPass(8.0)
    (motion,) = prepare(exact, lowpass).motions
    regressor = Regressor(ROBOT, effects)
    reduction = structure(regressor, ROBOT.joints)
    theta = rng.normal(size=len(regressor.columns))
    tau = np.einsum("ncj,c->nj", regressor(motion.t, motion.q, motion.v, motion.a), theta)
    motion = type(motion)(**{**vars(motion), "tau": tau + 1e-3 * rng.normal(size=tau.shape)})
    blocks = list(regressor.blocks(motion, lowpass))
    Y, torque, _ = stack(blocks, ROBOT, ROBOT.joints)
    dense = solve(np.column_stack([Y[:, list(reduction.base)], torque]))
    base = list(reduction.base)
    scale = np.linalg.norm(Y[:, base], axis=0)
    condition = np.linalg.cond(Y[:, base] / scale)
    assert condition > SAFE_CONDITION
    streamed = streaming_qr(regressor, [motion], lowpass, ROBOT.joints, base).solve(np.ones(2))
    assert np.linalg.norm((streamed - dense) * scale) < 1e-8 * np.linalg.norm(dense * scale)
    whole = sum(g.select(base).weighted() for g in accumulate(regressor, [motion], lowpass, ROBOT.joints))
    try:
        moments = NormalEquations(whole, [c.name for c in reduction.base_columns()]).theta
    except IdentifiabilityError:
        return
    assert np.linalg.norm((moments - dense) * scale) > 1e-9 * np.linalg.norm(dense * scale)


def test_identify_says_when_it_had_to():
    log = fr.simulate(ROBOT, fr.random_fourier(ROBOT, 20.0, seed=3), rate=200, noise=fr.Noise(tau=0.01))
    found = fr.identify(ROBOT, [log], recursion="none")
    assert found.model.estimate.condition < SAFE_CONDITION
    assert not any("streaming QR" in note for note in found.notes)
    gentle = Log(log.t, log.joints, 0.3 + 0.004 * log.q, tau=log.tau)
    options = {"cutoff": 8.0, "recursion": "none", "prior": "none"}  # with the prior the problem is well conditioned
    again = fr.identify(ROBOT, [gentle], effects=fr.parse_effects("viscous, offset"), **options)
    assert again.model.estimate.condition > SAFE_CONDITION
    assert any("streaming QR" in note for note in again.notes)
