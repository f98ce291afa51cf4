"""Which physical effect is missing from a model: candidates ranked by cross-validated evidence.

Every effect of the catalogue, on every joint and in every shape, is added to the model, refitted together with all base
parameters, and scored on data it was not fitted to:

    τ = Γ(q, q̇, q̈) θ_rigid  +  Σ_effects  C_e θ_e  +  C_candidate β  +  noise.

The stages are those of the package's docstring (`frischid.diagnosis`), and `diagnose` calls them in that order.

A log has one of three roles. The logs given *fit* the parameters and *select* the effects: each part is predicted by a
fit to the others (cross-validation). Logs given as ``valid`` only *test*: the model's error on them is stated, and no
stage looks at them.

Sources: Stone 1974, J. R. Stat. Soc. B 36(2), on cross-validation; Chen, Billings and Luo 1989, Int. J. Control 50(5),
on stepwise selection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from frischid.core.arguments import check_kind
from frischid.core.parallel import Workers
from frischid.core.text import shortened
from frischid.core.threads import on_one_thread
from frischid.diagnosis.carried_loads import find_load
from frischid.diagnosis.contacts import (
    Contact,
    contacts_at_rest,
    find_contacts,
    made_by_something_steady,
    said_of,
    stretches,
)
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_findings import FoundEffects, find_effects, refit_finding
from frischid.diagnosis.floor import Floor, asks_for_explanation
from frischid.diagnosis.hypotheses import Evidence, evidence_of
from frischid.diagnosis.model_notes import delay_in, limit_in, load_in, touch_in, untried
from frischid.diagnosis.probability import probabilities
from frischid.diagnosis.residual_formula import describe
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.situation import Situation, SituationOption, cross_validator, logs_to_diagnose, priors_of
from frischid.diagnosis.torque_limits import TorqueLimit, beyond_limits, find_limits
from frischid.diagnosis.unmodelled_terms import unmodelled_term
from frischid.diagnosis.verdict import (
    StageResults,
    Verdict,
    concluded,
    decided,
    notes_on,
    with_probability,
    with_refit,
    with_verdict,
    without_bias,
    without_imitator,
)
from frischid.effects import EFFECTS
from frischid.errors import InputError, UnknownNameError
from frischid.logs.excerpt import as_recording, excerpt
from frischid.logs.given import Logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.poses import NOTHING_MOVES, in_motion
from frischid.logs.recording import Recording
from frischid.model.headline import Headline, headline
from frischid.model.model import Model
from frischid.model.standstill_joints import standstill_note


@on_one_thread
def diagnose(
    model: Model,
    logs: Logs,
    *,
    valid: Logs = (),
    situation: SituationOption = "auto",
    effects: Sequence[str] | None = None,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
) -> Diagnosis:
    """Find the effect that a model misses on some logs.

    Parameters
    ----------
    model : Model
    logs : sequence of Log, Recording or data frame, or one data frame
        Data that the model predicts badly. Each of several logs is predicted by a fit to the others. Of a single log,
        each motion (stretch without a gap) is cut into four parts, and each part is predicted by a fit to the others.
        Of a long log, effects are searched along an excerpt (`frischid.logs.excerpt`), and a note says so.
    valid : sequence of Log, Recording or data frame, or one data frame
        Test logs of the same robot in the same state: the model's error on them is stated; nothing else uses them.
    situation : {"auto", "always", "changed"}
        ``"always"``: the robot has not changed since the model was identified, so a missing effect acted in the
        training logs too. ``"changed"``: the robot changed after that. ``"auto"``: changed when none of the logs is a
        training log of the model and a refit predicts them better than the model does.
    effects : sequence of str, optional
        Identifiers to try, the whole catalogue by default.
    criteria : DiagnosisCriteria, optional
        Every threshold that decides the result.
    workers : Workers, optional
        Processes that compute the candidates' columns, this process by default; the result is the same.
    progress : callable
        Called with a few words at each stage.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        There is no log, a log is given both to fit and to test, a log lacks a joint of the model or its torque, or
        no joint moves.
    UnknownNameError
        An effect is not in the catalogue, or there is no such situation.

    Examples
    --------
    A spring on the second joint that the model does not have:

    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> hidden = (*fr.BASELINE, *fr.parse_effects("joint_spring@joint2"))
    >>> motions = [fr.random_fourier(robot, 30, seed=seed) for seed in (1, 2)]
    >>> logs = [fr.simulate(robot, motion, rate=50, effects=hidden, parameters={"ks2": 1.5}, noise=fr.Noise(tau=0.01))
    ...         for motion in motions]
    >>> model = fr.identify(robot, logs[:1], recursion="none").model
    >>> found = fr.diagnose(model, logs[:1], valid=logs[1:], effects=["joint_spring"])
    >>> found.verdict, found.findings[0].effect, found.findings[0].joints
    ('effect', 'joint_spring', ('joint2',))
    >>> found.headline.nrmse == fr.compare(model, logs[1:]).nrmse
    True
    """
    logs, valid = logs_to_diagnose(model, logs, valid, situation, mapping)
    _check_names(effects or ())
    if workers is not None:
        check_kind("workers", workers, Workers, "with frischid.core.parallel.workers(count=2) as workers")
    model.check([*logs, *valid])
    progress("reading logs")
    touched = contacts_at_rest(model, logs)
    moving = in_motion(logs, model.robot.joints)
    if not moving:
        return _at_standstill(model, [*logs, *valid], touched, criteria)
    parts = [excerpt(log) for log in moving]
    searched = [part.log for part in parts]
    validator, state = cross_validator(model, searched, situation, criteria=criteria, workers=workers)
    found_by = [stages(v, state, Floor.of(v), effects, progress) for v in priors_of(validator, state)]
    results = _since_the_starts(best_stages(found_by), logs)
    results = replace(results, contacts=(*results.contacts, *touched))
    verdict, by_twin = decided(results), decided(results, by_twin=True)
    if state == "changed" and effects is None:
        refit = refit_finding(results.validator, results.floor)
        by_twin, _ = with_refit(by_twin, results.findings, refit, results.together)
        verdict, findings = with_refit(verdict, results.findings, refit, results.together)
        results = replace(results, findings=tuple(findings))
    found = _diagnosis(results, (verdict, by_twin), headline(model, [as_recording(log) for log in valid or moving]))
    judged = set(validator.joints) & found.headline.joints.keys()
    still = standstill_note([name for name in model.joints if name not in judged])
    said = [still, *said_of(model, logs), *(part.said for part in parts)]
    said += [
        delay_in(model),
        touch_in(model, logs, found.contacts),
        limit_in(model, logs, found.limits),
        load_in(model, logs, results.load),
    ]
    said += untried(model, effects or (), state, validator.data.cache.channels)
    return replace(found, notes=(*found.notes, *filter(None, said)))


def _check_names(effects: Sequence[str]) -> None:
    """Refuse what is no name of an effect, and names with a joint."""
    for name in effects:
        if not isinstance(name, str):
            raise InputError(f"effects to try must be names such as 'joint_spring', got {shortened(name)}")
        kind, at, _ = name.partition("@")
        if at and kind in EFFECTS:
            raise InputError(f"write {kind} instead of {name}: effects are tried at every joint")
        if name not in EFFECTS:
            raise UnknownNameError("effect", name, EFFECTS)


def _since_the_starts(results: StageResults, logs: Sequence[Log | Recording]) -> StageResults:
    """The results with times that count from the first sample of each log, as those of `frischid cut`."""
    first = {log.source: float(log.t[0]) for log in logs if isinstance(log, Log)}
    return replace(
        results,
        contacts=tuple(replace(c, log_start=first.get(c.source, 0.0)) for c in results.contacts),
        limits=tuple(replace(limit, log_starts=first) for limit in results.limits),
        load=results.load and replace(results.load, log_starts=first),
    )


def _at_standstill(
    model: Model, logs: Sequence[Log | Recording], contacts: Sequence[Contact], criteria: DiagnosisCriteria
) -> Diagnosis:
    """The result where the arm stands still in all logs: a contact, or nothing."""
    try:
        error = headline(model, logs)
    except InputError:  # one pose shows no error
        error = headline(model)
    verdict: Verdict = "contact" if contacts else "none"
    return Diagnosis(
        verdict=verdict,
        situation="always",
        findings=(),
        headline=error,
        error=error.nrmse,
        noise_floor=error.noise_floor,
        joints={},
        contacts=tuple(contacts),
        notes=("assumed: the robot has not changed since it was identified", NOTHING_MOVES),
        description=None,
        criteria=criteria,
        probabilities={},  # no hypotheses are compared
        evidence=Evidence((), ()),
        fit=None,
    )


def _diagnosis(results: StageResults, verdicts: tuple[Verdict, Verdict], error_of_model: Headline) -> Diagnosis:
    """The result, with a description of the residual where it is unknown.

    `verdicts`: those of the rules with the sensor noise, and with the error of the healthy twin, as the floor.
    """
    verdict, by_twin = verdicts
    validator, unmodelled = results.validator, results.unmodelled
    errors, floors = validator.predictive_nrmse(), results.floor / validator.spread
    evidence = evidence_of(
        results.findings,
        (errors, results.ranking.full.predictive_nrmse()),
        (floors, results.least / validator.spread),
        by_twin,
        unmodelled=unmodelled is not None,
    )
    probable = probabilities(evidence)
    named = with_probability(results.findings, probable, results.together)
    if unmodelled is None:
        named = without_bias(named, by_twin, probable)
    else:
        named = without_imitator(named, results.ranking.effects[0].kind.id, unmodelled)
    results = replace(results, findings=named)
    verdict = concluded(verdict, results.findings, probable, unmodelled=unmodelled is not None)
    row = int(np.argmax(errors)) if unmodelled is None else unmodelled.row
    description = describe(validator, row) if verdict == "unknown" else None
    error = float(errors.mean())
    return Diagnosis(
        verdict=verdict,
        situation=results.situation,
        findings=with_verdict(results.findings, verdict, error, probable),
        headline=error_of_model,
        error=error,
        noise_floor=float(np.mean(floors)),
        joints={
            name: {"error": float(e), "noise_floor": float(f)}
            for name, e, f in zip(validator.joints, errors, floors, strict=True)
        },
        contacts=results.contacts,
        notes=tuple(notes_on(results, verdict, description, probable)),
        description=description,
        criteria=validator.criteria,
        probabilities=probable,
        evidence=evidence,
        fit=validator,
        limits=results.limits,
        load=results.load,
    )


def stages(
    validator: CrossValidator,
    situation: Situation,
    floor: Floor,
    effects: Sequence[str] | None,
    progress: Callable[[str], None],
) -> StageResults:
    """Torques at their limit, a load, contacts, findings, and a term outside the catalogue that explains far more."""

    def search(fit: CrossValidator) -> FoundEffects:
        return find_effects(fit, floor, situation, effects, progress)

    def in_the_longer_times(fit: CrossValidator) -> FoundEffects:
        progress("again without the times with a load, or those without")
        return search(fit)

    def below_limits(
        fit: CrossValidator, found: FoundEffects
    ) -> tuple[CrossValidator, FoundEffects, list[TorqueLimit]]:
        limits = find_limits(fit, found.ranking.full, found.noise)
        if not limits:
            return fit, found, limits
        progress("again without torques at their limit")
        rest = fit.without(beyond_limits(fit, limits))
        return rest, search(rest), limits

    load, found = None, search(validator)
    below, left, limits = below_limits(validator, found)
    full, noise = left.ranking.full, left.noise
    # Limits that explain everything are no load; a load may look like limits that leave other errors.
    if asks_for_explanation(full.predictive_nrmse(), noise / full.spread, full).any():
        carried = find_load(validator, found.ranking.full, found.noise, in_the_longer_times)
        if carried is not None:
            load, longer, found = carried
            below, left, limits = below_limits(longer, found)
    validator, found = below, left
    contacts = find_contacts(validator, floor.noise)
    if contacts:
        rest = validator.without(stretches(contacts))
        if made_by_something_steady(validator, rest, found.findings):
            contacts = []
        else:
            progress("again without the contacts")
            validator = rest
            found = search(rest)
    least = floor.without_effects(found.noise)
    return StageResults(
        validator=validator,
        situation=situation,
        floor=found.noise,
        least=least,
        contacts=tuple(burst.contact for burst in contacts),
        findings=tuple(found.findings),
        ranking=found.ranking,
        unmodelled=None if contacts else unmodelled_term(found.ranking, found.noise, least),
        said=floor.said,
        limits=tuple(limits),
        load=load,
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
