"""What a model can be exported to, and which of its effects each format leaves out.

    C, NumPy: every effect whose class states its columns (all of the catalogue);   MJCF, URDF: friction and armature

Code of a model with memory is a step function: it must be called at every sample, see `frischid.export.code_columns`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from frischid.effects import Effect, columns_of
from frischid.export.code_columns import CodeModel, NoCodeError
from frischid.model.model import Model

FORMAT_EFFECTS = {"MJCF": {"viscous", "coulomb", "rotor_inertia"}, "URDF": {"viscous", "coulomb"}}
"""Effects that a format has a place for; code has a place for all."""


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


def left_out(model: Model, kind: str) -> tuple[str, ...]:
    """Effects of a model that a written MJCF or URDF file leaves out."""
    return tuple(str(e) for e in model.effects if e.id not in FORMAT_EFFECTS[kind] or e.parameters.get("coupled"))


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
