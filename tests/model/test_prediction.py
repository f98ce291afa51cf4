"""Predictions: rows are measured and modelled torque of the same samples, and the band is what the parameters allow."""

from dataclasses import replace
from functools import cache
from statistics import NormalDist

import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot

from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.model.fit_record import LEVELS
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
def test_the_band_is_as_wide_as_the_errors_that_were_left_out_of_the_fit(name):
    model, logs = case(name)
    seen = predict(model, logs)
    Y, fitted = rows_of(model, logs)
    uncertain = np.einsum("mpj,pr,mrj->mj", Y, model.estimate.covariance, Y)
    reach = model.fitted.scores[LEVELS.index(0.9)] * model.estimate.sigma
    half = np.sqrt(reach**2 + NormalDist().inv_cdf(0.95) ** 2 * model.fitted.model_share * uncertain)
    np.testing.assert_allclose(seen.fitted, fitted, rtol=1e-12)
    np.testing.assert_allclose(seen.upper - seen.fitted, half, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(seen.fitted - seen.lower, half, rtol=1e-9, atol=1e-12)
    used = seen.used
    assert np.std(seen.residual[used]) < 0.05 * np.std(seen.measured[used])


def test_the_band_holds_nine_tenths_of_a_log_that_was_never_fitted():
    model, logs = case("planar2")
    seen = predict(model, logs[1:])
    inside = (seen.measured >= seen.lower) & (seen.measured <= seen.upper)
    assert 0.85 <= inside[seen.used].mean() <= 0.97


def test_intervals_of_larger_shares_are_wider_and_a_joint_without_rows_has_those_of_a_normal_distribution():
    record = case("planar2")[0].fitted
    wider = [record.interval_reach(share) for share in (0.3, 0.6, 0.9, 0.97, 0.999)]
    assert (np.diff(wider, axis=0) > 0).all()
    unknown = replace(record, scores=np.full_like(record.scores, np.nan))
    np.testing.assert_allclose(unknown.interval_reach(0.95), 1.959964, rtol=1e-6)


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
