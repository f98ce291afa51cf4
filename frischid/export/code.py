"""A model as a function for a control loop: C that needs only <math.h>, or Python that needs only NumPy.

The recursive Newton-Euler algorithm over constant tables (Luh, Walker and Paul 1980; notation of Featherstone 2008,
chapter 5, with three-vectors), then the effects' torques, joint by joint:

    ω_i = R_iᵀ ω_p + s q̇,   α_i = R_iᵀ α_p + s q̈ + ω_i × s q̇,   a_i = R_iᵀ (a_p + α_p × p + ω_p × (ω_p × p)),
    f_i = m a_i + α_i × h + ω_i × (ω_i × h),   n_i = I α_i + ω_i × I ω_i + h × a_i,

and the forces are summed back to the base, with a_0 = −g. The tables hold inertias about the joints' frames, so the
code needs no division. Reference parameters without mass need no care for the same reason.

A model whose torque follows from (q, q̇, q̈) becomes the functions ``inverse_dynamics`` and ``friction``. A model with
memory becomes ``init`` and ``step``, with a state that the caller keeps; `frischid.export.code_columns` says how.

Only the functions of `frischid.export.names` write names and numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib import resources

import numpy as np

from frischid.core.text import sentence
from frischid.core.types import Array
from frischid.effects.state import SIGN_WIDTH
from frischid.export.code_body import Body as CodeBody
from frischid.export.code_body import C, Language, NumPy
from frischid.export.code_columns import CodeModel
from frischid.export.names import comment, identifier, identifiers, number
from frischid.model.model import Model
from frischid.robot.kinematic_tree import Body, bodies_of

LEAST_STEP = 0.00025
"""Shortest time between two stored torques of a delay, s: a loop of 4 kHz. A faster loop stores some of them."""

PARTS = ("slope", "spin", "slide", "heat", "lag", "delay", "sign")
"""Functions of the templates that only some effects need, each in a file of its own."""


def c_source(model: Model) -> str:
    """Write C99 source of ``<robot>_inverse_dynamics`` and ``<robot>_friction``, or of ``_init`` and ``_step``.

    Raises
    ------
    InputError
        The model has no physical links, an infinite number, or an effect whose class states no code.
    """
    code, prefix = CodeModel.of(model), identifier(model.robot.name)
    robot = prefix.lower()
    places = identifiers([name.upper() for name in model.robot.joints])
    values = {
        "head": _head(code, " * "),
        "robot": robot,
        "ROBOT": prefix.upper(),
        "J": len(model.robot.joints),
        "L": len(code.links),
        "joints": ",\n".join(f"    {prefix.upper()}_JOINT_{name} = {j}" for j, name in enumerate(places)),
        "up": "{" + ", ".join(number(-x) for x in model.robot.gravity) + "}",
        "tables": _c_bodies(bodies_of(model.robot)),
        "links": "\n".join(_c_links(robot, name, links) for name, links in _tables(code)),
        **_state(code, C(robot)),
    }
    return _whole(code, C(robot), "control.c", "c", values)


def numpy_source(model: Model) -> str:
    """Write Python source of ``inverse_dynamics`` and ``friction`` over samples (N, J), or of ``init`` and ``step``.

    The source imports NumPy only.

    Raises
    ------
    InputError
        As for `c_source`.
    """
    code = CodeModel.of(model)
    return _whole(code, NumPy(), "control_py.txt", "txt", python_values(code, NumPy()))


def python_values(code: CodeModel, language: Language) -> dict[str, object]:
    """Values of every generated Python file: joints, bodies, tables of links, and sizes of the state."""
    robot = code.model.robot
    return {
        "head": _head(code, ""),
        "imports": "import numpy as np",
        "joints": ascii(robot.joints),
        "up": _list(-np.array(robot.gravity)),
        "bodies": "\n".join(_python_body(b) for b in bodies_of(robot)),
        "links": "\n".join(_python_links(name, links) for name, links in _tables(code)),
        **_state(code, language),
    }


def _whole(code: CodeModel, language: Language, frame: str, suffix: str, values: dict[str, object]) -> str:
    """Fill in the templates: the frame with the functions that the model's effects need."""
    body = CodeBody(code, language)
    entry = "step" if code.remembers else "direct"
    filled = {
        "effects": "\n".join(body.lines("both" if code.remembers else "torque")),
        "friction": "\n".join(body.lines("friction")),
    }
    needed = set(body.parts) - ({"sign"} if suffix == "txt" else set())
    names = [*(part for part in PARTS if part in needed), entry]
    return filled_in(frame, [f"{name}.{suffix}" for name in names], values | filled)


def filled_in(frame: str, parts: Sequence[str], values: dict[str, object]) -> str:
    """A frame with functions of some templates, and values in the places that templates name between two ``@``."""
    between = "\n\n" if frame.endswith(".c") else "\n\n\n"
    text = _read(frame).replace("@functions@", between.join(map(_read, parts))) + "\n"
    return re.sub(r"@(\w+)@", lambda m: str(values[m[1]]), text)


def _read(template: str) -> str:
    return resources.files("frischid.export").joinpath("templates", template).read_text(encoding="utf-8").rstrip("\n")


def _head(code: CodeModel, lead: str) -> str:
    robot, model = code.model.robot, code.model
    lines = [
        f"Inverse dynamics of {robot.name}, identified by frischid. Torque in N·m (N), positions in rad (m).",
        f"Joints in order: {', '.join(robot.joints)}.",
        f"Effects: {', '.join(str(e) for e in model.effects) or 'none'}.",
        *(f"Held still: {n} at {x!r} rad (m)." for n, x in robot.locked.items()),
        *([sentence(late)] if (late := model.lowpass.lag_of_a_record) else []),
    ]
    return "\n".join(lead + comment(line) for line in lines)


def _tables(code: CodeModel) -> Iterator[tuple[str, Array]]:
    """The tables of links that the functions of this model use."""
    yield "links", code.links
    loaded = any(column.reads("load") or column.reads("torque") for column in code.columns)
    if loaded or any(m.kind in ("lag", "slope", "tilt") for m in code.made):
        yield "load_links", code.load_links
    for m in code.made:
        if m.kind == "extra":
            table = np.zeros_like(code.links)
            table[m.joint] = m.values
            yield f"{m.name}_links", table


def _state(code: CodeModel, language: Language) -> dict[str, object]:
    """Sizes and constants of what the model remembers."""
    of = {kind: [m for m in code.made if m.kind == kind] for kind in ("slide", "heat", "lag", "delay")}
    J, warm = len(code.model.robot.joints), code.uses("temperature")
    longest = max((m.values[0] for m in of["delay"]), default=0.0)
    kept = {
        "slides": f"    {language.robot}_slide slide[{len(of['slide'])}];" if of["slide"] else "",
        "heats": f"    double heat[{len(of['heat'])}];" if of["heat"] else "",
        "lags": f"    {language.robot}_lag lag[{len(of['lag'])}];" if of["lag"] else "",
        "delays": f"    {language.robot}_delay delay[{len(of['delay'])}];" if of["delay"] else "",
        "warmth": f"    double temperature[{J}]; /* degrees Celsius: set it before each step */" if warm else "",
    }
    return {
        "width": number(SIGN_WIDTH),
        "gears": "\n".join(language.gear(m) for m in of["lag"]),
        "stored": int(np.ceil(longest / LEAST_STEP)) + 3,
        "fields": "\n".join(line for line in kept.values() if line),
        "counts": ", ".join(str(len(of[kind])) for kind in ("slide", "heat", "lag", "delay")),
        "warm": language.warm(warm),
    }


def _row(values: Sequence[float] | Array) -> str:
    return "{" + ", ".join(number(x) for x in np.ravel(values)) + "}"


def _inertia(theta: Array) -> Array:
    xx, xy, yy, xz, yz, zz = theta[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _list(values: Array) -> str:
    """Nested lists of Python, of any depth."""
    return "[" + ", ".join(map(_list, values)) + "]" if np.ndim(values) else number(float(values))


def _c_bodies(bodies: Sequence[Body]) -> str:
    return "\n".join(
        f"    {{{b.parent}, {b.leader}, {int(b.slides)}, {number(b.factor)}, {number(b.shift)}, {_row(b.rotation)}, "
        f"{_row(b.translation)}, {_row(b.axis)}}}, /* {comment(b.joint)} */"
        for b in bodies
    )


def _c_links(robot: str, name: str, links: Array) -> str:
    rows = ",\n".join(f"    {{{number(x[0])}, {_row(x[1:4])}, {_row(_inertia(x))}}}" for x in links)
    return f"static const {robot}_link {robot}_{name}[{robot.upper()}_BODIES] = {{\n{rows}\n}};"


def _python_body(b: Body) -> str:
    arrays = ", ".join(f"np.array({_list(values)})" for values in (b.rotation, b.translation, b.axis))
    numbers = f"{b.parent}, {b.leader}, {bool(b.slides)}, {number(b.factor)}, {number(b.shift)}"
    return f"    ({numbers}, {arrays}),  # {comment(b.joint)}"


def _python_links(name: str, links: Array) -> str:
    rows = "\n".join(f"    ({number(x[0])}, np.array({_list(x[1:4])}), np.array({_list(_inertia(x))}))," for x in links)
    return f"{name.upper()} = [  # m, h, I\n{rows}\n]"
