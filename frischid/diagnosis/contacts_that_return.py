"""Bursts that return with the state of their joint are no contacts: what acts all the time repeats with the motion.

A missing effect of any kind is a function of the joint's state s = (q, q̇, q̈, load), or nearly so. So the residual of a
burst can be predicted from other times at which the joint was in a similar state. A contact cannot be predicted: at
these other times nothing touched the robot. With the k nearest states s_m outside the burst,

    ê(t) = mean of e(t_m),      share = 1 − Σ (e − ê)² / Σ (e − ē)²     over the bursts of all joints,

each joint over its own spread. ē is the mean of e over all times outside the burst: pushes of one direction in a fifth
of the time are predicted by a fifth wherever the neighbours lie. The prediction knows no equation, so it also sees
effects outside the catalogue.

A few pushes may meet in similar states by chance, so the share of B bursts has a standard error (that of a ratio),

    s² = B/(B − 1) Σ_b (g_b − share · E_b)² / (Σ_b E_b)²,      E_b = Σ (e − ē)²,   g_b = E_b − Σ (e − ê)²  in burst b.

Sources: Stone 1977, "Consistent nonparametric regression", Annals of Statistics 5(4); Cochran 1977, Sampling
Techniques, section 6.4 (the standard error of a ratio).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.residual_variables import MOST_ROWS
from frischid.diagnosis.stretches import Stretch

NEIGHBOURS = 10
"""States whose residuals are averaged: their mean has a third of the noise of one."""


def returning_share(validator: CrossValidator, rest: CrossValidator, bursts: Sequence[Stretch]) -> float:
    """Share of the bursts' squared residual that other times predict surely: less its standard error over the bursts.

    Parameters
    ----------
    validator : CrossValidator
        Of all rows.
    rest : CrossValidator
        Of the rows without the bursts: its parameters give the residual.
    bursts : sequence of (str, float, float)
        Source, start and stop of each burst, s.

    Returns
    -------
    float
        Below zero where the prediction is worse than none. One burst alone has no standard error.
    """
    squares, left = np.zeros(len(bursts)), np.zeros(len(bursts))
    for row, spread in enumerate(validator.spread):
        states, residual, burst, around = _rows(validator, rest.theta, row, bursts)
        for number in np.unique(burst[burst >= 0]):
            inside, outside = burst == number, np.flatnonzero((burst != number) & (around != number))
            if len(outside) < NEIGHBOURS:
                continue
            outside = outside[:: max(1, len(outside) // MOST_ROWS)]
            _, near = cKDTree(states[outside]).query(states[inside], NEIGHBOURS)
            error = residual[inside] - residual[outside][near].mean(axis=1)
            squares[number] += float(np.sum((residual[inside] - residual[outside].mean()) ** 2)) / spread**2
            left[number] += float(error @ error) / spread**2
    whole, count = float(squares.sum()), int((squares > 0).sum())
    if not whole > 0:
        return 0.0
    share = 1.0 - float(left.sum()) / whole
    off = squares - left - share * squares
    return share - float(np.sqrt(off @ off * count / max(count - 1, 1))) / whole


def _rows(
    validator: CrossValidator, theta: Array, row: int, bursts: Sequence[Stretch]
) -> tuple[Array, Array, Array, Array]:
    """State of a joint at its rows in units of its spread (n, 4), its residual (n,), and its burst or −1, (n,).

    And the burst within a second of the row, or −1, (n,): a push has a beginning and an end that are no burst yet.
    """
    j = validator.model.torque_index[row]
    states, residuals, marks, near = [], [], [], []
    beside = validator.criteria.block_seconds
    for state, data in zip(validator.data.cache.sampled_states(), validator.data.motions_of(row), strict=True):
        k = data.picked
        states.append(np.column_stack([x[k, j] for x in (state.q, state.v, state.a, state.load)]))
        residuals.append(validator.columns.residual(data, theta))
        mark, margin, t = np.full(len(k), -1), np.full(len(k), -1), state.t[k]
        for number, (source, start, stop) in enumerate(bursts):
            if source == data.motion.source:
                mark[(t >= start) & (t <= stop)] = number
                margin[(t >= start - beside) & (t <= stop + beside)] = number
        marks.append(mark)
        near.append(margin)
    found = np.concatenate(states)
    scaled = found / np.maximum(found.std(axis=0), 1e-12)
    return scaled, np.concatenate(residuals), np.concatenate(marks), np.concatenate(near)
