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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from frischid.core.types import Array, Column, Sign
from frischid.effects.dynamics import RigidDynamics, Slopes
from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import Robot

EFFECTS: dict[str, type[Effect]] = {}
"""The catalogue: identifier -> effect class, in order of definition."""

ANGLE, SPEED, SECONDS, CELSIUS = ("rad", "m"), ("rad/s", "m/s"), ("s", "s"), ("°C", "°C")
"""Units of shape parameters on a turning joint, on a sliding one."""

WIDTH = 0.005
"""Speed over which the sign of a speed is smoothed, rad/s (m/s): at standstill its sign is a coin toss."""


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
    reference : ndarray, shape (R,), optional
        Reference values of ``robot.columns``, those `load` is made of; None: the URDF's own.
    dry : ndarray, shape (J,), optional
        Level of the reference's dry friction, N·m (N); None: not known, taken as none.
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
    reference: Array | None = None
    dry: Array | None = None

    @classmethod
    def empty(cls, robot: Robot) -> State:
        """No samples: for asking an effect only what its columns are."""
        none = np.empty((0, len(robot.joints)))
        return cls(robot, np.empty(0), none, none, none, none, none)

    @cached_property
    def rigid(self) -> RigidDynamics:
        """Rigid-body dynamics of the reference parameters, for states other than the measured ones."""
        return RigidDynamics.of(self.robot, self.reference)

    @cached_property
    def slopes(self) -> Slopes:
        """Derivatives of the reference's rigid torque along this motion."""
        return self.rigid.slopes(self.q, self.v, self.a)

    def rates(self, x: Array) -> tuple[Array, Array]:
        """First and second time derivative of a channel (N,) or several (N, ...): those of the spline through it.

        Raises
        ------
        InputError
            The samples are not in the order of time, so nothing can be differentiated.
        """
        degree = min(5, len(self.t) - 1)
        if degree < 2:
            return np.zeros_like(x), np.zeros_like(x)
        spline = self._spline(x, degree)
        return np.asarray(spline.derivative(1)(self.t)), np.asarray(spline.derivative(2)(self.t))

    def earlier(self, x: Array, by: float) -> Array:
        """Channels (N, ...) as they were some seconds earlier (later, where negative): the spline through them.

        Raises
        ------
        InputError
            The samples are not in the order of time.
        """
        degree = min(3, len(self.t) - 1)
        if degree < 1:
            return x
        return np.asarray(self._spline(x, degree)(np.clip(self.t - by, self.t[0], self.t[-1])))

    def require_times(self) -> None:
        """Raise InputError unless the samples are in the order of time."""
        if (np.diff(self.t) <= 0).any():
            raise InputError(
                "an effect needs the torque's past and its rate: give the samples' times, in increasing order"
            )

    def _spline(self, x: Array, degree: int) -> BSpline:
        self.require_times()
        return make_interp_spline(self.t, x, k=degree)


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
    several: ClassVar[bool] = False
    """Whether it may come more than once on the same joints, with other parameters."""
    single: ClassVar[bool] = False
    """Whether it acts in one place only: the diagnosis then does not add further joints to it."""
    generalises: ClassVar[tuple[str, ...]] = ()
    """Effects this one contains: where one of them explains nearly as much, that one is named."""
    least: ClassVar[float] = 0.0
    """Size of its parameters below which the effect is not worth its name, however significant."""
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    """Values the diagnosis tries for each shape parameter, in order; it refines between neighbours."""
    units: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """Units of its parameters on a turning joint, on a sliding one; those that are pure numbers are not in it."""

    friction: ClassVar[bool] = False
    """Whether it is part of what `Model.friction` returns."""
    code: ClassVar[Mapping[str, str]] = {}
    """Parameter's symbol -> its column in terms of {q}, {v}, {a} of its joint and of shape parameters, for generated
    code; empty where a joint's own state does not say it all."""

    joints: tuple[str, ...] | None = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "id" in cls.__dict__:
            EFFECTS[cls.id] = cls

    @property
    def searched(self) -> Mapping[str, tuple[float, ...]]:
        """Those of `shapes` that its columns depend on."""
        return self.shapes

    @abstractmethod
    def terms(self, state: State) -> list[Term]:
        """Columns of this effect over `state`."""

    @classmethod
    def each(cls, effects: Sequence[Self], state: State) -> Iterator[list[Term]]:
        """Columns of several effects of this kind over `state`: for kinds that compute them faster together."""
        return (effect.terms(state) for effect in effects)

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

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """Extra channels of a log that this effect reads (see `State.extra`)."""
        return ()

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

    def per_joint(
        self, state: State, symbol: str, per: str, values: Callable[[int], Array], sign: Sign = 0
    ) -> list[Term]:
        """One column for each joint the effect acts on, in that joint's own row; `per` as in `torque_unit`."""
        return [
            Term(self.column(symbol, torque_unit(state.robot, i, per), name, number, sign), {i: values(i)})
            for i, name, number in self.acts_on(state.robot)
        ]

    def require_positive(self, **meanings: str) -> None:
        """Raise InputError unless each of these shape parameters is a positive number; `meanings` says of what."""
        for name, meaning in meanings.items():
            value = getattr(self, name)
            if not is_number(value) or value <= 0:
                raise InputError(f"{self.id}: {name} must be a positive {meaning}, got {value}")

    @property
    def parameters(self) -> dict[str, float | bool | str]:
        """Shape parameters of this effect (not identified, only stated)."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "joints"}

    def unit(self, parameter: str, robot: Robot | None = None) -> str:
        """Unit of a shape parameter, empty for a pure number: on a robot's joints, or on turning (and sliding) ones."""
        sliding = [False, True] if robot is None else sorted(bool(robot.prismatic[i]) for i, *_ in self.acts_on(robot))
        turns, *slides = dict.fromkeys(self.units.get(parameter, ("", ""))[s] for s in sliding)
        return turns + "".join(f" ({unit})" for unit in slides)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values from which `effect_from_dict` builds the effect again."""
        return {"effect": self.id, "joints": None if self.joints is None else list(self.joints), **self.parameters}

    def __str__(self) -> str:
        inner = ", ".join(f"{k}={_written(v)}" for k, v in self.parameters.items())
        where = "" if self.joints is None else "@" + "+".join(self.joints)
        return f"{self.id}{f'({inner})' if inner else ''}{where}"


def _written(value: float | bool | str) -> str:
    """A parameter as `parse_effects` reads it back: numbers short where that is exact, expressions in quotes."""
    if isinstance(value, str):
        return value if value.isidentifier() else f'"{value}"'
    if isinstance(value, bool):
        return str(value)
    return f"{value:g}" if float(f"{value:g}") == value else repr(float(value))


def is_number(value: object) -> bool:
    """Whether a parameter is a finite number: parameters come from text and files."""
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


UNITS = {
    "": ("N·m", "N"),
    "rate": ("N·m·s/rad", "N·s/m"),
    "rate^2": ("N·m·s²/rad²", "N·s²/m²"),
    "rate^3": ("N·m·s³/rad³", "N·s³/m³"),
    "acceleration": ("kg·m²", "kg"),
    "position": ("N·m/rad", "N/m"),
    "position^2": ("N·m/rad²", "N/m²"),
    "position^3": ("N·m/rad³", "N/m³"),
    "rate kelvin": ("N·m·s/(rad·K)", "N·s/(m·K)"),
    "kelvin": ("N·m/K", "N/K"),
    "torque": ("1", "1"),
    "torque rate": ("s", "s"),
    "torque slope": ("rad", "m"),
    "torque slope torque": ("rad/(N·m)", "m/N"),
}
"""What a column is made of -> unit of its parameter on a turning joint, on a sliding one."""


def torque_unit(robot: Robot, joint: int, per: str = "") -> str:
    """Unit of a joint's torque (force, when it slides) per what a column is made of, one of `UNITS`."""
    return UNITS[per][bool(robot.prismatic[joint])]


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
        raise InputError(
            f"parameter {twice} comes twice: the model has such an effect already, or two effects describe the same "
            "thing on the same joint"
        )
    return tuple(columns)
