"""The delay of the measured torque behind the measured motion.

    d = argmin_d  Π_j  Σ_k (τ_j(t_k + d) − τ_nominal,j(t_k) − friction_j(t_k))²

over a common delay of all joints j (the product is the likelihood of joints with noise of unknown size). A delay of the
recording is common to all joints. Joints with different delays have filters of their own, or friction that lags.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from frischid.checks.log_issue import Notebook, span
from frischid.checks.sketch import Sketch
from frischid.core.types import Array


def check_lag(sketch: Sketch, notes: Notebook) -> None:
    """Find a delay between torque and motion, of all joints or of single ones."""
    part, criteria = sketch.longest, sketch.criteria
    longest = criteria.longest_torque_lag
    t = sketch.t[part]
    step = float(np.median(np.diff(t))) if len(t) > criteria.enough_samples else 0.0
    judged = [k for k in range(len(sketch.rows)) if sketch.asis[k] < 1.0]
    if step == 0 or t[-1] - t[0] < criteria.lag_lengths * longest or not judged or not sketch.robot.nominal.any():
        return
    coarse = np.arange(-np.ceil(longest / step), np.ceil(longest / step) + 1) * step
    costs = _costs(sketch, part, judged, coarse)
    found = [_best(coarse, cost) for cost in costs]
    lag, error = np.array(found).T
    common, spread = _best(coarse, _together(costs))
    whole = np.full(len(sketch.robot.joints), np.nan)
    whole[sketch.rows[judged]] = lag
    notes.per_joint("torque_lag", whole)
    notes.facts |= {"torque_lag": common, "torque_lag_error": spread}
    shifted = np.clip(np.array([0.0, common, *lag]), coarse[0], coarse[-1])
    left = _costs(sketch, part, judged, shifted).sum(axis=2)
    gone = 1 - float(np.exp(np.mean(np.log(left[:, 1] / left[:, 0]))))
    removed = 1 - np.diag(left[:, 2:]) / left[:, 0]
    near = np.abs(lag - common) < criteria.alike_lag * abs(common) + criteria.alike_lag_errors * error
    seen = np.mean((np.abs(lag) > criteria.seen_lag_errors * error) & near)
    own = (removed > criteria.explained_share) & (np.abs(lag) > criteria.significant_errors * error)
    where = tuple(sketch.names[k] for k, yes in zip(judged, own, strict=True) if yes)
    alike = gone > criteria.slight_lag_share and seen > criteria.alike_lag_joints
    if abs(common) > criteria.significant_errors * spread and (gone > criteria.common_lag_share or alike):
        by, sure = f"{abs(common):.3g} ± {spread:.2g} s", "likely" if gone > criteria.common_lag_share else "possible"
        _late(notes, by, common, gone, (), sure)
    elif where:
        alone = np.isin([sketch.names[k] for k in judged], where)
        _late(
            notes,
            span(np.abs(lag[alone]), " s"),
            float(lag[alone].sum()),
            float(removed[alone].min()),
            where,
            "possible",
        )


def _together(costs: Array) -> Array:
    """Geometric mean over joints: the likelihood of joints whose noise is of unknown size, (D, Q)."""
    return np.asarray(np.exp(np.log(costs + 1e-30).mean(axis=0)))


def _late(notes: Notebook, by: str, sign: float, gone: float, where: tuple[str, ...], sure: str) -> None:
    notes.add(
        "late torque" if sign > 0 else "early torque",
        f"the torque {'lags the motion' if sign > 0 else 'runs ahead of the motion'} by {by.lstrip('-')}: "
        f"shifting the torque by this time explains {gone:.0%} of the squared error of the URDF with fitted friction",
        where,
        "likely" if sure == "likely" else "possible",
        "record both with one clock and one filter, shift the columns, or add time_delay (frischid effects time_delay)",
    )


def _costs(sketch: Sketch, part: slice, judged: list[int], delays: Array) -> Array:
    """Squared error of each joint for each delay and quarter of the stretch, (R, D, Q)."""
    t = sketch.t[part]
    inner = (t >= t[0] + sketch.criteria.longest_torque_lag * 1.2) & (
        t <= t[-1] - sketch.criteria.longest_torque_lag * 1.2
    )
    quarters = sketch.criteria.lag_quarters
    quarter = np.arange(inner.sum()) * quarters // max(1, inner.sum())
    cost = np.empty((len(judged), len(delays), quarters))
    for i, j in enumerate(sketch.rows[judged]):
        tau = make_interp_spline(t, sketch.tau[part, j])
        nominal, use = sketch.nominal[part, j][inner], sketch.used[part, j][inner]
        X = sketch.friction(j)[part][inner][use]
        # with friction of either sign allowed, one factorisation serves all delays
        Q, _ = np.linalg.qr(X[:, :4])
        Y = np.column_stack([tau(t[inner] + d) - nominal for d in delays])[use]
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
