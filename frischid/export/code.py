"""A model as a function for a control loop: C that needs only <math.h>, or Python that needs only NumPy.

The recursive Newton-Euler algorithm over constant tables (Luh, Walker and Paul 1980; notation of Featherstone 2008,
chapter 5, with three-vectors), then the effects' torques, joint by joint:

    ω_i = R_iᵀ ω_p + s q̇,   α_i = R_iᵀ α_p + s q̈ + ω_i × s q̇,   a_i = R_iᵀ (a_p + α_p × p + ω_p × (ω_p × p)),
    f_i = m a_i + α_i × h + ω_i × (ω_i × h),   n_i = I α_i + ω_i × I ω_i + h × a_i,

and the forces are summed back to the base, with a_0 = −g. The tables hold inertias about the joints' frames, so the
code needs no division.

Only the functions of `frischid.export.names` write names and numbers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from importlib import resources

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.export.names import comment, identifier, identifiers, number
from frischid.model.model import Model
from frischid.robot.kinematic_tree import Body, bodies_of

# Functions of one joint's state that `Effect.code` may call: the common part of <math.h> and NumPy.
_FUNCTIONS = "tanh|exp|sin|cos|abs|pow"


def c_source(model: Model) -> str:
    """Write C99 source of the functions ``<robot>_inverse_dynamics`` and ``<robot>_friction``.

    Raises
    ------
    InputError
        The model has no physical links, an infinite number, or an effect that does not follow from its joint's state.
    """
    robot, bodies, links = model.robot, bodies_of(model.robot), _joint_frame_links(model)
    every, friction = (_effects(model, "{}[{}]", _c, only) for only in (False, True))
    prefix = identifier(robot.name)
    places = identifiers([name.upper() for name in robot.joints])
    return _filled(
        "control.c",
        head=_head(model, " * "),
        robot=prefix.lower(),
        ROBOT=prefix.upper(),
        J=len(robot.joints),
        L=len(bodies),
        joints=",\n".join(f"    {prefix.upper()}_JOINT_{name} = {j}" for j, name in enumerate(places)),
        gravity=_row(robot.gravity),
        tables=_c_tables(bodies, links),
        effects="\n".join(f"    tau[{j}] += {term};" for j, term in every),
        friction="\n".join(f"    tau[{j}] += {term};" for j, term in friction),
    )


def numpy_source(model: Model) -> str:
    """Write Python source of ``inverse_dynamics`` and ``friction`` over samples (N, J), importing NumPy only.

    Raises
    ------
    InputError
        As for `c_source`.
    """
    bodies, links = bodies_of(model.robot), _joint_frame_links(model)
    every, friction = (_effects(model, "{}[:, {}]", _numpy, only) for only in (False, True))
    return _filled(
        "control_py.txt",
        head=_head(model, ""),
        joints=ascii(model.robot.joints),
        gravity=_list(np.array(model.robot.gravity)),
        bodies="\n".join(_python_body(b, P) for b, P in zip(bodies, links, strict=True)),
        effects="\n".join(f"    tau[:, {j}] += {term}" for j, term in every) or "    pass",
        friction="\n".join(f"    tau[:, {j}] += {term}" for j, term in friction) or "    pass",
    )


def _filled(template: str, **values: object) -> str:
    text = resources.files("frischid.export").joinpath("templates", template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda m: str(values[m[1]]), text)


def _joint_frame_links(model: Model) -> Array:
    """Mass, first moments and inertias (L, 10) about the joints' frames."""
    links, transforms = model.links, model.robot.transforms
    return links if transforms is None else (transforms @ links[:, :, None])[:, :, 0]


def _head(model: Model, lead: str) -> str:
    robot = model.robot
    lines = [
        f"Inverse dynamics of {robot.name}, identified by frischid. Torque in N·m (N), positions in rad (m).",
        f"Joints in order: {', '.join(robot.joints)}.",
        f"Effects: {', '.join(str(e) for e in model.effects) or 'none'}.",
        *(f"Held still: {n} at {x!r} rad (m)." for n, x in robot.locked.items()),
    ]
    return "\n".join(lead + comment(line) for line in lines)


def _effects(model: Model, place: str, spelled: Callable[[str], str], friction_only: bool) -> list[tuple[int, str]]:
    """Joint and expression of every effect's torque."""
    found = []
    for effect in model.effects:
        if friction_only and not effect.friction:
            continue
        for column in effect.columns(model.robot):
            symbol = column.name.removesuffix(str(model.robot.numbers[column.joint]))
            if symbol not in effect.code:
                raise InputError(
                    f"the effect {effect.id} needs more than its joint's own state at one instant, or its class does "
                    f"not state the column of {symbol} in `code`, so no function of (q, v, a) can be written for it; "
                    "identify a model without it for the control loop"
                )
            j = model.robot.joints.index(column.joint)
            values = {k: number(x) for k, x in effect.parameters.items() if not isinstance(x, str)}
            state = {k: place.format(k, j) for k in "qva"}
            if friction_only:  # a function of q and v: friction at constant speed
                state["a"] = "0.0"
            term = effect.code[symbol].format(**state, **values)
            found.append((j, f"{number(model.parameter(column.name))} * ({spelled(term)})"))
    return found


def _c(term: str) -> str:
    return re.sub(r"\babs\(", "fabs(", term)


def _numpy(term: str) -> str:
    return re.sub(rf"\b({_FUNCTIONS})\(", r"np.\1(", term).replace("np.pow(", "np.power(")


def _row(values: Sequence[float] | Array) -> str:
    return "{" + ", ".join(number(x) for x in np.ravel(values)) + "}"


def _inertia(theta: Array) -> Array:
    xx, xy, yy, xz, yz, zz = theta[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _list(values: Array) -> str:
    """Nested lists of Python, of any depth."""
    return "[" + ", ".join(map(_list, values)) + "]" if np.ndim(values) else number(float(values))


def _c_tables(bodies: Sequence[Body], links: Array) -> str:
    rows = [
        f"    {{{b.parent}, {b.leader}, {int(b.slides)}, {number(b.factor)}, {number(b.shift)}, {_row(b.rotation)}, "
        f"{_row(b.translation)}, {_row(b.axis)},\n     {number(x[0])}, {_row(x[1:4])}, {_row(_inertia(x))}}}, "
        f"/* {comment(b.joint)} */"
        for b, x in zip(bodies, links, strict=True)
    ]
    return "\n".join(rows)


def _python_body(b: Body, x: Array) -> str:
    arrays = (b.rotation, b.translation, b.axis)
    return (
        f"    ({b.parent}, {b.leader}, {bool(b.slides)}, {number(b.factor)}, {number(b.shift)}, "
        f"{', '.join(f'np.array({_list(values)})' for values in arrays)}, {number(x[0])}, "
        f"np.array({_list(x[1:4])}), np.array({_list(_inertia(x))})),  # {comment(b.joint)}"
    )
