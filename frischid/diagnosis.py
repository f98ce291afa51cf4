"""Which physical effect is missing: candidates ranked by held-out evidence.

Every effect of the catalogue, on every joint and in every shape, is added to the model, refitted together with all base
parameters, and scored on data it was not fitted to:

    Δ log L = ½ Σ_j n_j/ℓ_j · log(SSE_j before / SSE_j after)  −  ½ k log(n/ℓ)

with n_j/ℓ_j the *effectively independent* samples of joint j and k the parameters it costs (columns and shapes). A
finding must
also pass a paired test over blocks of time, corrected for every candidate tried. Candidates are then judged against
each
other: what each still gains once another is in the model tells which of them the log can tell apart.

Two situations differ in what is known of the base parameters. An effect that was *always* there: they are refitted,
under a weak
prior from the URDF. A robot that *changed* since it was identified: the identification's own information is the prior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from scipy import stats

from frischid.contact import Contact, find_contacts
from frischid.effects import EFFECTS, Effect
from frischid.errors import InputError, UnknownNameError
from frischid.evidence import Evidence, Projection, Score
from frischid.gram import Array
from frischid.log import Log
from frischid.model import Model
from frischid.noise import noise_floor
from frischid.prior import Prior, identified, nominal

Verdict = Literal["none", "effect", "contact", "unknown"]
SIGNIFICANCE = 0.01
TRIFLE = 0.004  # of a joint's torque: what explains less is not worth a parameter, however significant
LARGE = 0.015  # of a joint's torque: an error below this is not called unexplained, the floor being an estimate
EXPLAINED = 0.7  # share of the error that a steady effect must remove for bursts not to be contacts
STEADY = 0.05  # p value over blocks of time that a finding must reach, so that no single moment makes it
SAME = 0.9  # a rival that removes this share of what the best removes, and adds nothing to it, is the same finding


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
        Of the error above the noise floor on the joints it acts on, the part it removes.
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
    p_value: float
    parameters: dict[str, float]
    confused_with: tuple[str, ...]
    sentence: str
    members: tuple[Effect, ...]

    @property
    def significant(self) -> bool:
        """Whether it is more than chance, and more than a trifle."""
        return self.gain > 0 and self.p_value < SIGNIFICANCE and self.removed > TRIFLE**2

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
    """

    verdict: Verdict
    situation: Literal["always", "changed"]
    findings: tuple[Finding, ...]
    error: float
    noise_floor: float
    joints: dict[str, dict[str, float]]
    contacts: tuple[Contact, ...]
    notes: tuple[str, ...]
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
        }


def diagnose(
    model: Model,
    logs: Sequence[Log],
    *,
    valid: Sequence[Log] = (),
    situation: Literal["auto", "always", "changed"] = "auto",
    effects: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find the effect a model misses on some logs.

    Parameters
    ----------
    model : Model
    logs : sequence of Log
        Data the model fails on.
    valid : sequence of Log
        More data of the same robot in the same state; with several logs each is predicted from the others, a single
        log is
        cut into four.
    situation : {"auto", "always", "changed"}
        Whether the effect was always there, or the robot changed since the model was identified. ``"auto"``: changed
        when the
        logs are not the model's own and it predicts them significantly worse than its own.
    effects : sequence of str, optional
        Identifiers to try, the whole catalogue by default.
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
    everything = [*logs, *valid]
    progress("evidence")
    state = situation_of(model, everything) if situation == "auto" else situation
    prior = prior_of(model, state)
    evidence = Evidence(model, everything, prior)
    floor = noise_floor(model, evidence.motions)
    contacts = find_contacts(evidence, floor)
    findings = rank(evidence, floor, state, effects, progress)
    if contacts and any(f.significant and f.share > EXPLAINED for f in findings):
        contacts = []  # a steady effect accounts for the bursts as well
    if contacts:
        progress("evidence without contacts")
        evidence = Evidence(model, everything, prior, [(c.source, c.start, c.stop) for c in contacts])
        findings = rank(evidence, floor, state, effects, progress)
    error = float(evidence.nrmse(evidence.base_sse()).mean())
    joints = {
        name: {"error": float(e), "noise_floor": float(f)}
        for name, e, f in zip(
            evidence.joints, evidence.nrmse(evidence.base_sse()), floor / evidence.spread, strict=True
        )
    }
    verdict = _verdict(evidence, floor, findings, contacts)
    notes = [f"taken as a robot that {'changed since it was identified' if state == 'changed' else 'was always so'}"]
    return Diagnosis(
        verdict,
        state,
        _with_verdict(findings, verdict, error),
        error,
        float(np.mean(floor / evidence.spread)),
        joints,
        tuple(contacts),
        tuple(notes),
        evidence,
    )


# ---------------------------------------------------------------------- what is known beforehand


def situation_of(model: Model, logs: Sequence[Log]) -> Literal["always", "changed"]:
    """Changed: logs the model has not seen, predicted much worse than what it was cross-validated to."""
    own = {entry["sha256"] or entry["source"] for event in model.history for entry in event.get("logs", [])}
    if any((log.sha256 or log.source) in own for log in logs):
        return "always"
    expected = next(
        (event["cross_validated_nrmse"] for event in reversed(model.history) if "cross_validated_nrmse" in event), None
    )
    if expected is None:
        return "always"
    squared, total = np.zeros((2, len(model.joints)))
    for block, fitted in model.blocks(logs):
        used = block.used[:, model.torque_index]
        squared += (((block.tau - fitted)[:, model.torque_index] ** 2) * used).sum(axis=0)
        measured = np.where(used, block.tau[:, model.torque_index], 0.0)
        total += ((measured - measured.mean(axis=0)) ** 2 * used).sum(axis=0)
    frozen = float(np.mean(np.sqrt(squared / np.maximum(total, 1e-300))))
    return "changed" if frozen > 1.3 * expected else "always"


def prior_of(model: Model, situation: str) -> Prior:
    """The identification itself for a robot that changed; otherwise a weak belief in the URDF."""
    return identified(model) if situation == "changed" else nominal(model)


# ---------------------------------------------------------------------- ranking


def rank(
    evidence: Evidence,
    floor: Array,
    situation: str,
    only: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Finding]:
    """Every effect that can act on this robot, by held-out evidence, best first."""
    before = evidence.base_sse()
    tried = 0
    best: list[_Best] = []
    for name, kind in EFFECTS.items():
        if only is not None and name not in only:
            continue
        if kind.change and situation == "always":
            continue
        progress(f"trying {name}")
        judged = []
        for alternatives in kind.candidates(evidence.model.robot):
            projections = _distinct(evidence, alternatives)
            if projections and (scored := evidence.score(projections)) is not None:
                judged.append(_judge(evidence, before, *scored, shapes=len(kind.shapes)))
        tried += len(judged)
        if judged:
            best.append(_grouped(evidence, before, sorted(judged, key=lambda b: -b.gain), len(kind.shapes)))
    findings = _findings(evidence, floor, before, best, tried)
    findings.sort(key=lambda f: (not f.significant, -f.removed, -f.gain))
    return _simplest_first(findings)


@dataclass(frozen=True, eq=False)
class _Best:
    """An effect at its best place and shape."""

    projection: Projection
    score: Score
    gain: float
    ratio: float
    members: tuple[Effect, ...]


def _distinct(evidence: Evidence, alternatives: Sequence[Effect]) -> list[Projection]:
    """Projections of the shapes of one candidate whose columns have a row here."""
    present = {c.name for c in evidence.regressor.columns}
    fresh = [e for e in alternatives if not any(c.name in present for c in e.columns(evidence.model.robot))]
    return [p for p in evidence.project(fresh) if p.columns and all(np.isfinite(x).all() for x in p.columns.values())]


def _price(evidence: Evidence, projection: Projection, shapes: int) -> float:
    independent = float(evidence.counts.sum(axis=0)[list(projection.columns)].sum())
    return float(0.5 * (len(projection.signs) + shapes) * np.log(max(independent, 2.0)))


def _judge(evidence: Evidence, before: Array, score: Score, projection: Projection, shapes: int) -> _Best:
    effective = evidence.effective
    if evidence.log_likelihood(before, score.sse, effective) > 0:
        effective = evidence.effective_with(projection)
    ratio = evidence.log_likelihood(before, score.sse, effective)
    return _Best(projection, score, ratio - _price(evidence, projection, shapes), ratio, (projection.effect,))


def _grouped(evidence: Evidence, before: Array, judged: Sequence[_Best], shapes: int) -> _Best:
    """Add further joints to the best place of an effect while each pays for itself."""
    chosen = judged[0]
    for other in judged[1:] if not chosen.projection.effect.single else ():
        if other.gain <= 0 or chosen.gain <= 0:
            break
        merged = _merge(evidence, chosen.projection, other.projection)
        scored = evidence.score([merged])
        if scored is None:
            continue
        joined = _judge(evidence, before, scored[0], merged, shapes)
        if joined.gain > chosen.gain:
            chosen = replace(joined, members=(*chosen.members, *other.members))
    return chosen


def _merge(evidence: Evidence, a: Projection, b: Projection) -> Projection:
    columns = {}
    for row in {*a.columns, *b.columns}:
        n = len(evidence.rows[row].tau)
        left = a.columns.get(row, np.zeros((n, len(a.signs))))
        right = b.columns.get(row, np.zeros((n, len(b.signs))))
        columns[row] = np.column_stack([left, right])
    effect = a.effect
    if a.effect.parameters == b.effect.parameters and a.effect.joints and b.effect.joints:
        effect = replace(a.effect, joints=tuple(dict.fromkeys((*a.effect.joints, *b.effect.joints))))
    return Projection(effect, columns, (*a.signs, *b.signs))


def _findings(evidence: Evidence, floor: Array, before: Array, best: Sequence[_Best], tried: int) -> list[Finding]:
    error = float(evidence.nrmse(before).mean())
    best = sorted(best, key=lambda b: -_removed(evidence, before, b))
    confused = _confusions(evidence, best[:5]) if best and best[0].gain > 0 else {}
    findings = []
    for b in best:
        rows = list(b.projection.columns)
        after = evidence.nrmse(b.score.sse)
        kept = (evidence.nrmse(before) ** 2)[rows]
        explainable = kept - np.minimum(floor / evidence.spread, evidence.nrmse(before))[rows] ** 2
        share = float(((kept - after[rows] ** 2).sum()) / max(float(explainable.sum()), 1e-300))
        significance = 1.0
        if b.gain > 0:
            chance = float(stats.chi2.sf(2 * b.ratio, len(b.projection.signs) + len(_shapes_of(b))))
            significance = min(1.0, tried * chance) if block_test(evidence, b.projection) < STEADY else 1.0
        kind = type(b.projection.effect)
        joints = tuple(dict.fromkeys(j for e in b.members for j in (e.joints or ())))
        names = [c.name for e in b.members for c in e.columns(evidence.model.robot)]
        where = ", ".join(joints) if joints else "the robot"
        findings.append(
            Finding(
                kind.id,
                joints,
                error,
                float(after.mean()),
                b.gain,
                _removed(evidence, before, b),
                float(np.clip(share, 0.0, 1.0)),
                significance,
                dict(zip(names, map(float, b.score.beta), strict=True)) | _shape(b.projection.effect),
                confused.get(kind.id, ()),
                kind.sentence.format(joint=where),
                b.members,
            )
        )
    return findings


def _simplest_first(findings: list[Finding]) -> list[Finding]:
    """Where the best contains a simpler effect that explains nearly as much, the simpler one comes first."""
    if not findings:
        return findings
    best = findings[0]
    within = [f for f in findings if f.effect in EFFECTS[best.effect].generalises and f.significant]
    rivals = [f for f in within if f.removed >= SAME * best.removed]
    if not rivals:
        return findings
    first = replace(rivals[0], confused_with=tuple(dict.fromkeys((*rivals[0].confused_with, best.effect))))
    return [first, *(f for f in findings if f.effect != first.effect)]


def _removed(evidence: Evidence, before: Array, best: _Best) -> float:
    return float((evidence.nrmse(before) ** 2 - evidence.nrmse(best.score.sse) ** 2).sum())


def _shapes_of(best: _Best) -> tuple[str, ...]:
    """Shape parameters that were searched."""
    return tuple(type(best.projection.effect).shapes)


def _shape(effect: Effect) -> dict[str, float]:
    return {k: float(v) for k, v in effect.parameters.items() if k in type(effect).shapes}


def _confusions(evidence: Evidence, best: Sequence[_Best]) -> dict[str, tuple[str, ...]]:
    """For the best candidates: which others add nothing to them while explaining nearly as much alone."""
    if not best:
        return {}
    top = best[0]
    told: dict[str, list[str]] = {}
    extended = evidence.extended(top.projection)
    before = extended.base_sse()
    for other in best[1:]:
        if other.gain < 0.5 * top.gain:
            continue
        scored = extended.score([other.projection])
        given = -np.inf if scored is None else extended.log_likelihood(before, scored[0].sse, extended.effective)
        if given < _price(evidence, other.projection, 0) and other.gain > SAME * top.gain:
            told.setdefault(top.projection.effect.id, []).append(other.projection.effect.id)
            told.setdefault(other.projection.effect.id, []).append(top.projection.effect.id)
    return {k: tuple(v) for k, v in told.items()}


def block_test(evidence: Evidence, projection: Projection) -> float:
    """P value of a paired one-sided t test over blocks of time: the held-out squared error is smaller."""
    X, D = evidence.moments(projection)
    gains: dict[int, float] = {}
    for fold in range(evidence.folds):
        fit = evidence.fit(X, D, projection, fold)
        if fit is None:
            return 1.0
        theta = evidence.systems[fold][1]
        for row, r in enumerate(evidence.rows):
            part = r.fold == fold
            before = r.tau[part] - r.Y[part] @ theta
            after = before - r.Y[part] @ fit.change
            if row in projection.columns:
                after = after - projection.columns[row][part] @ fit.beta
            difference = evidence.omega[row] * (before**2 - after**2)
            blocks, where = np.unique(r.block[part], return_inverse=True)
            for b, g in zip(blocks, np.bincount(where, difference), strict=True):
                gains[int(b)] = gains.get(int(b), 0.0) + float(g)
    g = np.array(list(gains.values()))
    if len(g) < 3 or not g.std() > 0:
        return 1.0
    return float(stats.t.sf(g.mean() / (g.std(ddof=1) / np.sqrt(len(g))), len(g) - 1))


# ---------------------------------------------------------------------- verdict


def _verdict(evidence: Evidence, floor: Array, findings: Sequence[Finding], contacts: Sequence[Contact]) -> Verdict:
    if contacts:
        return "contact"
    best = next((f for f in findings if f.significant), None)
    error = evidence.nrmse(evidence.base_sse())
    unexplained = bool(((error > LARGE) & (error * evidence.spread > 3.0 * floor)).any())
    if best is None:
        return "unknown" if unexplained else "none"
    return "unknown" if best.share < 0.2 and unexplained else "effect"


def _with_verdict(findings: Sequence[Finding], verdict: Verdict, error: float) -> tuple[Finding, ...]:
    """With contact or unknown the first finding has that id."""
    if verdict not in {"contact", "unknown"}:
        return tuple(findings)
    sentence = {
        "contact": "something touched the robot for a while: these moments are left out, not modelled",
        "unknown": "something is missing that nothing in the catalogue explains",
    }[verdict]
    first = Finding(verdict, (), error, error, 0.0, 0.0, 0.0, 1.0, {}, (), sentence, ())
    return (first, *findings)
