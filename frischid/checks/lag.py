"""The delay of the measured torque behind the measured motion.

    d = argmin_d  Π_j  Σ_k (τ_j(t_k + d) − τ_nominal,j(t_k) − friction_j(t_k))²

over a common delay of all joints j (the product is the likelihood of joints with noise of unknown size).

Dry friction with memory follows a reversal late and looks like a delay, but each joint's friction by its own time, and
without gravity and inertia. A delay of the recording is common to all. So the joints' own delays d_j ± e_j, and the
delay g ± e_g of gravity and inertia, are explained by

    d_j = d + f_j + e_j ε_j,      g = d + e_g ε,      f_j ≥ 0 exponential with mean m,      ε ~ N(0, 1),

and a common delay d stands if the data are far more likely with it than with d = 0, each with its best m. This d is the
one that is told: the d of the first equation holds the friction's lags too. The delay g is estimated beside dry
friction Σ_i c_i sign q̇(t − δ_i) of any c_i, at δ_0 = 0 and four later times.

A torque that is late hides other faults, and other faults hide the delay. A linear fit of each row by itself,
Y_j(t_k) θ_j in place of τ_nominal,j, does not depend on signs, gains, exchanged torques or bodies. So `clear_lag` finds
a delay before those faults are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.special import log_ndtr

from frischid.checks.log_issue import Notebook, span
from frischid.checks.sketch import Sketch
from frischid.core.text import percent
from frischid.core.types import Array
from frischid.robot.stated_inertials import unstated

RANK_TOLERANCE = 1e-4
"""Singular value over the largest: a smaller one is that of parameters which the motion hardly shows."""
LATE_REVERSALS = np.array([0.125, 0.25, 0.5, 1.0])
"""δ_i over the longest delay that is searched."""
STEPS_PER_SAMPLE = 4
"""Delays tried per sample of the sketch: over a whole sample, the squared error is no parabola."""
COMMON_STEPS = 60
"""Common delays of either sign, and mean lags of friction, that are tried."""


def check_lag(sketch: Sketch, notes: Notebook) -> None:
    """Find a delay between torque and motion, of all joints or of single ones."""
    criteria, delays = sketch.criteria, _delays(sketch)
    judged = [k for k in range(len(sketch.rows)) if sketch.asis[k] < 1.0]
    if not len(delays) or not judged or unstated(sketch.robot):
        return
    rows = [_nominal_row(sketch, int(j)) for j in sketch.rows[judged]]
    shifted = _shifted(sketch, rows, delays)
    costs = _costs(sketch, rows, shifted)
    rigid = _best(sketch, delays, _costs(sketch, [_late_friction_row(sketch, row) for row in rows], shifted))
    own, error = np.array([_best(sketch, delays, cost[None]) for cost in costs]).T
    common, spread, evidence = common_delay(own, error, *rigid)
    whole = np.full(len(sketch.robot.joints), np.nan)
    whole[sketch.rows[judged]] = own
    notes.per_joint("torque_lag", whole)
    with_friction = _best(sketch, delays, costs)
    notes.facts |= {"torque_lag": with_friction[0], "torque_lag_error": with_friction[1]}
    # delays count from the torques as they were measured: the sketch may hold them moved
    tried = np.array([0.0, common, *own]) - sketch.earlier
    left = _costs(sketch, rows, _shifted(sketch, rows, tried)).sum(axis=2)
    gone = _removed(left)
    removed = 1 - np.diag(left[:, 2:]) / left[:, 0]
    alone = (removed > criteria.explained_share) & (abs(own) > criteria.significant_errors * error)
    clear = abs(common) > criteria.significant_errors * spread and gone > criteria.slight_lag_share
    if clear and evidence > np.log(criteria.common_lag_odds):
        by = f"{1e3 * abs(common):.1f} ± {1e3 * spread:.1f} ms"
        _late(notes, by, common, gone, (), "likely" if gone > criteria.common_lag_share else "possible")
    elif alone.any():
        by = span(1e3 * np.abs(own[alone]), " ms")
        where = tuple(sketch.names[k] for k, yes in zip(judged, alone, strict=True) if yes)
        _late(notes, by, float(own[alone].sum()), float(removed[alone].min()), where, "possible")


def common_delay(delays: Array, errors: Array, rigid: float, rigid_error: float) -> tuple[float, float, float]:
    """The common delay of all joints beside lags of friction, its standard error, and the log likelihood that it adds.

    Parameters
    ----------
    delays, errors : ndarray, shape (R,)
        Each joint's own delay and its standard error, s.
    rigid, rigid_error : float
        Delay of gravity and inertia and its standard error, s.

    Returns
    -------
    delay, error, evidence : float
        s, s, nats. Delay and standard error are the mean and the deviation of the likelihood with its best mean lag of
        friction.

    Examples
    --------
    Friction that lags by 5 to 40 ms, and the same friction in a recording that is late by 60 ms:

    >>> import numpy as np
    >>> own, error = np.array([0.005, 0.010, 0.020, 0.040]), np.full(4, 0.003)
    >>> common_delay(own, error, 0.0, 0.02)[2] < 1.0
    True
    >>> delay, _, evidence = common_delay(own + 0.06, error, 0.06, 0.002)
    >>> round(delay, 2), evidence > 6.0
    (0.06, True)
    """
    widest = float(np.abs(delays).max() + errors.max())
    common = np.linspace(-widest, widest, 2 * COMMON_STEPS + 1)
    lag = widest * np.geomspace(1e-3, 1.0, COMMON_STEPS)
    past, e = (delays - common[:, None])[:, None], errors / lag[:, None]
    each = e**2 / 2 - past / lag[:, None] + log_ndtr(past / errors - e) - np.log(lag)[:, None]
    best = each.sum(axis=2).max(axis=1) - ((rigid - common) / rigid_error) ** 2 / 2
    share = np.exp(best - best.max())
    share /= share.sum()
    delay = float(share @ common)
    spread = float(np.sqrt(share @ (common - delay) ** 2 + (common[1] - common[0]) ** 2 / 12))
    return delay, spread, float(best.max() - best[COMMON_STEPS])


def clear_lag(sketch: Sketch) -> float:
    """The delay of all torques that rows fitted freely show, s; 0 where it does not explain most of their error."""
    criteria, delays = sketch.criteria, _delays(sketch)
    if not len(delays) or not len(sketch.rows):
        return 0.0
    few = sketch.longest
    Y = np.empty((few.stop - few.start, len(sketch.robot.columns), len(sketch.robot.joints)))
    sketch.robot.regressor(sketch.q[few], sketch.v[few], sketch.a[few], Y)
    rows = [_free_row(sketch, int(j), Y[:, :, j]) for j in sketch.rows]
    rows = [row for row in rows if criteria.samples_per_parameter * row.basis.shape[1] < row.use.sum()]
    if not rows:
        return 0.0
    common, spread = _best(sketch, delays, _costs(sketch, rows, _shifted(sketch, rows, delays)))
    clear = abs(common) > criteria.significant_errors * spread
    tried = np.array([0.0, common])
    gone = _removed(_costs(sketch, rows, _shifted(sketch, rows, tried)).sum(axis=2)) if clear else 0.0
    return common if gone > criteria.common_lag_share else 0.0


@dataclass(frozen=True, eq=False)
class _Row:
    """A row of the longest stretch: its joint, known torque, samples that count, basis of the fitted torques."""

    joint: int
    known: Array
    use: NDArray[np.bool_]
    basis: Array


def _nominal_row(sketch: Sketch, j: int) -> _Row:
    """The URDF's torque and friction; with friction of either sign allowed, one factorisation serves all delays."""
    part, use = sketch.longest, _inner(sketch) & sketch.used[sketch.longest, j]
    return _Row(j, sketch.nominal[part, j], use, np.linalg.qr(sketch.motion.friction(j)[part][use][:, :4])[0])


def _late_friction_row(sketch: Sketch, row: _Row) -> _Row:
    """The row with dry friction that may follow a reversal late."""
    t, sign = sketch.t[sketch.longest], sketch.sign[sketch.longest, row.joint]
    late = [np.interp(t - d, t, sign)[row.use] for d in LATE_REVERSALS * sketch.criteria.longest_torque_lag]
    return replace(row, basis=np.linalg.qr(np.column_stack([row.basis, *late]))[0])


def _free_row(sketch: Sketch, j: int, columns: Array) -> _Row:
    """Friction and every parameter of every link, (M, C): an orthonormal basis of what they can explain."""
    use = _inner(sketch) & sketch.used[sketch.longest, j]
    X = np.column_stack([columns[use], sketch.motion.friction(j)[sketch.longest][use][:, :4]])
    X = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(X, full_matrices=False)
    return _Row(j, np.zeros(len(use)), use, left[:, size > RANK_TOLERANCE * size.max(initial=0.0)])


def _delays(sketch: Sketch) -> Array:
    """Delays that are searched, s; none where the longest stretch is too short to judge them."""
    t, longest, criteria = sketch.t[sketch.longest], sketch.criteria.longest_torque_lag, sketch.criteria
    step = float(np.median(np.diff(t))) if len(t) > criteria.enough_samples else 0.0
    if step == 0 or t[-1] - t[0] < criteria.lag_lengths * longest:
        return np.zeros(0)
    step /= STEPS_PER_SAMPLE
    return np.asarray(np.arange(-np.ceil(longest / step), np.ceil(longest / step) + 1) * step)


def _inner(sketch: Sketch) -> NDArray[np.bool_]:
    """Samples of the longest stretch whose torque is known at every delay."""
    t, margin = sketch.t[sketch.longest], sketch.criteria.longest_torque_lag * 1.2
    return np.asarray((t >= t[0] + margin) & (t <= t[-1] - margin))


def _removed(left: Array) -> float:
    """Share of the squared error that the second delay explains beyond the first, geometric mean over joints."""
    return 1 - float(np.exp(np.mean(np.log(left[:, 1] / left[:, 0]))))


def _late(notes: Notebook, by: str, sign: float, gone: float, where: tuple[str, ...], sure: str) -> None:
    sticks = "joints that stick at reversals look the same: where identify notes that the joints differ, nothing; "
    first = "" if sign > 0 else f"{sticks}otherwise, "
    notes.add(
        "late torque" if sign > 0 else "early torque",
        f"the torque {'lags the motion' if sign > 0 else 'runs ahead of the motion'} by {by.lstrip('-')}: "
        f"shifting the torque by this time explains {percent(gone)} of the squared error of the URDF with fitted "
        "friction",
        where,
        "likely" if sure == "likely" else "possible",
        "dry friction that follows a reversal late and an elastic gear look the same: identify, then frischid "
        "diagnose; or a channel of these joints has another filter or clock"
        if where
        else f"{first}up to 1.5 samples, nothing: identify takes that back; beyond, record both with one clock and "
        "one filter, shift the columns, or add time_delay (frischid effects time_delay)",
    )


def _shifted(sketch: Sketch, rows: Sequence[_Row], delays: Array) -> list[Array]:
    """Torque of each row less its known part, at each delay, (used samples, D)."""
    part = sketch.longest
    t, tau = sketch.t[part], make_interp_spline(sketch.t[part], sketch.tau[part][:, [row.joint for row in rows]])
    inner = _inner(sketch)
    at = tau((t[inner, None] + delays).ravel()).reshape(int(inner.sum()), len(delays), len(rows))
    return [at[row.use[inner], :, k] - row.known[row.use, None] for k, row in enumerate(rows)]


def _costs(sketch: Sketch, rows: Sequence[_Row], shifted: Sequence[Array]) -> Array:
    """Squared error of each row for each delay and block of the stretch, (R, D, B)."""
    inner, blocks = _inner(sketch), sketch.criteria.lag_blocks
    block = np.cumsum(inner) * blocks // (inner.sum() + 1)
    member = np.arange(blocks)[:, None] == block
    costs = []
    for row, Y in zip(rows, shifted, strict=True):
        left = Y - row.basis @ (row.basis.T @ Y)
        costs.append((member[:, row.use] @ left**2).T)
    return np.array(costs)


def _best(sketch: Sketch, delays: Array, costs: Array) -> tuple[float, float]:
    """The common delay of rows (R, D, B) that makes the geometric mean of their costs least, and its standard error, s.

    That mean is the likelihood of joints whose noise is of unknown size. The standard error is that of the jackknife
    over blocks of time.
    """

    def least(parts: Array) -> float:
        return _vertex(delays, np.exp(np.log(parts + 1e-30).mean(axis=0)))

    whole, blocks = costs.sum(axis=2), costs.shape[2]
    without = np.array([least(whole - part) for part in np.moveaxis(costs, 2, 0)])
    error = np.sqrt((blocks - 1) * without.var())
    rounding = 0.01 * float(delays[1] - delays[0])
    return least(whole) + sketch.earlier, max(float(error), rounding)


def _vertex(x: Array, y: Array) -> float:
    """Minimum of the parabola through the lowest value and its neighbours."""
    k = int(np.argmin(y))
    if not 0 < k < len(x) - 1:
        return float(x[k])
    before, here, after = y[k - 1 : k + 2]
    return float(x[k] + 0.5 * (x[1] - x[0]) * (before - after) / max(before - 2 * here + after, 1e-300))
