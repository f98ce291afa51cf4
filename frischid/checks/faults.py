"""A possible fault of a log or of the robot's description, its prior cost, and the mapping that would undo it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

from frischid.checks.check_criteria import CheckCriteria
from frischid.core.types import Array

Fix = tuple[str, str, Any]
"""Joint, key of its table in a mapping file, value."""
SURE_OR_NOT = re.compile(r"\{([^{}|]*)\|([^{}|]*)\}")


@dataclass(frozen=True, eq=False)
class Fault:
    """One possible fault.

    Attributes
    ----------
    kind, where, advice
        As in `LogIssue`.
    what : str
        The fault, with figures. ``{has|may have}`` holds the words of a likely fault and of a possible one.
    cost : float
        Nats.
    blocks : bool
        Whether an identification without the correction would be worthless.
    discrete : bool
        Whether it has no number that is fitted: such a fault cannot explain an error by chance.
    fix : tuple of Fix
        Entries of a mapping file that undo it.
    torque : ndarray, shape (M, J), optional
        Torque that a fault of the robot adds along the sketch.
    """

    kind: str
    what: str
    where: tuple[str, ...]
    advice: str
    cost: float
    blocks: bool = True
    discrete: bool = True
    fix: tuple[Fix, ...] = ()
    torque: Array | None = field(default=None, compare=False, repr=False)

    def said(self, *, possible: bool) -> str:
        """The fault in words: a fault that is only possible is not asserted.

        >>> Fault("torque sign", "the torque {has|may have} the wrong sign", (), "", 1.0).said(possible=True)
        'the torque may have the wrong sign'
        """
        return SURE_OR_NOT.sub(r"\2" if possible else r"\1", self.what)


def cost(criteria: CheckCriteria, kind: str, choices: int = 1, fitted: int = 0, samples: float = 1.0) -> float:
    """Nats of a fault that has several possible places and fitted numbers (Schwarz 1978: half log n each)."""
    fitting = 0.5 * fitted * math.log(max(samples, 2.0))
    return dict(criteria.fault_costs)[kind] + math.log(max(choices, 1)) + fitting
