import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import exact_log, robot
from hypothesis import example, given, settings
from hypothesis import strategies as st

from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.logs.cutoff_choice import LogSpectra, choose_lowpass, spectra_of
from frischid.logs.derivatives import Derivatives
from frischid.logs.filters import (
    LowPass,
    correlate,
    decimate,
    decimating_filter,
    derivative_taps,
    noise_level,
    power_spectrum,
)
from frischid.logs.log import Log
from frischid.logs.poses import is_static
from frischid.logs.preprocessing import prepare
from frischid.logs.readers import read_log, write_log
from frischid.logs.standstill import find_standstill
from frischid.logs.time_grid import retimed
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

RATE = 100.0
T = np.arange(2000) / RATE
NONE = LowPass(None)


def log_of(t, q, **channels):
    return Log(t, ("j",), np.reshape(q, (-1, 1)), **{c: np.reshape(x, (-1, 1)) for c, x in channels.items()})


def motion_of(log, lowpass=NONE, **options):
    (motion,) = prepare(log, lowpass, **options).motions
    return motion


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


# ---- noise


@pytest.mark.parametrize("sigma", [1e-6, 1e-3, 2.0])
def test_noise_level_of_known_noise(sigma):
    rng = np.random.default_rng(0)
    smooth = np.c_[np.sin(3 * T), T**3 / 100, np.abs(T - 5)]
    np.testing.assert_allclose(noise_level(smooth + sigma * rng.normal(size=smooth.shape)), sigma, rtol=0.1)
    assert (noise_level(smooth) < 1e-6).all()


@pytest.mark.parametrize("sigma", [1e-6, 1e-3])
def test_the_noise_of_samples_at_uneven_times_is_not_their_motion(sigma):
    """With even steps in place of the stamps, a third of a step of jitter at 3 rad/s looks like 5 mrad of noise."""
    rng = np.random.default_rng(0)
    t = np.sort(T + rng.uniform(-0.3, 0.3, len(T)) * (T[1] - T[0]))
    smooth = np.c_[np.sin(3 * t), t**3 / 100, np.zeros_like(t)]
    np.testing.assert_allclose(noise_level(smooth + sigma * rng.normal(size=smooth.shape), t), sigma, rtol=0.1)
    assert noise_level(smooth, t)[2] == 0


def test_the_noise_of_a_velocity_behind_a_filter_is_not_the_rounding_of_numbers_at_rest():
    """At rest the filter of a drive halves the velocity with every sample, down to 1e-300."""
    moving = np.round(1e3 * np.sin(np.arange(400) / 30)) / 1e3 + 1e-4 * np.random.default_rng(2).normal(size=400)
    assert noise_level(np.concatenate([moving, 0.1 * 0.5 ** np.arange(1000)])) > 1e-5


def test_noise_level_is_not_fooled_by_outliers_and_sees_rare_steps():
    rng = np.random.default_rng(0)
    x = 1e-3 * rng.normal(size=2000)
    x[::100] += 5.0
    assert noise_level(x) == pytest.approx(1e-3, rel=0.3)
    rare = np.zeros(2000)
    rare[::50] = 1e-3  # quantised, mostly at rest
    assert 1e-5 < noise_level(rare) < 1e-3


# ---- derivatives


@pytest.mark.parametrize("cutoff", [None, 2.0, 10.0])
@settings(max_examples=20, deadline=None)
@given(coefficients=st.lists(st.floats(-5, 5), min_size=5, max_size=5))
@example([0.0, 0.0, 0.0, 0.0, 2.8447924545324963e-05])  # moves by 2 mrad in 3 s: at rest for most of them
def test_derivatives_of_quartics_are_exact(cutoff, coefficients):
    t = np.arange(300) / RATE
    polynomial = np.polynomial.Polynomial(coefficients)
    log = log_of(t, polynomial(t))
    motion = motion_of(log, LowPass(cutoff))
    if is_static(log):  # an arm at standstill, with nothing to derive
        assert not motion.v.any()
        assert not motion.a.any()
        return
    size = 1e-8 * (1 + np.abs(coefficients).sum())
    np.testing.assert_allclose(motion.v[:, 0], polynomial.deriv()(motion.t), atol=size)
    np.testing.assert_allclose(motion.a[:, 0], polynomial.deriv(2)(motion.t), atol=1e3 * size)


@pytest.mark.parametrize("cutoff", [1.0, 3.0, 8.0])
def test_derivatives_pass_everything_up_to_the_cutoff(cutoff):
    for frequency in (0.2 * cutoff, cutoff):
        w = 2 * np.pi * frequency
        motion = motion_of(log_of(T, np.sin(w * T)), LowPass(cutoff))
        assert rms(motion.v[:, 0] - w * np.cos(w * motion.t)) < 1e-2 * w
        assert rms(motion.a[:, 0] + w**2 * np.sin(w * motion.t)) < 2e-2 * w**2


def test_derivatives_leave_out_noise_far_above_the_cutoff():
    q = np.sin(2 * T) + 1e-4 * np.random.default_rng(0).normal(size=T.size)
    narrow, wide = (motion_of(log_of(T, q), LowPass(c)) for c in (1.0, 10.0))
    errors = [rms(m.a[:, 0] + 4 * np.sin(2 * m.t)) for m in (narrow, wide)]
    assert errors[0] < 0.1 * errors[1]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cutoff", [None, 0.5, 5.0, 50.0])
def test_derivative_weights_are_symmetric_in_time(order, cutoff):
    taps = derivative_taps(order, 1 / RATE, cutoff)
    np.testing.assert_allclose(taps[::-1], -taps if order == 1 else taps, atol=1e-9 * np.abs(taps).max())
    assert taps.sum() == pytest.approx(0.0, abs=1e-9 * np.abs(taps).sum())


def test_true_time_stamps_are_ten_times_better_than_their_mean():
    steps = np.tile([0.010, 0.012], 1000)
    t = np.concatenate([[0.0], np.cumsum(steps)])
    w = 2 * np.pi * 0.7
    true = motion_of(log_of(t, np.sin(w * t)), LowPass(5.0))
    mean = motion_of(log_of(np.linspace(0, t[-1], t.size), np.sin(w * t)), LowPass(5.0))
    errors = [rms(m.a[:, 0] + w**2 * np.sin(w * m.t)) / w**2 for m in (true, mean)]
    assert errors[0] < 1e-3
    assert errors[0] < 0.1 * errors[1]
    notes = prepare(log_of(t, np.sin(w * t)), LowPass(5.0)).notes
    assert any("steps between 10 and 12 ms" in n and "through the samples at their time stamps" in n for n in notes)


def test_uniform_stamps_are_left_alone():
    prepared = prepare(log_of(T, np.sin(T)), NONE)
    (motion,) = prepared.motions
    assert np.isin(motion.t, T).all()
    np.testing.assert_array_equal(motion.q[:, 0], np.sin(motion.t))
    assert not any("grid" in n for n in prepared.notes)


# ---- a clean log has no edges


@pytest.fixture(scope="module")
def clean():
    machine = robot("ur10")
    values = {f"{k}{i}": x / i for i in range(1, 7) for k, x in {"fv": 12.0, "fc": 9.0, "off": 0.3, "Ia": 1.0}.items()}
    return machine, values, exact_log(machine, BASELINE, values, 12.0, 500.0, seed=3, channels=())


def test_derived_accelerations_are_within_one_percent(clean):
    machine, _, log = clean
    assert log.v is None
    assert log.a is None
    motion = motion_of(log, choose_lowpass([log], log.joints))
    _, v, a = random_fourier(machine, 12.0, seed=3)(motion.t)
    for derived, true in ((motion.v, v), (motion.a, a)):
        error = np.sqrt(np.mean((derived - true) ** 2, axis=0) / np.mean(true**2, axis=0))
        assert (error < 0.01).all()
        # nothing at the ends either
        ends = np.abs(derived - true)[[0, 1, -2, -1]]
        assert (ends < 0.01 * np.abs(true).max(axis=0)).all()
    assert log.duration - 0.5 < motion.t[-1] - motion.t[0] < log.duration


def test_viscous_friction_comes_back_within_half_a_percent(clean):
    machine, values, log = clean
    e = identify(machine, [log]).model.estimate
    found = {c.name: x for c, x in zip(e.columns, e.theta, strict=True)}
    for i in range(1, 7):
        assert found[f"fv{i}"] == pytest.approx(values[f"fv{i}"], rel=0.005)


# ---- the parallel filter


@pytest.mark.parametrize("cutoff", [0.7, 3.0, 20.0])
def test_lowpass_has_zero_phase_and_unit_gain_at_rest(cutoff):
    taps = LowPass(cutoff).taps(1 / RATE)
    assert len(taps) % 2 == 1
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-15)
    assert taps.sum() == pytest.approx(1.0)
    n = np.arange(len(taps)) - len(taps) // 2

    def gain(f):
        return float(taps @ np.cos(2 * np.pi * f * n / RATE))

    assert gain(cutoff) == pytest.approx(0.5, abs=0.01)
    assert gain(0.4 * cutoff) == pytest.approx(1.0, abs=0.01)
    assert abs(gain(min(2.0 * cutoff, RATE / 2))) < 0.002


def test_lowpass_without_effect():
    assert LowPass(None).taps(0.01).tolist() == [1.0]
    assert LowPass(45.0).taps(0.01).tolist() == [1.0]
    assert LowPass(None).decimation(0.01) == LowPass(45.0).decimation(0.01) == 1
    # the edge: 0.4 times the rate
    assert len(LowPass(40.0).taps(0.01)) == 1 < len(LowPass(39.9).taps(0.01))


@pytest.mark.parametrize("cutoff", [0.0, -1.0, np.nan, np.inf])
def test_lowpass_wants_a_frequency(cutoff):
    with pytest.raises(InputError, match="positive frequency"):
        LowPass(cutoff)


@settings(max_examples=30, deadline=None)
@given(count=st.integers(1, 200), width=st.integers(0, 20), every=st.integers(1, 9))
def test_decimating_filter_is_convolution_at_every_nth_sample(count, width, every):
    rng = np.random.default_rng(count)
    taps, x = rng.normal(size=2 * width + 1), rng.normal(size=count)
    F = decimating_filter(taps, count, every)
    expected = np.correlate(x, taps, "valid")[::every] if count >= len(taps) else np.empty(0)
    np.testing.assert_allclose(F @ x, expected, atol=1e-12)
    np.testing.assert_allclose(decimate(taps, x[:, None], every)[:, 0], expected, atol=1e-12)


def test_decimation_keeps_what_the_filter_passes():
    for cutoff in (0.5, 2.0, 8.0):
        every = LowPass(cutoff).decimation(1 / RATE)
        assert every >= 1
        assert RATE / every >= 2 * 1.5 * cutoff  # Nyquist of where the filter stops


# ---- gaps


def test_gaps_split_a_log():
    t = np.concatenate([T[:800], T[800:] + 0.5])
    q = np.where(np.arange(T.size) < 800, np.sin(T), 5 + np.sin(T))  # jumps across the gap
    prepared = prepare(log_of(t, q), LowPass(5.0))
    first, second = prepared.motions
    assert first.t[-1] < t[799]
    assert second.t[0] > t[800]
    for m in prepared.motions:
        assert np.abs(m.v).max() < 1.1
        assert np.abs(m.a).max() < 1.2
    assert any("split at 1 gap in" in n and "0.51 s" in n for n in prepared.notes)


def test_stretches_shorter_than_the_filters_are_dropped_and_said():
    t = np.concatenate([T[:800], T[800:820] + 0.5, T[820:] + 1.0])
    prepared = prepare(log_of(t, np.sin(t)), LowPass(5.0))
    assert len(prepared.motions) == 2
    assert any("20 samples dropped in stretches shorter than the filters" in n for n in prepared.notes)
    assert any("s trimmed at the ends" in n for n in prepared.notes)
    with pytest.raises(InputError, match=r"no stretch.*raise the cut-off"):
        prepare(log_of(T[:30], np.sin(T[:30])), LowPass(1.0))


@pytest.mark.parametrize(("gap", "stretches"), [(0.045, 1), (0.08, 1), (0.12, 2)])
def test_a_gap_is_longer_than_a_tenth_of_the_cutoffs_period(gap, stretches):
    t = np.concatenate([T[:800], T[799] + gap + T[: T.size - 800]])
    assert len(prepare(log_of(t, np.sin(t)), LowPass(1.0)).motions) == stretches
    without = prepare(log_of(t, np.sin(t)), LowPass(None)).motions  # four steps are a gap
    assert len(without) == 2


def test_the_note_says_how_much_the_filters_do_not_see():
    t, lowpass = np.concatenate([T[:800], T[800:] + 0.5]), LowPass(5.0)
    prepared = prepare(log_of(t, np.sin(t)), lowpass)
    step = T[1] - T[0]
    seen = sum(len(m.t) - len(lowpass.taps(m.step)) + 1 for m in prepared.motions)
    (said,) = (float(n.split(": ")[1].split(" s ")[0]) for n in prepared.notes if "trimmed" in n)
    assert said == pytest.approx((len(t) - seen) * step, rel=0.1)


def test_one_lost_sample_is_no_gap():
    t = np.delete(T, 500)
    prepared = prepare(log_of(t, np.sin(t)), LowPass(5.0))
    (motion,) = prepared.motions
    np.testing.assert_allclose(motion.a[:, 0], -np.sin(motion.t), atol=1e-3)


# ---- measured derivatives


def test_late_velocity_is_not_used_and_its_lag_is_said():
    lag = 0.19
    log = log_of(T, np.sin(2 * T), v=2 * np.cos(2 * (T - lag)))
    prepared = prepare(log, LowPass(5.0))
    (motion,) = prepared.motions
    np.testing.assert_allclose(motion.v[:, 0], 2 * np.cos(2 * motion.t), atol=1e-3)
    (note,) = (n for n in prepared.notes if "measured velocity of j differs" in n)
    said = float(note.split("it lags ")[1].split(" s")[0])
    assert said == pytest.approx(lag, rel=0.1)


def test_measured_velocity_is_used_when_it_is_the_better_one():
    rng = np.random.default_rng(0)
    q = np.sin(2 * T) + 1e-3 * rng.normal(size=T.size)
    exact, noisy = 2 * np.cos(2 * T), 2 * np.cos(2 * T) + 0.3 * rng.normal(size=T.size)
    good, poor = (motion_of(log_of(T, q, v=v), LowPass(5.0)) for v in (exact, noisy))
    np.testing.assert_allclose(good.v[:, 0], 2 * np.cos(2 * good.t), atol=1e-12)
    assert rms(good.a[:, 0] + 4 * np.sin(2 * good.t)) < 1e-3
    derived = motion_of(log_of(T, q), LowPass(5.0))
    np.testing.assert_array_equal(poor.v, derived.v)
    forced = motion_of(log_of(T, q, v=noisy), LowPass(5.0), velocity="measured")
    assert np.isin(forced.v, noisy).all()
    ignored = motion_of(log_of(T, q, v=exact, a=0 * T), LowPass(5.0), velocity="derived")
    np.testing.assert_array_equal(ignored.v, derived.v)
    np.testing.assert_array_equal(ignored.a, derived.a)


def test_measured_acceleration_is_used_where_it_is_nearer_the_truth():
    wrong = log_of(T, np.sin(T), a=np.full(T.size, 7.0))
    assert (motion_of(wrong, LowPass(5.0), velocity="measured").a == 7.0).all()
    assert motion_of(wrong, LowPass(5.0)).a[:, 0] == pytest.approx(-np.sin(motion_of(wrong, LowPass(5.0)).t), abs=1e-3)
    rough = np.sin(T) + 1e-3 * np.random.default_rng(0).normal(size=T.size)
    exact = log_of(T, rough, a=-np.sin(T))
    motion = motion_of(exact, LowPass(5.0))
    assert (motion.a[:, 0] == np.interp(motion.t, T, -np.sin(T))).all()


def test_of_two_accelerations_the_one_with_less_error_is_taken():
    rng, sigma, count = np.random.default_rng(0), 1e-3, 20_000
    truth = np.sin(2 * np.arange(count) / RATE)[:, None]
    shares = np.array([0.4, 0.8, 1.25, 2.5])  # error of the measured acceleration over that of the derived one
    q = truth + sigma * rng.normal(size=(count, len(shares)))
    both = Derivatives(q, np.full_like(q, np.nan), 1 / RATE, LowPass(5.0))
    smooth = both.lowpass.taps(both.step)
    exact = -4 * truth[both.half : count - both.half]
    derived = np.std(correlate(smooth, both.a - exact), axis=0)
    measured = exact + rng.normal(size=both.a.shape) * shares * derived / np.linalg.norm(smooth)
    assert both.better(measured).tolist() == [True, True, False, False]


def test_unknown_choice_of_velocity():
    with pytest.raises(InputError, match="one of auto, measured, derived"):
        prepare(log_of(T, np.sin(T), v=np.cos(T)), NONE, velocity="best")
    with pytest.raises(InputError, match="one of auto, measured, derived"):
        prepare(log_of(T, np.sin(T)), NONE, velocity="best")


# ---- rest


def test_standstill():
    q = np.where(T < 5, 0.0, np.where(T < 10, np.sin(2 * (T - 5)), np.sin(10.0)))[:, None]
    q += 1e-5 * np.random.default_rng(0).normal(size=q.shape)
    v = np.gradient(q, 1 / RATE, axis=0)
    still = find_standstill(q, v, np.gradient(v, 1 / RATE, axis=0), 1 / RATE)[:, 0]
    assert still[T < 4.7].all()
    assert still[T > 10.3].all()
    assert not still[(T > 5.2) & (T < 9.8)].any(), "a reversal is no standstill"


@pytest.mark.parametrize("step", [0.002, 0.01, 0.04])
def test_a_joint_that_travels_a_millirad_in_half_a_second_holds_no_position(step):
    t = np.arange(0, 10, step)
    for travel, expected in ((0.8e-3, True), (1.25e-3, False)):  # rad within half a second
        v = np.full((t.size, 1), travel / 0.5)
        still = find_standstill(v * t[:, None], v, 0 * v, step)[:, 0]
        assert (still == expected)[(t > 1) & (t < 9)].all()


def test_a_short_pause_before_a_joint_turns_is_standstill():
    move = np.clip(T - 2.0, 0, 1) - np.clip(T - 3.3, 0, 1)  # there, 0.3 s of standstill, and back
    q = (move**3 * (10 - 15 * move + 6 * move**2))[:, None]
    v = np.gradient(q, 1 / RATE, axis=0)
    still = find_standstill(q, v, np.gradient(v, 1 / RATE, axis=0), 1 / RATE)[:, 0]
    assert still[(T > 3.05) & (T < 3.25)].all()
    assert not still[(T > 2.1) & (T < 2.9)].any()


# ---- the cut-off from the data


def test_cutoff_follows_the_motion():
    for frequency in (0.3, 1.0, 1.9):
        q = np.sin(2 * np.pi * frequency * np.arange(6000) / RATE)
        chosen = choose_lowpass([log_of(np.arange(6000) / RATE, q)], ["j"])
        assert 7 * frequency < chosen.cutoff < 20 * frequency
        assert "bandwidth" in chosen.reason


def test_cutoff_is_at_most_a_fifth_of_the_rate():
    q = np.sin(2 * np.pi * RATE / 20 * np.arange(6000) / RATE)  # ten times its bandwidth is half the rate
    assert choose_lowpass([log_of(np.arange(6000) / RATE, q)], ["j"]).cutoff == pytest.approx(RATE / 5)


def test_cutoff_is_lower_where_the_torque_is_noisy():
    machine = robot("ur10")
    quiet, loud = (
        choose_lowpass([exact_log(machine, BASELINE, seconds=20.0, noise=Noise(tau=share))], machine.joints)
        for share in (0.0, 1.0)
    )
    assert loud.cutoff < 0.8 * quiet.cutoff
    assert "the torque nears its noise" in loud.reason
    band = float(loud.reason.split("bandwidth is ")[1].split(" Hz")[0])
    assert loud.cutoff >= 0.95 * 4 * band


def coarse(bits, rate=200.0, **options):
    """A log of a 2-joint arm with encoders of so many steps per turn."""
    noise = Noise(q=0.3 * 2 * np.pi / 2**bits, quantum=2 * np.pi / 2**bits)
    return exact_log(robot("planar2"), BASELINE, seconds=24.0, rate=rate, noise=noise, **options)


def test_cutoff_is_lower_where_the_positions_are_noisy():
    fine, rough = (choose_lowpass([coarse(bits, channels=())], ["joint1", "joint2"]) for bits in (20, 12))
    assert rough.cutoff < 0.8 * fine.cutoff
    assert "noise of the positions" in rough.reason
    measured = choose_lowpass([coarse(12, channels=("a",))], ["joint1", "joint2"])
    assert measured.cutoff == fine.cutoff, "a measured acceleration holds no noise of the positions"


@pytest.mark.parametrize("bits", [11, 13])
def test_the_share_of_noise_is_that_of_the_filtered_acceleration(bits):
    """Against the difference of the accelerations of a noisy and a noise-free log, both through the filter."""
    noisy, clean = coarse(bits, channels=()), coarse(40, channels=())
    for cutoff in (4.0, 8.0):
        lowpass = LowPass(cutoff)
        a, exact = (correlate(lowpass.taps(m.step), m.a) for m in (motion_of(x, lowpass) for x in (noisy, clean)))
        power = np.mean((a - exact) ** 2, axis=0) / np.mean(exact**2, axis=0)
        said = [spectra_of(noisy, [name]).noise_share(cutoff) for name in noisy.joints]
        np.testing.assert_allclose(said, power / (1 + power), rtol=0.5)


def test_held_samples_and_single_lines_are_no_motion():
    """Positions of a 100 Hz loop logged at 400 Hz: held for four samples, with images of the motion at 100 Hz."""
    t = np.arange(0, 30, 0.0025)
    q = np.sin(2 * np.pi * 0.5 * (t // 0.01) * 0.01) + 1e-5 * np.random.default_rng(0).normal(size=t.size)
    chosen = choose_lowpass([log_of(t, q)], ["j"])
    assert chosen.cutoff <= 10 * 0.75
    assert float(chosen.reason.split("bandwidth is ")[1].split(" Hz")[0]) < 1.0


def test_two_motions_of_one_joint_are_both_its_bandwidth():
    slow, quick = np.sin(2 * np.pi * 0.3 * T), 0.05 * np.sin(2 * np.pi * 1.0 * T)
    noise = 1e-7 * np.random.default_rng(0).normal(size=T.size)
    chosen = choose_lowpass([log_of(T, slow + quick + noise)], ["j"])
    assert float(chosen.reason.split("bandwidth is ")[1].split(" Hz")[0]) == pytest.approx(1.0, abs=0.3)


def test_spectra_of_several_logs_add():
    logs = [coarse(bits, channels=()) for bits in (12, 14)]
    both = sum((spectra_of(log, log.joints) for log in logs), LogSpectra())
    assert len(both.joints) == 4
    assert both.rate == logs[0].rate
    assert both.lowpass() == choose_lowpass(logs, logs[0].joints)
    assert LogSpectra().noise_share(10.0) == 0.0


def test_cutoff_without_motion_or_torque():
    assert choose_lowpass([log_of(T, 1e-5 * np.sin(T))], ["j"]).cutoff == 5.0  # an arm at standstill
    noise = 0.01 * np.random.default_rng(0).normal(size=T.size)
    assert choose_lowpass([log_of(T, noise)], ["j"]).cutoff is None
    alone = choose_lowpass([log_of(T, np.sin(T))], ["j"])
    both = Log(T, ("j", "k"), np.c_[np.sin(T), np.sin(T)], tau=np.c_[np.full(T.size, np.nan), np.sin(T)])
    assert alone.cutoff == choose_lowpass([both], ["j", "k"]).cutoff


@pytest.mark.parametrize("pattern", ["ur10e/logs/ident_*", "panda/logs/ident*", "tiago/logs/ident*"])
def test_cutoff_of_measured_logs(pattern):
    if not (folder := os.environ.get("FRISCHID_DATA")):
        pytest.skip("FRISCHID_DATA is not set")
    paths = sorted(Path(folder).glob(f"{pattern}.parquet"))
    assert paths
    logs = [read_log(path) for path in paths]
    chosen = choose_lowpass(logs, [j for j in logs[0].joints if j.startswith(("panda", "arm", *"sew"))])
    assert 1.0 <= chosen.cutoff <= 12.0


def sines(t):
    return np.stack([np.sin(2.1 * t) + 0.4 * np.sin(5.3 * t), np.cos(1.7 * t)], axis=1)


def two_joints(stamps, t):
    noise = 1e-6 * np.random.default_rng(1).normal(size=(len(t), 2))
    return Log(stamps, ("a", "b"), sines(t) + noise, tau=sines(t), source="busy")


def test_stamps_of_a_busy_computer_are_replaced_by_a_regular_clock():
    t = np.delete(T, [300, 301, 900])  # lost samples stay lost
    log = two_joints(t + np.random.default_rng(0).uniform(-0.002, 0.002, len(t)), t)
    cutoff = choose_lowpass([log], log.joints)
    assert cutoff.cutoff == choose_lowpass([two_joints(t, t)], log.joints).cutoff
    found = prepare(log, cutoff)
    assert any("the samples were taken at a regular 10 ms" in note for note in found.notes)
    (motion,) = found.motions
    expected = -(2.1**2) * np.sin(2.1 * motion.t) - 0.4 * 5.3**2 * np.sin(5.3 * motion.t)
    assert rms(motion.a[:, 0] - expected) < 0.02 * rms(expected)


def test_stamps_that_the_positions_follow_are_kept():
    t = T + np.random.default_rng(0).uniform(-0.002, 0.002, len(T))
    log = two_joints(t, t)
    assert retimed(log) is log
    still = Log(t, ("a",), np.zeros((len(t), 1)), source="still")
    assert retimed(still) is still


@pytest.mark.parametrize("noise", [0.0, 2e-5])
def test_joints_that_are_jogged_one_after_another_tell_the_clock(noise):
    """Most joints rest most of the time. The median joint had no noise with any clock, so no clock was better."""
    rng, t = np.random.default_rng(0), 0.008 * np.arange(5000)
    stamps = t + 0.0006 * rng.normal(size=len(t))

    def jogged(times):  # each of three joints moves for an eighth of the time
        begins = 5.0 * np.arange(8)
        turns = [0.3 * (1 - np.cos(np.pi * np.clip((times - b) / 5.0, 0, 1))) * (-1) ** k for k, b in enumerate(begins)]
        return np.column_stack([turns[j] + turns[j + 4] for j in range(3)]) + noise * rng.normal(size=(len(times), 3))

    regular = Log(stamps, ("a", "b", "c"), np.round(jogged(t), 6))
    assert np.abs(retimed(regular).t - t).max() < 1e-4
    true = Log(stamps, ("a", "b", "c"), np.round(jogged(stamps), 6))
    assert retimed(true) is true


@pytest.mark.parametrize("lost", [0.0, 0.01])
@pytest.mark.parametrize("jitter", ["uniform", "late", "normal"])
def test_large_jitter_is_no_lost_sample(jitter, lost):
    """Steps of more than one and a half had counted as two: the clock was ten times farther off than the stamps."""
    rng, t = np.random.default_rng(1), 0.01 * np.arange(2001)
    t = t[rng.random(len(t)) >= lost]
    late = {
        "uniform": rng.uniform(-0.3, 0.3, len(t)),
        "late": np.minimum(rng.exponential(0.15, len(t)), 0.9),
        "normal": rng.normal(0.0, 0.1, len(t)),
    }[jitter]
    stamps = np.sort(t + 0.01 * late)
    off = retimed(Log(stamps, ("a",), np.sin(3 * t)[:, None])).t - t
    # beside a loss, a jitter of a third of a step leaves no sure count: the clock is then no worse than the stamps
    assert off.std() <= (1.0 if lost else 0.1) * (stamps - t).std()


def test_a_clock_that_the_stamps_leave_for_long_is_none():
    """Rows that repeat others (5 %) are no samples of a regular clock, and many samples are lost (8 %)."""
    rng, t = np.random.default_rng(0), 0.001 * np.arange(20000)
    rows = np.sort(np.append(rng.choice(len(t), 18400, replace=False), rng.choice(len(t), 1000, replace=False)))
    stamps = np.sort(t[rows] + 4e-4 * rng.random(len(rows))) + 1e-9 * np.arange(len(rows))
    off = retimed(Log(stamps, ("a",), np.sin(3 * t[rows])[:, None])).t - t[rows]
    assert off.std() < 2 * (stamps - t[rows]).std()


def test_the_clock_of_each_stretch_is_judged_without_the_gap_between_them():
    """Across an hour's gap nothing was sampled: there is no noise to compare, and no memory for samples in it."""
    t = np.concatenate([0.001 * np.arange(900), 3600.0004 + 0.001 * np.arange(600)])
    stamps = t + 1e-4 * np.random.default_rng(0).uniform(-1, 1, len(t))
    regular = Log(stamps, ("a",), np.sin(9 * t)[:, None])
    assert np.abs(retimed(regular).t - t).max() < 5e-5
    true = Log(stamps, ("a",), np.sin(9 * stamps)[:, None])
    assert retimed(true) is true


@pytest.mark.parametrize(("cutoff", "rate"), [(5.0, 1000.0), (20.0, 125.0), (0.5, 100.0), (60.0, 500.0)])
def test_filters_equal_those_of_scipy(cutoff, rate):
    """They are written out, because scipy.signal takes too long to import."""
    from scipy import signal

    step, taps = 1 / rate, LowPass(cutoff).taps(1 / rate)
    length, beta = signal.kaiserord(60.0, min(cutoff, rate / 2 - cutoff) * 2 / rate)
    np.testing.assert_allclose(taps, signal.firwin(length | 1, cutoff, window=("kaiser", beta), fs=rate), atol=1e-15)
    for order in (1, 2):
        found = derivative_taps(order, step, cutoff)
        there = signal.savgol_coeffs(len(found), 4, deriv=order, delta=step, use="dot")
        np.testing.assert_allclose(found, there, atol=1e-13 * np.abs(there).max())
    for samples in (len(taps), len(taps) + 1, 3 * len(taps), 40 * len(taps) + 7):
        x = np.random.default_rng(0).normal(size=(samples, 3))
        there = signal.oaconvolve(x, taps[::-1, None], mode="valid", axes=0)
        np.testing.assert_allclose(correlate(taps, x), there, atol=1e-13)
    assert correlate(taps, x[: len(taps) - 1]).shape == (0, 3)


@pytest.mark.parametrize(("samples", "window"), [(1000, 256), (1000, 255), (333, 333)])
def test_a_power_spectrum_is_that_of_welch(samples, window):
    from scipy import signal

    x = np.random.default_rng(0).normal(size=(samples, 3)) + 0.1 * np.arange(samples)[:, None]
    f, power = power_spectrum(x, 0.005, window)
    there = signal.welch(x, 200.0, nperseg=window, detrend="linear", axis=0)
    np.testing.assert_allclose(f, there[0])
    np.testing.assert_allclose(power, there[1], rtol=1e-8)


@pytest.mark.parametrize("words", [["check"], ["identify", "-o", "model.json"]])
def test_reading_a_log_needs_no_package_that_imports_slowly(words, tmp_path):
    """`scipy.signal` imports all of `scipy.stats`: more than half a second of each command."""
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 8.0, seed=1), rate=100.0, noise=Noise(q=1e-5, tau=0.05))
    write_log(log, tmp_path / "log.csv")
    code = (
        "import sys\nfrom frischid.cli import main\n"
        f"main({[words[0], 'planar2', 'log.csv', *words[1:]]!r}, standalone_mode=False)\n"
        "assert not {'scipy.signal', 'scipy.stats'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True)


def test_a_gap_of_days_costs_nothing_and_does_not_move_the_cutoff():
    """The spectra had held the gap too: a spline through the night, of as many samples as the night has."""
    t = 0.01 * np.arange(3000)
    q = np.column_stack([np.sin(2 * np.pi * 0.5 * t), np.cos(2 * np.pi * 0.7 * t)])
    rng = np.random.default_rng(0)
    q = q + 1e-5 * rng.standard_normal(q.shape)
    tau = q + 1e-3 * rng.standard_normal(q.shape)
    parts = [Log(t[k], ("a", "b"), q[k], tau=tau[k], source="part") for k in (slice(0, 1500), slice(1500, 3000))]
    stamps = np.concatenate([t[:1500], t[1500:] + 1e9])  # thirty years: no memory holds such a grid
    night = Log(stamps, ("a", "b"), q, tau=tau, source="night")
    assert choose_lowpass([night], ("a", "b")).cutoff == choose_lowpass(parts, ("a", "b")).cutoff


# ---- a torque that is late


@pytest.mark.parametrize("lag", [0.5, -0.5])
def test_no_torque_is_made_up_where_the_log_ends(lag):
    """The torque of the last half second was recorded after the log; it had been taken as constant there."""
    motion = motion_of(log_of(T, np.sin(T), tau=np.sin(T - lag)), LowPass(20.0, torque_lag=lag))
    assert T[0] <= motion.t[0] + lag
    assert motion.t[-1] + lag <= T[-1] + 1e-9
    np.testing.assert_allclose(motion.tau[:, 0], np.sin(motion.t), atol=1e-6)


def test_notes_say_what_is_done_to_a_log_with_a_gap():
    """The gap of 5 s had been among the steps that are interpolated, and two samples more than lost were trimmed."""
    t = np.arange(2000) * 0.01 + 0.002 * np.random.default_rng(0).uniform(-1, 1, 2000)
    log = Log(np.where(np.arange(2000) > 1000, t + 5, t), ("a",), np.sin(2 * t)[:, None], source="log")
    prepared = prepare(log, LowPass(None))
    (steps,) = (note for note in prepared.notes if "steps between" in note)
    assert "and 14 ms" in steps or "and 13.9 ms" in steps, steps
    regular = Log(np.arange(500) * 0.1, ("a",), np.sin(0.02 * np.arange(500))[:, None])
    (motion,), notes = (found := prepare(regular, LowPass(None))).motions, found.notes
    (trimmed,) = (float(note.split(": ")[1].split(" s ")[0]) for note in notes if "trimmed" in note)
    assert trimmed == pytest.approx(0.1 * (500 - len(motion.t)))


@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0, 4.0])
def test_a_joint_that_is_sampled_slowly_moves(rate):
    """Half a second held one sample of a log of 2 Hz, which has no range: the whole log was at standstill."""
    t = np.arange(0.0, 600.0, 1 / rate)
    w = 2 * np.pi / 60
    q = np.where(t < 300, np.sin(w * t), 0.0)[:, None]
    v, a = np.where(t < 300, w * np.cos(w * t), 0.0)[:, None], np.where(t < 300, -(w**2) * np.sin(w * t), 0.0)[:, None]
    found = find_standstill(q, v, a, 1 / rate)[:, 0]
    assert found[t > 305].all()
    assert found[t < 295].mean() < 0.1
