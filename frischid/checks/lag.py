"""The delay of the measured torque behind the measured motion.

    d = argmin_d  Π_j  Σ_k (τ_j(t_k + d) − τ_nominal,j(t_k) − friction_j(t_k))²

over a common delay of all joints j (the product is the likelihood of joints with noise of unknown size). A delay of the
recording is common to all joints. Joints with different delays have filters of their own, or friction that lags.

A torque that is late hides other faults, and other faults hide the delay. A linear fit of each row by itself,
Y_j(t_k) θ_j in place of τ_nominal,j, does not depend on signs, gains, exchanged torques or bodies. So `clear_lag` finds
a delay before those faults are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from frischid.checks.log_issue import Notebook, span
from frischid.checks.sketch import Sketch
from frischid.core.text import percent
from frischid.core.types import Array

RANK_TOLERANCE = 1e-4
"""Singular value over the largest: a smaller one is that of parameters which the motion hardly shows."""


def check_lag(sketch: Sketch, notes: Notebook) -> None:
    """Find a delay between torque and motion, of all joints or of single ones."""
    criteria, delays = sketch.criteria, _delays(sketch)
    judged = [k for k in range(len(sketch.rows)) if sketch.asis[k] < 1.0]
    if not len(delays) or not judged or not sketch.robot.nominal.any():
        return
    rows = [_nominal_row(sketch, int(j)) for j in sketch.rows[judged]]
    costs = _costs(sketch, rows, delays)
    found = [_best(delays, cost) for cost in costs]
    lag, error = np.array(found).T
    common, spread = _best(delays, _together(costs))
    whole = np.full(len(sketch.robot.joints), np.nan)
    whole[sketch.rows[judged]] = lag + sketch.earlier
    notes.per_joint("torque_lag", whole)
    notes.facts |= {"torque_lag": common + sketch.earlier, "torque_lag_error": spread}
    # delays count from the torques as they were measured: the sketch may hold them moved
    left = _costs(sketch, rows, np.array([-sketch.earlier, common, *lag])).sum(axis=2)
    lag, common = lag + sketch.earlier, common + sketch.earlier
    gone = _removed(left)
    removed = 1 - np.diag(left[:, 2:]) / left[:, 0]
    near = np.abs(lag - common) < criteria.alike_lag * abs(common) + criteria.alike_lag_errors * error
    seen = np.mean((np.abs(lag) > criteria.seen_lag_errors * error) & near)
    own = (removed > criteria.explained_share) & (np.abs(lag) > criteria.significant_errors * error)
    where = tuple(sketch.names[k] for k, yes in zip(judged, own, strict=True) if yes)
    alike = gone > criteria.slight_lag_share and seen > criteria.alike_lag_joints
    if abs(common) > criteria.significant_errors * spread and (gone > criteria.common_lag_share or alike):
        by = f"{1e3 * abs(common):.1f} ± {1e3 * spread:.1f} ms"
        _late(notes, by, common, gone, (), "likely" if gone > criteria.common_lag_share else "possible")
    elif where:
        alone = np.isin([sketch.names[k] for k in judged], where)
        by = span(1e3 * np.abs(lag[alone]), " ms")
        _late(notes, by, float(lag[alone].sum()), float(removed[alone].min()), where, "possible")


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
    common, spread = _best(delays, _together(_costs(sketch, rows, delays)))
    clear = abs(common) > criteria.significant_errors * spread
    gone = _removed(_costs(sketch, rows, np.array([0.0, common])).sum(axis=2)) if clear else 0.0
    return common if gone > criteria.common_lag_share else 0.0


@dataclass(frozen=True)
class _Row:
    """A row of the longest stretch: its joint, known torque, samples that count, basis of the fitted torques."""

    joint: int
    known: Array
    use: NDArray[np.bool_]
    basis: Array


def _nominal_row(sketch: Sketch, j: int) -> _Row:
    """The URDF's torque and friction; with friction of either sign allowed, one factorisation serves all delays."""
    part, use = sketch.longest, _inner(sketch) & sketch.used[sketch.longest, j]
    return _Row(j, sketch.nominal[part, j], use, np.linalg.qr(sketch.friction(j)[part][use][:, :4])[0])


def _free_row(sketch: Sketch, j: int, columns: Array) -> _Row:
    """Friction and every parameter of every link, (M, C): an orthonormal basis of what they can explain."""
    use = _inner(sketch) & sketch.used[sketch.longest, j]
    X = np.column_stack([columns[use], sketch.friction(j)[sketch.longest][use][:, :4]])
    X = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(X, full_matrices=False)
    return _Row(j, np.zeros(len(use)), use, left[:, size > RANK_TOLERANCE * size.max(initial=0.0)])


def _delays(sketch: Sketch) -> Array:
    """Delays that are searched, s; none where the longest stretch is too short to judge them."""
    t, longest, criteria = sketch.t[sketch.longest], sketch.criteria.longest_torque_lag, sketch.criteria
    step = float(np.median(np.diff(t))) if len(t) > criteria.enough_samples else 0.0
    if step == 0 or t[-1] - t[0] < criteria.lag_lengths * longest:
        return np.zeros(0)
    return np.asarray(np.arange(-np.ceil(longest / step), np.ceil(longest / step) + 1) * step)


def _inner(sketch: Sketch) -> NDArray[np.bool_]:
    """Samples of the longest stretch whose torque is known at every delay."""
    t, margin = sketch.t[sketch.longest], sketch.criteria.longest_torque_lag * 1.2
    return np.asarray((t >= t[0] + margin) & (t <= t[-1] - margin))


def _removed(left: Array) -> float:
    """Share of the squared error that the second delay explains beyond the first, geometric mean over joints."""
    return 1 - float(np.exp(np.mean(np.log(left[:, 1] / left[:, 0]))))


def _together(costs: Array) -> Array:
    """Geometric mean over joints: the likelihood of joints whose noise is of unknown size, (D, Q)."""
    return np.asarray(np.exp(np.log(costs + 1e-30).mean(axis=0)))


def _late(notes: Notebook, by: str, sign: float, gone: float, where: tuple[str, ...], sure: str) -> None:
    notes.add(
        "late torque" if sign > 0 else "early torque",
        f"the torque {'lags the motion' if sign > 0 else 'runs ahead of the motion'} by {by.lstrip('-')}: "
        f"shifting the torque by this time explains {percent(gone)} of the squared error of the URDF with fitted "
        "friction",
        where,
        "likely" if sure == "likely" else "possible",
        "record both with one clock and one filter, shift the columns, or add time_delay (frischid effects time_delay)",
    )


def _costs(sketch: Sketch, rows: Sequence[_Row], delays: Array) -> Array:
    """Squared error of each row for each delay and quarter of the stretch, (R, D, Q)."""
    t, inner, quarters = sketch.t[sketch.longest], _inner(sketch), sketch.criteria.lag_quarters
    quarter = np.cumsum(inner) * quarters // (inner.sum() + 1)
    cost = np.empty((len(rows), len(delays), quarters))
    for i, row in enumerate(rows):
        tau, use, Q = make_interp_spline(t, sketch.tau[sketch.longest, row.joint]), row.use, row.basis
        Y = np.column_stack([tau(t[use] + d) - row.known[use] for d in delays])
        left = (Y - Q @ (Q.T @ Y)) ** 2
        cost[i] = np.stack([np.bincount(quarter[use], x, quarters) for x in left.T])
    return cost


def _best(delays: Array, cost: Array) -> tuple[float, float]:
    """Delay with the least cost summed over the quarters, and its standard error from the quarters; cost (D, Q)."""
    whole = _vertex(delays, cost.sum(axis=1))
    parts = [_vertex(delays, x) for x in cost.T]
    return whole, max(float(np.std(parts)) / np.sqrt(cost.shape[1] - 1), 0.01 * float(delays[1] - delays[0]))


def _vertex(x: Array, y: Array) -> float:
    """Minimum of the parabola through the lowest value and its neighbours."""
    k = int(np.argmin(y))
    if not 0 < k < len(x) - 1:
        return float(x[k])
    before, here, after = y[k - 1 : k + 2]
    return float(x[k] + 0.5 * (x[1] - x[0]) * (before - after) / max(before - 2 * here + after, 1e-300))
