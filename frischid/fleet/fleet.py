"""A fleet of equal robots: each one's parameters, what they have in common, and who is different.

    every log → moments        (where the log is read; a log that cannot be read is named, skipped and counted)
    logs of a robot → one sum  → its own parameters
    robots → one sum           → the fleet's parameters, standard errors from leaving out one robot at a time
    robot against the others   → a p value (`frischid.fleet.deviation`); who differs is taken out of the sum, and again
    who differs                → which effect: parameters of the model that changed, or `diagnose` in the situation
                                 "changed" with the fleet as what is known

Only moments travel. Every step is a `Workers.map` or `tree`: the result is the same in one process.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Literal

import numpy as np

from frischid.core.parallel import Here, Workers
from frischid.diagnosis.findings import Finding
from frischid.effects import BASELINE, Effect
from frischid.errors import InputError
from frischid.estimators.least_squares import Estimate, wls
from frischid.fleet.deviation import Change, Deviation, Null
from frischid.fleet.jobs import (
    Job,
    Look,
    Skipped,
    add,
    against,
    beside,
    combine,
    explain,
    look,
    measure,
    moments,
    summary,
    tools,
)
from frischid.fleet.log_paths import Entry
from frischid.logs.cutoff_choice import Bandwidths
from frischid.logs.filters import LowPass
from frischid.logs.mapping import LogMap
from frischid.model.model import Model
from frischid.regression.base_parameters import Reduction
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

SIGNIFICANCE = 0.01
LOOKED_AT = 32  # logs from which the filter and the joints are taken
ROUNDS = 5  # of taking out robots that differ
EXPLAINED = 20  # of those, how many are diagnosed
TIE = 1.1  # parameters that the model has already explain a change if they leave at most this times the error


@dataclass(frozen=True, eq=False)
class Member:
    """What was found of one robot.

    Attributes
    ----------
    name : str
    logs, samples, seconds
        What was counted.
    deviation : Deviation
        Its own parameters, and how they differ from the others'.
    excess : float
        How far it is from the others, as a multiple of what is usual in this fleet: mean one (see `deviation.Null`).
    p_value : float
        Corrected for the number of robots.
    changes : tuple of Change
        Parameters of the model that are no longer the fleet's; of robots that differ.
    finding : Finding or None
        Effect that explains most of its error by `diagnose`; of robots that differ.
    """

    name: str
    logs: int
    samples: int
    seconds: float
    deviation: Deviation
    excess: float
    p_value: float
    changes: tuple[Change, ...] = ()
    finding: Finding | None = None

    @property
    def differs(self) -> bool:
        """Whether it differs from the fleet by more than chance."""
        return self.p_value < SIGNIFICANCE

    @property
    def parameters_explain(self) -> bool:
        """Whether parameters that the model has already account for the change, rather than a new effect."""
        if not self.changes:
            return False
        return self.finding is None or self.changes[-1].error_after <= TIE * self.finding.error_after

    @property
    def effect(self) -> str:
        """Name of what changed, ``effect@joint``; ``"unknown"`` when nothing explains it, empty when nothing did."""
        if not self.differs:
            return ""
        if self.parameters_explain:
            return ", ".join(f"{c.effect}@{c.joint}" for c in self.changes)
        if self.finding is None:
            return "unknown"
        return self.finding.effect + ("@" + "+".join(self.finding.joints) if self.finding.joints else "")


@dataclass(frozen=True, eq=False)
class Fleet:
    """A fleet identified.

    Attributes
    ----------
    model : Model
        With the parameters that the robots have in common.
    members : tuple of Member
        Every robot, those that differ most first.
    skipped : tuple of Skipped
        Logs that could not be used.
    null : Null
        How much its robots usually differ.
    where : str
        Where the work was done.
    notes, warnings : tuple of str
    """

    model: Model
    members: tuple[Member, ...]
    skipped: tuple[Skipped, ...]
    null: Null
    where: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def different(self) -> tuple[Member, ...]:
        """Robots that differ significantly, ranked."""
        return tuple(m for m in self.members if m.differs)


def identify_fleet(
    robot: Robot,
    entries: Sequence[Entry],
    *,
    effects: Sequence[Effect] = BASELINE,
    torque_joints: Sequence[str] | None = None,
    cutoff: float | Literal["auto"] | None = "auto",
    velocity: str = "auto",
    mapping: LogMap | None = None,
    strict: bool = False,
    diagnosed: int = EXPLAINED,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Fleet:
    """Identify the robots of a fleet, alone and together.

    Parameters
    ----------
    robot : Robot
        What all of them are meant to be.
    entries : sequence of Entry
        Their logs, as `frischid.fleet.log_paths.entries` gives them.
    effects, torque_joints, cutoff, velocity
        As for `frischid.model.identification.identify`.
    mapping : LogMap, optional
        What the logs' columns mean.
    strict : bool
        Stop at a log that cannot be used instead of skipping it.
    diagnosed : int
        Of the robots that differ, how many are diagnosed for effects that the model does not have.
    workers : Workers, optional
        Where to work; this process by default.
    progress : callable
        Told what is being done.

    Returns
    -------
    Fleet

    Raises
    ------
    InputError
        No log can be used, or `strict` and one cannot.
    IdentifiabilityError
        All logs together do not determine the parameters.
    """
    pool = workers or Here()
    entries = sorted(set(entries))
    progress(f"a first look at the logs, {pool.where}")
    job, reduction, notes = _job(pool, robot, entries, effects, torque_joints, cutoff, velocity, mapping)

    parts = pool.map(measure, entries, job)
    named = [(name, [i for i, _ in group]) for name, group in groupby(enumerate(entries), key=lambda x: x[1].robot)]
    handles = pool.pairs(combine, [name for name, _ in named], [[parts[i] for i in index] for _, index in named])
    summaries = pool.gather(pool.map(summary, handles), lambda done, of: progress(f"moments of {done} of {of} robots"))
    skipped = tuple(s for machine in summaries for s in machine.skipped)
    if strict and skipped:
        raise InputError(f"{skipped[0].address}: {skipped[0].reason}")
    present = [k for k, machine in enumerate(summaries) if machine.addresses]
    if not present:
        raise InputError(
            f"none of {len(entries)} logs can be used; the first: {skipped[0].address}: {skipped[0].reason}"
        )

    progress("the fleet and who differs from it")
    fleet, estimate, found, null, outside = _compared(pool, {k: handles[k] for k in present})
    members = [
        Member(
            summaries[k].name,
            len(summaries[k].addresses),
            summaries[k].samples,
            summaries[k].seconds,
            found[k],
            null.excess(found[k]),
            null.p_value(found[k], len(present)),
        )
        for k in present
    ]
    estimate = _with_spread(estimate, fleet, [found[k] for k in present if k not in outside], null)
    model = _model(job, robot, reduction, fleet, estimate, entries, members)
    warnings = [w for machine in summaries for w in machine.warnings]
    members = _explained(pool, members, handles, present, model, job, diagnosed, null.scale, progress, warnings)
    members.sort(key=lambda m: (not m.differs, -m.excess))
    return Fleet(model, tuple(members), skipped, null, pool.where, tuple(notes), tuple(warnings))


def _job(
    pool: Workers,
    robot: Robot,
    entries: Sequence[Entry],
    effects: Sequence[Effect],
    torque_joints: Sequence[str] | None,
    cutoff: float | Literal["auto"] | None,
    velocity: str,
    mapping: LogMap | None,
) -> tuple[Job, Reduction, list[str]]:
    """Filter, joints and base parameters, from a look at some logs spread evenly over the fleet."""
    if not entries:
        raise InputError("there is no log to identify from")
    index = np.unique(np.linspace(0, len(entries) - 1, min(LOOKED_AT, len(entries))).astype(int))
    rows = None if torque_joints is None else tuple(torque_joints)
    looks = pool.gather(pool.map(look, [entries[i] for i in index], (*robot.joints, *robot.locked), rows, mapping))
    good = [x for x in looks if isinstance(x, Look)]
    if not good:
        raise InputError(
            f"none of {len(looks)} logs looked at can be read; the first: {looks[0].address}: {looks[0].reason}"
        )
    # What nearly every log holds; a log that lacks it is skipped by name.
    held = [n for n in robot.joints if sum(n in x.joints for x in good) > 0.5 * len(good)]
    if not held:
        raise InputError(
            f"the logs share no joint with the robot; joints of the robot are {', '.join(robot.joints)}; "
            f"the logs hold {', '.join(good[0].joints)}"
        )
    kept = robot.keep(held)
    have = [n for n in held if sum(n in x.torques for x in good) > 0.5 * len(good)]
    fitted = [n for n in (rows or have) if n in held]
    if not fitted:
        raise InputError(
            "no joint of the logs has a torque channel; give tau_<joint> columns, or current gains in a map"
        )
    bands = Bandwidths()
    bands.bands = [b for x in good for b in x.bands]
    bands.clear = [b for x in good for b in x.clear]
    bands.rate = min(x.rate for x in good)
    lowpass = bands.lowpass() if cutoff == "auto" else LowPass(cutoff)
    reduction = structure(Regressor(kept, tuple(effects)), fitted)
    job = Job(
        json.dumps(kept.to_dict()), tuple(effects), tuple(fitted), tuple(reduction.base), lowpass, velocity, mapping
    )
    filtering = "nothing is low-passed" if lowpass.cutoff is None else f"low-passed at {lowpass.cutoff:g} Hz"
    return job, reduction, [f"{filtering} ({lowpass.reason}), from {len(good)} logs spread over the fleet"]


def _compared(
    pool: Workers, machines: Mapping[int, Any]
) -> tuple[Gram, Estimate, dict[int, Deviation], Null, set[int]]:
    """The fleet without the robots that differ, and every robot against the rest of it."""
    sums = dict(zip(machines, pool.map(moments, list(machines.values())), strict=True))
    outside: set[int] = set()
    for _ in range(ROUNDS):
        inside = [k for k in machines if k not in outside]
        handle = pool.tree(add, [sums[k] for k in inside])
        (fleet,) = pool.gather([handle])
        estimate = wls([fleet])
        among = [len(inside) > 1 and k not in outside for k in machines]
        questions = pool.pairs(beside, list(machines.values()), among)
        answers = pool.gather(pool.map(against, questions, handle, estimate.theta, estimate.weights))
        found = dict(zip(machines, answers, strict=True))
        null = Null.of([found[k] for k in inside])
        differ = {k for k, d in found.items() if null.p_value(d, len(machines)) < SIGNIFICANCE}
        # A fleet is what most of its robots are: never take out half of them.
        if differ <= outside or len(differ | outside) * 2 >= len(machines):
            break
        outside |= differ
    return fleet, estimate, found, null, outside


def _with_spread(estimate: Estimate, fleet: Gram, inside: Sequence[Deviation], null: Null) -> Estimate:
    """Standard errors from leaving out one robot at a time, and how far the next robot may be from the fleet."""
    pulls = np.array([d.pull for d in inside])
    R = len(pulls)
    covariance = (R - 1) / R * pulls.T @ pulls if len(estimate.joints) < R else estimate.covariance
    plain = fleet.weighted(1.0 / estimate.sigma**2)[:-1, :-1]
    # Robots vary by (κ − κ_within) of what one robot's own data leave open: that is the prior for any one of them.
    information = plain / (null.scale + R * max(0.0, null.scale - null.within))
    notes = () if len(estimate.joints) < R else ("too few robots: standard errors take residuals as uncorrelated",)
    return replace(estimate, covariance=covariance, information=information, notes=notes)


def _model(
    job: Job,
    robot: Robot,
    reduction: Reduction,
    fleet: Gram,
    estimate: Estimate,
    entries: Sequence[Entry],
    members: Sequence[Member],
) -> Model:
    kept = tools(job.robot, job.effects)[0]
    columns = reduction.base_columns()
    error = float(np.median([m.deviation.error_fleet.mean() for m in members]))
    event = {
        "action": "identify fleet",
        "effects": [str(e) for e in job.effects],
        "robots": len(members),
        "logs": [],
        "log_count": len(entries),
        "first_log": entries[0].address,
        "samples": sum(m.samples for m in members),
        "different": [m.name for m in members if m.differs],
        "cross_validated_nrmse": error,
        "held_out_nrmse": None,
        "held_out_logs": [],
        "notes": [],
        "warnings": [],
    }
    return Model(
        kept,
        job.effects,
        job.lowpass,
        job.velocity,
        job.base,
        tuple(reduction.expressions()),
        replace(estimate, columns=columns),
        fleet.sums[:, -1] / fleet.counts,
        history=(event,),
    )


def _explained(
    pool: Workers,
    members: Sequence[Member],
    handles: Sequence[Any],
    present: Sequence[int],
    model: Model,
    job: Job,
    diagnosed: int,
    inflation: float,
    progress: Callable[[str], None],
    warnings: list[str],
) -> list[Member]:
    """The robots that differ, each with what changed on it."""
    ranked = sorted((i for i, m in enumerate(members) if m.differs), key=lambda i: -members[i].excess)
    content = model.to_dict()
    questions = pool.pairs(
        beside, [handles[present[i]] for i in ranked], [rank < diagnosed for rank in range(len(ranked))]
    )
    asked = pool.map(explain, questions, content, job.mapping, inflation)
    answers = pool.gather(asked, lambda done, of: progress(f"what changed on {done} of {of} robots"))
    result = list(members)
    for i, (changed, finding, failed) in zip(ranked, answers, strict=True):
        result[i] = replace(members[i], changes=tuple(changed), finding=finding)
        if failed:
            warnings.append(f"{members[i].name} could not be diagnosed: {failed}")
    return result
