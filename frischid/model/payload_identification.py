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
from scipy import special

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.errors import IdentifiabilityError, InputError, NoBodyError, UnknownNameError
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.recording import Recording
from frischid.model.identified_payload import IdentifiedPayload, payload_of
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.payload_alarms import DIFFERENT, alarms_with_body, unlike_with_body
from frischid.model.payload_carriers import carriers_before, other_carriers
from frischid.model.payload_fit import felt_on, fit_on_links, frame_name
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram
from frischid.robot.robot import LINK_PARAMETERS, Robot


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
    if LINK_PARAMETERS.index("m") not in (felt := felt_on(model, name)):
        what = f"{'the mass of ' if felt else ''}a body on the link of {name}"
        raise IdentifiabilityError(f"{what} changes no torque, so no log can weigh it; name another link (carrier)")
    motions = model.motions(logs)
    bodies = fit_on_links(model, list(motions), [name, *carriers_before(model, name)], frame)
    body = bodies[name]
    fit, phi, covariance, p = body.fit, body.phi, body.covariance, len(model.base)
    whole, names = total(body.blocks), (frame_name(robot, name, frame), name)
    unlike, by_chance = unlike_with_body(model, whole, fit.theta), _by_chance(fit.theta[p:], fit.covariance[p:, p:])
    if by_chance or phi[0] <= 0:
        limit = max(float(phi[0]), 0.0) + 2.0 * float(np.sqrt(covariance[0, 0]))
        raise NoBodyError(*names, limit, DIFFERENT if unlike or not by_chance else "")
    found = payload_of(names, phi, covariance, _errors(whole, fit.theta, model.estimate.theta), tuple(motions.notes))
    return replace(found, alarms=(*alarms_with_body(model, logs, unlike), *other_carriers(model, name, bodies)))


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


def _carrier(robot: Robot, wanted: str | None) -> str:
    if wanted is None:
        depth = [len(list(robot.model.supports[robot.numbers[n]])) for n in robot.joints]
        return robot.joints[int(np.argmax(depth))]
    if wanted not in robot.joints:
        raise UnknownNameError("joint", wanted, robot.joints)
    return wanted


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
