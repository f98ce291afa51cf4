"""The body that a robot carries: mass, centre of mass and inertia with bounds, from the model of the bare robot.

    τ = Y θ + Γ_last φ + noise,      θ ~ N(θ̂, C) of the model,      φ = (m, mc, I) of the body

The model's parameters are not fixed: they may move within their covariance, and friction by more. So what the bare
robot's model does not know widens the bounds of the body. The body has a wide prior (up to the robot's own mass, within
reach of a hand), which fills in what no motion of the log determines; the result says how much of each number came from
the log. The logs show a body only if φ̂ᵀ C_φ⁻¹ φ̂ exceeds what chance reaches in 5 % of the cases: χ² of as many numbers
as act on the torque, ten on the last link of an arm of six joints and one on a linear axis.

Source of the method with a known bare robot: Khalil, Gautier and Lemoine 2007, Identification of the payload inertial
parameters of industrial manipulators, IEEE ICRA.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg, special

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.effects.load import Payload
from frischid.errors import IdentifiabilityError, InputError, NoBodyError, UnknownNameError
from frischid.estimators.least_squares import Estimate, Prior, wls
from frischid.estimators.precision import precision_of
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.recording import Recording
from frischid.model.identified_payload import USUAL_REACH, IdentifiedPayload, payload_of
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.payload_alarms import DIFFERENT, alarms_with_body, unlike_with_body
from frischid.regression.accumulation import accumulate
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.robot.inertia import parameter_transform
from frischid.robot.robot import LINK_PARAMETERS, Robot

FRICTION_CHANGE = 0.2
"""Share. Friction and offsets change by so much from day to day, and with temperature (one standard deviation)."""
FLANGES = ("tool0", "flange", "link_ee", "ee_link", "link8", "tool")
"""Parts of the names that flange frames have in URDFs, the usual ones first."""


def payload(
    model: Model, logs: Logs, *, frame: str | None = None, carrier: str | None = None, mapping: MappingLike = None
) -> IdentifiedPayload:
    """Identify the body that a robot carries in some logs.

    Parameters
    ----------
    model : Model
        Of the robot without the body.
    logs : sequence of Log, Recording or data frame, or one data frame
        With the body; all with the same.
    frame : str, optional
        Frame of the URDF in whose axes, and from whose origin, the result is given; by default the flange's.
    carrier : str, optional
        Joint of the link that carries the body; the last joint of the longest chain by default.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    IdentifiedPayload

    Raises
    ------
    InputError
        A log cannot be used or is given twice, some logs are the model's own and others not, or the model has a payload
        already.
    NoBodyError
        These logs show no body.
    IdentifiabilityError
        The body, or its mass, changes no torque of the model.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motions = [fr.random_fourier(robot, 6.0, seed=seed) for seed in (1, 2)]
    >>> bare = fr.simulate(robot, motions[0], rate=100, noise=fr.Noise(tau=0.01))
    >>> model = fr.identify(robot, [bare], recursion="none").model
    >>> heavier = dict(zip(robot.all_names, robot.nominal)) | {"m2": robot.nominal[10] + 0.5}
    >>> loaded = fr.simulate(robot, motions[1], rate=100, parameters=heavier, noise=fr.Noise(tau=0.01))
    >>> body = fr.payload(model, [loaded])
    >>> abs(body.mass - 0.5) < body.bound["mass"]
    True
    """
    check_model(model)
    logs = as_logs(logs, model.robot.joints, mapping)
    robot, name = model.robot, _carrier(model.robot, carrier)
    _check_logs(model, logs)
    regressor = Regressor(robot, (*model.effects, Payload(joints=(name,), full=True)), model.reference)
    first = len(Regressor(robot, model.effects, model.reference).columns)
    felt = [LINK_PARAMETERS.index(c.name[1:].removesuffix(str(robot.numbers[name]))) for c in regressor.columns[first:]]
    if LINK_PARAMETERS.index("m") not in felt:
        what = f"{'the mass of ' if felt else ''}a body on the link of {name}"
        raise IdentifiabilityError(f"{what} changes no torque, so no log can weigh it; name another link (carrier)")
    motions = model.motions(logs)
    keep = [*model.base, *range(first, len(regressor.columns))]
    blocks = list(accumulate(regressor, list(motions), model.lowpass, model.joints, base=keep))
    H, p = robot_frame(robot, name, frame), len(model.base)
    fit, phi, covariance = _fit(model, blocks, felt, H[:3, 3])
    T = np.linalg.inv(parameter_transform(H))
    phi, covariance = T @ phi, T @ covariance @ T.T
    whole, names = total(blocks), (_frame_name(robot, name, frame), name)
    unlike, by_chance = unlike_with_body(model, whole, fit.theta), _by_chance(fit.theta[p:], fit.covariance[p:, p:])
    if by_chance or phi[0] <= 0:
        limit = max(float(phi[0]), 0.0) + 2.0 * float(np.sqrt(covariance[0, 0]))
        raise NoBodyError(*names, limit, DIFFERENT if unlike or not by_chance else "")
    found = payload_of(names, phi, covariance, _errors(whole, fit.theta, model.estimate.theta), tuple(motions.notes))
    return replace(found, alarms=alarms_with_body(model, logs, unlike))


def _check_logs(model: Model, logs: Sequence[Log | Recording]) -> None:
    """Refuse a model with a payload, and logs that are not all with the body or all without."""
    if any(effect.id == "payload" for effect in model.effects):
        raise InputError("the model has a payload already; give the model of the robot without it")
    if not logs:
        raise InputError("there is no log with the body; give at least one")
    model.check(logs)
    bare = [log.source for log in logs if model.made_from(log)]
    if 0 < len(bare) < len(logs):
        raise InputError(
            f"the model of the robot without the body was fitted to {listed(bare)}, and all logs must be recorded with "
            f"the same body; leave {'them' if len(bare) > 1 else 'it'} out"
        )


def _fit(model: Model, blocks: Sequence[Gram], felt: Sequence[int], flange: Array) -> tuple[Estimate, Array, Array]:
    """Fit the model's parameters and the body's together.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of the model's base parameters and of the body's parameters.
    felt : sequence of int
        The parameters of the ten that act on the torque.
    flange : ndarray, shape (3,)
        Place of the flange in the link's frame, m.

    Returns
    -------
    Estimate
        Of the model's parameters, then of those that are felt.
    ndarray, shape (10,)
        Parameters of the body.
    ndarray, shape (10, 10)
        Their covariance.
    """
    p, precision = len(model.base), precision_of(_model_covariance(model))
    robot_mass = max(float(model.robot.nominal[0::10].sum()), 1.0)
    mean, phi, mass = np.concatenate([model.estimate.theta, np.zeros(len(felt))]), np.zeros(10), 0.3 * robot_mass
    for _ in range(3):  # the spreads of the prior follow the mass
        covariance = _prior_covariance(mass, flange)
        own = np.linalg.inv(covariance[np.ix_(felt, felt)])
        fit = wls(blocks, prior=Prior(mean, linalg.block_diag(precision, own)))
        phi[felt], covariance[np.ix_(felt, felt)] = fit.theta[p:], fit.covariance[p:, p:]
        mass = max(abs(float(phi[0])), 0.02 * robot_mass)
    return fit, phi, covariance


def _carrier(robot: Robot, wanted: str | None) -> str:
    if wanted is None:
        depth = [len(list(robot.model.supports[robot.numbers[n]])) for n in robot.joints]
        return robot.joints[int(np.argmax(depth))]
    if wanted not in robot.joints:
        raise UnknownNameError("joint", wanted, robot.joints)
    return wanted


def _frame_name(robot: Robot, carrier: str, wanted: str | None) -> str:
    """The wanted frame of the carrier's body, or the one whose name says flange."""
    frames = {f.name: f for f in robot.model.frames if f.parentJoint == robot.numbers[carrier]}
    if wanted is not None:
        if wanted not in frames:
            raise UnknownNameError(f"frame on the body of {carrier}", wanted, frames)
        return wanted
    for part in FLANGES:
        for name in frames:
            if name == part or name.endswith(f"_{part}") or name.endswith(f"-{part}"):
                return str(name)
    return f"joint {carrier}"


def robot_frame(robot: Robot, carrier: str, wanted: str | None) -> Array:
    """Pose of the result's frame in the frame of the carrier's parameters, (4, 4)."""
    name = _frame_name(robot, carrier, wanted)
    H = np.eye(4)
    for frame in robot.model.frames:
        if frame.name == name and frame.parentJoint == robot.numbers[carrier]:
            H = np.asarray(frame.placement.homogeneous)
    own = np.asarray(robot.frame_placement(carrier).homogeneous)
    return np.asarray(np.linalg.inv(own) @ H)


def _model_covariance(model: Model) -> Array:
    """Covariance of the model's parameters, with the change of friction from day to day.

    The covariance of a fleet's model comes from few robots and leaves directions without any uncertainty. What one
    robot of the fleet may differ by is in its information.
    """
    covariance = np.array(model.estimate.covariance)
    sizes = np.sqrt(np.diag(covariance))
    if np.linalg.matrix_rank(covariance / np.outer(sizes, sizes)) < len(covariance):
        covariance = np.array(np.linalg.inv(model.estimate.information), dtype=np.float64)
    rigid = np.array([column.effect == "rigid" for column in model.estimate.columns])
    change = np.where(rigid, 0.0, FRICTION_CHANGE * np.abs(model.estimate.theta))
    floor = 1e-12 * np.maximum(np.abs(model.estimate.theta), 1e-6) ** 2
    return covariance + np.diag(change**2 + floor)


def _prior_covariance(mass: float, flange: Array) -> Array:
    """A body of about this mass, up to three times as heavy, somewhere around the flange."""
    reach = USUAL_REACH + float(np.linalg.norm(flange))
    spread = 3 * mass * np.array([1.0, *[reach] * 3, *[reach**2] * 6])
    return np.diag(spread**2)


def _errors(whole: Gram, theta: Array, bare: Array) -> tuple[float, float]:
    """Mean NRMSE of the joints that move, with the body and without it."""
    spread = whole.torque_ss()
    moving = spread > 0
    without = np.concatenate([bare, np.zeros(len(theta) - len(bare))])
    one, other = (float(np.mean(np.sqrt(whole.residual_ss(x)[moving] / spread[moving]))) for x in (theta, without))
    return one, other


def _by_chance(phi: Array, covariance: Array) -> bool:
    """Whether chance explains the numbers of a body that act on the torque."""
    spread = np.sqrt(np.diag(covariance))  # kilograms and kg·m² differ by many powers of ten
    far = phi / spread @ np.linalg.solve(covariance / np.outer(spread, spread), phi / spread)
    return bool(far <= special.chdtri(len(phi), 0.05))
