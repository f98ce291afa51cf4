"""A model as a function for a control loop: C with nothing but <math.h>, or Python with nothing but NumPy.

The recursive Newton-Euler algorithm over constant tables (Luh, Walker and Paul 1980; notation of Featherstone 2008,
chapter 5, with three-vectors), then the effects' torques, joint by joint:

    ω_i = R_iᵀ ω_p + s q̇,   α_i = R_iᵀ α_p + s q̈ + ω_i × s q̇,   a_i = R_iᵀ (a_p + α_p × p + ω_p × (ω_p × p)),
    f_i = m a_i + α_i × h + ω_i × (ω_i × h),   n_i = I α_i + ω_i × I ω_i + h × a_i,

and back to the base, with a_0 = −g. Tables hold the inertias about the joints' frames, so nothing is divided.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from importlib import resources

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.model.model import Model
from frischid.robot.kinematic_tree import Body, bodies_of

FUNCTIONS = "tanh|exp|sin|cos|abs|pow"


def c_source(model: Model) -> str:
    """C99 source of ``inverse_dynamics`` and ``friction``, checked against `Model.inverse_dynamics` in the tests.

    Raises
    ------
    InputError
        The model has no physical links, or an effect that its joint's own state does not determine.
    """
    bodies, links = bodies_of(model.robot), _joint_frame_links(model)
    J, L = len(model.robot.joints), len(bodies)
    every, friction = (_effects(model, "{}[{}]", _c, only) for only in (False, True))
    return _filled(
        "control.c",
        head=_head(model, " * "),
        J=J,
        L=L,
        gravity=_row(model.robot.gravity),
        tables=_c_tables(bodies, links),
        effects="\n".join(f"    tau[{j}] += {term};" for j, term in every),
        friction="\n".join(f"    tau[{j}] += {term};" for j, term in friction),
    )


def numpy_source(model: Model) -> str:
    """Python source of the same two functions over samples (N, J), importing NumPy only; see `c_source`."""
    bodies, links = bodies_of(model.robot), _joint_frame_links(model)
    every, friction = (_effects(model, "{}[:, {}]", _numpy, only) for only in (False, True))
    return _filled(
        "control_py.txt",
        head=_head(model, ""),
        gravity=list(model.robot.gravity),
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
    return "\n".join(lead + line.replace("*/", "* /").replace('"""', "'''") for line in lines)


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
                    f"the effect {effect.id} needs more than its joint's own state at one instant, so no function of "
                    "(q, v, a) can be written for it; identify a model without it for the control loop"
                )
            j = model.robot.joints.index(column.joint)
            values = {k: f"{float(x)!r}" for k, x in effect.parameters.items() if not isinstance(x, str)}
            state = {k: place.format(k, j) for k in "qva"}
            if friction_only:  # a function of q and v: friction at constant speed
                state["a"] = "0.0"
            term = effect.code[symbol].format(**state, **values)
            found.append((j, f"{model.parameter(column.name)!r} * ({spelled(term)})"))
    return found


def _c(term: str) -> str:
    return re.sub(r"\babs\(", "fabs(", term)


def _numpy(term: str) -> str:
    return re.sub(rf"\b({FUNCTIONS})\(", r"np.\1(", term).replace("np.pow(", "np.power(")


def _row(values: Sequence[float] | Array) -> str:
    return "{" + ", ".join(repr(float(x)) for x in np.ravel(values)) + "}"


def _inertia(theta: Array) -> Array:
    xx, xy, yy, xz, yz, zz = theta[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _c_tables(bodies: Sequence[Body], links: Array) -> str:
    rows = [
        f"    {{{b.parent}, {b.leader}, {int(b.slides)}, {b.factor!r}, {b.shift!r}, {_row(b.rotation)}, "
        f"{_row(b.translation)}, {_row(b.axis)},\n     {float(x[0])!r}, {_row(x[1:4])}, {_row(_inertia(x))}}}, "
        f"/* {b.joint} */"
        for b, x in zip(bodies, links, strict=True)
    ]
    return "\n".join(rows)


def _python_body(b: Body, x: Array) -> str:
    def array(values: Array) -> str:
        return f"np.array({values.tolist()!r})"

    return (
        f"    ({b.parent}, {b.leader}, {b.slides}, {b.factor!r}, {b.shift!r}, {array(b.rotation)}, "
        f"{array(b.translation)}, {array(b.axis)}, {float(x[0])!r}, {array(x[1:4])}, {array(_inertia(x))}),"
        f"  # {b.joint}"
    )
