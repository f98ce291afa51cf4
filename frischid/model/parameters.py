"""Base parameters one by one, by position and by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from frischid.core.named_sequence import NamedSequence
from frischid.estimators.least_squares import Estimate


class Parameter(NamedTuple):
    """One base parameter.

    Attributes
    ----------
    name : str
        Short name, for example ``"mx1R"``.
    expression : str
        The sum of parameters that it stands for, for example ``"mx1 + 0.5 m2"``.
    unit : str
    joint, effect : str
        Where it belongs; ``"rigid"`` is the effect of the links.
    value, stderr : float
        Value and standard error, in `unit`.
    """

    name: str
    expression: str
    unit: str
    joint: str
    effect: str
    value: float
    stderr: float


def parameters_by_name(estimate: Estimate, expressions: Sequence[str]) -> NamedSequence[Parameter]:
    """Base parameters of an estimate; `expressions` says of each which parameters it stands for."""
    parts = zip(estimate.columns, expressions, estimate.theta, estimate.stderr, strict=True)
    values = [Parameter(c.name, text, c.unit, c.joint, c.effect, float(x), float(s)) for c, text, x, s in parts]
    return NamedSequence("parameter", {value.name: value for value in values})
