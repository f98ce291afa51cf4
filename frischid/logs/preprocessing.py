"""From recorded samples to motion: a uniform time grid, zero-phase derivatives, stretches without gaps.

Three linear steps, each symmetric in time so that nothing is delayed:

1. cubic splines through the samples at their *true* times put every channel on a uniform grid of step h; where the
   stamps jitter and the positions do not, these are the times of a regular clock (`frischid.logs.time_grid`);
2. missing q̇ and q̈ are local quartic fits of the positions (`frischid.logs.derivatives`);
3. the parallel filter F is applied to τ and to every regressor column, ``F τ = (F Y) θ + F e``
   (`frischid.logs.filters`, applied by `frischid.regression.regressor`).

A torque that was recorded d seconds late is read from its spline at t + d (`LowPass.torque_lag`).

No end is padded: samples at the ends, where a filter lacks samples on one side or no torque was recorded d later, are
dropped, and a note counts them.

A log at standstill (`frischid.logs.poses`) has nothing to derive: each of its poses is one sample at rest.

Source: M. Gautier, "Dynamic identification of robots with power model", ICRA 1997.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from frischid.core.text import counted
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.derivatives import Derivatives
from frischid.logs.filters import LowPass, derivative_taps
from frischid.logs.log import Log
from frischid.logs.poses import is_static, poses_of
from frischid.logs.standstill import PAUSE, find_standstill
from frischid.logs.time_grid import at_times, breaks_of, largest_gap, retimed, uniform
from frischid.logs.wraps import unwrapped, wrap_notes

VELOCITIES = ("auto", "measured", "derived")
"""Sources of q̇: the better of the other two, joint by joint; the channel of the log; the slope of the positions."""
SPARE_SAMPLES = 10
"""Least samples of a stretch of motion, besides those that the filters need at its ends."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A gap-free stretch of one log on a uniform grid, with velocities and accelerations."""

    t: Array
    """Time, s, (N,)."""
    q: Array
    v: Array
    a: Array
    """`q`, `v`, `a`: rad, rad/s, rad/s² (m, m/s, m/s² for prismatic joints), (N, J)."""
    tau: Array
    """Torque, N·m (N), (N, J); NaN columns for joints without a torque channel."""
    standstill: NDArray[np.bool_]
    """Joints at standstill (see `find_standstill`), (N, J)."""
    source: str
    """Name of the log."""
    start: float = 0.0
    """Time at which the log begins, s; a motion begins later, after the trimmed samples."""
    extra: Mapping[str, Array] = field(default_factory=dict)
    """Other channels of the log on the same grid, for example ``temperature_<joint>``, (N,)."""
    measured: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None
    """Joints whose q̇, and whose q̈, are channels of the log, (J,), optional. Any other q̈ is derived from the measured
    q̇ where that is used, otherwise from the positions. None: everything is derived from the positions."""
    at_poses: bool = False
    """Whether the samples are poses at standstill: they do not follow one another, and `step` is infinite."""

    @property
    def step(self) -> float:
        """Time between samples, s."""
        if self.at_poses:
            return np.inf
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def direction(self) -> Array:
        """Sign of each joint's speed, shape (N, J); 0 at standstill, where the sign of the speed is rounding."""
        return np.where(self.standstill, 0.0, np.sign(self.v))

    def middle(self, share: float) -> Motion:
        """A stretch from the middle of the motion, `share` times its length."""
        half = max(2, round(0.5 * share * len(self.t)))
        return self.part(slice(max(0, len(self.t) // 2 - half), len(self.t) // 2 + half))

    def part(self, kept: slice) -> Motion:
        """Keep some consecutive samples."""
        parts = {name: getattr(self, name)[kept] for name in ("t", "q", "v", "a", "tau", "standstill")}
        return replace(self, **parts, extra={name: x[kept] for name, x in self.extra.items()})


@dataclass(frozen=True)
class Prepared:
    """Motions of one log, and notes on all changes of the data.

    ``at_end`` is a note on the last stretch of a chunk, where no chunk follows that takes its samples over.
    """

    motions: tuple[Motion, ...]
    notes: tuple[str, ...]
    at_end: str = ""


def prepare(
    log: Log, lowpass: LowPass, *, velocity: str = "auto", begin: float | None = None, whole: bool = True
) -> Prepared:
    """Turn a log into motions: on a uniform grid, with q̇ and q̈, split at gaps; or into poses, if the arm stands still.

    Parameters
    ----------
    log : Log
        Its joints are in the robot's order.
    lowpass : LowPass
        The filter; it decides the band of the derivatives.
    velocity : {"auto", "measured", "derived"}
        Whether to use q̇ and q̈ of the log. ``"auto"`` decides for each joint: the measured one is used if it differs
        from the positions' derivative by less than the noise of that derivative.
    begin : float, optional
        Time at which the recording began, s, if this log is a later chunk of a recording.
    whole : bool
        Whether this log is no chunk of a longer one. A chunk at standstill is no static log.

    Raises
    ------
    InputError
        No stretch of the log is longer than the filters.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.logs.filters import LowPass
    >>> from frischid.logs.preprocessing import prepare
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=0), rate=200.0)
    >>> motion = prepare(log, LowPass(10.0)).motions[0]
    >>> motion.q.shape == motion.a.shape, round(1 / motion.step)
    (True, 200)
    """
    if velocity not in VELOCITIES:
        raise InputError(f"velocity must be one of {', '.join(VELOCITIES)}, got '{velocity}'")
    wraps, log = wrap_notes(log), unwrapped(log)
    if whole and is_static(log):
        return _at_rest(log, wraps)
    stamped, log = log, retimed(log)
    median = float(np.median(np.diff(log.t)))
    begins = breaks_of(log, lowpass)
    bounds = [*begins.tolist(), len(log.t)]
    notes = [*wraps, *_notes_on_times(log, stamped, len(begins) - 1, largest_gap(median, lowpass))]
    lost = sum(ends_of(median, lowpass)) + len(lowpass.taps(median)) - 1
    least = lost + SPARE_SAMPLES
    motions, dropped = [], {"here": 0, "at end": 0}
    for start, stop in pairwise(bounds):
        if stop - start < least:
            dropped["here" if whole or stop < len(log.t) else "at end"] += stop - start
            continue
        motion, news = _motion(log.slice(start, stop), lowpass, velocity, float(log.t[0]) if begin is None else begin)
        motions.append(motion)
        notes += [s for s in news if s not in notes]
    said = {place: _dropped(log, samples, least) for place, samples in dropped.items() if samples}
    notes += [said["here"]] if "here" in said else []
    if not motions:
        raise InputError(
            f"{log.source}: no stretch without a gap is longer than the filters need ({least} samples at this "
            "cut-off); raise the cut-off, or record longer"
        )
    trimmed = lost * median * len(motions)
    notes.append(f"{log.source}: {trimmed:.2g} s trimmed at the ends, where the filters lack samples on one side")
    return Prepared(tuple(motions), tuple(notes), said.get("at end", ""))


def _notes_on_times(log: Log, stamped: Log, gaps: int, longest: float) -> Iterator[str]:
    """Say what is done to the times of a log.

    Parameters
    ----------
    log, stamped : Log
        With the times that are used, and with the stamps.
    longest : float
        Steps that are longer, s, are gaps.
    """
    steps = np.diff(log.t)
    median = float(np.median(steps))
    if gaps:
        yield f"{log.source}: split at {counted(gaps, 'gap')} in the time stamps, the longest {steps.max():.3g} s"
    if log is not stamped:
        off = 1e3 * float(np.std(stamped.t - log.t))
        yield (
            f"{log.source}: stamps jitter by {off:.3g} ms, and the positions do not: the samples were taken at a "
            f"regular {median * 1e3:.4g} ms, and these times are used"
        )
    steps = steps[steps <= longest]  # nothing is interpolated across a gap
    if (np.abs(steps - median) > 1e-3 * median).any():
        yield (
            f"{log.source}: steps between {steps.min() * 1e3:.3g} and {steps.max() * 1e3:.3g} ms, put on a uniform "
            f"{median * 1e3:.3g} ms grid by cubic splines through the samples at their time stamps"
        )


def _dropped(log: Log, samples: int, least: int) -> str:
    """Note on samples in stretches that are too short."""
    return f"{log.source}: {counted(samples, 'sample')} dropped in stretches shorter than the filters ({least} samples)"


def ends_of(step: float, lowpass: LowPass) -> tuple[int, int]:
    """Samples of a stretch that are dropped at its begin and its end, for the derivatives and the torque's lag."""
    half = len(derivative_taps(1, step, lowpass.cutoff)) // 2
    late = int(np.ceil(abs(lowpass.torque_lag) / step - 1e-6))
    return (half, max(half, late)) if lowpass.torque_lag > 0 else (max(half, late), half)


def _at_rest(log: Log, notes: list[str]) -> Prepared:
    """The poses of a static log as samples at standstill."""
    poses = poses_of(log)
    rest = np.zeros_like(poses.q)
    extra = {name: np.array([x[part].mean() for part in poses.parts]) for name, x in log.extra.items()}
    motion = Motion(
        poses.t, poses.q, rest, rest, poses.tau, rest > 0, log.source, float(log.t[0]), extra, at_poses=True
    )
    said = (
        "a log at standstill: each pose is one sample, of gravity and of the dry friction that holds; such a log shows "
        "no inertia and no viscous friction"
    )
    return Prepared((motion,), (*notes, said))


def _motion(log: Log, lowpass: LowPass, velocity: str, begin: float) -> tuple[Motion, list[str]]:
    nothing = np.full_like(log.q, np.nan)
    t, q, v, a, tau = uniform(log.t, *(nothing if x is None else x for x in (log.q, log.v, log.a, log.tau)))
    if lowpass.torque_lag and log.tau is not None:
        tau = at_times(log.t, log.tau, t + lowpass.torque_lag)
    step = (t[-1] - t[0]) / (len(t) - 1)
    source = Derivatives(q, v, step, lowpass)
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
    standstill = find_standstill(q[inside], keep_v, source.a, step, pause)
    extra = {name: np.interp(t[inside], log.t, values) for name, values in log.extra.items()}
    motion = Motion(
        t[inside], q[inside], keep_v, keep_a, tau[inside], standstill, log.source, begin, extra, (use_v, use_a)
    )
    first, last = ends_of(step, lowpass)
    return motion.part(slice(first - half, len(motion.t) - (last - half))), notes
