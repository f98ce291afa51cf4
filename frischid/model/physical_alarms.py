"""Alarms of parameters that no robot can have: of the wrong sign, or with a mass matrix that is not positive definite.

Each sentence says what the logs would give, and what the model in hand has.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace

from frischid.core.text import listed, percent
from frischid.core.types import Column
from frischid.effects import columns_of
from frischid.model.alarms import Alarm, AlarmCriteria, by_severity
from frischid.model.joint_inertia import LeastInertia, drawn_poses, least_inertia
from frischid.model.model import Model
from frischid.robot.robot import Robot

SIGN = "impossible-sign"
INERTIA = "indefinite-mass-matrix"
OF_INERTIA = ("kg·m²", "kg")
"""Units of a coefficient of the acceleration."""


def wrong_signs(
    contradicted: Sequence[tuple[str, float]],
    criteria: AlarmCriteria,
    values: Mapping[str, tuple[Column, float]] | None = None,
) -> list[Alarm]:
    """Parameters of known sign that the data would give the other sign.

    Parameters
    ----------
    contradicted : sequence of (str, float)
        Parameter, and by how many standard errors.
    values : mapping of str to (Column, float), optional
        Parameter -> its column, and its value in the model.
    """
    most: dict[str, float] = {}
    for name, x in contradicted:  # a rotor may be named by its bound and by its value
        most[name] = max(x, most.get(name, 0.0))
    bad = sorted(((n, x) for n, x in most.items() if x > criteria.sign_errors), key=lambda pair: -pair[1])
    if not bad:
        return []
    known = {n: values[n] for n, _ in bad if values and n in values}
    says = f": {', '.join(f'{_in_the_model(n, known)} ({x:.1f} s.e.)' for n, x in bad)}."
    return [_sign_alarm(says, [column.joint for column, _ in known.values()], max(x for _, x in bad), criteria)]


def _in_the_model(name: str, values: Mapping[str, tuple[Column, float]]) -> str:
    """A parameter with its value in the model, if that is known."""
    if name not in values:
        return name
    column, x = values[name]
    return f"{name} = {x:.3g} {column.unit}" if x else f"{name}, held at 0"


def _sign_alarm(says: str, joints: Sequence[str], value: float | None, criteria: AlarmCriteria) -> Alarm:
    return Alarm(
        SIGN,
        "doubt",
        f"The logs would give a negative value to parameters that cannot be negative{says}".rstrip(),
        "Check the signs of torque and motion of these joints (frischid check), then look for a missing effect "
        "(frischid diagnose).",
        tuple(dict.fromkeys(joints)),
        value,
        criteria.sign_errors,
    )


def indefinite_mass(model: Model, found: LeastInertia, where: str, criteria: AlarmCriteria) -> list[Alarm]:
    """The mass matrix is not positive definite, so the model cannot be simulated.

    A doubt: the torque along a motion, which every error measures, needs no positive mass matrix.

    Parameters
    ----------
    where : str
        The poses, in words.
    """
    if found.value > 0.0:
        return []
    return [
        Alarm(
            INERTIA,
            "doubt",
            f"The model cannot be simulated: its mass matrix is not positive definite at {percent(found.share)} of the "
            f"{where}, mostly because of {found.joint}.",
            remedy(model, criteria),
            (found.joint,),
            found.value,
            0.0,
        )
    ]


def as_one(signs: Sequence[Alarm], inertia: Sequence[Alarm]) -> list[Alarm]:
    """One alarm of both: parameters of impossible sign are why a mass matrix is not positive definite."""
    if not (signs and inertia):
        return [*signs, *inertia]
    (sign,), (matrix,) = signs, inertia
    sentence, remedy_of_both = f"{sign.sentence} {matrix.sentence}", f"{sign.remedy} {matrix.remedy}"
    return [replace(sign, sentence=sentence, remedy=remedy_of_both)]


def eigenvalue_in_words(robot: Robot, found: LeastInertia) -> str:
    """The least eigenvalue of a mass matrix, with units."""
    slides = robot.prismatic[robot.joints.index(found.joint)]
    inertia, position = ("kg", "m") if slides else ("kg·m²", "rad")
    return (
        f"its least eigenvalue is {found.value:.3g} {inertia}, mostly of {found.joint}, at {found.joint} = "
        f"{found.position:.3g} {position}"
    )


def remedy(model: Model, criteria: AlarmCriteria | None = None) -> str:
    """How to come to a model that can be simulated.

    `frischid consistent` finds links with a positive mass matrix, but keeps a rotor inertia that the logs clearly make
    negative. Such a model needs a fit without rotor inertias first.
    """
    kept = _kept_negative(model, (criteria or AlarmCriteria()).sign_errors)
    if not kept:
        return "Find links that can exist (frischid consistent MODEL -o FILE), and simulate with these."
    owners = {c.effect for c in kept}
    others = ", ".join(str(effect) for effect in model.effects if effect.id not in owners)
    return (
        f"To simulate, identify without {' and '.join(sorted(owners))} (--effects {shlex.quote(others)}), then find "
        "links that can exist (frischid consistent)."
    )


def _kept_negative(model: Model, limit: float) -> list[Column]:
    """Inertias of effects that stay negative in physical links: by more than `limit` standard errors before."""
    columns = [c for c in columns_of(model.robot, model.effects) if c.effect != "rigid" and c.unit in OF_INERTIA]
    if model.standard is not None:
        return [c for c in columns if c.sign * model.standard[c.name] < 0.0]
    e = model.estimate
    below = {c.name for c, x, s in zip(e.columns, e.theta, e.stderr, strict=True) if c.sign * x < -limit * s}
    return [c for c in columns if c.name in below]


def of_physical(before: Sequence[Alarm], model: Model) -> tuple[Alarm, ...]:
    """The alarms of a fit, after links were found that can exist.

    Parameters
    ----------
    before : sequence of Alarm
        Of the fit.
    model : Model
        With these links.
    """
    criteria = AlarmCriteria()
    others = [alarm for alarm in before if alarm.id not in (SIGN, INERTIA)]
    signs = [_in_physical_links(alarm, model, criteria) for alarm in before if alarm.id == SIGN]
    least = least_inertia(model, [drawn_poses(model.robot)])
    inertia = indefinite_mass(model, least, "poses within the joints' limits", criteria)
    return by_severity([*others, *as_one(signs, inertia)])


def _in_physical_links(alarm: Alarm, model: Model, criteria: AlarmCriteria) -> Alarm:
    """The alarm of impossible signs, with the values of a model whose links can exist."""
    columns = columns_of(model.robot, model.effects)
    pairs = ((c.name, c, model.parameter(c.name)) for c in columns if c.sign > 0)
    negative = {name: (column, x) for name, column, x in pairs if x < 0.0}
    says = f" ({listed(alarm.joints)})" * bool(alarm.joints)
    values = listed([_in_the_model(name, negative) for name in negative])
    has = f"This model has {values}." if values else "In this model none of them is negative."
    return replace(_sign_alarm(f"{says}. {has}", alarm.joints, alarm.value, criteria), severity=alarm.severity)
