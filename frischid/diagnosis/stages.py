"""The stages between the regression data and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from frischid.diagnosis.contacts import find_contacts, made_by_something_steady, stretches
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_findings import find_effects
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.situation import Situation
from frischid.diagnosis.torque_limits import beyond_limits, find_limits
from frischid.diagnosis.unmodelled_terms import unmodelled_term
from frischid.diagnosis.verdict import StageResults


def stages(
    validator: CrossValidator,
    situation: Situation,
    floor: Floor,
    effects: Sequence[str] | None,
    progress: Callable[[str], None],
) -> StageResults:
    """Torques at their limit, contacts, findings, and a term outside the catalogue that explains more than one."""
    contacts = find_contacts(validator, floor.noise)
    findings, ranking, noise = find_effects(validator, floor, situation, effects, progress)
    limits = find_limits(validator, ranking.full, noise)
    if limits:
        progress("again without torques at their limit")
        validator = validator.without(beyond_limits(validator, limits))
        contacts = find_contacts(validator, floor.noise)
        findings, ranking, noise = find_effects(validator, floor, situation, effects, progress)
    if contacts:
        rest = validator.without(stretches(contacts))
        if made_by_something_steady(validator, rest, findings):
            contacts = []
        else:
            progress("again without the contacts")
            validator = rest
            findings, ranking, noise = find_effects(rest, floor, situation, effects, progress)
    least = floor.without_effects(noise)
    unmodelled = None if contacts else unmodelled_term(ranking, noise, least)
    return StageResults(
        validator,
        situation,
        noise,
        least,
        tuple(burst.contact for burst in contacts),
        tuple(findings),
        ranking,
        unmodelled,
        floor.said,
        tuple(limits),
    )


def best_stages(found_by: Sequence[StageResults]) -> StageResults:
    """Results of the prior whose effects explain most; if several leave noise only, that of the best first finding."""
    tolerance = found_by[0].validator.criteria.floor_tolerance
    noise = tolerance * max(float((r.floor / r.validator.spread).mean()) for r in found_by)

    def left(results: StageResults) -> tuple[float, float]:
        error = float(results.validator.predictive_nrmse().mean())
        first = next((f.error_after for f in results.findings if f.significant), error)
        return max(float(results.ranking.full.predictive_nrmse().mean()), noise), first

    return min(found_by, key=left)
