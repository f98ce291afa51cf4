"""The fit of a body on one link of a robot, beside the parameters of the bare robot's model.

τ = Y θ + Γ_link φ + noise,      θ ~ N(θ̂, C) of the model,      φ = (m, mc, I) of the body
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from frischid.core.types import Array, Column
from frischid.effects.load import Payload
from frischid.errors import UnknownNameError
from frischid.estimators.least_squares import Estimate, Prior, wls
from frischid.estimators.precision import precision_of
from frischid.logs.preprocessing import Motion
from frischid.model.identified_payload import USUAL_REACH
from frischid.model.model import Model
from frischid.regression.accumulation import accumulate
from frischid.regression.moment_blocks import Blocks
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.robot.inertia import parameter_transform
from frischid.robot.robot import LINK_PARAMETERS, Robot

FRICTION_CHANGE = 0.2
"""Share. Friction and offsets change by so much from day to day, and with temperature (one standard deviation)."""
FLANGES = ("tool0", "flange", "link_ee", "ee_link", "link8", "tool")
"""Parts of the names that flange frames have in URDFs, the usual ones first."""


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A body that is fitted on a link."""

    felt: Sequence[int]
    """The parameters of the ten that act on the torque."""
    blocks: Blocks
    """Moments of the logs: the model's base parameters, then those of the body that are felt."""
    fit: Estimate
    """Of the model's parameters, then of those that are felt."""
    phi: Array
    """Parameters of the body in the wanted frame, (10,)."""
    covariance: Array
    """Their covariance, (10, 10)."""


def felt_on(model: Model, name: str) -> list[int]:
    """The parameters of the ten of a body on the link behind a joint that act on the torque."""
    return _felt(Payload((name,), full=True).columns(model.robot), str(model.robot.numbers[name]))


def _felt(columns: Sequence[Column], number: str) -> list[int]:
    return [LINK_PARAMETERS.index(c.name[1:].removesuffix(number)) for c in columns]


def fit_on_links(
    model: Model, motions: Sequence[Motion], names: Sequence[str], frame: str | None = None
) -> dict[str, BodyFit]:
    """Fit a body on the link behind each of some joints, one link at a time, from one pass over the motions.

    Parameters
    ----------
    motions : sequence of Motion
        Of the logs with the body.
    names : sequence of str
        Joints, the named one first.
    frame : str, optional
        Frame of the URDF in which the body's parameters on the first link are given; by default the flange's.

    Returns
    -------
    dict of str to BodyFit
        All with the same blocks of time.
    """
    robot, p = model.robot, len(model.base)
    regressor = Regressor(robot, (*model.effects, Payload(tuple(names), full=True)), model.reference)
    own = Payload(tuple(names), full=True).columns(robot)
    keep = [*model.base, *range(len(regressor.columns) - len(own), len(regressor.columns))]
    blocks = accumulate(regressor, motions, model.lowpass, model.joints, base=keep)
    found = {}
    for name in names:
        there = [k for k, column in enumerate(own) if column.joint == name]
        felt = _felt([own[k] for k in there], str(robot.numbers[name]))
        of_link = Blocks(block.select([*range(p), *(p + k for k in there)]) for block in blocks)
        H = robot_frame(robot, name, frame if name == names[0] else None)
        fit, phi, covariance = _fit(model, of_link, felt, H[:3, 3])
        T = np.linalg.inv(parameter_transform(H))
        found[name] = BodyFit(felt, of_link, fit, T @ phi, T @ covariance @ T.T)
    return found


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


def frame_name(robot: Robot, carrier: str, wanted: str | None) -> str:
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
    name = frame_name(robot, carrier, wanted)
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
