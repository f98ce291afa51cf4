"""Predictions: rows are measured and modelled torque of the same samples, and the band is what the parameters allow."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot

from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.estimators.frisch import Box
from frischid.model.prediction import predict
from frischid.motions.simulation import Noise


@cache
def case(name):
    machine = robot(name)
    logs = [
        exact_log(machine, BASELINE, random_values(machine, BASELINE), noise=Noise(tau=0.02), seed=k) for k in (1, 2)
    ]
    return quick(machine, logs[:1]).model, logs


def rows_of(model, logs):
    """Base rows (M, p, J) and whole fitted torque (M, J), block after block."""
    base, index = list(model.base), model.torque_index
    pairs = [(block, fitted) for log in logs for block, fitted in model.blocks([log])]
    Y = np.concatenate([block.Y[:, base][:, :, index] for block, _ in pairs])
    return Y, np.concatenate([(fitted + block.known)[:, index] for block, fitted in pairs])


@pytest.mark.parametrize("name", ["planar2", "planar2 far_end known"])
def test_the_band_is_the_error_to_expect_of_90_percent(name):
    model, logs = case(name)
    seen = predict(model, logs)
    Y, fitted = rows_of(model, logs)
    spread = np.sqrt(np.einsum("mpj,pr,mrj->mj", Y, model.estimate.covariance, Y) + model.estimate.sigma**2)
    np.testing.assert_allclose(seen.fitted, fitted, rtol=1e-12)
    np.testing.assert_allclose(seen.upper - seen.fitted, 1.6448536269514722 * spread, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(seen.fitted - seen.lower, 1.6448536269514722 * spread, rtol=1e-9, atol=1e-12)
    used = seen.used
    assert np.std(seen.residual[used]) < 0.05 * np.std(seen.measured[used])


def test_the_band_of_a_box_holds_every_corner():
    model, logs = case("planar2 far_end known")
    theta = model.estimate.theta
    rng = np.random.default_rng(0)
    below, above = rng.uniform(0.01, 0.1, (2, len(theta)))
    box = Box(tuple(c.name for c in model.estimate.columns), theta - below, theta + above)
    seen = predict(replace(model, bounds={**model.bounds, "sensorwise": box}), logs)
    Y, fitted = rows_of(model, logs)
    corners = theta + np.where(rng.random((200, len(theta))) < 0.5, -below, above)
    torques = fitted + np.einsum("kp,mpj->kmj", corners - theta, Y)
    assert (torques <= seen.upper + 1e-9).all()
    assert (torques >= seen.lower - 1e-9).all()
    reach = np.einsum("mpj,p->mj", np.maximum(Y, 0), above) + np.einsum("mpj,p->mj", np.maximum(-Y, 0), below)
    np.testing.assert_allclose(seen.upper - fitted, reach, rtol=1e-9, atol=1e-12)


def test_samples_know_their_log():
    model, (first, second) = case("planar2")
    late = replace(second, t=second.t + 100.0)
    seen = predict(model, [first, late])
    assert seen.starts == (first.t[0], late.t[0])
    for number, log in enumerate((first, late)):
        t = seen.t[seen.log == number]
        assert (t >= 0.0).all()
        assert (t <= log.t[-1] - log.t[0]).all()
    with pytest.raises(InputError, match="no log"):
        predict(model, [])
