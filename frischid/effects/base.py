"""What a physical effect is: one frozen dataclass with one method.

An effect adds columns to the regression, ``τ = Γ θ_rigid + Σ_effects C_e(state) θ_e``. `Effect.terms` returns them
for a stretch of motion, each with its parameter's name, unit and known sign. Everything else that frischid knows of
an effect (the command line's list, the simulator, the diagnosis, the report, the test matrix) is read from the class:
defining a subclass is all there is to adding one.
"""

from __future__ import annotations

import dataclasses
import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from frischid.errors import InputError, UnknownNameError
from frischid.gram import Column, Sign
from frischid.robot import Robot

Array = NDArray[np.float64]

EFFECTS: dict[str, type[Effect]] = {}
"""The catalogue: identifier -> effect class, in order of definition."""


@dataclass(frozen=True, eq=False)
class State:
    """A stretch of motion as effects see it.

    Attributes
    ----------
    robot : Robot
    t : ndarray, shape (N,)
        Time, s.
    q, v, a : ndarray, shape (N, J)
        Joint positions (rad, m), velocities and accelerations.
    load : ndarray, shape (N, J)
        Rigid-body torque of the reference parameters; zero unless the effect is `Effect.loaded`.
    torque : ndarray, shape (N, J)
        Torque of the reference parameters with all columns that come before this effect's; likewise.
    start : float
        Time at which the log begins, s.
    extra : mapping of str to ndarray, shape (N,)
        Other channels of the log, for example ``temperature_<joint>``.
    """

    robot: Robot
    t: Array
    q: Array
    v: Array
    a: Array
    load: Array
    torque: Array
    start: float = 0.0
    extra: Mapping[str, Array] = dataclasses.field(default_factory=dict)

    @classmethod
    def empty(cls, robot: Robot) -> State:
        """No samples: for asking an effect only what its columns are."""
        none = np.empty((0, len(robot.joints)))
        return cls(robot, np.empty(0), none, none, none, none, none)


@dataclass(frozen=True, eq=False)
class Term:
    """One column an effect adds.

    Attributes
    ----------
    column : Column
        Name, unit, joint, effect and known sign of its parameter.
    rows : dict of int to ndarray, shape (N,)
        Joint index -> torque on that joint per unit of the parameter; absent joints feel nothing.
    """

    column: Column
    rows: Mapping[int, Array]


@dataclass(frozen=True)
class Effect(ABC):
    """Base of all effects.

    Attributes
    ----------
    joints : tuple of str or None
        Joints it acts on; None means all.
    """

    id: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    sentence: ClassVar[str]
    looks_like: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]]
    confirmed_by: ClassVar[str]
    reference: ClassVar[str]
    dry: ClassVar[bool] = False
    """Whether the effect has no definite value at standstill, so that resting joints must be left out."""
    memory: ClassVar[bool] = False
    """Whether a sample's columns depend on other samples, so that whole motions must be evaluated at once."""
    loaded: ClassVar[bool] = False
    """Whether the columns depend on `State.load` or `State.torque`."""
    candidate: ClassVar[Literal["joint", "robot", "never"]] = "joint"
    """What the diagnosis tries: one joint at a time, the whole robot, or nothing."""
    change: ClassVar[bool] = False
    """Whether it is something that happens to a robot (a payload, a tilt) rather than part of it from the start."""
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    """Values the diagnosis tries for each shape parameter, in order; it refines between neighbours."""

    joints: tuple[str, ...] | None = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "id" in cls.__dict__:
            EFFECTS[cls.id] = cls

    @abstractmethod
    def terms(self, state: State) -> list[Term]:
        """Columns of this effect over `state`."""

    @classmethod
    def variants(cls, joints: tuple[str, ...] | None) -> list[Self]:
        """One effect for every combination of the shape parameters' values."""
        combinations = itertools.product(*cls.shapes.values())
        return [cls(joints=joints, **dict(zip(cls.shapes, values, strict=True))) for values in combinations]

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """What the diagnosis may find missing: alternatives that differ in where they act, each in all its shapes."""
        if cls.candidate == "never":
            return []
        places = [None] if cls.candidate == "robot" else [(name,) for name in robot.joints]
        return [cls.variants(place) for place in places]

    def columns(self, robot: Robot) -> list[Column]:
        """Names, units and signs of the columns, without any motion."""
        return [term.column for term in self.terms(State.empty(robot))]

    def nominal(self, robot: Robot) -> list[float]:
        """Values of the parameters that the URDF itself states, one a column; zero where it says nothing."""
        return [0.0] * len(self.columns(robot))

    def acts_on(self, robot: Robot) -> list[tuple[int, str, str]]:
        """Index, name and number of the joints this effect acts on.

        Raises
        ------
        UnknownNameError
            The effect names a joint the robot does not have.
        """
        for name in self.joints or ():
            if name not in robot.joints:
                raise UnknownNameError("joint", name, robot.joints, f"effect {self.id}")
        return [
            (i, name, str(robot.numbers[name]))
            for i, name in enumerate(robot.joints)
            if self.joints is None or name in self.joints
        ]

    def column(self, symbol: str, unit: str, joint: str, number: str, sign: Sign = 0) -> Column:
        """Build a column ``symbol + number`` that belongs to this effect."""
        return Column(f"{symbol}{number}", unit, joint, self.id, sign)

    @property
    def parameters(self) -> dict[str, float | bool | str]:
        """Shape parameters of this effect (not identified, only stated)."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "joints"}

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values from which `effect_from_dict` builds the effect again."""
        return {"effect": self.id, "joints": None if self.joints is None else list(self.joints), **self.parameters}

    def __str__(self) -> str:
        inner = ", ".join(f"{k}={v:g}" if isinstance(v, float) else f"{k}={v}" for k, v in self.parameters.items())
        where = "" if self.joints is None else "@" + "+".join(self.joints)
        return f"{self.id}{f'({inner})' if inner else ''}{where}"


def torque_unit(robot: Robot, joint: int, per: str = "") -> str:
    """Unit of a joint's torque (force, when it slides) per rad/s, rad/s² or nothing."""
    slides = bool(robot.prismatic[joint])
    units = {
        "": ("N·m", "N"),
        "rate": ("N·m·s/rad", "N·s/m"),
        "acceleration": ("kg·m²", "kg"),
    }
    return units[per][slides]


def effect_from_dict(data: Mapping[str, Any]) -> Effect:
    """Inverse of `Effect.to_dict`.

    Raises
    ------
    UnknownNameError
        No such effect, or it has no such parameter.
    """
    values = dict(data)
    name = str(values.pop("effect"))
    if name not in EFFECTS:
        raise UnknownNameError("effect", name, EFFECTS)
    kind = EFFECTS[name]
    known = {f.name: f.default for f in dataclasses.fields(kind)}
    joints = values.pop("joints", None)
    for key, value in values.items():
        if key not in known:
            raise UnknownNameError("parameter", key, set(known) - {"joints"}, f"effect {name}")
        number = isinstance(known[key], float) and isinstance(value, int | float) and not isinstance(value, bool)
        if isinstance(known[key], bool | float | str) and not (number or type(value) is type(known[key])):
            raise InputError(f"effect {name}: {key} = {value!r}, expected something like {known[key]!r}")
    return kind(joints=None if joints is None else tuple(joints), **values)


def parse_effects(text: str) -> tuple[Effect, ...]:
    """Read ``"viscous, coulomb(width=0.02), offset@joint1+joint2"``.

    Raises
    ------
    InputError
        The text is malformed; UnknownNameError when a name does not exist.
    """
    effects = [_parse_one(item) for item in _split(text) if item.strip()]
    if len({(e.id, e.joints) for e in effects}) < len(effects):
        raise InputError(f"effects '{text}': the same effect is named twice for the same joints")
    return tuple(effects)


def _split(text: str) -> list[str]:
    """Split at commas that are not inside parentheses."""
    items, depth = [""], 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if character == "," and depth == 0:
            items.append("")
        else:
            items[-1] += character
    return items


def _parse_one(item: str) -> Effect:
    head, _, joints = item.strip().partition("@")
    name, bracket, inside = head.partition("(")
    if bracket and not inside.endswith(")"):
        raise InputError(f"effect '{item.strip()}': write it as name(parameter=value)@joint+joint")
    values: dict[str, Any] = {"effect": name.strip()}
    for pair in filter(None, (p.strip() for p in inside.removesuffix(")").split(","))):
        key, _, value = pair.partition("=")
        values[key.strip()] = _value(value.strip(), item)
    if joints:
        values["joints"] = [j.strip() for j in joints.split("+")]
    return effect_from_dict(values)


def _value(text: str, item: str) -> float | bool | str:
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    try:
        return float(text)
    except ValueError:
        if text:
            return text
        raise InputError(f"effect '{item.strip()}': a parameter has no value; write name(parameter=value)") from None


def columns_of(robot: Robot, effects: Sequence[Effect]) -> tuple[Column, ...]:
    """Columns of the whole regressor: rigid, then every effect's.

    Raises
    ------
    InputError
        Two effects make a column of the same name.
    """
    columns = [*robot.columns, *(c for effect in effects for c in effect.columns(robot))]
    names = [c.name for c in columns]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise InputError(f"parameter {twice} comes twice: two effects describe the same thing on the same joint")
    return tuple(columns)
