"""The quantities on which a joint's residual may depend, at every n-th row of the joint.

Rows are counted over all motions, so that the choice does not depend on how a log was cut into motions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator

MOST_ROWS = 50_000
"""Rows of a joint, spread evenly, that give medians and dependences: more rows change no printed digit."""


def thinned(parts: Iterable[Array], every: int) -> Array:
    """Every n-th value of a sequence that comes in parts, counted over all parts."""
    kept, passed = [], 0
    for x in parts:
        kept.append(x[-passed % every :: every].copy())
        passed += len(x)
    return np.concatenate(kept)


def speeds(validator: CrossValidator) -> Iterator[Array]:
    """Speeds of the fitted joints over their rms speed, at each motion's filtered samples, (N, J)."""
    for state in validator.data.cache.sampled_states():
        v = state.v[:, list(validator.model.torque_index)]
        yield np.asarray(v / np.maximum(np.sqrt((v**2).mean(axis=0)), 1e-12))


def variables(validator: CrossValidator, row: int, every: int) -> dict[str, Array]:
    """Quantities of all joints at every n-th row of one joint, (n,) each: ``q1``, ``v1``, ``a1``, ..., and t.

    Returns
    -------
    dict of str to ndarray
        Positions in rad (m), speeds, accelerations, and ``t``, seconds since the log's beginning.
    """
    numbers = [str(validator.model.robot.numbers[name]) for name in validator.model.robot.joints]
    found: dict[str, list[Array]] = {}
    passed = 0
    for state, data in zip(validator.data.cache.sampled_states(), validator.data.motions_of(row), strict=True):
        picked = data.picked[-passed % every :: every]
        passed += len(data)
        found.setdefault("t", []).append(state.t[picked] - state.start)
        for symbol, values in (("q", state.q), ("v", state.v), ("a", state.a)):
            for number, x in zip(numbers, values.T, strict=True):
                found.setdefault(symbol + number, []).append(x[picked])
    return {name: np.concatenate(parts) for name, parts in found.items()}
