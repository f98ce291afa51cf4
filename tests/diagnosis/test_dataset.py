"""The motion cache of a diagnosis: the same results in memory and in a file, and no more memory for longer logs."""

import gc
import tracemalloc
from functools import cache

import numpy as np
import pytest

import frischid.core.array_store
from frischid.core.array_store import Series, Store
from frischid.diagnosis.addition import add
from frischid.diagnosis.block_test import block_gains
from frischid.diagnosis.candidate_fits import candidate_fits
from frischid.diagnosis.change_prior import weak_urdf_prior
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.motion_cache import MotionCache
from frischid.diagnosis.residual_variables import thinned, variables
from frischid.effects import BASELINE, EFFECTS, parse_effects
from frischid.logs.recording import Recording
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")
TRIED = ("joint_spring", "stribeck", "hysteresis", "thermal_drift")
BYTES = 8  # a sample at 200 Hz, in motions of 2000; rows and columns would be 300, torques alone 4


def log_of(seed: int, seconds: float = 20.0):
    effects = (*BASELINE, *parse_effects("joint_spring@joint2"))
    values = {"fv1": 0.2, "fv2": 0.2, "fc1": 0.3, "fc2": 0.3, "ks2": 1.5}
    motion = random_fourier(ARM, seconds, seed=seed)
    noise = Noise(q=1e-5, tau=0.01)
    return simulate(ARM, motion, rate=200.0, effects=effects, parameters=values, noise=noise, seed=seed, channels=())


@cache
def model():
    return identify(ARM, [log_of(1)], recursion="none").model


def in_pieces(log, samples=1500, times=1):
    def read(_):
        for k in range(times):
            for first in range(0, len(log) - 10, samples):
                piece = log.slice(first, min(first + samples, len(log)))
                yield piece if k == 0 else later(piece, k * (log.t[-1] - log.t[0] + log.t[1] - log.t[0]))

    return Recording(log.source, read)


def later(log, seconds):
    return type(log)(log.t + seconds, log.joints, log.q, tau=log.tau, source=log.source)


def test_a_file_gives_back_what_was_written():
    store, rng = Store(limit=1000), np.random.default_rng(0)
    arrays = [rng.normal(size=shape) for shape in [(10, 3), (50, 4), (0, 2), (7,), (300, 2)]]
    kept = [store.put(x) for x in arrays]
    assert [k.held is None for k in kept] == [False, True, False, False, True]
    for stored, x in zip(kept, arrays, strict=True):
        np.testing.assert_array_equal(stored.read(), x)
    assert store.written == arrays[1].nbytes + arrays[4].nbytes


def test_a_series_gives_back_what_was_appended():
    store, rng = Store(limit=1000), np.random.default_rng(0)
    series, arrays = Series(store), [rng.normal(size=(n, 2)) for n in (10, 100, 0, 7, 300)]
    for x in arrays:
        series.append(x)
    assert len(series) == len(arrays)
    for number, x in enumerate(arrays):
        np.testing.assert_array_equal(series[number], x)
    assert store.written == arrays[1].nbytes + arrays[4].nbytes


@pytest.mark.parametrize("limit", [0, 10**6])
def test_an_array_can_be_replaced(limit):
    store = Store(limit)
    kept, other = store.put(np.arange(6)), store.put(np.ones(4, bool))
    kept.replace(np.arange(6) ** 2)
    np.testing.assert_array_equal(kept.read(), np.arange(6) ** 2)
    np.testing.assert_array_equal(other.read(), np.ones(4, bool))
    assert other.read().dtype == bool


def test_thinning_does_not_see_the_parts():
    x = np.arange(1000)
    for every in (1, 3, 7, 400):
        np.testing.assert_array_equal(thinned(np.split(x, [5, 5, 320, 777]), every), x[::every])


def test_what_a_residual_depends_on_is_thinned_alike():
    validator = CrossValidator.of(model(), [log_of(1), log_of(2)], weak_urdf_prior(model()))
    whole, few = variables(validator, 1, 1), variables(validator, 1, 7)
    for name, x in whole.items():
        np.testing.assert_array_equal(few[name], x[::7])


def test_where_rows_are_kept_changes_nothing(monkeypatch):
    logs = [log_of(1), log_of(2)]
    here = diagnose(model(), logs, effects=TRIED)
    monkeypatch.setattr(frischid.core.array_store, "LIMIT", 0)
    there = diagnose(model(), logs, effects=TRIED)
    assert there.to_dict() == here.to_dict()
    assert here.findings[0].effect == "joint_spring"
    assert here.validator.data.cache.store.written == 0
    assert there.validator.data.cache.store.written > 0


def test_a_recording_says_what_its_log_says():
    logs = [log_of(1), log_of(2)]
    whole = diagnose(model(), logs, effects=TRIED, situation="always")
    # Given, because the model knows its own log but not a recording of the same samples.
    pieces = diagnose(model(), [in_pieces(log) for log in logs], effects=TRIED, situation="always")
    assert pieces.verdict == whole.verdict == "effect"
    first, again = whole.findings[0], pieces.findings[0]
    assert (again.effect, again.joints) == (first.effect, first.joints)
    assert again.parameters["ks2"] == pytest.approx(first.parameters["ks2"], rel=1e-3)
    assert pieces.error == pytest.approx(whole.error, rel=1e-3)
    np.testing.assert_allclose(pieces.validator.counts, whole.validator.counts, atol=5)


def test_moments_with_a_candidate_are_those_of_the_rows_with_its_columns():
    validator = CrossValidator.of(model(), [log_of(1), log_of(2)], weak_urdf_prior(model()))
    spring, drag, play = validator.candidates(
        parse_effects("joint_spring@joint2")
        + parse_effects("quadratic_viscous@joint1")
        + parse_effects("joint_spring@joint1")
    )
    cut = validator.without([(validator.data.sources[0], 3.0, 5.0)])
    assert cut.counts.sum() < validator.counts.sum()
    for start in (validator, cut):
        both = start.joined([spring, drag])
        assert len(both.signs) == 2
        now = start.extended(both).extended(play)
        base, k = len(start.theta), 3
        for row in range(len(now.joints)):
            found = np.zeros_like(now.columns.gram[:, row])
            for part in now.data.motions_of(row):
                Z = np.column_stack([*(now.columns.predicted(part, e) for e in np.eye(base + k)), part.tau])
                for fold, own in part.folds:
                    found[fold] += Z[own].T @ Z[own]
            np.testing.assert_allclose(now.columns.gram[:, row], found, rtol=1e-9, atol=1e-9 * np.abs(found).max())
        np.testing.assert_allclose(now.counts, start.counts)
        gains = block_gains(start, spring)
        assert len(gains.gain) == len(
            np.unique(np.concatenate([p.block for row in (0, 1) for p in start.data.motions_of(row)]))
        )
        assert gains.gain.sum() > 0
        assert (gains.energy >= 0).all()


def test_memory_hardly_grows(monkeypatch):
    """Rows and candidates' columns of a longer log go to the file; of every motion stay its name and places."""
    monkeypatch.setattr(frischid.core.array_store, "LIMIT", 0)
    log = log_of(1)
    peaks = []
    for times in (2, 8):
        known = model()
        tracemalloc.start()
        validator = CrossValidator.of(known, [in_pieces(log, 2000, times)], weak_urdf_prior(known))
        found = validator.candidates(parse_effects("joint_spring") + parse_effects("hysteresis(distance=0.01)"))
        assert validator.score(found[:1]) is not None
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / (6 * len(log)) < BYTES


def test_the_next_diagnosis_of_the_same_motions_has_the_columns_already():
    log, tried = log_of(1), parse_effects("joint_spring@joint1") + parse_effects("hysteresis(distance=0.01)@joint2")
    first = CrossValidator.of(model(), [log], weak_urdf_prior(model()))
    known = first.candidates(tried)
    better = add(model(), parse_effects("joint_spring@joint2"), [log]).model
    again = CrossValidator.of(better, [log], weak_urdf_prior(better))
    assert all(a is b for a, b in zip(known, again.candidates(tried), strict=True))
    other = CrossValidator.of(model(), [log_of(2)], weak_urdf_prior(model()))
    assert not any(a is b for a, b in zip(known, other.candidates(tried), strict=True))
    columns = [[series[0].copy() for series in c.columns.values()] for c in known]
    del first, again, known
    gc.collect()
    fresh = CrossValidator.of(better, [log], weak_urdf_prior(better)).candidates(tried)
    for candidate, before in zip(fresh, columns, strict=True):
        for series, x in zip(candidate.columns.values(), before, strict=True):
            np.testing.assert_array_equal(series[0], x)


def test_candidates_are_fitted_together_as_alone():
    validator = CrossValidator.of(model(), [log_of(1)], weak_urdf_prior(model()))
    effects = [e for name in EFFECTS for shapes in EFFECTS[name].candidates(ARM) for e in shapes[:2]]
    measured = validator.data.cache.channels
    candidates = [c for c in validator.candidates([e for e in effects if measured.issuperset(e.channels(ARM))])
                  if c.columns and c.finite]  # fmt: skip
    together = validator.fits(candidates)
    assert {len(c.signs) for c in candidates} >= {1, 2}
    for candidate, fits in zip(candidates, together, strict=True):
        (alone,) = candidate_fits(validator.fit, [validator.columns.moments(candidate)], [candidate])
        for one, other in zip(fits, alone, strict=True):
            assert (one is None) == (other is None)
            if one is not None:
                assert one.gain == pytest.approx(other.gain, rel=1e-9, abs=1e-9)
                np.testing.assert_allclose(one.beta, other.beta, rtol=1e-6, atol=1e-9)


def test_errors_are_shares_of_the_measured_torque():
    """The rows lack the torque of known parameters: with a known link, errors were up to eight times as large."""
    known = {name: dict(zip(ARM.all_names, ARM.nominal, strict=True))[name] for name in ("m2", "mx2")}
    found = identify(Robot.load("planar2", known=known), [log_of(1)], recursion="none").model
    validator = CrossValidator.of(found, [log_of(1)], weak_urdf_prior(found))
    assert validator.spread == pytest.approx([joint.std for joint in compare(found, [log_of(1)]).joints])


def test_logs_in_which_an_arm_rests_are_cut_like_a_single_log():
    """Of a torso with two arms only one moved in a log. No log left out could predict the other arm: 8 of 14 joints."""
    robot = Robot.load("ur5")
    both, one = (
        simulate(robot, random_fourier(robot, seconds, seed=seed), rate=50.0, seed=seed)
        for seed, seconds in ((1, 20.0), (2, 15.0))
    )
    q = np.array(one.q)
    q[:, :4] = q[0, :4]
    rests = type(one)(one.t, one.joints, q, tau=one.tau, source="one arm")
    fitted = identify(robot, [both, rests], recursion="none").model
    assert MotionCache(fitted, [both, rests], DIAGNOSIS_CRITERIA).folds == DIAGNOSIS_CRITERIA.folds_of_one_log
    assert MotionCache(fitted, [both, one], DIAGNOSIS_CRITERIA).folds == 2
    short = one.slice(0, len(one) // 5)
    assert MotionCache(fitted, [both, short], DIAGNOSIS_CRITERIA).folds == 2, "a short log leaves all joints alike"
