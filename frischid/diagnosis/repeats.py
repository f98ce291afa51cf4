"""Repeated motions: what comes again with the motion is the robot, what does not is noise.

If a log runs a motion twice, or two logs run the same motion, the residuals r of the two runs hold the same missing
effects, and each its own noise. So the noise of joint j is measured and not modelled,

    n_j² = ½ mean_t (r_j(t + s) − r'_j(t))²,

with s the time between the runs. The residual of a fitted model takes the place of the torque, because a second run
never follows exactly the same path.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.logs.repeated_motion import LEAST_OVERLAP, Repeat, repeat_of
from frischid.model.comparison_criteria import COMPARISON_CRITERIA

_MOST_MOTIONS = 8  # motions that are compared with one another: each pair costs a correlation


class MeasuredNoise(NamedTuple):
    """Noise of each joint from repeated motions, N·m (N), (J,), and a sentence on the repetitions."""

    noise: Array
    said: str


def measured_noise(validator: CrossValidator) -> MeasuredNoise | None:
    """Measure the noise where a motion comes again.

    Returns
    -------
    MeasuredNoise or None
        None where no motion comes again, or where a joint has too few samples in the repeated stretches.
    """
    motions = validator.data.cache.motions[:_MOST_MOTIONS]
    states = [validator.data.cache.state(motion) for motion in motions]
    squares, counts = np.zeros((2, len(validator.joints)))
    seconds = 0.0
    where: list[str] = []
    for n, (motion, state) in enumerate(zip(motions, states, strict=True)):
        for m in range(n + 1):
            own = LEAST_OVERLAP if m == n else 0.0
            found = repeat_of(state.t, state.q, states[m].t, states[m].q, own)
            if found is None:
                continue
            seconds += found.overlap
            where += [Path(x.source).name for x in (motions[m], motion)]
            for row in range(len(validator.joints)):
                apart = _differences(validator, row, (n, m), found)
                squares[row] += apart @ apart / 2
                counts[row] += len(apart)
    if not (counts / validator.fit.correlation >= COMPARISON_CRITERIA.dependence_samples).all():
        return None
    said = (
        f"a motion comes again ({', '.join(dict.fromkeys(where))}; {seconds:.0f} s): the noise floor is measured, "
        "as the difference between the runs"
    )
    return MeasuredNoise(np.sqrt(squares / counts), said)


def _differences(validator: CrossValidator, row: int, pair: tuple[int, int], found: Repeat) -> Array:
    """Differences of a joint's residuals in two runs, at the samples of the first run, (n,)."""
    (t, x), (other_t, other) = (_residual(validator, row, number) for number in pair)
    if len(other_t) < 4 or not len(t):
        return np.empty(0)
    at = t - found.shift
    after = np.clip(np.searchsorted(other_t, at), 1, len(other_t) - 1)
    near = other_t[after] - other_t[after - 1] < 1.5 * np.median(np.diff(other_t))  # no sample at standstill between
    inside = near & (at >= other_t[0]) & (at <= other_t[-1])
    return np.asarray(x[inside] - make_interp_spline(other_t, other, k=3)(at[inside]))


def _residual(validator: CrossValidator, row: int, number: int) -> tuple[Array, Array]:
    """Times and residuals of a joint over one motion, (n,) each."""
    data = validator.data.of_motion(row, number)
    return data.motion.t.read()[data.picked], validator.columns.residual(data, validator.theta)
