"""The columns of effects as expressions for generated code, the same for every language.

    τ_j = τ_rigid,j + Σ_columns θ_c x_c,j(q, q̇, q̈, state)

An expression is arithmetic over ``q[j]``, ``v[j]``, ``a[j]``, ``load[j]``, ``torque[j]``, ``temperature[j]``, the time
``t``, and the results of the few functions of the templates: Dahl's state of a joint, the lag of a link behind its
motor, a delayed torque, a derivative of the rigid-body torque along a direction, the weight under another gravity, the
reaction of a spinning rotor. `Made` names such a result and the function that computes it.

The code sees no future. Where a model's own evaluation of a log uses later samples, the code uses this instead:

- Dahl's state is zero until its joint first moves faster than `SIGN_WIDTH`; the model knows the direction before.
- A link starts at the deflection of its first load. The model takes the mean over `START_WINDOW`.
- The deflection δ of a link is the model's, and advances with every call. Its rate is that of the last step, and its
  acceleration is the model's of one sample before; the model takes the mean of the last step and the next one. A spring
  without a period is rigid, and its deflection, the load over k, is differentiated in the same way.
- A torque ``size`` seconds ago lies on the line between the two samples around that time; the model takes a spline. For
  a negative size, the torque ``|size|`` ahead lies on the line through the torques now and ``|size|`` ago.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.effects import (
    Effect,
    EncoderZero,
    Formula,
    GravityTilt,
    JointCoupling,
    Payload,
    RotorInertia,
    TimeDelay,
)
from frischid.effects.dynamics import RigidDynamics
from frischid.effects.flexibility import Backlash, Elasticity
from frischid.effects.link_lag import SWING_DAMPING
from frischid.errors import InputError
from frischid.export.formula_code import written
from frischid.export.names import number
from frischid.model.model import Model
from frischid.regression.regressor import Regressor
from frischid.robot.robot import LINK_PARAMETERS, Robot


class NoCodeError(InputError):
    """An effect's class does not say how its columns are computed from a joint's state."""


@dataclass(frozen=True)
class Made:
    """A quantity that a function of the template computes before the columns that use it."""

    name: str
    """As it stands in the columns' expressions."""
    kind: str
    number: int
    """Place among the quantities of its kind."""
    joint: int
    values: tuple[float, ...] = ()
    """Constants of the function, see the templates."""


@dataclass(frozen=True)
class CodeColumn:
    """One column of an effect."""

    effect: Effect
    name: str
    """Of the coefficient."""
    rows: dict[int, str]
    """Index of a joint -> expression of the torque on it per unit of the coefficient."""
    theta: float
    reference: float
    """`theta`, `reference`: The coefficient in the model, and among the parameters that give the load."""
    made: tuple[Made, ...] = ()
    """Quantities that the expressions use."""

    def reads(self, quantity: str) -> bool:
        """Whether an expression of this column, or a quantity that it uses, reads a quantity of the joints."""
        fed = {"load": ("lag",), "torque": ("delay",)}.get(quantity, ())
        return any(f"{quantity}[" in text for text in self.rows.values()) or any(m.kind in fed for m in self.made)


@dataclass(frozen=True, eq=False)
class CodeModel:
    """A model with the columns of its effects as expressions."""

    model: Model
    """With physical links."""
    columns: tuple[CodeColumn, ...]
    links: Array
    load_links: Array
    """`links`, `load_links`: Inertial parameters about the joints' frames, (L, 10): the model's, and those that give
    the load and its derivatives."""

    @classmethod
    def of(cls, model: Model, payload_in_links: bool = True) -> CodeModel:
        """Write the columns of a model's effects.

        Parameters
        ----------
        payload_in_links : bool
            Whether payloads become part of the links; otherwise they are columns as all other effects.

        Raises
        ------
        NoCodeError
            An effect of another package states no code for its columns.
        """
        robot, writer = model.robot, _Writer(model, payload_in_links)
        columns = [column for effect in model.effects for column in writer.columns(effect)]
        rigid = dict(zip((c.name for c in robot.columns), writer.values[: len(robot.columns)], strict=True))
        loads = np.array([robot.known[name] if name in robot.known else rigid[name] for name in robot.all_names])
        return cls(
            model,
            tuple(columns),
            _joint_frames(robot, model.links + writer.payload),
            _joint_frames(robot, loads.reshape(-1, 10)),
        )

    @property
    def made(self) -> list[Made]:
        """Quantities of all columns, each once, in their order."""
        return list(dict.fromkeys(m for column in self.columns for m in column.made))

    @property
    def remembers(self) -> bool:
        """Whether the torque depends on more than (q, q̇, q̈): on the past, the time, or a temperature."""
        return (
            any(m.kind in ("slide", "heat", "lag", "delay") for m in self.made)
            or self.uses("t")
            or self.uses("temperature")
        )

    def uses(self, word: str) -> bool:
        """Whether a name stands in a column's expression."""
        return any(re.search(rf"\b{word}\b", text) for column in self.columns for text in column.rows.values())


def _joint_frames(robot: Robot, links: Array) -> Array:
    return links if robot.transforms is None else (robot.transforms @ links[:, :, None])[:, :, 0]


class _Writer:
    """Writes the columns of a model's effects, one effect after the other."""

    def __init__(self, model: Model, payload_in_links: bool) -> None:
        self.model, self.robot, self.payload_in_links = model, model.robot, payload_in_links
        self.regressor = Regressor(model.robot, model.effects, model.reference)
        self.values = self.regressor.reference
        self.reference = dict(zip((c.name for c in self.regressor.columns), self.values, strict=True))
        self.payload = np.zeros((len(self.robot.bodies), 10))
        self._counts: dict[str, int] = {}
        self._made: dict[tuple[str, int, tuple[float, ...]], Made] = {}

    def columns(self, effect: Effect) -> list[CodeColumn]:
        """Columns of one effect; none of an effect of the controller, which is no torque of the robot."""
        if effect.of_controller:
            return []
        if effect.changed:
            raise NoCodeError(f"{effect} describes a change of the robot; identify the robot again, without the change")
        write = _WRITERS.get(type(effect), _Writer._plain)
        return write(self, effect)

    def _column(self, effect: Effect, name: str, rows: dict[int, str], *made: Made) -> CodeColumn:
        return CodeColumn(effect, name, rows, self.model.parameter(name), float(self.reference[name]), made)

    def _quantity(self, kind: str, joint: int, *values: float) -> Made:
        """The quantity of this kind; the same for equal values."""
        key = (kind, joint, values)
        if key not in self._made:
            place = self._counts.get(kind, 0)
            self._counts[kind] = place + 1
            self._made[key] = Made(f"{kind}{place}", kind, place, joint, values)
        return self._made[key]

    def _plain(self, effect: Effect) -> list[CodeColumn]:
        """Columns that the effect's class states in `Effect.code`."""
        found = []
        for column in effect.columns(self.robot):
            symbol = column.name.removesuffix(str(self.robot.numbers[column.joint]))
            coupled = isinstance(effect, RotorInertia) and effect.coupled
            if symbol not in effect.code or coupled:
                raise NoCodeError(
                    f"the effect {effect.id} cannot be written as code, because its class does not state the column of "
                    f"{symbol} in `code`; add it there (see the page on effects of your own), or identify a model "
                    "without this effect for the control loop"
                )
            j = self.robot.joints.index(column.joint)
            text, made = effect.code[symbol], []
            values = {k: number(x) for k, x in effect.parameters.items() if not isinstance(x, str)}
            state = {k: f"{k}[{j}]" for k in ("q", "v", "a", "load", "torque", "temperature")} | {"t": "t"}
            state["middle"] = number(float(self.robot.limits.middle[j]))
            if "{z}" in text:
                made.append(self._quantity("slide", j, float(effect.parameters["distance"])))
                state["z"] = made[0].name
            if "{heat}" in text:
                shape = effect.parameters
                made.append(self._quantity("heat", j, float(shape["constant"]), float(shape["exponent"])))
                state["heat"] = made[-1].name
            found.append(self._column(effect, column.name, {j: text.format(**values | state)}, *made))
        return found

    def _formula(self, effect: Effect) -> list[CodeColumn]:
        assert isinstance(effect, Formula)
        found = []
        for column in effect.columns(self.robot):
            j = self.robot.joints.index(column.joint)
            found.append(self._column(effect, column.name, {j: written(effect.tree, self.robot, j)}))
        return found

    def _coupling(self, effect: Effect) -> list[CodeColumn]:
        assert isinstance(effect, JointCoupling)
        found, ratio, width = [], number(effect.ratio), number(effect.width)
        for first, second in effect.pairs(self.robot):
            i, j = self.robot.joints.index(first), self.robot.joints.index(second)
            speed, acceleration = (f"({x}[{i}] + {ratio} * {x}[{j}])" for x in "va")
            texts = {"fvm": speed, "fcm": f"tanh({speed} / {width})", "Iam": acceleration}
            for symbol, text in texts.items():
                name = f"{symbol}{effect.number(self.robot, first, second)}"
                found.append(self._column(effect, name, {i: text, j: f"{ratio} * {text}"}))
        return found

    def _rotor(self, effect: Effect) -> list[CodeColumn]:
        assert isinstance(effect, RotorInertia)
        if not effect.coupled:
            return self._plain(effect)
        found = []
        for _, name, digits in effect.acts_on(self.robot):
            spin = self._quantity("spin", self.robot.bodies.index(name), effect.ratio)
            found.append(self._column(effect, f"Im{digits}", self._rows(spin), spin))
        return found

    def _payload(self, effect: Effect) -> list[CodeColumn]:
        """A payload that is added to the model's links gives columns only where later effects read the torque."""
        found = []
        for column in effect.columns(self.robot):
            body, place = self.robot.bodies.index(column.joint), LINK_PARAMETERS.index(self._symbol(column.name)[1:])
            value, reference = self.model.parameter(column.name), float(self.reference[column.name])
            if self.payload_in_links:
                self.payload[body, place] += value
                value = 0.0
            if value or reference:
                unit = np.zeros_like(self.payload)
                unit[body, place] = 1.0
                extra = self._quantity("extra", body, *_joint_frames(self.robot, unit)[body])
                found.append(CodeColumn(effect, column.name, self._rows(extra), value, reference, (extra,)))
        return found

    def _tilt(self, effect: Effect) -> list[CodeColumn]:
        found = []
        for column in effect.columns(self.robot):
            turned = np.cross(np.array(self.robot.gravity), np.eye(3)["xyz".index(column.name[-1])])
            tilt = self._quantity("tilt", 0, *map(float, turned))
            rows = {i: text for i, text in self._rows(tilt).items() if i in {j for j, *_ in effect.acts_on(self.robot)}}
            found.append(self._column(effect, column.name, rows, tilt))
        return found

    def _zero(self, effect: Effect) -> list[CodeColumn]:
        found = []
        for column in effect.columns(self.robot):
            slope = self._quantity("slope", self.robot.joints.index(column.joint))
            rows = {i: f"-{text}" for i, text in self._rows(slope).items()}
            found.append(self._column(effect, column.name, rows, slope))
        return found

    def _delay(self, effect: Effect) -> list[CodeColumn]:
        assert isinstance(effect, TimeDelay)
        delay = self._quantity("delay", 0, abs(effect.size))
        rows = {i: f"({text} - torque[{i}]) / {number(abs(effect.size))}" for i, text in self._rows(delay).items()}
        if effect.joints is None:
            return [self._column(effect, "delay", rows, delay)]
        return [self._column(effect, f"delay{n}", {i: rows[i]}, delay) for i, _, n in effect.acts_on(self.robot)]

    def _geared(self, effect: Effect) -> list[CodeColumn]:
        assert isinstance(effect, Elasticity | Backlash)
        body, found = RigidDynamics.of(self.robot, self.values[: len(self.robot.columns)]), []
        for i, _, digits in effect.acts_on(self.robot):
            gear, inertia = effect.gear(i), float(body.inertia[i])
            rigid = gear.period == 0.0
            omega = 0.0 if rigid else 2 * math.pi / gear.period
            stiffness, gap = omega**2 * inertia, gear.gap if math.isfinite(gear.gap) else 0.0
            unit = 1.0 / gap if gap else stiffness or 1.0
            dry = gear.rubbing * float(self.regressor.dry[i])
            constants = (float(rigid), stiffness, 2 * SWING_DAMPING * omega * inertia, gap, dry, unit, 0.05 * inertia)
            lag = self._quantity("lag", i, *constants)
            found.append(self._column(effect, f"{effect.symbol}{digits}", self._rows(lag), lag))
        return found

    def _symbol(self, name: str) -> str:
        return name.rstrip("0123456789")

    def _rows(self, made: Made) -> dict[int, str]:
        return {i: f"{made.name}[{i}]" for i in range(len(self.robot.joints))}


_WRITERS: dict[type[Effect], Callable[[_Writer, Effect], list[CodeColumn]]] = {
    Formula: _Writer._formula,
    JointCoupling: _Writer._coupling,
    RotorInertia: _Writer._rotor,
    Payload: _Writer._payload,
    GravityTilt: _Writer._tilt,
    EncoderZero: _Writer._zero,
    TimeDelay: _Writer._delay,
    Elasticity: _Writer._geared,
    Backlash: _Writer._geared,
}
