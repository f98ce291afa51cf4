"""The user's own effect: one coefficient times an expression.

    τ_j = c · expression(q, q̇, q̈, load, τ_model, temperature, t)

written as ``formula("sin(3*q2)*v1")@shoulder``. A number after a quantity is a joint number as in parameter names. A
quantity without a number belongs to the joint that the effect acts on. See `frischid.effects.expression` for the
language.

Source of the idea of a library of candidate functions: Brunton, Proctor and Kutz 2016, PNAS 113(15).
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.expression import QUANTITIES, VARIABLE_NAME, Expression
from frischid.effects.state import State, Term
from frischid.effects.units import torque_unit
from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import Robot

LARGEST_VALUE = 1e9
"""Largest value of a formula. Columns of other effects are near one; sums of products of both keep digits."""


@dataclass(frozen=True)
class Formula(Effect):
    """A column given as an expression.

    Attributes
    ----------
    expression : str
        Arithmetic over ``q``, ``v``, ``a`` (rad, rad/s, rad/s²; m when sliding), ``load`` and ``tau_model`` (torque of
        the rigid body, and of the whole model, N·m), ``temperature`` (°C, from the log) and ``t`` (s since the log's
        beginning).
    """

    id = "formula"
    title = "the user's own formula"
    equation = "c·expression(q, v, a, load, tau_model, temperature, t)"
    symbols: ClassVar = {
        "c": "identified coefficient",
        "expression": "the formula that you write",
    }
    sentence = "{joint} needs torque that follows a formula of your own"
    looks_like = "a residual that follows the formula"
    confused_with = ("joint_spring", "cogging", "quadratic_viscous")
    confirmed_by = "record a motion on which the formula's variables change independently of one another"
    reference = "Brunton, Proctor and Kutz 2016, PNAS 113(15)"

    loaded = True
    candidate = "never"
    several = True
    stated = ("expression",)

    expression: str = "sin(q)*v"

    def __post_init__(self) -> None:
        _ = self._parsed

    @cached_property
    def _parsed(self) -> Expression:
        return Expression.parse(self.expression)

    @property
    def tree(self) -> ast.expr:
        """The expression's checked syntax tree."""
        return self._parsed.tree

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """``temperature_<joint>`` of every temperature in the expression."""
        wanted = {
            f"temperature_{robot.joints[_joint(robot, name, i, self.expression)]}": None
            for name in self._parsed.variables
            if name.startswith("temperature")
            for i, _, _ in self.acts_on(robot)
        }
        return tuple(wanted)

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the value of the expression."""
        return [self._term(state, *joint) for joint in self.acts_on(state.robot)]

    def _term(self, state: State, i: int, name: str, number: str) -> Term:
        values = {variable: _quantity(state, variable, i, self.expression) for variable in self._parsed.variables}
        result = np.broadcast_to(self._parsed(values), len(state.t)).copy()
        if not np.isfinite(result).all():
            first = int(np.flatnonzero(~np.isfinite(result))[0])
            raise InputError(
                f"formula '{self.expression}' has no finite value on joint {name} at t = {state.t[first]:.4g} s; "
                "guard its divisions, logarithms and roots, for example sqrt(abs(x)) or x/(abs(x) + 0.01)"
            )
        if (largest := float(np.abs(result).max(initial=0.0))) > LARGEST_VALUE:
            raise InputError(
                f"formula '{self.expression}' reaches {largest:.3g} on joint {name}, and its coefficient would be lost "
                f"among the others; divide the expression, so that its values stay below {LARGEST_VALUE:g}"
            )
        compact = self.expression.replace(" ", "")
        unit = f"{torque_unit(state.robot, i)}/[{compact}]"
        return Term(self.column(f"c[{compact}]", unit, name, number), {i: result})


def _joint(robot: Robot, variable: str, own: int, expression: str) -> int:
    """Index of the joint that a variable belongs to."""
    found = VARIABLE_NAME.fullmatch(variable)
    number = found.group(2) if found else ""
    if not number:
        return own
    numbered = {str(robot.numbers[name]): i for i, name in enumerate(robot.joints)}
    if number not in numbered:
        joints = ", ".join(f"{n} {robot.joints[i]}" for n, i in numbered.items())
        valid = [variable.removesuffix(number) + n for n in numbered]
        raise UnknownNameError("variable", variable, valid, f"formula '{expression}' on {robot.name} (joints {joints})")
    return numbered[number]


def _quantity(state: State, variable: str, own: int, expression: str) -> Array:
    """Values of a variable along the motion, (N,)."""
    if variable == "t":
        return state.t - state.start
    joint = _joint(state.robot, variable, own, expression)
    kind = variable.rstrip("0123456789")
    if kind == "temperature":
        channel = f"temperature_{state.robot.joints[joint]}"
        if len(state.t) and channel not in state.extra:
            raise UnknownNameError("channel", channel, state.extra, f"the log (formula '{expression}')")
        return np.asarray(state.extra.get(channel, np.zeros(len(state.t))))
    channels = dict(zip(QUANTITIES, (state.q, state.v, state.a, state.load, state.torque), strict=False))
    return channels[kind][:, joint]
