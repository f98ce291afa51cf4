"""Which physical effect is missing: candidates ranked by held-out evidence.

Every effect of the catalogue, on every joint and in every shape, is added to the model, refitted together with all base
parameters, and scored on data it was not fitted to; then candidates are judged against each other (see `ranking`).

Two situations differ in what is known of the base parameters. An effect that was *always* there: they are refitted,
under a weak prior from the URDF. A robot that *changed* since it was identified: the identification's own information
is the prior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from frischid.candidates import Projection
from frischid.cluster import Workers
from frischid.contact import Contact, find_contacts, stretches
from frischid.description import Description, Stranger, best_foreign, describe, outdone
from frischid.effects import EFFECTS, Effect
from frischid.errors import InputError, UnknownNameError
from frischid.evidence import Evidence
from frischid.gram import Array
from frischid.log import Log
from frischid.model import Model
from frischid.noise import NoiseFloor
from frischid.prior import identified, nominal
from frischid.ranking import SIGNIFICANCE, TRIFLE, Ranked, Ranking, ranking
from frischid.recording import Recording
from frischid.resting import at_rest
from frischid.robot import Robot
from frischid.words import each_of, listed

Verdict = Literal["none", "effect", "contact", "unknown"]
Known = Literal["always", "changed"]
Situation = Literal["auto", "always", "changed"]
LARGE = 0.01  # of a joint's torque: an error below this is not called unexplained
ABOVE = 2.0  # noise floors: the same, the floor being an estimate
BESIDE = 1.5  # noise floors: the same where a finding acts, and leaves more than it removes
HALF, NEARLY = 0.5, 0.8  # of what is wrong where a finding acts
REMAINDER = 4.0  # times what a finding removes: may be left elsewhere, if half is removed where it acts
EXPLAINED = 0.6  # share of the bursts' energy that is left if a steady effect is what makes them
BEATEN = 1.5  # what a refit must remove over what the best single effect removes
OLD = "old_parameters"  # the finding that they no longer hold
ROUGHLY = 1.25  # times what a model missed on its own logs: as much may be missing on others
CHANGED = 1.02  # error of the model as it is over that of a refit, above which the robot is not the one identified


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
    def significant(self) -> bool:
        """Whether it is more than chance, more than a trifle, and not a part of what sensors or dry friction may leave.

        Where little is above the noise it must explain half of that; where that is all dry friction, nearly all.
        """
        sure = self.gain > 0 and self.p_value < SIGNIFICANCE and self.removed > TRIFLE**2
        return sure and (self.floors > ABOVE or self.share >= (HALF if self.floors > 0 else NEARLY))

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


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is missing from a model.

    Attributes
    ----------
    verdict : {"none", "effect", "contact", "unknown"}
    situation : {"always", "changed"}
    findings : tuple of Finding
        The whole ranking, best first.
    error, noise_floor : float
        Held-out NRMSE of the model refitted without any finding, and what the sensors alone would leave.
    joints : dict of str to dict
        The same per joint.
    contacts : tuple of Contact
        Transients kept out of everything else.
    notes : tuple of str
    description : Description or None
        Of what is left, when the verdict is "unknown".
    """

    verdict: Verdict
    situation: Known
    findings: tuple[Finding, ...]
    error: float
    noise_floor: float
    joints: dict[str, dict[str, float]]
    contacts: tuple[Contact, ...]
    notes: tuple[str, ...]
    description: Description | None
    evidence: Evidence = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "verdict": self.verdict,
            "situation": self.situation,
            "noise_floor": self.noise_floor,
            "error": self.error,
            "joints": self.joints,
            "findings": [f.to_dict() for f in self.findings],
            "contacts": [vars(c) for c in self.contacts],
            "notes": list(self.notes),
            "description": None if self.description is None else vars(self.description),
        }


def diagnose(
    model: Model,
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: Situation = "auto",
    effects: Sequence[str] | None = None,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find the effect a model misses on some logs.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
        Data the model fails on.
    valid : sequence of Log or Recording
        More data of the same robot in the same state; with several logs each is predicted from the others, of a
        single one each stretch without a gap (each piece of a recording) is cut into four.
    situation : {"auto", "always", "changed"}
        Whether the effect was always there, or the robot changed since the model was identified. ``"auto"``: changed
        when the logs are not the model's own and a refit predicts them better than the model does.
    effects : sequence of str, optional
        Identifiers to try, the whole catalogue by default.
    workers : Workers, optional
        Where the candidates' columns are computed, this process by default; the answer is the same.
    progress : callable

    Returns
    -------
    Diagnosis
    """
    if not logs:
        raise InputError("there is no log to diagnose")
    for name in effects or ():
        if name not in EFFECTS:
            raise UnknownNameError("effect", name, EFFECTS)
    progress("gathering evidence")
    everything = [*logs, *valid]
    evidence, state = gathered(model, everything, situation, workers)
    noise = NoiseFloor(model)
    for _ in noise.watch(evidence.motions):
        pass
    floor = noise.under(evidence.nrmse(evidence.base_sse()) * evidence.spread)
    contacts = find_contacts(evidence, floor)
    findings, judged = rank(evidence, floor, state, effects, progress)
    if contacts:
        rest = evidence.without(stretches(contacts))
        if _steady(evidence, rest, findings):
            contacts = []
        else:
            progress("once more without the contacts")
            evidence, (findings, judged) = rest, rank(rest, floor, state, effects, progress)
    error = float(evidence.nrmse(evidence.base_sse()).mean())
    joints = {
        name: {"error": float(e), "noise_floor": float(f)}
        for name, e, f in zip(
            evidence.joints, evidence.nrmse(evidence.base_sse()), floor / evidence.spread, strict=True
        )
    }
    stranger = None if contacts else outdone(judged, floor)
    verdict = _verdict(evidence, floor, findings, contacts, judged, stranger)
    if state == "changed" and effects is None:
        verdict, findings = _with_refit(verdict, findings, _refit(model, evidence, floor))
    worst = int(np.argmax(evidence.nrmse(evidence.base_sse())))
    description = describe(evidence, worst if stranger is None else stranger.row) if verdict == "unknown" else None
    return Diagnosis(
        verdict,
        state,
        _with_verdict(findings, verdict, error),
        error,
        float(np.mean(floor / evidence.spread)),
        joints,
        tuple(contacts),
        tuple(_notes(state, verdict, description, stranger, judged, floor)),
        description,
        evidence,
    )


# ---------------------------------------------------------------------- what is known beforehand


def gathered(
    model: Model, logs: Sequence[Log | Recording], situation: Situation = "auto", workers: Workers | None = None
) -> tuple[Evidence, Known]:
    """Rows of logs under what is known beforehand, and which of the two situations that is.

    A robot *changed* when the logs are not the model's own and a refit, under no more than a weak belief in the URDF,
    predicts them better than the model as it is.
    """
    evidence = Evidence(model, logs, nominal(model), workers)
    own = any(model.made_from(log) for log in logs)
    if situation == "auto":
        situation = "changed" if not own and _frozen(evidence) > CHANGED * _error(evidence) else "always"
    if situation == "changed":
        evidence = evidence.believing(identified(model))
    if not own:
        evidence = evidence.comparing(ROUGHLY * model.estimate.sigma / evidence.spread)
    return evidence, situation


def _error(evidence: Evidence) -> float:
    return float(evidence.nrmse(evidence.base_sse()).mean())


def _frozen(evidence: Evidence) -> float:
    """Mean NRMSE of the model as it is."""
    theta = evidence.model.estimate.theta
    sse = np.array([[evidence.squares(row, theta) for row in range(len(evidence.joints))]])
    return float(evidence.nrmse(sse).mean())


def _steady(evidence: Evidence, rest: Evidence, findings: Sequence[Finding]) -> bool:
    """Whether the bursts are the doing of something that is always there: an effect, or what is in no catalogue."""
    if any(explains(evidence, rest, evidence.project(f.members)) for f in findings if f.significant):
        return True
    strange = best_foreign(evidence, int(np.argmax(_inside(evidence, rest))), jumping=False)
    return strange is not None and explains(evidence, rest, [strange.projection])


def explains(evidence: Evidence, rest: Evidence, found: Sequence[Projection]) -> bool:
    """Whether, with these in the model, most of the bursts' energy is gone."""
    extended, between = evidence, rest
    effects = [p.effect for p in found]
    for whole, part in zip(found, rest.project(effects), strict=True):
        extended, between = extended.extended(whole), between.extended(part)
    return float(_inside(extended, between).sum()) < EXPLAINED * float(_inside(evidence, rest).sum())


def _inside(evidence: Evidence, rest: Evidence) -> Array:
    """Squares over each joint's spread that a model of everything leaves in the stretches left out of `rest`, (J,)."""
    everywhere, between = ([e.squares(row, evidence.theta) for row in range(len(e.joints))] for e in (evidence, rest))
    return np.asarray((np.array(everywhere) - np.array(between)) / evidence.spread**2)


# ---------------------------------------------------------------------- findings


def rank(
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
    rows = list(ranked.together.columns)
    explainable = before[rows] ** 2 - np.minimum(floor / evidence.spread, before)[rows] ** 2
    above = float(explainable.sum())
    share = float((before[rows] ** 2 - after[rows] ** 2).sum()) / above if above > TRIFLE**2 else 0.0
    seen = [row for row in rows if moving[row]]
    floors = _in_floors(before[seen], floor[seen] / evidence.spread[seen])
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
        float(np.clip(share, 0.0, 1.0)),
        floors,
        ranked.p_value,
        dict(zip(names, map(float, ranked.score.beta), strict=True)) | shapes,
        ranked.rivals,
        ranked.kind.sentence.format(joint=each_of(joints), joints=listed(joints)),
        members,
    )


def _in_floors(error: Array, noise: Array) -> float:
    return float(np.linalg.norm(error)) / max(float(np.linalg.norm(noise)), 1e-12)


def _shape(effect: Effect) -> dict[str, float]:
    return {k: float(v) for k, v in effect.parameters.items() if k in type(effect).shapes}


# ---------------------------------------------------------------------- verdict


def _verdict(
    evidence: Evidence,
    floor: Array,
    findings: Sequence[Finding],
    contacts: Sequence[Contact],
    judged: Ranking,
    stranger: Stranger | None,
) -> Verdict:
    """Unknown: more is left on some joint, with all that pass in the model, than the best finding removes.

    A finding that removes half of what is wrong where it acts stands beside a larger remainder elsewhere; what dry
    friction leaves where a joint turns or rests does not count. Or what is a stranger to the catalogue describes far
    more than the best finding explains.
    """
    if contacts:
        return "contact"
    sure = [f for f in findings if f.significant]
    noise = floor / evidence.spread
    left = judged.full.nrmse(judged.full.base_sse())
    left = np.minimum(left, evidence.nrmse(evidence.base_sse()))  # a finding on one joint may cost another a little
    there = _seen(left, noise)
    if sure:
        where = np.array([not sure[0].joints or name in sure[0].joints for name in evidence.joints])
        there |= where & (left > TRIFLE) & (left > BESIDE * noise)
    there &= ~at_rest(judged.full, floor)
    unexplained = float(np.where(there, left**2 - noise**2, 0.0).max())
    if not sure:
        return "unknown" if unexplained > 0 else "none"
    bar = max(f.removed for f in sure) * (REMAINDER if sure[0].share > HALF else 1.0)
    return "unknown" if unexplained > bar or stranger is not None else "effect"


def _seen(left: Array, noise: Array) -> NDArray[np.bool_]:
    """Joints on which so much is left that it has to be explained."""
    return np.asarray((left > LARGE) & (left > ABOVE * noise))


def _notes(
    state: Known,
    verdict: Verdict,
    description: Description | None,
    stranger: Stranger | None,
    judged: Ranking,
    floor: Array,
) -> list[str]:
    notes = [f"taken as a robot that {'changed since it was identified' if state == 'changed' else 'was always so'}"]
    seen = _seen(judged.full.nrmse(judged.full.base_sse()), floor / judged.full.spread) & at_rest(judged.full, floor)
    if verdict == "none" and seen.any():
        where = each_of([name for name, here in zip(judged.full.joints, seen, strict=True) if here])
        notes.append(f"what is left on {where} is where it turns or rests, where dry friction is anybody's guess")
    if judged.full.missed.any():
        notes.append("not the model's own logs: what explains more than was missing on those comes first")
    if description is not None and stranger is not None:
        where, first = judged.full.joints[stranger.row], judged.effects[0].kind.id
        notes.append(f"on {where} {stranger.words} describes far more than {first} explains, so that is not the cause")
    return notes + ([str(description)] if description is not None else [])


def _refit(model: Model, evidence: Evidence, floor: Array) -> Finding:
    """That the old parameters no longer hold: all of them fitted to these logs alone, for the price of all of them."""
    anew = evidence.believing(nominal(model))
    before, after = evidence.base_sse(), anew.base_sse()
    ratio = evidence.log_likelihood(before, after, np.maximum(evidence.effective, anew.effective))
    costs = len(model.base)
    gain = ratio - 0.5 * costs * float(np.log(max(float(evidence.counts.sum()), 2.0)))
    errors = evidence.nrmse(before), evidence.nrmse(after)
    taken = float((errors[0] ** 2 - errors[1] ** 2).sum())
    explainable = float((errors[0] ** 2 - np.minimum(floor / evidence.spread, errors[0]) ** 2).sum())
    chance = float(stats.chi2.sf(2 * ratio, costs)) if gain > 0 else 1.0
    share = float(np.clip(taken / explainable, 0.0, 1.0)) if explainable > TRIFLE**2 else 0.0
    floors = _in_floors(errors[0], floor / evidence.spread)
    sentence = (
        "the old parameters no longer hold, and no single effect says why: several links or friction changed; identify "
        "the robot again"
    )
    error, rest = (float(x.mean()) for x in errors)
    return Finding(OLD, (), error, rest, gain, taken, share, floors, chance, {}, (), sentence, ())


def _with_refit(verdict: Verdict, findings: list[Finding], refit: Finding) -> tuple[Verdict, list[Finding]]:
    """A refit is the answer only where no effect is one; a refit can swallow any payload into the last link."""
    if not refit.significant:
        return verdict, findings
    best = next((f for f in findings if f.significant), None)
    beaten = best is None or (refit.gain > best.gain and refit.removed > BEATEN * best.removed)
    if verdict != "contact" and refit.share > HALF and (verdict == "unknown" or beaten):
        return "effect", [refit, *findings]
    better = [f for f in findings if f.removed >= refit.removed] or findings[:1]
    return verdict, [*better, refit, *(f for f in findings if f not in better)]


def _with_verdict(findings: Sequence[Finding], verdict: Verdict, error: float) -> tuple[Finding, ...]:
    """With contact or unknown the first finding has that id."""
    if verdict not in {"contact", "unknown"}:
        return tuple(findings)
    sentence = {
        "contact": "something touched the robot for a while: these moments are left out, not modelled",
        "unknown": "something is missing that nothing in the catalogue explains",
    }[verdict]
    first = Finding(verdict, (), error, error, 0.0, 0.0, 0.0, 0.0, 1.0, {}, (), sentence, ())
    return (first, *findings)
