"""A fleet of equal robots: the parameters of each, the shared ones, and the robots that differ.

    every log → moments        (on the worker that reads the log; a log that cannot be read is skipped and named)
    logs of a robot → one sum  → its own parameters
    robots → five sums         → the fleet's parameters with the URDF as prior (`frischid.fleet.shared_fit`), standard
                                 errors from leaving out one robot at a time
    robot against the others   → a p value (`frischid.fleet.deviation`); robots that differ leave the sum, and the
                                 comparison is repeated
    robots that differ         → the cause: parameters of the model that changed, or an effect that `diagnose` finds in
                                 the situation "changed", with the fleet's model as the one before the change

Only moments are sent between processes. Every step is a `Workers.map` or `tree`, so the result is the same in one
process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np

from frischid.core.parallel import Here, Workers
from frischid.errors import InputError
from frischid.estimators.held_out import FOLDS
from frischid.estimators.least_squares import Estimate
from frischid.estimators.urdf_prior import UrdfPrior
from frischid.fleet.deviation import LEAST_ROBOTS, Centre, Deviation, Null, usual_deviation
from frischid.fleet.fleet_options import FleetOptions
from frischid.fleet.jobs import (
    Explaining,
    Job,
    RobotMoments,
    Skipped,
    add,
    against,
    combine,
    explain,
    measure,
    moments,
    paired,
    summary,
    tools,
)
from frischid.fleet.log_paths import LogPath
from frischid.fleet.results import SIGNIFICANCE, Fleet, Member
from frischid.fleet.shared_fit import SharedFit, shared_fit, with_spread
from frischid.fleet.shared_job import shared_job
from frischid.model.alarms import Alarm
from frischid.model.log_faults import faulty_logs
from frischid.model.model import Model
from frischid.regression.base_parameters import Reduction
from frischid.regression.moments import Gram
from frischid.robot.robot import Robot

_EXCLUSION_ROUNDS = 5  # rounds of taking out robots that differ; each is one pass over the moments


def identify_fleet(
    robot: Robot,
    logs: Sequence[LogPath],
    options: FleetOptions | None = None,
    *,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Fleet:
    """Identify the robots of a fleet, alone and together.

    Parameters
    ----------
    robot : Robot
        The design that all robots of the fleet share.
    logs : sequence of LogPath
        Their logs, as `frischid.fleet.log_paths.find_logs` gives them.
    workers : Workers, optional
        Processes that do the work; this process by default.
    progress : callable
        Called with a few words at each stage.

    Raises
    ------
    InputError
        No log can be used, or with `FleetOptions.strict` one log cannot be used.
    IdentifiabilityError
        Without a prior, all logs together do not determine the parameters.

    Examples
    --------
    >>> import tempfile
    >>> import frischid as fr
    >>> from frischid.fleet.fleet import identify_fleet
    >>> from frischid.fleet.log_paths import find_logs
    >>> robot = fr.Robot.load("planar2")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for seed in (1, 2):
    ...         log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=seed), rate=100.0, noise=fr.Noise(tau=0.05))
    ...         fr.write_log(log, f"{folder}/robot{seed}.parquet")
    ...     found = identify_fleet(robot, find_logs([f"{folder}/*.parquet"]))
    >>> sorted(member.name for member in found.members), len(found.skipped)
    (['robot1', 'robot2'], 0)
    """
    pool, wanted, logs = workers or Here(), options or FleetOptions(), sorted(set(logs))
    progress(f"a first look at the logs, {pool.where}")
    job, reduction, notes = shared_job(pool, robot, logs, wanted)
    handles, summaries = _robots(pool, logs, job, progress)
    skipped = tuple(s for one in summaries for s in one.skipped)
    _refuse_skipped(skipped, wanted.strict, len(logs))

    progress("the fleet, and which robots differ from it")
    present = [k for k, one in enumerate(summaries) if one.addresses]
    fitted = partial(shared_fit, regressor=tools(job.robot, job.effects)[1], reduction=reduction, prior=wanted.prior)
    shared, found, null, outside = _compared(pool, {k: handles[k] for k in present}, fitted)
    members = [_member(summaries[k], found[k], null, len(present)) for k in present]
    estimate = with_spread(shared, [found[k] for k in present if k not in outside], null)
    alarms = _faulty([fault for one in summaries for fault in one.faults])
    model = _model(job, reduction, shared, estimate, logs, (members, alarms))
    different = sorted((i for i, m in enumerate(members) if m.differs), key=lambda i: -members[i].excess)
    questions = [handles[present[i]] for i in different], [rank < wanted.diagnosed for rank in range(len(different))]
    answers = _explained(pool, questions, model, Explaining(job.mapping, null.scale), progress)
    warnings = [w for one in summaries for w in one.warnings]
    for i, (changed, finding, failed) in zip(different, answers, strict=True):
        members[i] = replace(members[i], changes=tuple(changed), finding=finding)
        warnings += [f"{members[i].name} could not be diagnosed: {failed}"] * bool(failed)
    members.sort(key=lambda m: (not m.differs, -m.excess))
    return Fleet(model, tuple(members), skipped, null, pool.where, tuple(notes), tuple(warnings), alarms)


def _robots(
    pool: Workers, logs: Sequence[LogPath], job: Job, progress: Callable[[str], None]
) -> tuple[list[Any], list[RobotMoments]]:
    """Handles of all robots' moments, and the robots' other results."""
    parts = pool.map(measure, logs, job)
    named = [(name, [i for i, _ in group]) for name, group in groupby(enumerate(logs), key=lambda x: x[1].robot)]
    handles = pool.pairs(combine, [name for name, _ in named], [[parts[i] for i in index] for _, index in named])
    told = pool.gather(pool.map(summary, handles), lambda done, of: progress(f"moments of {done} of {of} robots"))
    return handles, told


def _faulty(faults: Sequence[str]) -> tuple[Alarm, ...]:
    """The alarm that logs have faults, which change the shared parameters, and so the robots that differ from them."""
    remedy = "`frischid check ROBOT LOG` says what to do. Undo the faults, or leave these logs out, and start again."
    return tuple(faulty_logs(faults, remedy=remedy))


def _refuse_skipped(skipped: Sequence[Skipped], strict: bool, logs: int) -> None:
    if skipped and strict:
        raise InputError(f"{skipped[0].address}: {skipped[0].reason}")
    if len(skipped) == logs:
        raise InputError(f"none of {logs} logs can be used; the first: {skipped[0].address}: {skipped[0].reason}")


def _member(one: RobotMoments, found: Deviation, null: Null, robots: int) -> Member:
    excess, p_value = null.excess(found), null.p_value(found, robots)
    return Member(one.name, len(one.addresses), one.samples, one.seconds, found, excess, p_value)


def _compared(
    pool: Workers, robots: Mapping[int, Any], fitted: Callable[[Sequence[Gram]], SharedFit]
) -> tuple[SharedFit, dict[int, Deviation], Null, set[int]]:
    """The fleet without the robots that differ, and the comparison of every robot with the rest of the fleet."""
    sums = dict(zip(robots, pool.map(moments, list(robots.values())), strict=True))
    small = dict(zip(robots, pool.gather(list(sums.values())), strict=True)) if len(robots) < LEAST_ROBOTS else {}
    outside: set[int] = set()
    for _ in range(_EXCLUSION_ROUNDS):
        inside = [k for k in robots if k not in outside]
        groups = np.array_split(np.array(inside), min(FOLDS, len(inside)))
        parts = [pool.tree(add, [sums[k] for k in group]) for group in groups]
        fit = fitted(pool.gather(parts))
        among = [len(inside) > 1 and k not in outside for k in robots]
        questions = pool.pairs(paired, list(robots.values()), among)
        answers = pool.gather(pool.map(against, questions, pool.tree(add, parts), fit.centre))
        found = dict(zip(robots, answers, strict=True))
        if small:
            found = _with_usual(found, small, fit.centre)
        null = Null.of([found[k] for k in inside], len(robots))
        differ = {k for k, d in found.items() if null.p_value(d, len(robots)) < SIGNIFICANCE}
        # Most robots of a fleet are alike, so never half of them are taken out.
        if differ <= outside or len(differ | outside) * 2 >= len(robots):
            break
        outside |= differ
    return fit, found, null, outside


def _with_usual(found: Mapping[int, Deviation], sums: Mapping[int, Gram], centre: Centre) -> dict[int, Deviation]:
    """The same with the differences of all other robots among themselves, of a small fleet."""
    return {
        k: replace(d, usual=usual_deviation([one for n, one in sums.items() if n != k], centre))
        for k, d in found.items()
    }


def _model(
    job: Job,
    reduction: Reduction,
    shared: SharedFit,
    estimate: Estimate,
    logs: Sequence[LogPath],
    known: tuple[Sequence[Member], Sequence[Alarm]],
) -> Model:
    """The model with the shared parameters, and the event in its history that tells its origin."""
    members, alarms = known
    kept = tools(job.robot, job.effects)[0]
    columns = reduction.base_columns()
    error = float(np.median([m.deviation.error_fleet.mean() for m in members]))
    event = {
        "action": "identify fleet",
        "effects": [str(e) for e in job.effects],
        "robots": len(members),
        "logs": [],
        "log_count": len(logs),
        "first_log": logs[0].address,
        "samples": sum(m.samples for m in members),
        "different": [m.name for m in members if m.differs],
        "error_after": error,
        "measured_on": "logs left out of the fit, median of the robots",
        "notes": [],
        "warnings": [],
        "alarms": [alarm.to_dict() for alarm in alarms],
    }
    prior = None if shared.posterior is None else UrdfPrior.of(shared.posterior)
    if prior is not None:
        event["prior"] = {key: prior.to_dict()[key] for key in ("kind", "rows", "scales")}
    return Model(
        kept,
        job.effects,
        job.lowpass,
        job.velocity,
        job.base,
        tuple(reduction.expressions()),
        replace(estimate, columns=columns),
        shared.whole.sums[:, -1] / np.maximum(shared.whole.counts, 1),
        history=(event,),
        prior=prior,
    )


def _explained(
    pool: Workers,
    questions: tuple[Sequence[Any], Sequence[bool]],
    model: Model,
    how: Explaining,
    progress: Callable[[str], None],
) -> list[Any]:
    """The change on each robot that differs, in the order of the questions."""
    asked = pool.map(explain, pool.pairs(paired, *questions), model.to_dict(), how)
    return pool.gather(asked, lambda done, of: progress(f"the change on {done} of {of} robots"))
