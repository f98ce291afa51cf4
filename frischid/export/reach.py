"""What a model can be exported to, and which of its effects each format leaves out.

    C, NumPy: every effect whose class states its columns (all of the catalogue);   MJCF, URDF: friction and armature;
    MJCF: linear springs too, with the joint's torque offset as the angle without torque

Code of a model with memory is a step function: it must be called at every sample, see `frischid.export.code_columns`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from frischid.effects import EFFECTS, Effect, columns_of
from frischid.export.code_columns import CodeModel, NoCodeError
from frischid.model.model import Model

FORMAT_EFFECTS = {"MJCF": {"viscous", "coulomb", "rotor_inertia"}, "URDF": {"viscous", "coulomb"}}
"""Effects that a format has a place for; code has a place for all."""


REACH_FORMATS = {"c": "code", "mjcf": "MJCF", "urdf": "URDF"}
"""Formats by the names of the command line."""


@dataclass(frozen=True)
class Reach:
    """What one format holds of a model.

    Attributes
    ----------
    format : str
    without : tuple of str
        Effects that the format leaves out.
    refused : tuple of str
        Effects without which the model could be written in this format; it cannot be written as it is.
    steps : bool
        Whether the code must be called at every sample, because the torque depends on the past.
    """

    format: str
    without: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    steps: bool = False

    @property
    def whole(self) -> bool:
        """Whether nothing of the model is missing."""
        return not self.without and not self.refused

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        kept = {"without": list(self.without), "refused": list(self.refused), "steps": self.steps}
        return {"whole": self.whole, **kept}


def exportable(model: Model, kind: str) -> tuple[str, ...]:
    """Effects of the catalogue that an export of a model holds whole.

    Parameters
    ----------
    model : Model
    kind : {"c", "mjcf", "urdf"}

    Returns
    -------
    tuple of str
        Identifiers.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.export.reach import exportable
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> "hysteresis" in exportable(model, "c"), exportable(model, "urdf")
    (True, ('viscous', 'coulomb', 'command_delay', 'position_gain'))
    """
    held = []
    for name, effect in EFFECTS.items():
        place = next((places[0] for places in effect.candidates(model.robot) if places), None)
        reach = () if place is None else reach_of(replace(model, effects=(place,)))
        held += [name for found in reach if found.format == REACH_FORMATS[kind] and found.whole]
    return tuple(held)


def left_out(model: Model, kind: str) -> tuple[str, ...]:
    """Effects of a model that a written MJCF or URDF file leaves out."""
    held = mjcf_springs(model) if kind == "MJCF" else {}
    found = []
    for effect in model.effects:
        if effect.of_controller:  # no torque of the robot, and no format has a delay
            continue
        if effect.id in FORMAT_EFFECTS[kind] and not effect.parameters.get("coupled"):
            continue
        joints = [name for _, name, _ in effect.acts_on(model.robot)] if effect.id in ("joint_spring", "offset") else []
        rest = [name for name in joints if name not in held]
        if not joints or len(rest) == len(joints):
            found.append(str(effect))
        elif rest:
            found.append(str(replace(effect, joints=tuple(rest))))
    return tuple(found)


def mjcf_springs(model: Model) -> dict[str, tuple[float, float]]:
    """Joint -> stiffness and angle without torque of its linear spring: ``τ = ks q + off = ks (q − springref)``.

    MuJoCo refuses a negative stiffness, so a spring that pushes away from its place is not among them.
    """
    offsets, springs = (_values(model, *of) for of in (("offset", "off"), ("joint_spring", "ks")))
    return {joint: (ks, -offsets.get(joint, 0.0) / ks) for joint, ks in springs.items() if ks > 0}


def _values(model: Model, effect: str, symbol: str) -> dict[str, float]:
    """Values of an effect's parameter by joint, of base parameters alone too."""
    if model.standard is not None:
        return model.of_effect(effect, symbol)
    return {x.joint: x.value for x in model.parameters if x.effect == effect and x.name.startswith(symbol)}


def reach_of(model: Model) -> tuple[Reach, ...]:
    """What each format holds of a model: C and NumPy (one entry, ``code``), MJCF, URDF.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.export.reach import reach_of
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none", effects=fr.parse_effects("viscous, hysteresis")).model
    >>> [(x.format, x.without, x.steps) for x in reach_of(model)]
    [('code', (), True), ('MJCF', ('hysteresis(distance=0.006, width=0.005)',), False), \
('URDF', ('hysteresis(distance=0.006, width=0.005)',), False)]
    """
    return _code(model), *(Reach(kind, left_out(model, kind)) for kind in FORMAT_EFFECTS)


def _code(model: Model) -> Reach:
    columns = columns_of(model.robot, model.effects)
    filled = replace(model, standard={**dict.fromkeys(model.robot.all_names, 0.0), **{c.name: 0.0 for c in columns}})
    try:
        return Reach("code", steps=CodeModel.of(filled).remembers)
    except NoCodeError:
        return Reach("code", refused=tuple(str(e) for e in model.effects if not _writable(filled, e)))


def _writable(model: Model, effect: Effect) -> bool:
    try:
        CodeModel.of(replace(model, effects=(effect,)))
    except NoCodeError:
        return False
    return True


def in_words(reach: Sequence[Reach]) -> str:
    """One line for a terminal."""
    code, *others = reach
    if code.refused:
        said = [f"C and NumPy: not with {', '.join(code.refused)}, whose class states no code"]
    else:
        how = "a step function with memory" if code.steps else "a function of q, v, a"
        said = [f"C and NumPy: whole, as {how}"]
    return "exports to " + "; ".join([*said, *(f"{x.format}: {_less(x)}" for x in others)])


def _less(reach: Reach) -> str:
    ids = dict.fromkeys(text.partition("(")[0].partition("@")[0] for text in reach.without)
    return f"without {', '.join(ids)}" if ids else "whole"
