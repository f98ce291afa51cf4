"""The first four of identification's six stages, from logs to an estimate.

    read_logs → form_moments → set_prior → fit_parameters → bound_parameters → assess

Each stage takes the object of the stage before it and returns its own, which holds the other. Notes, warnings and the
progress line go to one `Journal`. The last two stages are in `frischid.model.identification_bounds` and
`frischid.model.identification`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

from frischid.checks.log_issue import UNDONE
from frischid.core.text import listed
from frischid.effects import BASELINE, Effect, check_effects
from frischid.effects.springs import JointSpring
from frischid.errors import InputError
from frischid.estimators.friction_smoothing import baseline, dry_friction
from frischid.estimators.least_squares import Estimate, ols, wls
from frischid.estimators.map_estimate import MapEstimate, map_estimate
from frischid.estimators.parameter_prior import ParameterPrior
from frischid.estimators.urdf_prior import urdf_prior
from frischid.logs.driven import driven, idle
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Motions, Recording, check_logs
from frischid.logs.summary import Data, held_by, summarise, torque_joints
from frischid.model.damping_noise import without_velocity_noise
from frischid.model.doubtful_delay import delay_effects, with_delay_prior
from frischid.model.friction_lead import lead_effects, without_columns
from frischid.model.identify_options import IdentifyOptions
from frischid.model.log_data import Journal, LogData
from frischid.model.log_examination import check_cutoff, refuse_worthless, report_issues
from frischid.model.log_faults import faults_of
from frischid.model.unknown_damping import damping_effects, damping_notes
from frischid.model.unknown_drive import known_controller
from frischid.model.unknown_gains import known_currents
from frischid.regression.accumulation import accumulate, streaming_qr
from frischid.regression.base_parameters import Reduction
from frischid.regression.moment_blocks import Blocks, total
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.regression.streaming_qr import SAFE_CONDITION
from frischid.regression.structure import structure
from frischid.robot.mjcf_reading import unread_forces
from frischid.robot.robot import Robot
from frischid.robot.stated_inertials import unstated


@dataclass(frozen=True, eq=False)
class Problem:
    """Stage 2: the regression problem, as moments of [Y τ]."""

    data: LogData
    effects: tuple[Effect, ...]
    regressor: Regressor
    reduction: Reduction
    """Base parameters of the regressor's columns."""
    blocks: Blocks
    """Moments of the base columns in consecutive stretches of time."""
    whole: Gram
    """Their sum."""

    @cached_property
    def urdf(self) -> ParameterPrior:
        """The URDF as a prior of all parameters."""
        options = self.data.options
        prior = urdf_prior(self.regressor, self.reduction, self.whole, options.prior_criteria)
        return with_delay_prior(prior, options.controller, self.regressor)


@dataclass(frozen=True, eq=False)
class PriorSet:
    """Stage 3: the problem and its prior."""

    problem: Problem
    prior: ParameterPrior | None
    """Of all parameters; None: the logs alone."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Stage 4: the estimate."""

    problem: Problem
    estimate: Estimate
    posterior: MapEstimate | None
    """Of all parameters, where there is a prior."""


def read_logs(
    robot: Robot, logs: Sequence[Data], valid: Sequence[Data], options: IdentifyOptions, journal: Journal
) -> LogData:
    """Stage 1: choose joints and filter, prepare the motions, check the logs.

    Raises
    ------
    InputError
        A log is not usable.
    """
    journal.stage("reading the logs")
    check_logs(logs, valid)
    if options.controller is not None:
        options.controller.check_joints((*robot.joints, *robot.locked))
        journal.progress("the controller's gains and delay")
        options = replace(options, controller=known_controller(robot, logs, options, journal.notes))
    journal.warnings += idle(logs, options.controller)
    logs, valid = driven(logs, options.controller), driven(valid, options.controller)
    options = replace(options, currents=known_currents(robot, logs, options, journal.notes))
    logs, valid = driven(logs, None, options.currents), driven(valid, None, options.currents)
    robot, locked = held_by(robot, logs)
    journal.notes += [*locked, *_unstated(robot)]
    joints = tuple(torque_joints(robot, logs, options.torque_joints, journal.notes))
    try:
        check_cutoff(options.cutoff, [*logs, *valid])
        seen = summarise(robot, logs, joints, options.cutoff)
        seen = replace(seen, lowpass=replace(seen.lowpass, torque_lag=options.known_torque_lag))
        streamed = any(isinstance(log, Recording) for log in logs)
        told = partial(journal.passed, of=sum(seen.samples)) if streamed else _nothing
        preparation = Motions(logs, robot.joints, seen.lowpass, options.velocity, told)
        motions: Iterable[Motion] = preparation if streamed else list(preparation)
    except InputError:
        if not options.force:  # a wrong unit is a better reason than the errors that follow from it
            refuse_worthless(report_issues(robot, logs))
        raise
    journal.notes.append(_filtering(seen.lowpass))
    data = LogData(robot, tuple(logs), tuple(valid), joints, seen, motions, preparation, options, journal)
    _check_issues(data)
    return data


def _unstated(robot: Robot) -> list[str]:
    what, forces = unstated(robot), listed(unread_forces(robot.urdf))
    notes = [f"{robot.source} has {what}: the links' values come from the logs, not from the URDF"] if what else []
    notes += [f"{robot.source} has {forces}, which are not read: the nominal torque lacks them"] if forces else []
    return notes


def _nothing(_: int) -> None:
    """Short passes tell no share: the stages are counted."""


def _check_issues(data: LogData) -> None:
    """Warn of suspicious findings in the logs; stop at an issue that makes an identification worthless."""
    data.journal.stage("checking the logs")
    prepared = None if data.streamed else (data.lowpass, [list(data.preparation.of(log)) for log in data.logs])
    reports = report_issues(data.robot, data.logs, prepared)
    issues = [(r.source, x) for r in reports for x in r.issues if x.kind not in UNDONE]
    data.journal.warnings += [f"{source}: {issue.short}" for source, issue in issues]
    for report in reports:
        data.journal.faults += [(report.source, x) for x in faults_of(report)]
        data.journal.explained |= report.explained(data.robot.joints)
    if not data.options.force:
        refuse_worthless(reports)


def _filtering(lowpass: LowPass) -> str:
    late = f"; {lowpass.lag_in_words}" if lowpass.torque_lag else ""
    if lowpass.cutoff is None:
        return f"nothing is low-passed ({lowpass.reason}){late}"
    return f"torque and every regressor column low-passed at {lowpass.cutoff:g} Hz ({lowpass.reason}){late}"


def form_moments(data: LogData, effects: Sequence[Effect] | None) -> Problem:
    """Stage 2: columns of the robot and its effects, and their moments along the logs.

    Parameters
    ----------
    effects : sequence of Effect, optional
        By default the baseline; cross-validation on the logs chooses the smoothing of its dry friction.
    """
    if effects is not None:
        check_effects(effects)
    data.journal.stage("dry friction")
    chosen = default_effects(data) if effects is None else tuple(effects)
    if data.options.with_prior:
        chosen = delay_effects(data.options.controller, chosen, data.some_motions, data.robot.joints)
    chosen = with_damping(data, chosen)
    journal = data.journal
    journal.notes += damping_notes(data.options.controller, chosen, data.joints)
    journal.stage("regressor and moments")
    regressor = Regressor(data.robot, chosen, data.options.reference)
    reduction = structure(regressor, data.joints)
    seconds = data.summary.seconds if data.streamed else None
    leads = lead_effects(chosen, data.some_motions)
    beside = Regressor(data.robot, (*chosen, *leads), data.options.reference) if leads else regressor
    nuisance = beside.columns[len(regressor.columns) :]
    base = [*reduction.base, *range(len(regressor.columns), len(beside.columns))]
    blocks = accumulate(beside, data.motions, data.lowpass, data.joints, seconds=seconds, base=base).described(
        [*reduction.base_columns(), *nuisance]
    )
    blocks = without_velocity_noise(
        blocks, data.robot, data.some_motions, data.lowpass, data.options.criteria.most_noise
    )
    blocks = without_columns(blocks, len(nuisance))
    journal.notes += data.preparation.notes
    if reduction.gap < data.options.criteria.clear_rank_gap:
        journal.warnings.append(
            f"the rank is not clear (gap {reduction.gap:.1f}): some base parameter hardly acts on the torque"
        )
    return Problem(data, chosen, regressor, reduction, blocks, total(blocks))


def set_prior(problem: Problem) -> PriorSet:
    """Stage 3: the URDF as a prior, unless the user or the estimator wants the logs alone."""
    return PriorSet(problem, problem.urdf if problem.data.options.with_prior else None)


def fit_parameters(given: PriorSet) -> Fit:
    """Stage 4: maximum a posteriori with a prior, least squares without.

    Raises
    ------
    IdentifiabilityError
        The logs do not determine the parameters.
    """
    problem, options = given.problem, given.problem.data.options
    problem.data.journal.stage("estimate")
    if given.prior is None:
        return Fit(problem, _least_squares(problem), None)
    mapping = problem.reduction.mapping
    found = map_estimate(problem.blocks, mapping, given.prior, options.prior_criteria.scale_rule)
    return Fit(problem, found.base_estimate(problem.whole, mapping), found)


def _least_squares(problem: Problem) -> Estimate:
    """Least squares with standard errors; by a streaming QR where moments would lose digits."""
    data = problem.data
    estimate = ols(problem.blocks) if data.options.estimator == "ols" else wls(problem.blocks)
    if estimate.condition <= SAFE_CONDITION:
        return estimate
    data.journal.progress("streaming QR")
    rows = streaming_qr(problem.regressor, data.motions, data.lowpass, data.joints, problem.reduction.base)
    data.journal.notes.append(
        f"condition number {estimate.condition:.1e}: solved by a streaming QR, moments would lose digits"
    )
    return replace(estimate, theta=rows.solve(estimate.weights))


def with_damping(data: LogData, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Effects, with the drives' damping where it is open."""
    channels = [motion.extra for motion in data.some_motions]
    return damping_effects(data.options.controller, effects, channels, data.robot.joints)


def default_effects(data: LogData) -> tuple[Effect, ...]:
    """The baseline, with the smoothing of dry friction chosen by cross-validation.

    A spring that the robot has and the baseline lacks would decide the smoothing: its torque is largest at the ends of
    a motion, where dry friction changes its direction. So the choice is made without and with a torque of each joint's
    position beside, and a lead or a wider sign must be clear in both.
    """
    some = [motion for motion in data.some_motions if not motion.at_poses]
    if not some:
        return BASELINE
    effects = with_damping(data, delay_effects(data.options.controller, BASELINE, some, data.robot.joints))
    found = []
    for beside in (effects, (*effects, JointSpring(form="cubic"))):
        reduction = structure(Regressor(data.robot, beside), data.joints)
        found.append(dry_friction(data.robot, some, data.lowpass, data.joints, reduction, beside))
    dry = min((x for x in found if x is not None), key=lambda x: (x.lead, x.width), default=None)
    if dry is None:
        return BASELINE
    ahead = f", {1e3 * dry.lead:g} ms ahead of the motion" if dry.lead else ""
    data.journal.notes.append(
        f"dry friction changes its direction over ±{dry.width:g} rad/s (m/s){ahead}, chosen by cross-validation"
    )
    return baseline(dry)
