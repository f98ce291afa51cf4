"""The lines of generated code that add the effects' torques, from the columns' expressions, in C and in Python.

First come the quantities that columns need, then the columns in the order of the effects. A column adds ``θ x`` to the
torque and, where a later column reads the torque of the reference parameters, ``reference · x`` to that torque. Effects
with memory read the torque of all effects without memory, as `frischid.regression.regressor` has it.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Literal

from frischid.export.code_columns import CodeColumn, CodeModel, Made
from frischid.export.names import number

Wanted = Literal["torque", "friction", "both"]


class Language(ABC):
    """Spelling of the few statements that generated code has."""

    robot: str = ""

    @abstractmethod
    def spelled(self, text: str) -> str:
        """An expression of a column in this language."""

    @abstractmethod
    def at(self, name: str, joint: int) -> str:
        """One joint's place in an array."""

    @abstractmethod
    def value(self, name: str, text: str) -> str:
        """A statement that names the value of an expression, already spelled."""

    @abstractmethod
    def add(self, name: str, joint: int, text: str) -> str:
        """A statement that adds to one joint's place in an array."""

    @abstractmethod
    def rigid(self, name: str, table: str) -> str:
        """A statement that makes an array of the rigid-body torque of a table of links."""

    @abstractmethod
    def copy(self, name: str, of: str) -> str:
        """A statement that makes an array with the values of another."""

    @abstractmethod
    def made(self, quantity: Made) -> str:
        """A statement that computes a quantity."""

    def inputs(self, code: CodeModel) -> Iterator[str]:
        """Statements that give quantities of the state the names of the expressions."""
        yield from ()

    @abstractmethod
    def gear(self, lag: Made) -> str:
        """One row of the table of gears."""

    @abstractmethod
    def warm(self, used: bool) -> str:
        """The statement that sets the temperatures of a new state."""


class C(Language):
    """C99."""

    def __init__(self, robot: str) -> None:
        self.robot = robot

    def spelled(self, text: str) -> str:
        """The functions of <math.h>; the time and the temperatures stand in the state."""
        for name, other in (("abs", "fabs"), ("max", "fmax"), ("sign", f"{self.robot}_sign")):
            text = re.sub(rf"\b{name}\(", f"{other}(", text)
        return re.sub(r"\btemperature\[", "state->temperature[", re.sub(r"\bt\b", "state->t", text))

    def at(self, name: str, joint: int) -> str:
        """``name[joint]``."""
        return f"{name}[{joint}]"

    def value(self, name: str, text: str) -> str:
        """A constant."""
        return f"    const double {name} = {text};"

    def add(self, name: str, joint: int, text: str) -> str:
        """``name[joint] += …``."""
        return f"    {name}[{joint}] += {text};"

    def rigid(self, name: str, table: str) -> str:
        """An array, and the call that fills it."""
        return f"{self._array(name)} {self.robot}_rigid({self.robot}_{table}, {self.robot}_up, q, v, a, {name});"

    def copy(self, name: str, of: str) -> str:
        """An array, filled joint by joint."""
        loop = f"for (j = 0; j < {self._joints}; j++)"
        return f"    double {name}[{self._joints}];\n    {loop}\n        {name}[j] = {of}[j];"

    def made(self, quantity: Made) -> str:
        """The call of the quantity's function."""
        name, joint, k = quantity.name, quantity.joint, quantity.number
        values, robot = [number(x) for x in quantity.values], self.robot
        loads = f"{robot}_load_links"
        match quantity.kind:
            case "slide":
                call = f"{robot}_slid(&state->slide[{k}], state->v[{joint}], v[{joint}], h, {values[0]})"
                return self.value(name, call)
            case "heat":
                speeds = f"state->v[{joint}], v[{joint}]"
                return self.value(name, f"{robot}_heated(&state->heat[{k}], {speeds}, h, {', '.join(values)})")
            case "lag":
                call = f"{robot}_lagged(&{robot}_gears[{k}], &state->lag[{k}], q, v, a, load, h, {name});"
            case "delay":
                call = f"{robot}_delayed(&state->delay[{k}], state->t, {values[0]}, steady, {name});"
            case "slope":
                call = f"{robot}_derivative({loads}, q, v, a, {joint}, 1.0, 0.0, 0.0, {name});"
            case "tilt":
                up = ", ".join(number(-x) for x in quantity.values)
                call = (
                    f"{{ const double up[3] = {{{up}}}, still[{self._joints}] = {{0.0}};\n"
                    f"      {robot}_rigid({loads}, up, q, still, still, {name}); }}"
                )
            case "spin":
                call = f"{robot}_spin({joint}, {values[0]}, q, v, a, {name});"
            case _:
                call = f"{robot}_rigid({robot}_{name}_links, {robot}_up, q, v, a, {name});"
        return f"{self._array(name)}\n    {call}"

    def gear(self, lag: Made) -> str:
        """The constants of a gear."""
        return f"    {{{lag.joint}, {int(lag.values[0])}, {', '.join(number(x) for x in lag.values[1:])}}},"

    def warm(self, used: bool) -> str:
        """A loop over the joints."""
        return f"    for (j = 0; j < {self._joints}; j++)\n        state->temperature[j] = 25.0;" if used else ""

    @property
    def _joints(self) -> str:
        return f"{self.robot.upper()}_JOINTS"

    def _array(self, name: str) -> str:
        return f"    double {name}[{self._joints}] = {{0.0}};"


class NumPy(Language):
    """Python with NumPy; arrays have a row for every sample."""

    def spelled(self, text: str) -> str:
        """NumPy's functions; a joint is a column."""
        text = re.sub(r"\b([A-Za-z_]\w*)\[(\d+)\]", r"\1[:, \2]", text)
        text = re.sub(r"\b(tanh|exp|expm1|sin|cos|tan|abs|sqrt|log|sign)\(", r"np.\1(", text)
        return re.sub(r"\bpow\(", "np.power(", re.sub(r"\bmax\(", "np.maximum(", text))

    def at(self, name: str, joint: int) -> str:
        """``name[:, joint]``."""
        return f"{name}[:, {joint}]"

    def value(self, name: str, text: str) -> str:
        """An assignment."""
        return f"    {name} = {text}"

    def add(self, name: str, joint: int, text: str) -> str:
        """``name[:, joint] += …``."""
        return f"    {name}[:, {joint}] += {text}"

    def rigid(self, name: str, table: str) -> str:
        """A call."""
        return f"    {name} = _rigid({table.upper()}, UP, q, v, a)"

    def copy(self, name: str, of: str) -> str:
        """A copy."""
        return f"    {name} = {of}.copy()"

    def made(self, quantity: Made) -> str:
        """The call of the quantity's function."""
        name, joint, k = quantity.name, quantity.joint, quantity.number
        values = ", ".join(number(x) for x in quantity.values)
        calls = {
            "slide": f"_slid(state.slide[{k}], state.v[{joint}], v[0, {joint}], h, {values})",
            "heat": f"_heated(state.heat, {k}, state.v[{joint}], v[0, {joint}], h, {values})",
            "lag": f"_lagged(GEARS[{k}], state.lag[{k}], q, v, a, load, h)",
            "delay": f"_delayed(state.delay[{k}], state.t, {values}, steady)",
            "slope": f"_derivative(LOAD_LINKS, q, v, a, {joint}, 1.0, 0.0, 0.0)",
            "tilt": f"_rigid(LOAD_LINKS, -np.array([{values}]), q, 0.0 * v, 0.0 * a)",
            "spin": f"_spin({joint}, {values}, q, v, a)",
            "extra": f"_rigid({name.upper()}_LINKS, UP, q, v, a)",
        }
        return self.value(f"{name}, state.lag[{k}]" if quantity.kind == "lag" else name, calls[quantity.kind])

    def inputs(self, code: CodeModel) -> Iterator[str]:
        """The time, and the temperatures as a row."""
        if code.uses("t"):
            yield "    t = state.t"
        if code.uses("temperature"):
            yield "    temperature = np.atleast_2d(np.asarray(state.temperature, dtype=float))"

    def gear(self, lag: Made) -> str:
        """The constants of a gear."""
        return f"    ({lag.joint}, {bool(lag.values[0])}, {', '.join(number(x) for x in lag.values[1:])}),"

    def warm(self, used: bool) -> str:
        """An array."""
        text = "        self.temperature = np.full(len(JOINTS), 25.0)  # degrees Celsius: set it before each step"
        return text if used else ""


class Body:
    """Writes the body of the functions of one model."""

    def __init__(self, code: CodeModel, language: Language) -> None:
        self.code, self.language = code, language

    @property
    def parts(self) -> Iterator[str]:
        """Functions of the templates that the body calls."""
        kinds = {m.kind for m in self.code.made}
        yield from kinds & {"slide", "heat", "delay", "spin", "lag"}
        if kinds & {"lag", "slope"}:
            yield "slope"
        if self.code.uses("sign"):
            yield "sign"

    def lines(self, wanted: Wanted) -> Iterator[str]:
        """Statements that add the effects to ``tau``: all of them, friction only, or both at once.

        "friction" writes the torque of friction alone to ``tau``; "both" adds the friction to ``friction`` as well.
        """
        columns = self.code.columns
        if wanted == "both":
            yield from self.language.inputs(self.code)
        if wanted == "friction":
            last = max((k for k, c in enumerate(columns) if c.effect.friction), default=-1)
            reads = any(c.effect.friction and c.reads("torque") for c in columns)
            columns = tuple(c for c in columns[: last + 1] if c.effect.friction or (reads and c.reference))
        yield from self._prepared(columns)
        reading = [k for k, c in enumerate(columns) if c.reads("torque") and not c.effect.memory]
        if reading:
            yield self.language.copy("torque", "load")
        for first, group in self._by_effect(columns):
            values = list(self._values(group, first, "steady" if group[0].effect.memory else "torque", "x"))
            yield from (line for line, *_ in values)
            for _, column, joint, name in values:
                yield from self._added(column, joint, name, wanted)
                if column.reference and reading and first < reading[-1]:
                    yield self.language.add("torque", joint, f"{number(column.reference)} * {name}")

    def _added(self, column: CodeColumn, joint: int, name: str, wanted: Wanted) -> Iterator[str]:
        text = f"{number(column.theta)} * {name}"
        if wanted != "friction" or column.effect.friction:
            yield self.language.add("tau", joint, text)
        if wanted == "both" and column.effect.friction:
            yield self.language.add("friction", joint, text)

    def _prepared(self, columns: Sequence[CodeColumn]) -> Iterator[str]:
        """The load, the quantities of the columns, and the torque that effects with memory read."""
        made = list(dict.fromkeys(m for c in columns for m in c.made))
        late = [m for m in made if m.kind == "delay"]
        steady = bool(late) or any(c.reads("torque") for c in columns if c.effect.memory)
        if any(c.reads("load") or c.reads("torque") for c in columns):
            yield self.language.rigid("load", "load_links")
        yield from (self.language.made(m) for m in made if m not in late)
        if steady:
            yield self.language.copy("steady", "load")
            for first, group in self._by_effect([c for c in columns if not c.effect.memory and c.reference]):
                values = list(self._values(group, first, "steady", "s"))
                yield from (line for line, *_ in values)
                for _, column, joint, name in values:
                    yield self.language.add("steady", joint, f"{number(column.reference)} * {name}")
        yield from (self.language.made(m) for m in late)

    def _by_effect(self, columns: Sequence[CodeColumn]) -> Iterator[tuple[int, list[CodeColumn]]]:
        """Columns that follow one another and belong to one effect, with the place of the first."""
        first = 0
        while first < len(columns):
            last = first
            while last < len(columns) and columns[last].effect is columns[first].effect:
                last += 1
            yield first, list(columns[first:last])
            first = last

    def _values(
        self, group: Sequence[CodeColumn], first: int, torque: str, letter: str
    ) -> Iterator[tuple[str, CodeColumn, int, str]]:
        """Statements that name the columns' values; and per value its column, joint and name."""
        for k, column in enumerate(group):
            for joint, text in column.rows.items():
                name = f"{letter}{first + k}_{joint}"
                spelled = self.language.spelled(re.sub(r"\btorque\[", f"{torque}[", text))
                yield self.language.value(name, spelled), column, joint, name
