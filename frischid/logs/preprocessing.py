"""From recorded samples to motion: real time stamps, zero-phase derivatives, one low-pass for everything.

Three linear steps, each symmetric in time so that nothing is delayed:

1. cubic splines through the samples at their *true* time stamps put every channel on a uniform grid of step h;
2. missing q̇ and q̈ are local quartic fits (Savitzky and Golay 1964), ``q̇ = Σ_k d_k q_{i+k}``, wide enough to pass
   five times the cut-off, so that step 3 alone shapes the spectrum;
3. the *parallel filter* F, a windowed-sinc low-pass, goes over τ and over every regressor column before decimation,
   ``F τ = (F Y) θ + F e`` (Gautier 1997): it removes noise without biasing θ, because both sides see the same F.

All filters are finite, so the samples a filter cannot fully see are known exactly. They are dropped and counted;
no end is padded. A gap in the stamps ends one stretch of motion and begins another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal, sparse
from scipy.interpolate import make_interp_spline

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import STANDSTILL_SPAN, Log

DERIVATIVE_BAND = 5.0  # derivatives pass this many times the cut-off; beyond it only noise is left
QUARTIC = 4
VELOCITIES = ("auto", "measured", "derived")
CREEPING = 0.01  # a joint slower than this for a while is not under way, rad/s (m/s)
UNMOVED, PAUSE = 0.2, 0.1  # share of the acceleration before and after, and least time, s: rest between two motions
ALIKE = 1e-3  # of the acceleration: measured and derived ones that differ by less are the same
LATE_VELOCITY = 0.05  # measured q̇ that differs from dq/dt by more than this share is not used


@dataclass(frozen=True)
class LowPass:
    """The zero-phase filter applied to torque and regressor columns alike.

    Attributes
    ----------
    cutoff : float or None
        Frequency of half amplitude, Hz; None: nothing is filtered.
    reason : str
        Why this cut-off.
    """

    cutoff: float | None
    reason: str = "given by the user"

    def __post_init__(self) -> None:
        if self.cutoff is not None and not (np.isfinite(self.cutoff) and self.cutoff > 0):
            raise InputError(f"the cut-off must be a positive frequency in Hz, got {self.cutoff}")

    def taps(self, step: float) -> Array:
        """Symmetric impulse response for samples `step` seconds apart, odd length, sum 1."""
        if self.cutoff is None or self.cutoff >= 0.4 / step:
            return np.ones(1)
        length, beta = signal.kaiserord(60.0, min(self.cutoff, 0.5 / step - self.cutoff) * 2 * step)
        return np.asarray(signal.firwin(length | 1, self.cutoff, window=("kaiser", beta), fs=1 / step))

    def decimation(self, step: float) -> int:
        """Samples per kept sample: the filter stops at 1.5 times the cut-off, so three samples a period suffice."""
        return 1 if len(self.taps(step)) == 1 else max(1, int(1 / (3 * step * float(self.cutoff or 1))))


@dataclass(frozen=True, eq=False)
class Motion:
    """A gap-free stretch of one log on a uniform grid, derivatives filled in.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time, s.
    q, v, a : ndarray, shape (N, J)
        rad, rad/s, rad/s² (m, m/s, m/s² for prismatic joints).
    tau : ndarray, shape (N, J)
        Torque, N·m (N); NaN columns for joints without a torque channel.
    standstill : ndarray of bool, shape (N, J)
        Joints at standstill (see `find_standstill`).
    source : str
        The log it comes from.
    start : float
        Time at which the log begins, s; a motion begins later, after what was trimmed.
    extra : mapping of str to ndarray, shape (N,)
        Other channels of the log on the same grid, for example ``temperature_<joint>``.
    measured : (ndarray of bool, ndarray of bool), each shape (J,), optional
        Joints whose q̇, and whose q̈, are channels of the log; other q̈ come from the measured q̇, and what is left from
        the positions. None: all from the positions.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    standstill: NDArray[np.bool_]
    source: str
    start: float = 0.0
    extra: Mapping[str, Array] = field(default_factory=dict)
    measured: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None

    @property
    def step(self) -> float:
        """Time between samples, s."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def middle(self, share: float) -> Motion:
        """A stretch from the middle, of so much of its length."""
        half = max(2, round(0.5 * share * len(self.t)))
        return self.part(slice(max(0, len(self.t) // 2 - half), len(self.t) // 2 + half))

    def part(self, kept: slice) -> Motion:
        """Some of the samples."""
        parts = {name: getattr(self, name)[kept] for name in ("t", "q", "v", "a", "tau", "standstill")}
        return replace(self, **parts, extra={name: x[kept] for name, x in self.extra.items()})


@dataclass(frozen=True)
class Prepared:
    """Motions of one log and what was done to get them."""

    motions: tuple[Motion, ...]
    notes: tuple[str, ...]


def noise_level(x: Array) -> Array:
    """Standard deviation of the white noise on uniformly sampled channels.

    Fourth differences cancel what is smooth over five samples and keep ``Σ c² = 70`` times the noise variance; the
    median absolute value is not fooled by jerks and reversals.

    Parameters
    ----------
    x : ndarray, shape (N, ...)

    Returns
    -------
    ndarray, shape (...)
    """
    fourth = np.diff(x, n=QUARTIC, axis=0) / np.sqrt(70.0)
    spread = np.median(np.abs(fourth), axis=0) / 0.6745
    # A quantised channel at rest has mostly zero differences: its noise is then in the few that are not.
    return np.asarray(np.where(spread > 0, spread, np.std(fourth, axis=0)))


def find_standstill(q: Array, v: Array, a: Array, step: float, pause: float = PAUSE) -> NDArray[np.bool_]:
    """Joints that hold their position, or stop and go on without reversing.

    Dry friction at rest takes any value up to break-away, whatever the speed's noise says; a model with Coulomb
    friction makes no prediction there. A joint holds its position when it travels less than `STANDSTILL_SPAN` within
    half a second around the sample. It stops where it creeps (slower than `CREEPING`, or than a fiftieth of its usual speed
    if that is less) and slows to a fifth of that, unless the stretch is short and the joint turns round in it: a
    reversal is motion, and says most about friction. It has rested before it turned when it was hardly accelerated for
    as long as `pause`, s: less than a period of the filter's cut-off is blurred into the motion before and after.
    """
    window = 2 * round(0.25 / step) + 1
    travel = ndimage.maximum_filter1d(q, window, axis=0) - ndimage.minimum_filter1d(q, window, axis=0)
    still = np.asarray(travel < STANDSTILL_SPAN)
    for j in range(q.shape[1]):
        creeping = min(CREEPING, float(np.quantile(np.abs(v[:, j]), 0.9)) / 50)
        labels, count = ndimage.label(np.abs(v[:, j]) < creeping)
        for part in ndimage.find_objects(labels, count):
            slow = part[0]
            inner = slow.start > 0 and slow.stop < len(v)
            reverses = inner and v[slow.start - 1, j] * v[slow.stop, j] < 0
            brief = (slow.stop - slow.start) * step < 0.5 and not _rests(a[:, j], slow, step, pause)
            if np.abs(v[slow, j]).min() < creeping / 5 and not (reverses and brief):
                still[slow, j] = True
    return still


def _rests(a: Array, slow: slice, step: float, pause: float) -> bool:
    """Whether a joint that creeps is hardly accelerated for a while; one that turns round is accelerated most there."""
    around = round(0.25 / step)
    most = np.abs(a[max(0, slow.start - around) : slow.stop + around]).max()
    runs, _ = ndimage.label(np.abs(a[slow]) < UNMOVED * most)
    return bool(np.bincount(runs)[1:].max(initial=0) * step >= pause)


def derivative_taps(order: int, step: float, cutoff: float | None) -> Array:
    """Savitzky-Golay weights of a zero-phase derivative that passes `DERIVATIVE_BAND` times the cut-off.

    The half length follows Schafer 2011 (IEEE Signal Processing Magazine 28(4), eq. 12).
    """
    half = 3
    if cutoff is not None:
        share_of_nyquist = min(1.0, DERIVATIVE_BAND * cutoff * 2 * step)
        half = max(half, round(((QUARTIC + 1) / share_of_nyquist + 4.6) / 3.2))
    return np.asarray(signal.savgol_coeffs(2 * half + 1, QUARTIC, deriv=order, delta=step, use="dot"))


def choose_lowpass(logs: Sequence[Log], joints: Sequence[str]) -> LowPass:
    """Cut-off from the data: high enough to keep the shape of reversals, low enough to leave the torque's noise out.

    Every joint's *bandwidth* holds 99 % of the power of its velocity, as the spectrum of q shows it above ten times its
    own noise floor (the upper third of the spectrum). The cut-off is ten times the median bandwidth over moving joints
    and logs: dry friction is a square wave of the velocity's frequency, and its first harmonics carry the information.
    Where the torque's spectrum sinks to ten times its floor earlier than that, the cut-off is there, but never below
    four bandwidths.

    Parameters
    ----------
    logs : sequence of Log
    joints : sequence of str
        Joints whose torque is fitted.

    Returns
    -------
    LowPass
    """
    bands = Bandwidths()
    for log in logs:
        bands.add(log, joints)
    return bands.lowpass()


class Bandwidths:
    """What spectra say of the motion and of the torque's noise, gathered log by log; see `choose_lowpass`."""

    def __init__(self) -> None:
        self.bands: list[float] = []
        self.clear: list[float] = []
        self.rate = np.inf

    def add(self, log: Log, joints: Sequence[str]) -> None:
        """Look at one log, or one piece of a recording."""
        chosen = log.select(joints)
        self.rate = min(self.rate, log.rate)
        t, q, tau = uniform(log.t, chosen.q, np.full_like(chosen.q, np.nan) if chosen.tau is None else chosen.tau)
        step = (t[-1] - t[0]) / (len(t) - 1)
        f, power, floor = _spectrum(q, step)
        velocity = np.where(power > 10 * floor, power - floor, 0.0) * (f**2)[:, None]
        share = np.cumsum(velocity, axis=0) / np.maximum(velocity.sum(axis=0), 1e-300)
        moving = (np.ptp(q, axis=0) > STANDSTILL_SPAN) & velocity.any(axis=0)
        edge = f[np.minimum((share < 0.99).sum(axis=0), len(f) - 1)]
        self.bands += edge[moving].tolist()
        f, power, floor = _spectrum(np.nan_to_num(tau), step)
        # below the motion's bandwidth the torque's spectrum may have holes, above it noise
        noisy = (power < 10 * floor) & (f[:, None] > edge)
        self.clear += [float(f[noisy[:, j].argmax()]) for j in np.flatnonzero(moving & noisy[1:].any(axis=0))]

    def lowpass(self) -> LowPass:
        """The filter for everything that was looked at."""
        if not self.bands:
            return LowPass(None, "no joint's motion stands out of its noise")
        band = float(np.median(self.bands))
        sinks = float(np.median(self.clear)) if self.clear else np.inf
        cutoff = float(f"{min(max(4 * band, min(10 * band, sinks)), 0.2 * self.rate):.2g}")
        if cutoff < 9.5 * band:
            return LowPass(cutoff, f"chosen where the torque nears its noise; the motion's bandwidth is {band:.2g} Hz")
        return LowPass(cutoff, f"chosen as ten times the motion's bandwidth of {band:.2g} Hz")


def _spectrum(x: Array, step: float) -> tuple[Array, Array, Array]:
    """Frequencies, power spectral density and its floor per column."""
    f, power = signal.welch(x, 1 / step, nperseg=min(len(x), round(8 / step)), detrend="linear", axis=0)
    return f, power, np.median(power[2 * len(f) // 3 :], axis=0)


def prepare(log: Log, lowpass: LowPass, *, velocity: str = "auto", begin: float | None = None) -> Prepared:
    """Turn a log into motions: uniform time, q̇ and q̈ present, split at gaps.

    Parameters
    ----------
    log : Log
        Joints in the order of the robot's.
    lowpass : LowPass
        Sets the band of the derivatives.
    velocity : {"auto", "measured", "derived"}
        Which q̇ and q̈ to use where the log holds them. ``"auto"`` takes per joint what is nearer the truth: a measured
        one only where it differs from the positions' by less than their own noise makes it.
    begin : float, optional
        Time at which the recording began, s, where this log is a later piece of one.

    Returns
    -------
    Prepared

    Raises
    ------
    InputError
        No stretch of the log is longer than the filters.
    """
    if velocity not in VELOCITIES:
        raise InputError(f"velocity must be one of {', '.join(VELOCITIES)}, got '{velocity}'")
    median = float(np.median(np.diff(log.t)))
    largest_gap = _largest_gap(median, lowpass)
    begins = breaks_of(log, lowpass)
    bounds = [*begins.tolist(), len(log.t)]
    notes = []
    if gaps := len(begins) - 1:
        longest = float(np.diff(log.t).max())
        notes.append(
            f"{log.source}: split at {gaps} gap{'s' * (gaps > 1)} in the time stamps, the longest {longest:.3g} s"
        )
    jitter = np.abs(np.diff(log.t) - median)
    if (jitter[jitter < largest_gap] > 1e-3 * median).any():
        notes.append(
            f"{log.source}: steps between {np.diff(log.t).min() * 1e3:.3g} and {np.diff(log.t).max() * 1e3:.3g} ms, "
            f"put on a uniform {median * 1e3:.3g} ms grid by cubic splines through the true time stamps"
        )
    reach = (len(derivative_taps(1, median, lowpass.cutoff)) + len(lowpass.taps(median))) // 2
    motions, too_short = [], 0
    for start, stop in pairwise(bounds):
        if stop - start < 2 * reach + 10:
            too_short += stop - start
            continue
        motion, said = _motion(log.slice(start, stop), lowpass, velocity, float(log.t[0]) if begin is None else begin)
        motions.append(motion)
        notes += [s for s in said if s not in notes]
    if too_short:
        notes.append(
            f"{log.source}: {too_short} samples dropped in stretches shorter than the filters ({2 * reach + 10} "
            "samples)"
        )
    if not motions:
        raise InputError(
            f"{log.source}: no stretch without a gap is longer than the filters need ({2 * reach + 10} samples at this "
            "cut-off); raise the cut-off, or record longer"
        )
    trimmed = reach * median * len(motions) * 2
    notes.append(f"{log.source}: {trimmed:.2g} s trimmed at the ends, where the filters cannot see both sides")
    return Prepared(tuple(motions), tuple(notes))


def _largest_gap(step: float, lowpass: LowPass) -> float:
    return max(4 * step, 0.1 / lowpass.cutoff if lowpass.cutoff else 0.0)


def breaks_of(log: Log, lowpass: LowPass) -> NDArray[np.intp]:
    """First sample of every stretch without a gap: zero, and each sample after a gap."""
    steps = np.diff(log.t)
    return np.append(0, np.flatnonzero(steps > _largest_gap(float(np.median(steps)), lowpass)) + 1)


def uniform(t: Array, *channels: Array) -> tuple[Array, ...]:
    """Put channels (N, J) on a uniform grid of the median step by cubic splines; all-NaN columns stay so."""
    step = float(np.median(np.diff(t)))
    count = int((t[-1] - t[0]) / step * (1 + 1e-12)) + 1
    grid = t[0] + step * np.arange(count)
    if count == len(t) and np.abs(grid - t).max() < 1e-6 * step:
        return (t, *channels)
    out = []
    for x in channels:
        y = np.full((count, x.shape[1]), np.nan)
        present = ~np.isnan(x).any(axis=0)
        if present.any():
            y[:, present] = make_interp_spline(t, x[:, present], k=3)(np.minimum(grid, t[-1]))
        out.append(y)
    return (grid, *out)


def _motion(log: Log, lowpass: LowPass, velocity: str, begin: float) -> tuple[Motion, list[str]]:
    nothing = np.full_like(log.q, np.nan)
    t, q, v, a, tau = uniform(log.t, *(nothing if x is None else x for x in (log.q, log.v, log.a, log.tau)))
    step = (t[-1] - t[0]) / (len(t) - 1)
    source = _Derivatives(q, v, step, lowpass)
    use_v, notes = source.choice(log, velocity)
    half = source.half
    inside = slice(half, len(t) - half)
    keep_v = np.where(use_v, v[inside], source.v)
    keep_a = np.where(use_v, source.a_from_v, source.a)
    use_a = np.zeros_like(use_v)
    if velocity != "derived":
        use_a = log.has("a") if velocity == "measured" else source.better(a[inside])
        keep_a = np.where(use_a, a[inside], keep_a)
    pause = PAUSE if lowpass.cutoff is None else max(PAUSE, 1.0 / lowpass.cutoff)
    still = find_standstill(q[inside], keep_v, source.a, step, pause)
    extra = {name: np.interp(t[inside], log.t, values) for name, values in log.extra.items()}
    return Motion(
        t[inside], q[inside], keep_v, keep_a, tau[inside], still, log.source, begin, extra, (use_v, use_a)
    ), notes


@dataclass(frozen=True, eq=False)
class _Derivatives:
    """The ways to get q̇ and q̈ of one stretch, and which to believe."""

    q: Array
    v_measured: Array
    step: float
    lowpass: LowPass

    @cached_property
    def taps(self) -> tuple[Array, Array]:
        cutoff = self.lowpass.cutoff
        return derivative_taps(1, self.step, cutoff), derivative_taps(2, self.step, cutoff)

    @property
    def half(self) -> int:
        return len(self.taps[0]) // 2

    @cached_property
    def v(self) -> Array:
        return correlate(self.taps[0], self.q - self.q[0])  # a joint that never moves has exactly zero speed

    @cached_property
    def a(self) -> Array:
        return correlate(self.taps[1], self.q - self.q[0])

    @cached_property
    def a_from_v(self) -> Array:
        return correlate(self.taps[0], self.v_measured)

    def choice(self, log: Log, velocity: str) -> tuple[NDArray[np.bool_], list[str]]:
        """Per joint, whether the measured velocity is used; and what to say about it."""
        present = log.has("v")
        if velocity == "derived" or not present.any():
            return np.zeros(len(present), bool), []
        if velocity == "measured":
            return present, []
        smooth = self.lowpass.taps(self.step)
        inside = slice(self.half, len(self.q) - self.half)
        measured, derived = correlate(smooth, self.v_measured[inside]), correlate(smooth, self.v)
        acceleration = correlate(smooth, self.a)
        scale = np.sqrt(np.mean(derived**2, axis=0)) + 1e-12
        off = np.sqrt(np.mean((measured - derived) ** 2, axis=0)) / scale
        with np.errstate(invalid="ignore"):
            lag = -np.sum((measured - derived) * acceleration, axis=0) / (np.sum(acceleration**2, axis=0) + 1e-300)
        late = present & (off > LATE_VELOCITY)
        notes = []
        if late.any():
            names = [name for name, wrong in zip(log.joints, late, strict=True) if wrong]
            notes.append(
                f"{log.source}: measured velocity of {', '.join(names)} differs from the slope of the positions by "
                f"{_range(100 * off[late])} % (it lags {_range(lag[late])} s): derived from the positions instead"
            )
        return present & ~late & self.better(self.a_from_v), notes

    def better(self, acceleration: Array) -> NDArray[np.bool_]:
        """Per joint, whether an acceleration is nearer the truth, in the filter's band, than that of the positions.

        The mean square of the difference of the two is e² + n², with e its own error (noise, and a tachometer's lag)
        and n the noise of the positions' second derivative, which is known: e < n if the difference is below √2 n.
        Where both agree to a thousandth, the measured one is as good, and free of the differentiator's own bias.
        """
        smooth = self.lowpass.taps(self.step)
        difference = correlate(smooth, acceleration - self.a)
        noise = noise_level(self.q) * np.linalg.norm(np.convolve(smooth, self.taps[1]))
        alike = ALIKE * np.sqrt(np.mean(self.a**2, axis=0))
        return np.asarray(np.sqrt(np.mean(difference**2, axis=0)) < np.maximum(np.sqrt(2) * noise, alike))


def correlate(taps: Array, x: Array) -> Array:
    """``Σ_k taps_k x_{i+k}`` for every i where all of it is inside, along the first axis."""
    return np.asarray(signal.oaconvolve(x, taps[::-1, None], mode="valid", axes=0))


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


def _range(values: Array) -> str:
    """Smallest to largest, or the one value there is."""
    low, high = (f"{x:.2g}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"
