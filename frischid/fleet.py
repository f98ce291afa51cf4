"""A fleet of equal robots: each one's parameters, what they have in common, and who is different.

    every log → moments        (where the log is read; a log that cannot be read is named, skipped and counted)
    logs of a robot → one sum  → its own parameters
    robots → one sum           → the fleet's parameters, standard errors from leaving out one robot at a time
    robot against the others   → a p value (`frischid.deviation`); who differs is taken out of the sum, and again
    who differs                → which effect: parameters of the model that changed, or `diagnose` in the situation
                                 "changed" with the fleet as what is known

Only moments travel. Every step is a `frischid.cluster.Workers.map` or `tree`: the result is the same in one process.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import groupby
from typing import Any, Literal

import numpy as np

from frischid.archive import Entry, local
from frischid.cluster import Here, Workers
from frischid.deviation import Change, Deviation, Null, changes, deviation
from frischid.diagnosis import Finding, diagnose
from frischid.effects import BASELINE, Effect
from frischid.errors import FrischidError, InputError
from frischid.estimate import Estimate, wls
from frischid.gram import Array, Gram, total
from frischid.identification import structure
from frischid.inspection import inspect
from frischid.log import Log
from frischid.mapping import LogMap
from frischid.model import Model
from frischid.readers import read_log
from frischid.recording import Motions, Recording, head_of, pieces_of
from frischid.reduction import Reduction
from frischid.regressor import Regressor, accumulate
from frischid.robot import Robot
from frischid.signals import Bandwidths, LowPass, prepare
from frischid.survey import survey

SIGNIFICANCE = 0.01
LOOKED_AT = 32  # logs from which the filter and the joints are taken
BLOCKS = 32  # of a robot
WHOLE = 32 * 2**20  # bytes of a file that is read as a whole
ROUNDS = 5  # of taking out robots that differ
EXPLAINED = 20  # of those, how many are diagnosed
DIAGNOSED = 30_000  # samples of a robot that are diagnosed
MOSTLY = 0.5  # share of a robot's error that an effect must explain to be what changed
TIE = 1.1  # parameters that the model has already explain a change if they leave at most this times the error


@dataclass(frozen=True)
class Job:
    """What a worker must know to turn a log into moments; rebuilt once a worker."""

    robot: str
    effects: tuple[Effect, ...]
    rows: tuple[str, ...]
    base: tuple[int, ...]
    lowpass: LowPass
    velocity: str
    mapping: LogMap | None = field(compare=False, default=None)


@dataclass(frozen=True)
class Skipped:
    """A log that is not counted, and why."""

    robot: str
    address: str
    reason: str


@dataclass(frozen=True, eq=False)
class Part:
    """Moments of one log."""

    address: str
    blocks: tuple[Gram, ...]
    samples: int
    seconds: float
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Machine:
    """Moments of one robot of the fleet."""

    name: str
    blocks: tuple[Gram, ...]
    addresses: tuple[str, ...]
    samples: int
    seconds: float
    skipped: tuple[Skipped, ...]
    warnings: tuple[str, ...]


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
        Their logs, as `frischid.archive.entries` gives them.
    effects, torque_joints, cutoff, velocity
        As for `frischid.identification.identify`.
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


# ---------------------------------------------------------------------- on the workers


@lru_cache(maxsize=4)
def _tools(robot: str, effects: tuple[Effect, ...]) -> tuple[Robot, Regressor]:
    machine = Robot.from_dict(json.loads(robot))
    return machine, Regressor(machine, effects)


def _open(path: Any, address: str, joints: Sequence[str], mapping: LogMap | None) -> Log | Recording:
    """A log in memory where it is small, else one that is read in pieces; called by its address."""
    if path.is_file() and path.stat().st_size > WHOLE:
        return replace(Recording.open(path, joints, mapping), source=address)
    return replace(read_log(path, joints, mapping), source=address)


@dataclass(frozen=True)
class Look:
    """What a first look at a log shows."""

    joints: tuple[str, ...]
    torques: tuple[str, ...]
    bands: tuple[float, ...]
    clear: tuple[float, ...]
    rate: float


def look(entry: Entry, joints: tuple[str, ...], rows: tuple[str, ...] | None, mapping: LogMap | None) -> Look | Skipped:
    """See which joints a log holds and how fast they move."""
    try:
        with local(entry.address) as path:
            log = _open(path, entry.address, joints, mapping)
            head = head_of(log)
            torques = tuple(str(n) for n in np.compress(head.has("tau"), head.joints))
            bands = Bandwidths()
            bands.add(next(pieces_of(log)), [n for n in (rows or torques) if n in torques])
            return Look(head.joints, torques, tuple(bands.bands), tuple(bands.clear), float(bands.rate))
    except Exception as error:
        return _skipped(entry, error)


def measure(entry: Entry, job: Job) -> Part | Skipped:
    """Moments of one log; a log that cannot be used is an answer, not an error."""
    try:
        robot, regressor = _tools(job.robot, job.effects)
        with local(entry.address) as path:
            log = _open(path, entry.address, (*robot.joints, *robot.locked), job.mapping)
            seen = survey(robot, [log], job.rows, job.lowpass.cutoff)
            missing = [n for n in job.rows if not head_of(log).select([n]).has("tau")[0]]
            if missing:
                raise InputError(f"no torque of {', '.join(missing)}, which other logs have")
            motions = Motions([log], robot.joints, job.lowpass, job.velocity)
            seconds = seen.seconds if isinstance(log, Recording) else None
            grams = accumulate(regressor, motions, job.lowpass, job.rows, seconds=seconds, base=job.base)
            merged = tuple(_merged(grams, BLOCKS))
            first = next(pieces_of(log)).select(robot.joints)
            motion = prepare(first, job.lowpass, velocity=job.velocity).motions
            report = inspect(
                robot,
                first,
                lambda: structure(Regressor(robot, BASELINE), robot.joints),
                alone=False,
                prepared=(job.lowpass, motion),
            )
            warnings = tuple(f"{entry.address}: {finding.short}" for finding in report.findings)
            return Part(entry.address, merged, seen.samples[0], seen.seconds, warnings)
    except Exception as error:
        return _skipped(entry, error)


def _skipped(entry: Entry, error: Exception) -> Skipped:
    # One of ten thousand logs may be broken in any way; the rest must not stop for it, and it is not passed over.
    reason = str(error).removeprefix(f"{entry.address}: ")
    return Skipped(entry.robot, entry.address, reason if isinstance(error, FrischidError) else f"{error!r}")


def _merged(grams: Sequence[Gram], most: int) -> list[Gram]:
    """At most so many blocks, neighbours added."""
    size = -(-len(grams) // most)
    return [total(grams[i : i + size]) for i in range(0, len(grams), max(1, size))]


def combine(name: str, parts: Sequence[Part | Skipped]) -> Machine:
    """One robot's logs, in order."""
    good = [p for p in parts if isinstance(p, Part)]
    return Machine(
        name,
        tuple(_merged([g for p in good for g in p.blocks], BLOCKS)) if good else (),
        tuple(p.address for p in good),
        sum(p.samples for p in good),
        sum(p.seconds for p in good),
        tuple(p for p in parts if isinstance(p, Skipped)),
        tuple(w for p in good for w in p.warnings)[:3],
    )


def summary(machine: Machine) -> Machine:
    """A robot without its moments."""
    return replace(machine, blocks=())


def moments(machine: Machine) -> Gram:
    """Sum over a robot."""
    return total(machine.blocks)


def add(a: Gram, b: Gram) -> Gram:
    """Sum of two."""
    return a + b


def against(question: tuple[Machine, bool], fleet: Gram, theta: Array, weights: Array) -> Deviation:
    """One robot against the others; whether it is in their sum stands beside it."""
    machine, included = question
    return deviation(machine.blocks, fleet, theta, weights, included)


def _with(machine: Machine, flag: bool) -> tuple[Machine, bool]:
    return machine, flag


def explain(
    question: tuple[Machine, bool], model: Mapping[str, Any], mapping: LogMap | None, inflation: float
) -> tuple[list[Change], Finding | None, str]:
    """What changed on a robot: parameters of the model, and, where it is to be diagnosed, the effect its logs show."""
    machine, diagnosed = question
    fleet = Model.from_dict(model)
    whole = total(machine.blocks)
    changed = changes(whole, fleet.estimate.theta, fleet.estimate.weights, inflation)
    if not diagnosed:
        return changed, None, ""
    logs: list[Log] = []
    for address in machine.addresses:
        if logs and sum(map(len, logs)) + len(logs[-1]) > DIAGNOSED:
            break
        with local(address) as path:
            opened = _open(path, address, (*fleet.robot.joints, *fleet.robot.locked), mapping)
            logs.append(next(pieces_of(opened)))
    try:
        found = diagnose(fleet, logs, situation="changed").findings
    except FrischidError as error:
        return changed, None, str(error)
    # That it differs is settled by the fleet; here it is only asked which effect it is.
    return changed, next((f for f in found if f.gain > 0 and f.share > MOSTLY), None), ""


# ---------------------------------------------------------------------- here


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
        questions = pool.pairs(_with, list(machines.values()), among)
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
    kept = _tools(job.robot, job.effects)[0]
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
        _with, [handles[present[i]] for i in ranked], [rank < diagnosed for rank in range(len(ranked))]
    )
    asked = pool.map(explain, questions, content, job.mapping, inflation)
    answers = pool.gather(asked, lambda done, of: progress(f"what changed on {done} of {of} robots"))
    result = list(members)
    for i, (changed, finding, failed) in zip(ranked, answers, strict=True):
        result[i] = replace(members[i], changes=tuple(changed), finding=finding)
        if failed:
            warnings.append(f"{members[i].name} could not be diagnosed: {failed}")
    return result
