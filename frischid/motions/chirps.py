"""Motions for position drives: steps and chirps of every joint, linear in their amplitudes.

    q_j(t) = Σ_k l_kj s_k(t) + Σ_w b_w(t) [A_wj sin φ + B_wj cos φ + C_wj sin φ̄ + D_wj cos φ̄]

*Steps.* l_k is a pose. s_k leads from pose to pose by a quintic of its own duration, and holds the pose: a short step
is small and fast, a long one wide. The last pose is the first one, so the motion can run again without a jump.

*Chirps.* φ̇ / 2π rises from the lowest frequency to the highest as a geometric series, φ̄ falls. The windows b_w follow
one another and overlap. So the amplitudes of a joint's windows are amplitudes of its frequencies: a search chooses the
bands of each joint, and where the two sweeps meet, joints move at different frequencies.

Dense points (q, q̇, q̈) of this law are joined by quintics, so that all extremes are known exactly.

Source: Pintelon and Schoukens 2012, "System Identification", 2nd edition, Wiley, section 5.2, on sweeps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError

STEP_SHARES = {"steps": 1.0, "chirps": 0.0, "steps+chirps": 0.35}
"""Family -> share of its time in which the joints step from pose to pose. Later, wide steps go on below the chirps."""
BAND = 12.0
"""Highest over lowest frequency of the chirps."""
ABOVE_CORNER = 2.0
"""Highest frequency over that from which the acceleration limit, not speed or range, holds a joint's amplitude.

Faster chirps tell no more of the inertia, but need a wider filter, and the noise of accelerations from encoders grows
with the square of the frequency. Experiment: two simulated joints with encoders of 14 bits, two seeds, a corner at 0.64
Hz. Ranges of Coulomb friction over those of the plain Fourier motion: 1.25 with chirps to 4 Hz, 0.71 to 2 Hz, 0.65 to
1.2 Hz. An SO-101 with 12 bits: 1.9 to 2 Hz, 1.4 to 1.2 Hz, and both have the same ranges of armature.
"""
FASTEST = 4.0
"""Hz. Few position loops of an arm or a leg follow faster commands."""
USUAL = 1.25
"""Hz. Highest frequency for the usual limits of an arm: full speed after a quarter of a second."""
POINTS_PER_PERIOD = 40
"""Points of the quintics per period of the highest frequency."""
STEP_TIMES = (0.2, 1.0, 0.4, 1.6)
"""s. Durations of the steps from pose to pose, in turn."""
HOLD = 0.3
"""s. Standstill after a step."""
WINDOWS_PER_SECOND = 0.5
"""Amplitudes per second of each of the four chirps."""
POINTS_IN_FILE = 5.0
"""Least rows of a file per period of the highest frequency."""
SHORTEST = 4.0
"""s. A shorter motion has no room for steps, nor for slow chirps."""


class Law(NamedTuple):
    """Steps and chirps with unit coefficients at dense times."""

    t: Array
    """Shape (M,)."""
    rows: Array
    """Position, velocity and acceleration of every coefficient, (3, M, P)."""
    constant: Array
    """Coefficients of the motion that stays at 1, (P,)."""


def law(family: str, duration: float, size: int, highest: float) -> Law:
    """The rows of a family of steps and chirps.

    Parameters
    ----------
    family : {"steps", "chirps", "steps+chirps"}
    duration : float
        s.
    size : int
        Windows of each chirp, if all of the time were the chirps'.
    highest : float
        Highest frequency of the chirps, Hz; see `highest_frequency`.

    Raises
    ------
    InputError
        The motion is too short.
    """
    if duration < SHORTEST:
        raise InputError(f"family '{family}' needs a duration of at least {SHORTEST:g} s, got {duration:g}")
    t = np.linspace(0.0, duration, round(POINTS_PER_PERIOD * highest * duration) + 1)
    until = STEP_SHARES[family] * duration
    poses = _poses(t, until, duration if until else 0.0)
    sweeps = _sweeps(t, (until, duration), highest, max(2, round(size * (1.0 - STEP_SHARES[family]))))
    constant = np.concatenate([np.ones(poses.shape[2]), np.zeros(sweeps.shape[2])])
    return Law(t, np.concatenate([poses, sweeps], axis=2), constant)


def highest_frequency(half: Array, velocity: Array, acceleration: Array) -> float:
    """Highest frequency of chirps within limits of J joints, Hz.

    The amplitude at the circular frequency ω is the least of half the range, velocity / ω and acceleration / ω².

    Parameters
    ----------
    half, velocity, acceleration : ndarray, shape (J,)
        rad, rad/s, rad/s² (m, m/s, m/s²).
    """
    corner = np.maximum(acceleration / velocity, np.sqrt(acceleration / half)).max() / (2 * np.pi)
    return float(min(ABOVE_CORNER * corner, FASTEST))


def check_command_rate(family: str, highest: float, rate: float) -> None:
    """Refuse (InputError) a rate [Hz] at which rows of a file do not show a family's chirps."""
    if family in STEP_SHARES and rate < POINTS_IN_FILE * highest:
        raise InputError(
            f"family '{family}' moves with up to {highest:.3g} Hz and needs a rate of at least "
            f"{POINTS_IN_FILE * highest:.3g} rows a second, got {rate:g}"
        )


def default_windows(duration: float) -> int:
    """Windows of each chirp over a duration in s."""
    return max(4, round(WINDOWS_PER_SECOND * duration))


def _poses(t: Array, until: float, end: float) -> Array:
    """Rows of the poses, (3, M, K): steps up to a time, and wide ones below the chirps; a single pose without time."""
    begins: list[float] = []
    times: list[float] = []
    at = HOLD
    while at + (length := STEP_TIMES[len(times) % len(STEP_TIMES)] if at < until else max(STEP_TIMES)) + HOLD <= end:
        begins.append(at)
        times.append(length)
        at += length + HOLD
    count = max(1, len(times))  # the last step leads back to the first pose
    rows = np.zeros((3, len(t), count))
    rows[0, :, 0] = 1.0
    for k, (begin, length) in enumerate(zip(begins, times, strict=True)):
        rise = _smooth((t - begin) / length) / length ** np.arange(3)[:, None]
        rows[:, :, k] -= rise
        rows[:, :, (k + 1) % count] += rise
    return rows


def _sweeps(t: Array, between: tuple[float, float], highest: float, windows: int) -> Array:
    """Rows of the chirps between two times, (3, M, 4 windows); none where no time is left."""
    begin, end = between
    length = end - begin
    if length <= 0:
        return np.zeros((3, len(t), 0))
    x, ratio = np.clip((t - begin) / length, 0.0, 1.0), np.log(BAND)
    rows = []
    for grow, first in ((ratio, highest / BAND), (-ratio, highest)):
        rate = 2 * np.pi * first * np.exp(grow * x)
        phase, slope = (rate - rate[0]) * length / grow, rate * grow / length
        for wave, turned, sign in ((np.sin, np.cos, 1.0), (np.cos, np.sin, -1.0)):
            w, dw = wave(phase), sign * turned(phase) * rate
            ddw = -w * rate**2 + sign * turned(phase) * slope
            for b, db, ddb in _windows(t - begin, length, windows):
                rows.append([b * w, db * w + b * dw, ddb * w + 2 * db * dw + b * ddw])
    return np.asarray(rows).transpose(1, 2, 0)


def _windows(t: Array, length: float, count: int) -> list[Array]:
    """Bumps with their two derivatives, (3, M) each; neighbours sum to 1."""
    width = length / (count + 1)
    scale = (1.0 / width) ** np.arange(3)[:, None]
    up = [_smooth(t / width - k) * scale for k in range(count + 1)]
    return [up[k] - up[k + 1] for k in range(count)]


def _smooth(x: Array) -> Array:
    """The quintic from 0 to 1 over 0 ≤ x ≤ 1, at rest at both ends, with its two derivatives, (3, M)."""
    x = np.clip(x, 0.0, 1.0)
    return np.stack([x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)])
