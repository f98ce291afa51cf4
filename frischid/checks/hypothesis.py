"""A set of faults that may explain a log, and the same set without some of its faults.

A fault that adds a torque is taken back by its torque, and a shifted zero by the torque of the links at the recorded
angles:

    τ(h without f) = τ(h) − τ_f,        τ(h without a zero δ_j) = τ(h) + τ_URDF(q) − τ_URDF(q + δ_j e_j).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from frischid.checks.faults import Fault
from frischid.checks.position_faults import JOINT_ZERO
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.core.types import Array

POSITION_KINDS = ("position sign", "swapped positions", "swapped joints", JOINT_ZERO, "degrees")


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Some faults, their score, the errors that they leave (R,), and the log with them undone."""

    faults: tuple[Fault, ...]
    score: float
    errors: Array
    sketch: Sketch

    @property
    def key(self) -> frozenset[tuple[str, tuple[str, ...]]]:
        """The claim of the hypothesis."""
        return frozenset((fault.kind, fault.where) for fault in self.faults)


def hypothesis_of(faults: tuple[Fault, ...], sketch: Sketch) -> Hypothesis:
    """Some faults that a sketch holds undone."""
    errors = sketch.errors(sketch.nominal)
    return Hypothesis(faults, RowFits(sketch).total(errors) - sum(f.cost for f in faults), errors, sketch)


def without(hypothesis: Hypothesis, dropped: Sequence[Fault]) -> Hypothesis:
    """A hypothesis without some of its `separable` faults; the numbers of the other faults stay as they are."""
    sketch = hypothesis.sketch
    nominal = sketch.nominal - sum(f.torque for f in dropped if f.torque is not None)
    shift = np.zeros(len(sketch.robot.joints))
    for fault in dropped:
        if fault.kind == JOINT_ZERO:
            shift[sketch.robot.joints.index(fault.where[0])] += fault.fix[0][2]
    if shift.any():
        back = sketch.moving(q=sketch.q - shift)
        nominal = nominal + back.nominal - sketch.motion.rigid
        sketch = back
    kept = tuple(f for f in hypothesis.faults if f not in dropped)
    return hypothesis_of(kept, replace(sketch, given_nominal=nominal))


def separable(hypothesis: Hypothesis) -> list[Fault]:
    """Faults that can be taken back: added torques, and zeros where no other fault changes the positions."""
    zeros = all(f.kind == JOINT_ZERO for f in hypothesis.faults if f.kind in POSITION_KINDS)
    return [f for f in hypothesis.faults if f.torque is not None or (zeros and f.kind == JOINT_ZERO)]


def parts_of(hypothesis: Hypothesis) -> Iterator[Hypothesis]:
    """A hypothesis without some of its faults that can be taken back: each may take up what the URDF misses anyway."""
    faults = separable(hypothesis)
    for n in range(1, len(faults) + 1):
        for dropped in combinations(faults, n):
            yield without(hypothesis, dropped)
