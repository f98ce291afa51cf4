"""Zero-phase filters: the parallel low-pass, differentiators, and the noise that they leave.

    F τ = (F Y) θ + F e

The *parallel filter* F is applied to the torque and to every regressor column, so it removes noise without biasing θ
(Gautier 1997). F is a windowed-sinc low-pass. A missing q̇ or q̈ is a local quartic fit, ``q̇ = Σ_k d_k q_{i+k}``,
wide enough to pass five times the cut-off of F, so that F alone shapes the spectrum.

All filters are finite and symmetric in time: nothing is delayed, and it is known exactly which samples at the ends lack
neighbours for the filter. They are written out here, because `scipy.signal` takes longer to import than a log takes to
be evaluated.

References: M. Gautier, "Dynamic identification of robots with power model", ICRA 1997; A. Savitzky and M. Golay,
Analytical Chemistry 36(8), 1964; R. Schafer, "What is a Savitzky-Golay filter?", IEEE Signal Processing Magazine 28(4),
2011.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg, sparse, special

from frischid.core.bursts import robust_std
from frischid.core.types import Array
from frischid.errors import InputError

DERIVATIVE_BAND = 5.0
"""A differentiator passes frequencies up to this many times the cut-off; above, there is only noise."""
QUARTIC = 4
"""Degree of the local polynomial of a differentiator, and order of the differences that measure noise."""


LONGEST_FILTER = 10_000_000  # samples: 80 MB, nearly three hours at 1 kHz
STOP_BAND = 60.0
"""Attenuation of the low-pass in its stop band, dB."""
HIGHEST_CUTOFF = 0.4
"""Share of the sampling rate from which a cut-off filters nothing: below half the rate, no room is left to filter."""
BLOCK_OF_TAPS = 8  # length of a block over that of a filter: a block costs N log N, and begins with K − 1 lost outputs


@dataclass(frozen=True)
class LowPass:
    """The zero-phase filter applied to torque and regressor columns alike.

    Raises
    ------
    InputError
        The cut-off is not a positive frequency, or the lag is no time.

    Examples
    --------
    >>> from frischid.logs.filters import LowPass
    >>> lowpass = LowPass(5.0)
    >>> taps = lowpass.taps(step=0.001)
    >>> len(taps) % 2, round(float(taps.sum()), 12), lowpass.decimation(step=0.001)
    (1, 1.0, 66)
    """

    cutoff: float | None
    """Frequency of half amplitude, Hz; None: nothing is filtered. Nor are samples for whose rate the cut-off is too
    high (`HIGHEST_CUTOFF`)."""
    reason: str = "given by the user"
    """Reason for this cut-off."""
    torque_lag: float = 0.0
    """Time by which the recorded torque is late, s: the torque of the motion at t was recorded at t + `torque_lag`."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.torque_lag):
            raise InputError(f"the torque's lag must be a time in s, got {self.torque_lag}")
        if self.cutoff is not None and not (np.isfinite(self.cutoff) and self.cutoff > 0):
            raise InputError(f"the cut-off must be a positive frequency in Hz, got {self.cutoff}")

    @property
    def lag_in_words(self) -> str:
        """The treatment of a torque that was recorded late or early, in words; empty where it is taken as recorded."""
        if not self.torque_lag:
            return ""
        way = "late" if self.torque_lag > 0 else "early"
        return f"the recorded torque counts as {1e3 * abs(self.torque_lag):.3g} ms {way}"

    @property
    def lag_of_a_record(self) -> str:
        """Advice for comparing a recorded torque with one that is in time; empty where a record needs no shift."""
        if not self.torque_lag:
            return ""
        way, shift = ("late", "ahead") if self.torque_lag > 0 else ("early", "back")
        late = f"{1e3 * abs(self.torque_lag):.3g} ms"
        return (
            f"the torque is that of the motion at the same instant; the logs recorded it {late} {way}. To replay or "
            f"compare a recorded torque, read the record {late} {shift}"
        )

    def taps(self, step: float) -> Array:
        """Symmetric impulse response for samples `step` seconds apart, of odd length and sum 1."""
        if self.cutoff is None or self.cutoff >= HIGHEST_CUTOFF / step:
            return np.ones(1)
        width = min(self.cutoff, 0.5 / step - self.cutoff) * 2 * step  # of the transition, as a share of Nyquist's
        length = int(np.ceil((STOP_BAND - 7.95) / (2.285 * np.pi * width) + 1))  # Kaiser's formula
        check_length(length, self.cutoff, step)
        return _windowed_sinc(length | 1, 2 * self.cutoff * step)

    def decimation(self, step: float) -> int:
        """Samples per kept sample: the filter stops at 1.5 times the cut-off, so three samples per period suffice."""
        return 1 if len(self.taps(step)) == 1 else max(1, int(1 / (3 * step * float(self.cutoff or 1))))


def _windowed_sinc(length: int, cutoff: float) -> Array:
    """Low-pass of odd length and sum 1; its cut-off is a share of the Nyquist frequency.

    The sinc is the ideal low-pass, and Kaiser's window I₀(β sqrt(1 − x²)) / I₀(β) ends it.
    Source: Oppenheim and Schafer, Discrete-Time Signal Processing, 1989, section 7.4.3.
    """
    middle = (length - 1) / 2.0
    n = np.arange(length) - middle
    beta = 0.1102 * (STOP_BAND - 8.7)
    window = special.i0(beta * np.sqrt(1 - (n / middle) ** 2)) / special.i0(beta)
    taps = cutoff * np.sinc(cutoff * n) * window
    return np.asarray(taps / taps.sum())


def check_length(samples: float, cutoff: float, step: float) -> None:
    """Refuse a filter that no log is longer than, before memory is asked for it.

    Raises
    ------
    InputError
        The cut-off is too low for samples `step` seconds apart.
    """
    if samples > LONGEST_FILTER:
        raise InputError(
            f"a cut-off of {cutoff:g} Hz on samples {step:g} s apart needs a filter of {samples:.1g} samples, above "
            f"{LONGEST_FILTER:g}; raise the cut-off"
        )


def derivative_taps(order: int, step: float, cutoff: float | None) -> Array:
    """Savitzky-Golay weights of a zero-phase derivative that passes `DERIVATIVE_BAND` times the cut-off.

    The half length follows Schafer 2011, eq. 12.

    Parameters
    ----------
    order : {1, 2}
        Order of the derivative.
    step : float
        Time between samples, s.
    cutoff : float or None
        Cut-off of the low-pass, Hz; None: the shortest differentiator.

    Returns
    -------
    ndarray, shape (2 half + 1,)
        Weights for `correlate`.
    """
    half = 3
    if cutoff is not None:
        share_of_nyquist = min(1.0, DERIVATIVE_BAND * cutoff * 2 * step)
        half = max(half, round(((QUARTIC + 1) / share_of_nyquist + 4.6) / 3.2))
        check_length(2 * half + 1, cutoff, step)
    return polynomial_taps(half, QUARTIC, order, step)


def polynomial_taps(half: int, degree: int, order: int, step: float = 1.0) -> Array:
    """Savitzky-Golay weights (2 half + 1,) of a derivative of order 1 or 2 of a local polynomial."""
    powers = np.arange(-half, half + 1.0) ** np.arange(degree + 1.0)[:, None]
    wanted = np.zeros(degree + 1)
    wanted[order] = order / step**order  # the derivative of that order at zero of 1, x, x²
    return np.asarray(linalg.lstsq(powers, wanted)[0])


def correlate(taps: Array, x: Array) -> Array:
    """``Σ_k taps_k x_{i+k}`` along the first axis, for every i whose samples all exist: (N, ...) -> (N − K + 1, ...).

    By overlap-save: each block of samples begins with the K − 1 last ones of the block before, and is convolved by a
    fast Fourier transform.
    """
    K, outputs = len(taps), len(x) - len(taps) + 1
    if K == 1 or outputs <= 0:
        return np.asarray(taps[0] * x[: max(outputs, 0)])
    size = fft.next_fast_len(min(BLOCK_OF_TAPS * K, len(x)), real=True)
    step = size - K + 1
    blocks = -(-outputs // step)
    padded = np.concatenate([x, np.zeros((blocks * step + K - 1 - len(x), *x.shape[1:]))])
    windows = np.lib.stride_tricks.sliding_window_view(padded, size, axis=0)[::step]  # (blocks, ..., size)
    found = fft.irfft(fft.rfft(windows) * fft.rfft(taps[::-1], size), size)[..., K - 1 :]
    return np.ascontiguousarray(np.moveaxis(found, -1, 1).reshape(blocks * step, *x.shape[1:])[:outputs])


def decimating_filter(taps: Array, samples: int, decimation: int) -> sparse.csr_array:
    """Filter and keep every `decimation`-th output, as a sparse matrix (outputs, samples) to apply to many columns."""
    outputs = (samples - len(taps)) // decimation + 1
    if outputs <= 0:
        return sparse.csr_array((0, samples))
    first = decimation * np.arange(outputs)
    columns = (first[:, None] + np.arange(len(taps))).ravel()
    return sparse.csr_array(
        (np.tile(taps, outputs), columns, len(taps) * np.arange(outputs + 1)), shape=(outputs, samples)
    )


def decimate(taps: Array, x: Array, decimation: int) -> Array:
    """The same outputs of one channel array of any length, without a matrix: (N, J) -> (outputs, J).

    The matrix of `decimating_filter` is faster on short chunks of many columns. Its memory grows with the samples.
    """
    if len(x) < len(taps):
        return np.zeros((0, *x.shape[1:]))
    windows = np.lib.stride_tricks.sliding_window_view(x, len(taps), axis=0)[::decimation]
    return np.asarray(np.einsum("...k,k->...", windows, taps))


def power_spectrum(x: Array, step: float, window: int) -> tuple[Array, Array]:
    """Power spectral density by Welch's method: windows of Hann that overlap by half, each without its linear trend.

        P(f) = 2 step / Σ w² · mean over windows |FFT(w (x − trend))|²

    Source: Welch 1967, IEEE Trans. Audio and Electroacoustics 15(2).

    Parameters
    ----------
    x : ndarray, shape (N, J)
        Uniformly sampled channels.
    step : float
        Time between samples, s.
    window : int
        Samples of a window, at most N.

    Returns
    -------
    f : ndarray, shape (F,)
        Hz.
    power : ndarray, shape (F, J)
        Unit of x squared, per Hz; one-sided.
    """
    place = np.arange(window) - (window - 1) / 2.0
    trend = np.stack([np.ones(window), place])
    trend /= np.maximum(np.linalg.norm(trend, axis=1, keepdims=True), 1e-300)
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(window) / window)
    starts = range(0, len(x) - window + 1, window - window // 2)
    total = np.zeros((window // 2 + 1, x.shape[1]))
    for start in starts:
        part = x[start : start + window]
        lines = fft.rfft(hann[:, None] * (part - trend.T @ (trend @ part)), axis=0)
        total += lines.real**2 + lines.imag**2
    power = total * (step / (hann @ hann) / len(starts))
    power[1 : (window + 1) // 2] *= 2.0  # all but zero and, of an even window, the highest frequency
    return fft.rfftfreq(window, step), power


def noise_level(x: Array, t: Array | None = None) -> Array:
    """Standard deviation of the white noise on sampled channels.

    Fourth differences cancel a motion that is smooth over five samples and keep ``Σ c² = 70`` times the noise variance.
    Jerks and reversals hardly change the median of their absolute values. Of samples at uneven times, these are divided
    differences, with ``c_i = Π_{j≠i} 1 / (t_i − t_j)``.

    Parameters
    ----------
    x : ndarray, shape (N, ...)
    t : ndarray, shape (N,), optional
        Times of the samples, s; even ones if not given.

    Returns
    -------
    ndarray, shape (...)
    """
    fourth = fourth_differences(x) if t is None else _divided_differences(x, t)
    spread = robust_std(fourth)
    # Most differences of a quantised channel at standstill are zero: only the others show its noise. A velocity
    # behind a drive's filter runs out instead, to less than any sensor resolves.
    nothing = np.finfo(float).eps ** 2 * np.max(np.abs(x), axis=0, initial=0.0)
    return np.asarray(np.where(spread > nothing, spread, np.std(fourth, axis=0)))


def fourth_differences(x: Array) -> Array:
    """Fourth differences of even samples (N, ...), with weights of unit norm: white noise keeps its variance."""
    return np.asarray(np.diff(x, n=QUARTIC, axis=0) / np.sqrt(70.0))


def _divided_differences(x: Array, t: Array) -> Array:
    """Fourth divided differences with weights of unit norm, (N - 4, ...)."""
    times = np.lib.stride_tricks.sliding_window_view(t, QUARTIC + 1)
    apart = (times[:, :, None] - times[:, None, :]) / np.ptp(times, axis=1)[:, None, None] + np.eye(QUARTIC + 1)
    weights = 1 / apart.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1)[:, None]
    values = np.lib.stride_tricks.sliding_window_view(x, QUARTIC + 1, axis=0)
    steady = values - values[..., :1]  # of equal samples, the difference is zero exactly
    return np.asarray(np.einsum("nk,n...k->n...", weights, steady))
