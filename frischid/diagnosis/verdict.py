"""The verdict of a diagnosis: none, effect, several, contact or unknown.

With r_j the residual NRMSE of joint j with all effects that entered in the model, and n_j that of the sensor noise,

    unexplained = max_j (r_j² − n_j²)     over joints whose error asks for an explanation.

A joint's error *asks for an explanation* when it is clearly above the sensor noise, and the part above the noise is
large beside the joint's torque.
The verdicts:

- *contact*: something touched the robot for a while.
- *effect*: the model lacks at least one effect of the catalogue, and this effect explains more than `unexplained`.
- *unknown*: `unexplained` is more than any such effect explains, or a term outside the catalogue explains far more than
  the first finding (`unmodelled_terms`).
- *none*: no joint's error asks for an explanation.
- *several*: several small effects act, and none dominates. This is concluded from the probabilities (`probability`), in
  place of *effect*, *unknown* or *none*, where it is the most probable hypothesis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from frischid.core.text import about, listed
from frischid.core.types import Array
from frischid.diagnosis.carried_loads import CarriedLoad
from frischid.diagnosis.contacts import Contact
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_ranking import Ranking
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.floor import asks_for_explanation
from frischid.diagnosis.hypotheses import OTHERS
from frischid.diagnosis.residual_formula import Description
from frischid.diagnosis.reversal_residuals import only_at_reversals
from frischid.diagnosis.rivals import sentence_of, suspect_of
from frischid.diagnosis.situation import Situation
from frischid.diagnosis.torque_limits import TorqueLimit
from frischid.diagnosis.unmodelled_terms import UnmodelledTerm
from frischid.effects import EFFECTS

Verdict = Literal["none", "effect", "contact", "unknown", "several"]

SENTENCES = {
    "contact": "something touched the robot for a while; these stretches of time are left out, not modelled",
    "unknown": "more is missing than any one effect of the catalogue explains",
    "several": "several small effects act, and none of them dominates: no single one is the cause",
}
"""Verdicts that no effect of the catalogue stands for."""


LIKE_THE_TWIN = "a robot that misses nothing has as much error there, because sensor noise biases the fit"
"""Why a finding is set aside."""


@dataclass(frozen=True, eq=False)
class StageResults:
    """Results of the stages before the verdict."""

    validator: CrossValidator
    """Fit to the logs without the contacts."""
    situation: Situation
    floor: Array
    """Sensor noise of each joint, N·m (N), (J,)."""
    least: Array
    """Error where no effect is missing, N·m (N), (J,): the healthy twin's, or the floor where that is larger."""
    contacts: tuple[Contact, ...]
    findings: tuple[Finding, ...]
    """Best first."""
    ranking: Ranking
    unmodelled: UnmodelledTerm | None
    said: str = ""
    """A sentence on repeated motions, empty without any."""
    limits: tuple[TorqueLimit, ...] = ()
    load: CarriedLoad | None = None

    @property
    def together(self) -> float:
        """Error that all effects that entered explain, in summed squared NRMSE."""
        before, after = self.validator.predictive_nrmse(), self.ranking.full.predictive_nrmse()
        return float((before**2 - after**2).sum())

    @cached_property
    def at_reversals(self) -> NDArray[np.bool_]:
        """Joints whose error is only at reversals and standstill, with the effects that entered or without, (J,)."""
        with_effects, without = (only_at_reversals(x, self.floor) for x in (self.ranking.full, self.validator))
        return np.asarray(with_effects | without)


def decided(results: StageResults, *, by_twin: bool = False) -> Verdict:
    """The verdict, before a refit of all parameters is considered; `by_twin`: the healthy twin's error counts as noise.

    A finding that explains half of the error on its own joints is named even if another joint has a larger unexplained
    error. Errors of dry friction at reversals and standstill ask for no explanation, be they so without the effects or
    with them: an effect may enter because it explains a part of such an error, and spread the rest over the motion.
    """
    if results.contacts:
        return "contact"
    validator, full = results.validator, results.ranking.full
    criteria = validator.criteria
    sure = [f for f in results.findings if (f.beyond_twin if by_twin else f.significant)]
    noise = results.floor / validator.spread
    residual = full.predictive_nrmse()
    residual = np.minimum(residual, validator.predictive_nrmse())  # an effect may raise another joint's error
    floor = results.least if by_twin else results.floor
    asks = asks_for_explanation(residual, floor / validator.spread, validator)
    asks &= ~results.at_reversals
    unexplained = float(np.where(asks, residual**2 - noise**2, 0.0).max())
    if not sure:
        return "unknown" if unexplained > 0 else "none"
    factor = criteria.remainder_factor if sure[0].share > criteria.half_explained else 1.0
    most = max(f.removed for f in sure) * factor
    return "unknown" if unexplained > most or results.unmodelled is not None else "effect"


def notes_on(
    results: StageResults, verdict: Verdict, description: Description | None, probabilities: Mapping[str, float]
) -> list[str]:
    """Sentences beside the verdict: the situation that was assumed, and the reasons."""
    validator, full, unmodelled = results.validator, results.ranking.full, results.unmodelled
    changed = results.situation == "changed"
    notes = [f"assumed: the robot {'changed' if changed else 'has not changed'} since it was identified"]
    notes += [
        *map(str, results.limits),
        *([] if results.load is None else [str(results.load)]),
        *filter(None, [results.said]),
    ]
    errors = zip(full.joints, full.base_nrmse(), strict=True)  # with the effects: a large one is no short log
    lost = [name for name, error in errors if error > 1.0]  # a constant torque has an NRMSE of 1
    if lost:
        notes.append(
            f"{listed(lost)}: a model fitted to a part of these logs predicts the torque of the others worse than a "
            "constant would. The logs are too short or move too little to judge the model; record longer ones"
        )
    asks = asks_for_explanation(full.predictive_nrmse(), results.floor / full.spread, full)
    # The probabilities may conclude "none" beside an error that is in motion too.
    if verdict == "none" and (asks & results.at_reversals).any():
        where = listed([name for name, here in zip(full.joints, asks & results.at_reversals, strict=True) if here])
        notes.append(
            f"the residual error of {where} is at reversals and standstill, where dry friction is undetermined"
        )
    smoothed = max(results.ranking.smoothing, key=lambda c: c.explained, default=None)
    cutoff = validator.model.lowpass.cutoff
    if smoothed is not None and smoothed.explained > validator.criteria.smallest_error**2 and cutoff is not None:
        where = listed(smoothed.effect.joints or ()) or "all joints"
        notes.append(
            f"a shift of the torque in time explains a part of the error of {where}, and the opposite shift explains "
            f"as much: that is no delay, but noise of the positions; identify with a lower cut-off than {cutoff:g} Hz "
            "(--cutoff)"
        )
    shared = sentence_of(results.findings, probabilities, validator.model.robot)
    if shared and verdict != "contact":
        notes.append(shared)
    notes += not_called_missing(results.findings, probabilities, verdict)
    if full.known_residual.any():
        factor = validator.criteria.known_residual_factor
        notes.append(
            "the model was not fitted to these logs: effects are ranked by the error they explain beyond "
            f"{factor:g} times the model's residual on its training logs"
        )
    if description is not None and unmodelled is not None:
        where, first = full.joints[unmodelled.row], results.ranking.effects[0].kind.id
        more, which = ("more error", "main cause") if unmodelled.on_another_joint else ("far more", "cause")
        notes.append(f"on {where} {unmodelled.words} explains {more} than {first} does, so {first} is not the {which}")
    return notes + ([str(description)] if description is not None else [])


def not_called_missing(findings: Sequence[Finding], probabilities: Mapping[str, float], verdict: Verdict) -> list[str]:
    """Why a likely effect is not called missing; where nothing is, `Diagnosis.remainder` says that of the likeliest."""
    suspect = suspect_of(findings, probabilities)
    withheld = next((f for f in findings if f.sure and f.withheld), None)
    if verdict == "none" and withheld is not None and withheld is not suspect:
        return [f"more than chance, but not called missing: {withheld.title}; {withheld.withheld}"]
    if verdict != "none" and suspect is not None:
        return [f"the most probable cause, {suspect.title}, is not called missing: {suspect.refused}"]
    return []


def with_refit(
    verdict: Verdict, findings: Sequence[Finding], refit: Finding, together: float
) -> tuple[Verdict, list[Finding]]:
    """Put the refit of all parameters among the findings: first only where it explains far more than any effect.

    The refit says that no effects explain the change. So it is left out where the effects that entered explain more
    than the refit.

    Parameters
    ----------
    together : float
        Error that all effects that entered explain, in summed squared NRMSE.
    """
    findings = list(findings)
    if not refit.significant:
        return verdict, findings
    criteria = refit.criteria
    best = next((f for f in findings if f.significant), None)
    better = best is None or (refit.gain > best.gain and refit.removed > criteria.refit_factor * best.removed)
    needed = refit.removed > together
    if verdict != "contact" and refit.share > criteria.half_explained and (verdict == "unknown" or (better and needed)):
        return "effect", [refit, *findings]
    if not needed:
        return verdict, findings
    before = [f for f in findings if f.removed >= refit.removed] or findings[:1]
    return verdict, [*before, refit, *(f for f in findings if f not in before)]


def concluded(
    verdict: Verdict, findings: Sequence[Finding], probabilities: Mapping[str, float], *, unmodelled: bool
) -> Verdict:
    """The verdict of the rules, corrected by the probabilities where the table beside it allows that.

    A contact stays one: its stretches of time are left out. *Unknown* stays where a term outside the catalogue explains
    far more than any finding (`unmodelled`). *None* needs a table without a finding that is called missing.
    """
    if verdict == "contact" or unmodelled:
        return verdict
    likely = max(OTHERS, key=lambda name: probabilities[name])
    most = probabilities[likely]
    if likely not in {"none", "several"} or most <= max((f.probability for f in findings), default=0.0):
        return verdict
    if likely == "several":
        return "several"
    return verdict if any(f.significant for f in findings) else "none"


def without_bias(
    findings: Sequence[Finding], by_twin: Verdict, probabilities: Mapping[str, float]
) -> tuple[Finding, ...]:
    """The findings, set aside where the twin has as much error and "none" is the most probable hypothesis.

    Parameters
    ----------
    by_twin : str
        Verdict where the twin's error counts as noise.
    probabilities : mapping of str to float
    """
    if by_twin != "none" or max(probabilities, key=lambda name: probabilities[name]) != "none":
        return tuple(findings)
    return tuple(replace(f, set_aside=LIKE_THE_TWIN) if f.significant else f for f in findings)


def without_imitator(findings: Sequence[Finding], imitator: str, unmodelled: UnmodelledTerm) -> tuple[Finding, ...]:
    """The findings; the sentence of one that a term outside the catalogue surpasses does not say that it is the cause.

    Parameters
    ----------
    imitator : str
        Effect that the term was compared with.
    unmodelled : UnmodelledTerm
        A term that explains far more; on another joint than the effect's, the effect is missing beside it.
    """
    if unmodelled.on_another_joint:
        return tuple(findings)
    said = f"{EFFECTS[imitator].title} on {{joint}} only resembles the cause"
    return tuple(replace(f, sentence=about(f.joints, said)) if f.effect == imitator else f for f in findings)


def with_probability(
    findings: Sequence[Finding], probabilities: Mapping[str, float], together: float
) -> tuple[Finding, ...]:
    """The findings, each with its probability; of those that are called missing the most probable stands first.

    All others keep their places: `improve` tries the findings in this order, by the error that they explain.
    Two effects that a robot lacks share the probability with the rivals of each. So each of the other findings stands
    by its probability, or by its share of the explained error that no other finding explains, where that is larger.

    Parameters
    ----------
    probabilities : mapping of str to float
    together : float
        Error that all effects that entered explain, in summed squared NRMSE.
    """
    found = [replace(f, probability=probabilities.get(f.effect, 0.0)) for f in findings]
    places = [k for k, f in enumerate(found) if f.significant]
    named = [found[k] for k in places]
    first = max(named, key=lambda f: f.probability, default=None)
    ordered = sorted(named, key=lambda f: (f is not first, -max(f.probability, f.own / max(together, 1e-300))))
    for k, finding in zip(places, ordered, strict=True):
        found[k] = finding
    return tuple(found)


def with_verdict(
    findings: Sequence[Finding], verdict: Verdict, error: float, probabilities: Mapping[str, float]
) -> tuple[Finding, ...]:
    """The findings; where the verdict is contact, unknown or several, a finding of that name comes first."""
    if verdict not in SENTENCES:
        return tuple(findings)
    chance = probabilities["outside" if verdict == "unknown" else verdict]
    first = Finding(
        effect=verdict,
        joints=(),
        error_before=error,
        error_after=error,
        gain=0.0,
        removed=0.0,
        share=0.0,
        floors=0.0,
        over_twin=0.0,
        twin_removed=0.0,
        p_value=1.0,
        parameters={},
        confused_with=(),
        sentence=SENTENCES[verdict],
        members=(),
    )
    return (replace(first, probability=chance), *findings)
