"""The result of a diagnosis: a verdict, the ranking, the probability of every answer, and what was looked at.

`frischid.diagnosis.diagnosis` makes it. Every surface says the same, because each takes its sentences and figures from
here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from frischid.core.shown import Shown
from frischid.core.text import listed
from frischid.diagnosis.carried_loads import CarriedLoad
from frischid.diagnosis.contacts import Contact
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.hypotheses import Evidence
from frischid.diagnosis.residual_formula import Description
from frischid.diagnosis.rivals import suspected
from frischid.diagnosis.situation import Situation
from frischid.diagnosis.stretches import Stretch
from frischid.diagnosis.torque_limits import TorqueLimit
from frischid.diagnosis.verdict import Verdict
from frischid.errors import InputError
from frischid.logs.poses import NOTHING_MOVES
from frischid.model.headline import Headline


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """Result of `diagnose`: the effects that a model misses on some logs.

    Attributes
    ----------
    verdict : {"none", "effect", "several", "contact", "unknown"}
    situation : {"always", "changed"}
    findings : tuple of Finding
        The whole ranking, best first.
    headline : Headline
        The error of the model as it is: on the test logs, or on those of these logs that it was not fitted to;
        cross-validated without any.
    error, noise_floor : float
        The search's own yardstick: cross-validated NRMSE of the model refitted to these logs without any finding, and
        that of noise alone, with slow noise of the drives and the uncertainty of the parameters.
    joints : dict of str to dict
        ``error`` and ``noise_floor`` of each joint.
    contacts : tuple of Contact
        Stretches of time that were left out of everything else.
    notes : tuple of str
    description : Description or None
        Of the residual, when the verdict is "unknown".
    criteria : DiagnosisCriteria
        Thresholds that were used.
    probabilities : dict of str to float
        Of each hypothesis, summing to one: the effects of findings that may be the cause, and ``none``, ``several``
        (small effects, none dominant), ``outside`` (the catalogue) and ``contact``. Empty where the arm stands still in
        all logs.
    evidence : Evidence
        Numbers from which the probabilities follow.
    fit : CrossValidator or None
        The model's fit to the logs that select; None where the arm stands still in all of them, so that only contacts
        were searched.
    limits : tuple of TorqueLimit
        Torques at their limit, which were left out like contacts.
    load : CarriedLoad or None
        A body that the robot carries for a while. The search leaves out the times with the body, or those without.
    always_missing : tuple of Finding
        Of a robot that changed: what its model's own logs already show. The search takes these effects as known.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> found = fr.diagnose(fr.identify(robot, [log], recursion="none").model, [log], effects=["joint_spring"])
    >>> found.verdict, found.situation
    ('none', 'always')
    >>> sorted(found.to_dict())[:4]
    ['always_missing', 'contacts', 'criteria', 'description']
    >>> round(sum(found.probabilities.values()), 9)
    1.0
    """

    verdict: Verdict
    situation: Situation
    findings: tuple[Finding, ...]
    headline: Headline
    error: float
    noise_floor: float
    joints: dict[str, dict[str, float]]
    contacts: tuple[Contact, ...]
    notes: tuple[str, ...]
    description: Description | None
    criteria: DiagnosisCriteria
    probabilities: dict[str, float]
    evidence: Evidence = field(repr=False)
    fit: CrossValidator | None = field(repr=False)
    always_missing: tuple[Finding, ...] = ()
    limits: tuple[TorqueLimit, ...] = ()
    load: CarriedLoad | None = None

    @property
    def validator(self) -> CrossValidator:
        """The model's fit to the logs that select.

        Raises
        ------
        InputError
            The arm stands still in all of them.
        """
        if self.fit is None:
            raise InputError(NOTHING_MOVES)
        return self.fit

    def __repr__(self) -> str:
        named = [f"{f.effect} on {', '.join(f.joints) or 'the robot'}" for f in self.findings if f.significant][:1]
        found = ": ".join([self.verdict, *named])
        return f"Diagnosis({found}; NRMSE {self.headline.nrmse:.4f} {self.headline.where})"

    @property
    def by_verdict(self) -> list[Finding]:
        """The findings as a table lists them: first those that are called missing."""
        return sorted(self.findings, key=lambda f: not f.significant)

    @property
    def shown_before(self) -> tuple[Finding, ...]:
        """Of `always_missing`, the effects that are called missing on the model's own logs."""
        return tuple(f for f in self.always_missing if f.significant)

    @property
    def remainder(self) -> str:
        """A sentence on the residual error where no effect is found: this error may be more than the sensor noise.

        Of a robot that changed it names what is called missing on its model's own logs, whatever came later.
        """
        if self.fit is None:
            return "the arm stands still, and nothing touches it"
        error, noise, tolerance = self.headline.nrmse, self.headline.noise_floor, self.criteria.floor_tolerance
        if self.for_a_while:
            error, noise = self.error, self.noise_floor  # of the rest of the logs
        more = suspected(self.findings, self.probabilities)
        missing, explains = ("called missing", "may explain") if more else ("missing", "explains")
        if self.error > tolerance * self.noise_floor:
            said = f"called missing; the model's NRMSE is {error:.2g}, that of the sensor noise alone {noise:.2g}"
        elif error > tolerance * noise:
            figures = f"error {self.error:.2g} in this search, noise of sensors and drives {self.noise_floor:.2g}"
            said = f"{missing}: noise {explains} the error, with the parameters that noise leaves uncertain ({figures})"
        else:
            said = f"{missing}: the residual error is that of the sensor noise"
        named = listed([f.title for f in self.shown_before])
        known = f"beside {named}, which the model's own logs already show, " if named else ""
        cut = f"{self.for_a_while}; in the rest of the logs, " if self.for_a_while else ""
        return f"{cut}{known}no effect is {said}{more}"

    def left_out(self, joint: str) -> dict[str, list[Stretch]]:
        """Reason -> stretches of time that the search leaves out for this reason, where the joint shows it."""
        touched = [(c.source, c.start, c.stop) for c in self.contacts if joint in c.joints]
        limited = [stretch for limit in self.limits if limit.joint == joint for stretch in limit.stretches]
        found = {"contact": touched, "torque at its limit": limited}
        if self.load is not None:
            found["load" if self.load.left_out == self.load.stretches else "no load"] = list(self.load.left_out)
        return {reason: stretches for reason, stretches in found.items() if stretches}

    @property
    def to_cut_out(self) -> list[Stretch]:
        """Contacts, and the times with the load or without, whichever are shorter: one model cannot hold them."""
        touched = [(c.source, c.start, c.stop) for c in self.contacts]
        return touched + ([] if self.load is None else list(self.load.left_out))

    @property
    def for_a_while(self) -> str:
        """The clause that torques are at their limit, and that the robot carries a load; empty where neither is so."""
        names = listed([limit.joint for limit in self.limits])
        limited = f"the torque of {names} is at its limit for a while" if names else ""
        if len(self.limits) > 1:
            limited = f"the torques of {names} are at their limits for a while"
        loaded = "" if self.load is None else f"the robot carries {self.load.words} for a while"
        return " and ".join(filter(None, [limited, loaded]))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "verdict": self.verdict,
            "situation": self.situation,
            "headline": self.headline.to_dict(),
            "search": {"error": self.error, "noise_floor": self.noise_floor, "joints": self.joints},
            "probabilities": self.probabilities,
            "findings": [f.to_dict() for f in self.findings],
            "always_missing": [
                {"effect": f.effect, "joints": list(f.joints), "probability": f.probability}
                for f in self.always_missing
            ],
            "contacts": [vars(c) for c in self.contacts],
            "limits": [x.to_dict() for x in self.limits],
            "load": None if self.load is None else self.load.to_dict(),
            "notes": list(self.notes),
            "description": None if self.description is None else vars(self.description),
            "criteria": self.criteria.to_dict(),
        }
