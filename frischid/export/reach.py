"""The formats that a model can be exported to, and the effects that each of them leaves out.

    C, NumPy: every effect whose class states its columns (all of the catalogue);   URDF: viscous and Coulomb friction
    MJCF: as C, what the XML has no place for in a Python file beside it (`frischid.export.mjcf_effects`)

Code of a model with memory is a step function: it must be called at every sample, see `frischid.export.code_columns`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from frischid.effects import EFFECTS, Backlash, Effect, Elasticity, JointSpring, columns_of
from frischid.export.code_columns import CodeModel, NoCodeError
from frischid.export.consistency import describes_change
from frischid.export.mjcf_gears import has_gears
from frischid.export.mjcf_share import forces, share_of
from frischid.model.model import Model

URDF_EFFECTS = frozenset({"viscous", "coulomb"})
"""Effects that a URDF has a place for; code has a place for all, and MJCF with the Python file beside it too."""


REACH_FORMATS = {"c": "code", "mjcf": "MJCF", "urdf": "URDF"}
"""Formats by the names of the command line."""


@dataclass(frozen=True)
class Reach:
    """The part of a model that one format holds."""

    format: str
    without: tuple[str, ...] = ()
    """Effects that the format leaves out."""
    refused: tuple[str, ...] = ()
    """Effects without which the model could be written in this format; it cannot be written as it is."""
    steps: bool = False
    """Whether the code must be called at every sample, because the torque depends on the past."""
    beside: tuple[str, ...] = ()
    """Effects that are in a Python file beside the file: of MJCF."""

    @property
    def whole(self) -> bool:
        """Whether nothing of the model is missing."""
        return not self.without and not self.refused

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        kept: dict[str, Any] = {"without": list(self.without), "refused": list(self.refused), "steps": self.steps}
        kept["beside"] = list(self.beside)
        return {"whole": self.whole, **kept}


def exportable(model: Model, kind: str) -> tuple[str, ...]:
    """Effects of the catalogue that an export of a model holds whole.

    Parameters
    ----------
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
    """Effects of a model that a written MJCF (with the file beside it) or URDF file leaves out."""
    torques = [e for e in model.effects if not e.of_controller]  # no torque of the robot, and no format has a delay
    if kind == "MJCF":
        filled = _filled(model)
        return tuple(str(e) for e in torques if not (has_gears(filled, e) or _explicit(filled, e)))
    return tuple(str(e) for e in torques if e.id not in URDF_EFFECTS)


def beside(model: Model) -> tuple[str, ...]:
    """Effects of a model that an MJCF file has no place for, so that they are in the Python file beside it."""
    filled, found = _filled(forces(model)), []
    lost = left_out(model, "MJCF")
    written = [e for e in filled.effects if str(e) not in lost]
    held = share_of(replace(filled, effects=tuple(written))).held
    for effect in written:
        columns = effect.columns(model.robot)
        rest = [c.joint for c in columns if c.name not in held]
        part = len(rest) < len(columns) and len({c.joint for c in columns}) == len(columns)
        if rest:
            found.append(str(replace(effect, joints=tuple(rest)) if part else effect))
    return tuple(found)


def _filled(model: Model) -> Model:
    """The model with a value for every parameter: of base parameters alone those with their names, else the URDF's."""
    robot, columns = model.robot, columns_of(model.robot, model.effects)
    standard = dict.fromkeys((c.name for c in columns), 0.0) | dict(
        zip(robot.all_names, map(float, robot.nominal), strict=True)
    )
    if model.standard is not None:
        return replace(model, standard={**standard, **model.standard})
    known = {x.name: x.value for x in model.parameters if x.name in standard}
    springs = {(x.joint, x.effect): x for x in model.parameters if x.effect == JointSpring.id}
    for c in columns:  # a spring may be one of a sum
        x = springs.get((c.joint, c.effect))
        if x is not None and x.name.startswith(c.name):
            known[c.name] = x.value
    return replace(model, standard={**standard, **known})


def changes_in(model: Model) -> tuple[str, ...]:
    """The effects of a model that came when the robot changed, as text."""
    fitted = {parameter.effect for parameter in model.parameters}
    return tuple(str(e) for e in model.effects if (e.change or e.changed) and e.id in fitted)


def reach_of(model: Model) -> tuple[Reach, ...]:
    """The part of a model that each format holds: C and NumPy (one entry, ``code``), MJCF, URDF.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.export.reach import reach_of
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none", effects=fr.parse_effects("viscous, hysteresis")).model
    >>> [(x.format, x.without, x.beside) for x in reach_of(model)]
    [('code', (), ()), ('MJCF', (), ('hysteresis(distance=0.006, width=0.005)',)), \
('URDF', ('hysteresis(distance=0.006, width=0.005)',), ())]
    """
    if (changes := changes_in(model)) and describes_change(model):
        return tuple(Reach(name, refused=changes) for name in ("code", "MJCF", "URDF"))
    return (
        _code(model),
        Reach("MJCF", left_out(model, "MJCF"), beside=beside(model)),
        Reach("URDF", left_out(model, "URDF")),
    )


def _code(model: Model) -> Reach:
    filled = _filled(model)
    try:
        return Reach("code", steps=CodeModel.of(filled).remembers)
    except NoCodeError:
        return Reach("code", refused=tuple(str(e) for e in model.effects if not _writable(filled, e)))


def _explicit(model: Model, effect: Effect) -> bool:
    """Whether MuJoCo can be given the effect as a force; it cannot of a gear with a negative compliance or gap."""
    return not isinstance(effect, Elasticity | Backlash) and _writable(model, effect)


def _writable(model: Model, effect: Effect) -> bool:
    try:
        CodeModel.of(replace(model, effects=(effect,)))
    except NoCodeError:
        return False
    return True


def in_words(reach: Sequence[Reach]) -> str:
    """One line for a terminal."""
    code, *others = reach
    if any(x.refused for x in others):
        return (
            f"exports to no format, because {_ids(code.refused)} describes a change of the robot; identify the robot "
            "again, or take the change back (frischid history --undo)"
        )
    if code.refused:
        said = [f"C and NumPy: not with {', '.join(code.refused)}, whose class states no code"]
    else:
        how = "a step function with memory" if code.steps else "a function of q, v, a"
        said = [f"C and NumPy: whole, as {how}"]
    return "exports to " + "; ".join([*said, *(f"{x.format}: {_less(x)}" for x in others)])


def _less(reach: Reach) -> str:
    if reach.without:
        return f"without {_ids(reach.without)}"
    return f"whole, with {_ids(reach.beside)} in a Python file beside the XML" if reach.beside else "whole"


def _ids(effects: Sequence[str]) -> str:
    return ", ".join(dict.fromkeys(text.partition("(")[0].partition("@")[0] for text in effects))
