"""Base parameters one by one, by position and by name."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
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


def numbering(estimate: Estimate, numbers: Mapping[str, int]) -> str:
    """Which joint the number in a parameter's name means; empty where the names of the joints end with it.

    Parameters
    ----------
    numbers : mapping of str to int
        Number of each joint (`Robot.numbers`).

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.model.parameters import numbering
    >>> robot = fr.Robot.load("ur10", joints=["elbow_joint", "wrist_1_joint"])
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(tau=0.1))
    >>> numbering(fr.identify(robot, [log], recursion="none").model.estimate, robot.numbers)
    'numbers in names of parameters: 1 is elbow_joint, 2 is wrist_1_joint'
    """
    return joint_numbers({c.joint for c in estimate.columns}, numbers)


def joint_numbers(joints: Collection[str], numbers: Mapping[str, int]) -> str:
    """Which of these joints the number in a parameter's name means; empty where their names end with it."""
    found = {name: k for name, k in numbers.items() if name in joints}
    if all(re.findall(r"\d+", name)[-1:] == [str(k)] for name, k in found.items()):
        return ""
    return f"numbers in names of parameters: {', '.join(f'{k} is {name}' for name, k in found.items())}"
