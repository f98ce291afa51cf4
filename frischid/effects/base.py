"""A physical effect: one frozen dataclass with an `id` and one method.

An effect adds columns to the regression,

    τ = Γ θ_rigid + Σ_effects C_e(state) θ_e.

`Effect.terms` returns the columns for a stretch of motion, each with its parameter's name, unit and known sign. The
command line, the simulator, the diagnosis, the report and the tests read everything else from the class, and every
class variable but `id` has a default. So a new subclass is all that a new effect needs; CONTRIBUTING.md has the recipe.

Source of the form, linear in θ: Atkeson, An and Hollerbach 1986, Int. J. Robotics Research 5(3).
"""

from __future__ import annotations

import dataclasses
import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

from frischid.core.types import Array, Column, Sign
from frischid.effects.catalogue import Catalogue
from frischid.effects.definition import check_class, check_decorated, complete, is_complete
from frischid.effects.state import State, Term
from frischid.effects.units import UnitPair, is_number, torque_unit
from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import Robot


@dataclass(frozen=True)
class Effect(ABC):
    """Base class of all effects: a subclass with an `id` and a method `terms` is a new effect.

    Dataclass fields of the subclass are its shape parameters, which are stated and not identified. They need defaults.

    Attributes
    ----------
    joints : tuple of str or None
        Joints that the effect acts on; None means all.

    Raises
    ------
    InputError
        When a subclass is defined: it lacks `id` or `terms`, its `id` is taken, or a class variable is not usable.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import frischid as fr
    >>> @dataclass(frozen=True)
    ... class PropellerDrag(fr.Effect):
    ...     '''Drag of a propeller that the joint turns.'''
    ...
    ...     id = "propeller_drag"
    ...
    ...     def terms(self, state):
    ...         return self.per_joint(state, "cd", "velocity^2", lambda i: abs(state.v[:, i]) * state.v[:, i], sign=1)
    >>> robot = fr.Robot.load("planar2")
    >>> [f"{c.name}, {c.unit}" for c in PropellerDrag(joints=("joint2",)).columns(robot)]
    ['cd2, N·m·s²/rad²']
    >>> fr.parse_effects("propeller_drag@joint1")
    (PropellerDrag(joints=('joint1',), changed=0),)
    >>> fr.EFFECTS.remove("propeller_drag")
    """

    id: ClassVar[str]
    """Name in the catalogue, in commands and in files: letters, digits and underscores."""
    title: ClassVar[str]
    """A few words; by default the first line of the class's docstring."""
    equation: ClassVar[str]
    """Torque as a formula, with the coefficients' symbols."""
    symbols: ClassVar[Mapping[str, str]] = {}
    """The equation's own letters in words."""
    sentence: ClassVar[str]
    """Finding of a diagnosis, with ``{joint}`` as the subject of a verb in the singular, or ``{joints}`` as a list."""
    looks_like: ClassVar[str]
    """How the residual of a model without the effect looks."""
    confused_with: ClassVar[tuple[str, ...]]
    """Identifiers of effects whose columns resemble this one's on many motions."""
    confirmed_by: ClassVar[str]
    """Experiment that shows the effect beyond doubt."""
    reference: ClassVar[str]
    """Publication or file with the equation."""

    dry: ClassVar[bool] = False
    """Whether the effect has no definite value at standstill, so that joints at standstill must be left out."""
    smooths_sign: ClassVar[bool] = False
    """Whether its shape parameter `width` is the speed over which it smooths the sign of the speed, as dry friction. A
    diagnosis then uses the width of the model's own dry friction."""
    memory: ClassVar[bool] = False
    """Whether a sample's columns depend on other samples, so that whole motions must be evaluated at once."""
    loaded: ClassVar[bool] = False
    """Whether the columns depend on `State.load` or `State.torque`."""
    candidate: ClassVar[Literal["joint", "robot", "never"]] = "joint"
    """Places that the diagnosis tries: one joint at a time, the whole robot, or none."""
    change: ClassVar[bool] = False
    """Whether the effect is an event in a robot's life (a payload, a tilt) and not part of the robot from the start."""
    after_change: ClassVar[tuple[str, ...]] = ()
    """Changes of old parameters that come with the effect where the robot changed, because its equation relies on them.
    """
    several: ClassVar[bool] = False
    """Whether the effect may come more than once on the same joints, with other parameters."""
    single: ClassVar[bool] = False
    """Whether the effect acts in one place only: the diagnosis then adds no further joints to it."""
    generalises: ClassVar[tuple[str, ...]] = ()
    """Effects that this one contains. If one of them explains nearly as much, the diagnosis names that one, unless the
    logs show that this one explains more."""
    same_in_motion: ClassVar[str] = ""
    """Another effect that has the same columns wherever the joint moves. Beside the other one in the model, a diagnosis
    does not try this one: the two differ only at standstill, where dry friction is undetermined. Where the robot
    changed, this one is tried beside the changes that `after_change` names."""
    least: ClassVar[float] = 0.0
    """Size of the coefficients below which the diagnosis does not name the effect, however significant."""
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    """Shape parameter -> values that the diagnosis tries, ascending; it refines between neighbours."""
    units: ClassVar[Mapping[str, UnitPair]] = {}
    """Shape parameter -> its units on a turning joint and on a sliding joint. Pure numbers are absent."""
    stated: ClassVar[tuple[str, ...]] = ()
    """Shape parameters without a usual value: commands ask for them (`parse_effects`, with `complete`)."""
    internal: ClassVar[tuple[str, ...]] = ()
    """Shape parameters of the calculation alone, which say nothing of the robot: findings do not print them."""
    of_recording: ClassVar[bool] = False
    """Whether the effect is an error of how a torque was recorded: a torque computed from commands cannot have it."""
    of_controller: ClassVar[bool] = False
    """Whether the effect corrects what is known of the controller: such an effect is no torque of the robot."""
    friction: ClassVar[bool] = False
    """Whether the effect is part of `Model.friction`."""
    code: ClassVar[Mapping[str, str]] = {}
    """Coefficient's symbol -> its column for generated code, in terms of shape parameters and of quantities of its
    joint: {q}, {v}, {a}, {load}, {torque}, {temperature}, the time {t}, the {middle} of its range; with a shape
    parameter `distance` Dahl's state {z}, and with `constant` and `exponent` the heat {heat} (see
    `frischid.export.code_columns`); empty where the class states no column."""

    joints: tuple[str, ...] | None = None
    changed: int = dataclasses.field(default=0, kw_only=True)
    """Which change of an effect of its kind this is, 0: none. A model that has an effect gets its first change when the
    robot changed. The names of the coefficients begin with a d for each change, and have no known sign."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if is_complete(cls):
            check_class(cls, Effect)
            complete(cls)
            EFFECTS.register(cls)

    @property
    def reverse(self) -> Self | None:
        """The opposite shift, if the effect is a shift in time: an error that both explain is not caused by a shift."""
        return None

    @property
    def searched(self) -> Mapping[str, tuple[float, ...]]:
        """The entries of `shapes` on which the columns of this effect depend."""
        return self.shapes

    def with_sign_width(self, width: float) -> Self:
        """The effect with the sign of the speed smoothed over another width, rad/s (m/s), if it smooths the sign."""
        changed: dict[str, Any] = {"width": width} if self.smooths_sign else {}
        return dataclasses.replace(self, **changed)

    def shows_within(self, reach: Mapping[str, float]) -> bool:
        """Whether motions show the effect in this shape; `reach`: each joint's range in all of them, rad (m)."""
        return True

    @abstractmethod
    def terms(self, state: State) -> list[Term]:
        """Columns of this effect over `state`, which may be without samples (`State.empty`)."""

    def remembered(self, state: State) -> list[Term]:
        """What an unknown state before the first sample adds to the torque; nothing by default.

        One term for each such coefficient, under the column's name in `terms`. Its values are the share of the first
        sample's state that each sample still holds. The state lies between −1 and 1, and `terms` begins at an end.
        """
        return []

    @classmethod
    def each(cls, effects: Sequence[Self], state: State) -> Iterator[list[Term]]:
        """Columns of several effects of this kind over `state`; some kinds compute several faster at once."""
        return (effect.terms(state) for effect in effects)

    @classmethod
    def variants(cls, joints: tuple[str, ...] | None) -> list[Self]:
        """One effect for every combination of the shape parameters' values."""
        combinations = itertools.product(*cls.shapes.values())
        shapes: list[dict[str, Any]] = [dict(zip(cls.shapes, values, strict=True)) for values in combinations]
        return [cls(joints=joints, **values) for values in shapes]

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """Effects that a diagnosis tries: one list per place, with the effect in all its shapes."""
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
        """Values of the parameters in the URDF, one per column; zero where the URDF states none."""
        return [0.0] * len(self.columns(robot))

    def usual(self, robot: Robot) -> list[float]:
        """Usual size of each column's coefficient, as a share of the value that alone would cause the measured torque.

        The URDF prior has these sizes as standard deviations (`frischid.estimators.urdf_prior`).
        """
        return [1.0] * len(self.columns(robot))

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
        if self.changed:
            symbol, sign = f"{'d' * self.changed}{symbol}", 0
        return Column(f"{symbol}{number}", unit, joint, self.id, sign)

    def per_joint(
        self, state: State, symbol: str, per: str | UnitPair, values: Callable[[int], Array], sign: Sign = 0
    ) -> list[Term]:
        """One column for each joint the effect acts on, in that joint's own row.

        Parameters
        ----------
        state : State
        symbol : str
            Name of the coefficient; the joint's number follows it.
        per : str or pair of str
            Quantity that the column holds, or the coefficient's units; see `frischid.effects.units.torque_unit`.
        values : callable
            Index of a joint -> its column, shape (N,).
        sign : {-1, 0, 1}
            Known sign of the coefficient; 0 when either sign is possible.
        """
        return [
            Term(self.column(symbol, torque_unit(state.robot, i, per), name, number, sign), {i: values(i)})
            for i, name, number in self.acts_on(state.robot)
        ]

    def require_positive(self, **meanings: str) -> None:
        """Raise InputError unless each of these shape parameters is a positive number; `meanings` describe them."""
        for name, meaning in meanings.items():
            value = getattr(self, name)
            if not is_number(value) or value <= 0:
                raise InputError(f"{self.id}: {name} must be a positive {meaning}, got {value}")

    @property
    def parameters(self) -> dict[str, float | bool | str]:
        """Shape parameters of this effect (stated, not identified)."""
        names = (f.name for f in dataclasses.fields(self) if f.name not in {"joints", "changed"})
        return {name: getattr(self, name) for name in names}

    def unit(self, parameter: str, robot: Robot | None = None) -> str:
        """Unit of a shape parameter on a robot's joints (None: on turning and sliding ones); empty for a number."""
        sliding = [False, True] if robot is None else sorted(bool(robot.prismatic[i]) for i, *_ in self.acts_on(robot))
        turns, *slides = dict.fromkeys(self.units.get(parameter, ("", ""))[s] for s in sliding)
        return turns + "".join(f" ({unit})" for unit in slides)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values from which `effect_from_dict` builds the effect again, with the package if not frischid."""
        package = EFFECTS.package(type(self))
        origin = {} if package is None else {"package": package.to_dict()}
        joints = None if self.joints is None else list(self.joints)
        changed = {"changed": self.changed} if self.changed else {}
        return {"effect": self.id, "joints": joints, **self.parameters, **changed, **origin}

    def __str__(self) -> str:
        stated = self.parameters | ({"changed": self.changed} if self.changed else {})
        inner = ", ".join(f"{k}={_written(v)}" for k, v in stated.items())
        where = "" if self.joints is None else "@" + "+".join(self.joints)
        return f"{self.id}{f'({inner})' if inner else ''}{where}"


EFFECTS: Catalogue[Effect] = Catalogue()
"""The catalogue: identifier -> effect class, in order of definition; then the effects of installed packages."""


def _written(value: float | bool | str) -> str:
    """A parameter as `parse_effects` reads it back: numbers short where that is exact, expressions in quotes."""
    if isinstance(value, str):
        return value if value.isidentifier() else f'"{value}"'
    if isinstance(value, bool):
        return str(value)
    return f"{value:g}" if float(f"{value:g}") == value else repr(float(value))


def check_effects(effects: Any) -> None:
    """Refuse everything but a sequence of effects.

    Raises
    ------
    InputError
        The text of an effect stands where an effect is meant.
    """
    alone: list[Any] = [] if isinstance(effects, Iterable) and not isinstance(effects, str) else [effects]
    for wrong in alone or (x for x in effects if not isinstance(x, Effect)):
        raise InputError(
            f"effects must be a list of effects, got {wrong!r}: effects=frischid.parse_effects('viscous@joint1')"
        )


def columns_of(robot: Robot, effects: Sequence[Effect]) -> tuple[Column, ...]:
    """Columns of the whole regressor: rigid, then every effect's.

    Raises
    ------
    InputError
        Something is no effect, two effects make a column of the same name, or the class of an effect is no dataclass.
    """
    check_effects(effects)
    columns = list(robot.columns)
    owners: dict[str, Effect | str] = {c.name: "the rigid body" for c in columns}
    for effect in effects:
        check_decorated(type(effect))
        for column in effect.columns(robot):
            if column.name in owners:
                raise InputError(
                    f"parameter {column.name} comes twice, from {owners[column.name]} and from {effect}: parameters of "
                    "a model need different names; leave one of the two out, or give its coefficient another symbol"
                )
            owners[column.name] = effect
            columns.append(column)
    return tuple(columns)
