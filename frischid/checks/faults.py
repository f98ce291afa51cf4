"""A possible fault of a log or of the robot's description, its prior cost, and the mapping that would undo it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

Fix = tuple[str, str, Any]
"""Joint, key of its table in a mapping file, value."""

TORQUE_SIGN = "torque sign"
COSTS = {
    "all torque signs": 1.0,
    "degrees": 2.0,
    "common scale": 2.0,
    TORQUE_SIGN: 3.0,
    "swapped torques": 4.0,
    "position sign": 4.0,
    "swapped joints": 4.0,
    "swapped positions": 5.0,
    "joint zero": 4.0,
    "mounting": 4.0,
    "payload": 3.0,
    "torque scale": 5.0,
    "spring": 6.0,
    "motor coupling": 6.0,
}
"""Nats, the negative logarithm of how common each fault is. One convention for all drives is the most common fault;
turned, exchanged and shifted joints follow; gains, springs and couplings are rarer. The choice among joints, and each
fitted number, cost more on top of it (see `cost`)."""


@dataclass(frozen=True)
class Fault:
    """One possible fault.

    Attributes
    ----------
    kind, what, where, advice
        As in `LogIssue`.
    cost : float
        Nats.
    blocks : bool
        Whether an identification without the correction would be worthless.
    discrete : bool
        Whether it has no number that is fitted: such a fault cannot explain an error by chance.
    fix : tuple of Fix
        Entries of a mapping file that undo it.
    """

    kind: str
    what: str
    where: tuple[str, ...]
    advice: str
    cost: float
    blocks: bool = True
    discrete: bool = True
    fix: tuple[Fix, ...] = ()


def cost(kind: str, choices: int = 1, fitted: int = 0, samples: float = 1.0) -> float:
    """Nats of a fault that has several possible places and fitted numbers (Schwarz 1978: half log n each)."""
    return COSTS[kind] + float(np.log(max(choices, 1))) + 0.5 * fitted * float(np.log(max(samples, 2.0)))
