"""Alarms of an identification, and the record of the fit that later alarms are held against.

The two fits are compared along the fitted motion run faster by a factor f, ``(q, f q̇, f² q̈)``: with the least-squares
parameters θ_LS of the logs alone and θ of the fit with the prior they differ by ``rms(Y (θ_LS − θ)) / std(τ)``. Along
directions in which the logs alone have no solution, θ_LS is taken to differ by one standard deviation of the prior: a
direction counts by the torque that it has on the faster motion, and one that hardly acts on any motion hardly counts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy import linalg

from frischid.checks.log_issue import LogIssue
from frischid.checks.position_faults import JOINT_ZERO
from frischid.core.types import Array, Column
from frischid.effects import Coulomb, Offset, Viscous
from frischid.estimators.map_estimate import MapEstimate, friction_alone, map_estimate
from frischid.estimators.normal_equations import WORST_CONDITION
from frischid.estimators.urdf_prior import precision_root
from frischid.logs.preprocessing import Motion
from frischid.model.alarms import (
    Alarm,
    AlarmCriteria,
    by_severity,
    doubtful_gains,
    gains_from_masses,
    never_moving,
    noisy_cutoff,
    too_short,
    undetermined,
)
from frischid.model.comparison import Comparison
from frischid.model.fit_record import LEVELS, FitRecord
from frischid.model.identification_stages import Fit, Problem
from frischid.model.joint_inertia import least_inertia
from frischid.model.log_agreement import disagreeing_logs
from frischid.model.log_faults import faulty_logs
from frischid.model.model import Model
from frischid.model.physical_alarms import as_one, indefinite_mass, wrong_signs
from frischid.regression.block import Samples
from frischid.regression.regressor import Regressor

STATES = 400
"""States per motion along which two fits are compared: enough for a mean square, cheap to evaluate."""
HARDLY_PREDICTED = "is hardly predicted at all"
"""Words of a warning that holds for the identified model; added effects may end it."""
REACHED = 0.99
"""Share of the samples that lie within the fitted range: single jerks do not widen it."""


def fit_record(fit: Fit) -> FitRecord:
    """Record of a fit; its scores, its model's share and its spread come from the next pass over the logs."""
    problem = fit.problem
    index = [problem.data.robot.joints.index(n) for n in problem.data.joints]
    reach = np.zeros((2, len(index)))
    for motion in problem.data.motions:
        for row, x in enumerate((motion.v, motion.a)):
            reach[row] = np.maximum(reach[row], np.quantile(np.abs(x[:, index]), REACHED, axis=0))
    urdf = friction_alone(problem.blocks, problem.reduction.mapping, problem.urdf, _friction(problem))
    scores = np.full((len(LEVELS), len(index)), np.nan)
    return FitRecord(reach[0], reach[1], urdf, scores, np.ones(len(index)), np.full(len(index), np.nan))


def _friction(problem: Problem) -> set[str]:
    """Parameters that are fitted to the URDF's links for comparison: the same, whatever effects the model has besides.

    Those of viscous and dry friction, of the torque's zero and of the controller. A model that has other friction
    instead of viscous and dry friction is compared with that.
    """
    usual = [e for e in problem.effects if e.id in (Viscous.id, Coulomb.id)]
    friction = usual or [e for e in problem.effects if e.friction]
    others = [e for e in problem.effects if e.id == Offset.id or e.of_controller]
    return {c.name for e in (*friction, *others) for c in e.columns(problem.data.robot)}


def model_share(problem: Problem, own: Comparison, rows: float) -> Array:
    """Share of the parameters' covariance that is the model's error; see `FitRecord`."""
    joints = problem.data.joints  # of one that never moves nothing is known: all of its residual may be the model's
    ratios = {j.name: j.noise_floor / max(j.nrmse, 1e-300) for j in own.joints}
    noise = np.minimum(1.0, [ratios.get(name, 0.0) for name in joints]) ** 2
    independent = problem.data.independent_rows / len(joints)
    return np.asarray(1.0 - noise * (1.0 - min(1.0, rows / max(independent, 1e-300))))


def fit_alarms(
    fit: Fit, model: Model, still: Sequence[str], errors: Mapping[str, float], there: Comparison | None
) -> tuple[Alarm, ...]:
    """Alarms of an identification and of its model, most severe first.

    Parameters
    ----------
    still : sequence of str
        Joints that never move.
    errors : mapping of str to float
        Cross-validated NRMSE of each joint.
    there : Comparison or None
        Of the model on the fitted logs.
    """
    problem, criteria = fit.problem, fit.problem.data.options.alarm_criteria
    posterior, record = _posterior(fit), model.fitted
    spread = np.zeros(len(model.joints)) if record is None else record.spread
    currents = problem.data.options.currents
    found = [
        *gains_from_masses({} if currents is None else currents.doubt),
        *_gains(problem, criteria),
        *undetermined(_disagreement(problem, posterior, criteria.faster, spread), criteria),
        *noisy_cutoff(problem.data.summary.spectra, problem.data.lowpass.cutoff, criteria),
        *too_short(problem.data.summary.seconds, criteria),
        *never_moving(still),
        *faulty_logs(_harmful(problem.data.journal.faults, errors, there, criteria)),
        *disagreeing_logs(problem, posterior, _share(model), criteria),
        *as_one(
            wrong_signs([*posterior.contradicted, *_negative_rotors(posterior)], criteria, _values(fit)),
            indefinite_mass(model, least_inertia(model, map(_poses, problem.data.motions)), "fitted poses", criteria),
        ),
    ]
    return by_severity(found)


def _share(model: Model) -> Array:
    return np.ones(len(model.joints)) if model.fitted is None else model.fitted.model_share


def _harmful(
    faults: Sequence[tuple[str, LogIssue]],
    errors: Mapping[str, float],
    there: Comparison | None,
    criteria: AlarmCriteria,
) -> list[str]:
    """The faults of logs, without a wrong zero of a joint whose torque the fit predicts as well as noise allows.

    The check of a log knows only the URDF, and a wrong centre of mass of the URDF acts like a wrong zero. The fit finds
    the centre of mass. With another zero in one of the logs, it would leave an error on this joint.
    """
    floors = {} if there is None else {j.name: j.noise_floor for j in there.joints}
    quiet = {n for n, x in errors.items() if n in floors and x <= criteria.above_noise * floors[n]}
    return [f"{source}: {x.short}" for source, x in faults if x.kind != JOINT_ZERO or not quiet.issuperset(x.where)]


def _values(fit: Fit) -> dict[str, tuple[Column, float]]:
    """Parameter -> its column and its value in the model: of all with a prior, else of the base parameters."""
    e = fit.estimate
    if fit.posterior is None:
        return {c.name: (c, float(x)) for c, x in zip(e.columns, e.theta, strict=True)}
    columns = {c.name: c for c in fit.problem.regressor.columns}
    pairs = zip(fit.posterior.prior.names, fit.posterior.full, strict=True)
    return {name: (columns[name], float(x)) for name, x in pairs if name in columns}


def _some(motion: Motion) -> Motion:
    """At most `STATES` states of a motion, or a few more."""
    return motion.part(slice(None, None, max(1, len(motion.t) // STATES)))


def _poses(motion: Motion) -> tuple[Array, dict[str, Array]]:
    """Some positions of a motion, with the further channels there."""
    some = _some(motion)
    return some.q, dict(some.extra)


def _gains(problem: Problem, criteria: AlarmCriteria) -> list[Alarm]:
    """Whether the named gains of a controller give torques that such a robot can have."""
    controller, robot, joints = problem.data.options.controller, problem.data.robot, problem.data.joints
    if controller is None:
        return []
    index = [robot.joints.index(n) for n in joints]
    some = [_some(motion) for motion in problem.data.motions]
    tau = np.concatenate([motion.tau[:, index] for motion in some])
    links = np.concatenate([robot.inverse_dynamics(m.q, m.v, m.a)[:, index] for m in some])
    effort = robot.limits.effort[index]
    effort = np.where(effort > 0, effort, np.inf)
    return doubtful_gains(joints, (np.abs(tau).max(axis=0), tau.std(axis=0)), (effort, links.std(axis=0)), criteria)


def _posterior(fit: Fit) -> MapEstimate:
    """The fit with the prior, made for the alarms where the model does without."""
    if fit.posterior is not None:
        return fit.posterior
    problem = fit.problem
    rule = problem.data.options.prior_criteria.scale_rule
    return map_estimate(problem.blocks, problem.reduction.mapping, problem.urdf, rule)


def _disagreement(problem: Problem, posterior: MapEstimate, factor: float, spread: Array) -> dict[str, float]:
    """Joint -> difference of the two fits on the faster motion, over the standard deviation of the measured torque.

    Of a joint that is always at standstill, the logs know nothing: it counts as 1.
    """
    index = [problem.data.robot.joints.index(n) for n in problem.data.joints]
    steps = _steps_to_least_squares(problem, posterior)
    squares, count = np.zeros(len(index)), 0
    for Y, _ in run_faster(problem.regressor, problem.data.motions, factor):
        found = np.einsum("npj,pk->njk", Y[:, list(problem.reduction.base)][:, :, index], steps, optimize=True)
        squares, count = squares + (found**2).sum(axis=(0, 2)), count + len(found)
    ratio = np.sqrt(squares / max(count, 1)) / np.maximum(spread, 1e-150)
    ratio = np.where(problem.whole.counts > 0, ratio, 1.0)
    return dict(zip(problem.data.joints, ratio.tolist(), strict=True))


def _steps_to_least_squares(problem: Problem, posterior: MapEstimate) -> Array:
    """Independent steps (p, 1 + k) from the fit with the prior to the fits of the logs alone.

    The first leads to the least-squares solution along the directions that the logs determine, each of the others
    along one of the k other directions, by one standard deviation of the prior.
    """
    mapping, prior, moments = problem.reduction.mapping, posterior.prior, problem.whole.weighted(1 / posterior.variance)
    known = precision_root(mapping * prior.total_spread)
    unit = np.sqrt(np.diag(moments)[:-1])
    unit = np.where(unit > 0, unit, np.linalg.norm(known, axis=0))
    values, axes = linalg.eigh(moments[:-1, :-1] / np.outer(unit, unit))
    told = values > values[-1] / WORST_CONDITION**2
    pull = (moments[:-1, -1] - moments[:-1, :-1] @ posterior.theta) / unit
    certain = axes[:, told] @ ((axes[:, told].T @ pull) / values[told])
    open_axes = axes[:, ~told]
    free = open_axes @ np.linalg.inv(np.linalg.qr((known / unit) @ open_axes, mode="r"))
    return np.asarray(np.column_stack([certain, free]) / unit[:, None])


def run_faster(regressor: Regressor, motions: Iterable[Motion], factor: float) -> Iterator[tuple[Array, Array]]:
    """Columns (N, C, J) and speeds (N, J) along states of some motions at a multiple of their speed."""
    for motion in motions:
        some = _some(motion)
        v = factor * some.v
        states = Samples(some.t / factor, some.q, v, factor**2 * some.a, some.start / factor, some.extra)
        yield regressor.evaluate(states), v


def _negative_rotors(posterior: MapEstimate) -> list[tuple[str, float]]:
    """Rotor inertias that came out negative: by how many standard errors."""
    error = np.sqrt(np.diag(posterior.full_covariance))
    return [
        (name, float(-posterior.full[k] / error[k]))
        for k, name in enumerate(posterior.prior.names)
        if posterior.prior.negative[k] > 0 and posterior.full[k] < 0
    ]


def unpredicted(names: Sequence[str], limit: float, explained: Collection[str]) -> list[str]:
    """Warn of joints whose torque the model does not predict even on the logs it was fitted to.

    Parameters
    ----------
    names : sequence of str
        These joints.
    limit : float
        NRMSE above which the torque of a joint counts as not predicted.
    explained : collection of str
        Joints whose torque a fault explains that another warning names.
    """
    said = f"{HARDLY_PREDICTED} (cross-validated NRMSE above"
    known, open_ = [n for n in names if n in explained], [n for n in names if n not in explained]
    asked = "are columns swapped, a sign flipped, an angle in degrees, or a channel dead?"
    why = "a fault that another warning names may be the reason"
    found = [(known, why), (open_, asked)]
    return [f"the torque of {', '.join(some)} {said} {limit}): {words}" for some, words in found if some]


def held_at_poses(poses: Comparison) -> str:
    """The torque that is no gravity, and so the least dry friction, at poses of an arm at standstill."""
    most = {n: abs(j.worst.measured - j.worst.predicted) for n, j in poses.joints.items()}
    said = ", ".join(f"{name} {torque:.3g}" for name, torque in most.items())
    return (
        f"at standstill the torque differs from gravity by up to (N·m, N): {said}; dry friction of at least this size "
        "holds the joint there, or the model of gravity is wrong. Inertia and viscous friction are not fitted: record "
        "a motion"
    )
