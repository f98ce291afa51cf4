"""What was judged, as findings: effects with what they explain, what they are confused with, and a sentence.

A finding stands when it is more than chance and more than a trifle, and explains enough of what is wrong where it acts:
of an error well above the noise any part, of one near the noise half of it, of one that dry friction may leave
where a joint turns or rests (see `resting`) nearly all. That all the old parameters no longer hold is a finding too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from frischid.core.text import each_of, listed
from frischid.core.types import Array
from frischid.diagnosis.change_prior import nominal
from frischid.diagnosis.cross_validation import Evidence
from frischid.diagnosis.reversal_residuals import at_rest
from frischid.diagnosis.stepwise_selection import SIGNIFICANCE, TRIFLE, Ranked, Ranking, ranking
from frischid.effects import EFFECTS, Effect
from frischid.model.model import Model
from frischid.robot.robot import Robot

WITHIN = 1.15  # noise floors: an error below is what the sensors leave, as well as that is known
ABOVE = 2.0  # noise floors: an error below is not well above the noise, the floor being an estimate
HALF, NEARLY = 0.5, 0.8  # of what is wrong where a finding acts
OLD = "old_parameters"  # the finding that they no longer hold
HOW_RANKED = (
    "First comes the effect whose work no other can do, not always the one that lowers the error most. Those below it "
    "are what each would do alone; many vanish once the first is in the model."
)


@dataclass(frozen=True, eq=False)
class Finding:
    """One effect, judged.

    Attributes
    ----------
    effect : str
        Identifier in the catalogue.
    joints : tuple of str
        Where it acts; empty for the whole robot.
    error_before, error_after : float
        Held-out NRMSE, mean over the joints.
    gain : float
        Log likelihood it adds on held-out data, less its price.
    removed : float
        What it takes off the sum of the joints' squared held-out NRMSE: how much of what is wrong it explains.
    share : float
        Of the error above the noise floor on the joints it acts on, the part it removes; zero where hardly any is.
    floors : float
        Error in noise floors, without it, on those of these joints where it is not all dry friction (see `resting`).
    p_value : float
        Of a gain at least this large by chance, corrected for all candidates tried.
    parameters : dict of str to float
        Its coefficients, and its shape.
    confused_with : tuple of str
        Effects that explain these data as well.
    sentence : str
    members : tuple of Effect
        Ready to be added to a model: one for every joint, or the one for the robot.
    """

    effect: str
    joints: tuple[str, ...]
    error_before: float
    error_after: float
    gain: float
    removed: float
    share: float
    floors: float
    p_value: float
    parameters: dict[str, float]
    confused_with: tuple[str, ...]
    sentence: str
    members: tuple[Effect, ...]

    @property
    def sure(self) -> bool:
        """Whether it is more than chance and more than a trifle."""
        return self.gain > 0 and self.p_value < SIGNIFICANCE and self.removed > TRIFLE**2

    @property
    def withheld(self) -> str:
        """Why it may be no more than a part of what sensors or dry friction leave; empty where it is more.

        Where little is above the noise it must explain half of that; where that is all dry friction, nearly all.
        """
        part = f"it explains {self.share:.0%} of what is above the noise there"
        if self.floors == 0 and self.share > 0:
            rests = f"all of that is where a joint turns or rests, and {NEARLY:.0%} is asked of an effect"
            return "" if self.share >= NEARLY else f"{part}, {rests}"
        if self.floors <= WITHIN:
            return "hardly more is left there than what the sensors leave"
        if self.share == 0:
            return "nothing of what is wrong there goes away with it"
        if self.floors <= ABOVE and self.share < HALF:
            return f"{part}, and at only {self.floors:.1f} noise floors {HALF:.0%} is asked of an effect"
        return ""

    @property
    def significant(self) -> bool:
        """Whether it is called missing: sure, and with nothing for which it is withheld."""
        return self.sure and not self.withheld

    def found(self, robot: Robot) -> list[tuple[str, float, str]]:
        """Its `parameters` to read: name, value and unit (empty for a pure number), coefficients first."""
        values = [
            (c.name, self.parameters[c.name], "" if c.unit == "1" else c.unit)
            for member in self.members
            for c in member.columns(robot)
        ]
        for member in self.members:
            where = f" of {listed(member.joints or ('the robot',))}" if len(self.members) > 1 else ""
            values += [(f"{k}{where}", x, member.unit(k, robot)) for k, x in _shape(member).items()]
        return values

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        values = {k: v for k, v in vars(self).items() if k != "members"}
        return values | {"joints": list(self.joints), "confused_with": list(self.confused_with)}


def findings_of(
    evidence: Evidence,
    floor: Array,
    situation: str,
    only: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Finding], Ranking]:
    """Every effect that can act on this robot, best first; and how they were judged."""
    kinds = [
        kind
        for name, kind in EFFECTS.items()
        if (only is None or name in only) and not (kind.change and situation == "always")
    ]
    judged = ranking(evidence, kinds, progress)
    moving = ~at_rest(evidence, floor)
    return [_finding(evidence, floor, moving, ranked) for ranked in judged.effects], judged


def _finding(evidence: Evidence, floor: Array, moving: NDArray[np.bool_], ranked: Ranked) -> Finding:
    before = evidence.nrmse(evidence.base_sse())
    after = evidence.nrmse(ranked.score.sse)
    noise = floor / evidence.spread
    rows = list(ranked.together.columns)
    seen = [row for row in rows if moving[row]]
    members = tuple(place.effect for place in ranked.places)
    joints = tuple(dict.fromkeys(j for e in members for j in (e.joints or ())))
    names = [c.name for e in members for c in e.columns(evidence.model.robot)]
    shapes = {f"{k}_{n}" if len(members) > 1 else k: v for n, e in enumerate(members, 1) for k, v in _shape(e).items()}
    return Finding(
        ranked.kind.id,
        joints,
        float(before.mean()),
        float(after.mean()),
        ranked.gain,
        ranked.removed,
        _share(before[rows], after[rows], noise[rows]),
        _in_floors(before[seen], noise[seen]),
        ranked.p_value,
        dict(zip(names, map(float, ranked.score.beta), strict=True)) | shapes,
        ranked.rivals,
        ranked.kind.sentence.format(joint=each_of(joints), joints=listed(joints)),
        members,
    )


def _share(before: Array, after: Array, noise: Array) -> float:
    """Of the squares above the noise, the part that is removed; zero where they are a trifle."""
    above = float((before**2 - np.minimum(noise, before) ** 2).sum())
    return float(np.clip((before**2 - after**2).sum() / above, 0.0, 1.0)) if above > TRIFLE**2 else 0.0


def _in_floors(error: Array, noise: Array) -> float:
    return float(np.linalg.norm(error)) / max(float(np.linalg.norm(noise)), 1e-12)


def _shape(effect: Effect) -> dict[str, float]:
    return {k: float(v) for k, v in effect.parameters.items() if k in effect.searched}


def refitted(model: Model, evidence: Evidence, floor: Array) -> Finding:
    """That the old parameters no longer hold: all of them fitted to these logs alone, for the price of all of them."""
    anew = evidence.believing(nominal(model))
    before, after = evidence.base_sse(), anew.base_sse()
    ratio = evidence.log_likelihood(before, after, np.maximum(evidence.effective, anew.effective))
    costs = len(model.base)
    gain = ratio - 0.5 * costs * float(np.log(max(float(evidence.counts.sum()), 2.0)))
    errors = evidence.nrmse(before), evidence.nrmse(after)
    taken = float((errors[0] ** 2 - errors[1] ** 2).sum())
    chance = float(stats.chi2.sf(2 * ratio, costs)) if gain > 0 else 1.0
    noise = floor / evidence.spread
    share, floors = _share(*errors, noise), _in_floors(errors[0], noise)
    sentence = (
        "the old parameters no longer hold, and no single effect says why: several links or friction changed; identify "
        "the robot again"
    )
    error, rest = (float(x.mean()) for x in errors)
    return Finding(OLD, (), error, rest, gain, taken, share, floors, chance, {}, (), sentence, ())
