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

from frischid.core.parallel import Workers
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Projection
from frischid.diagnosis.change_prior import identified, nominal
from frischid.diagnosis.contacts import Contact, find_contacts, stretches
from frischid.diagnosis.cross_validation import Evidence
from frischid.diagnosis.findings import WITHIN, Finding, findings_of, refitted
from frischid.diagnosis.residual_formula import Description, best_foreign, describe, outdone
from frischid.diagnosis.verdict import Known, Verdict, decided, notes_on, with_refit, with_verdict
from frischid.effects import EFFECTS
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Log
from frischid.logs.recording import Recording, check_logs
from frischid.model.model import Model
from frischid.model.noise_floor import NoiseFloor

Situation = Literal["auto", "always", "changed"]
EXPLAINED = 0.6  # share of the bursts' energy that is left if a steady effect is what makes them
ROUGHLY = 1.25  # times what a model missed on its own logs: as much may be missing on others
CHANGED = 1.02  # error of the model as it is over that of a refit, above which the robot is not the one identified


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

    def __repr__(self) -> str:
        named = [f"{f.effect} on {', '.join(f.joints) or 'the robot'}" for f in self.findings if f.significant][:1]
        found = ": ".join([self.verdict, *named])
        return f"Diagnosis({found}; held-out NRMSE {self.error:.4f}, noise floor {self.noise_floor:.4f})"

    @property
    def remainder(self) -> str:
        """What is to be said of what is left, where nothing is found: it need not be the sensors' noise."""
        if self.error <= WITHIN * self.noise_floor:
            return "nothing is missing: what is left is what the sensors leave"
        times = f"{self.error / self.noise_floor:.1f} × " if self.noise_floor > 0 else "more than "
        return f"no effect of the catalogue passes; what is left is {times}what the sensors alone would leave"

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

    Raises
    ------
    InputError
        There is no log, one is both fitted and held out, one lacks a joint of the model or its torque, or a joint never
        moves.
    UnknownNameError
        An effect that is not in the catalogue.
    """
    if not logs:
        raise InputError("there is no log to diagnose")
    for name in effects or ():
        if name not in EFFECTS:
            raise UnknownNameError("effect", name, EFFECTS)
    check_logs(logs, valid)
    progress("gathering evidence")
    everything = [*logs, *valid]
    evidence, state = gathered(model, everything, situation, workers)
    noise = NoiseFloor(model)
    for _ in noise.watch(evidence.motions):
        pass
    floor = noise.under(evidence.nrmse(evidence.base_sse()) * evidence.spread)
    contacts = find_contacts(evidence, floor)
    findings, judged = findings_of(evidence, floor, state, effects, progress)
    if contacts:
        rest = evidence.without(stretches(contacts))
        if _steady(evidence, rest, findings):
            contacts = []
        else:
            progress("once more without the contacts")
            evidence, (findings, judged) = rest, findings_of(rest, floor, state, effects, progress)
    error = float(evidence.nrmse(evidence.base_sse()).mean())
    joints = {
        name: {"error": float(e), "noise_floor": float(f)}
        for name, e, f in zip(
            evidence.joints, evidence.nrmse(evidence.base_sse()), floor / evidence.spread, strict=True
        )
    }
    stranger = None if contacts else outdone(judged, floor)
    verdict = decided(evidence, floor, findings, contacts, judged, stranger)
    if state == "changed" and effects is None:
        verdict, findings = with_refit(verdict, findings, refitted(model, evidence, floor))
    worst = int(np.argmax(evidence.nrmse(evidence.base_sse())))
    description = describe(evidence, worst if stranger is None else stranger.row) if verdict == "unknown" else None
    return Diagnosis(
        verdict,
        state,
        with_verdict(findings, verdict, error),
        error,
        float(np.mean(floor / evidence.spread)),
        joints,
        tuple(contacts),
        tuple(notes_on(evidence, state, verdict, description, stranger, judged, floor, findings)),
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
