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

import json
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import special
from scipy.spatial.transform import Rotation

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.effects.load import Payload
from frischid.errors import IdentifiabilityError, InputError, NoBodyError, UnknownNameError
from frischid.estimators.least_squares import Prior, wls
from frischid.estimators.precision import precision_of
from frischid.logs.given import Logs, as_logs
from frischid.logs.mapping import MappingLike
from frischid.model.alarms import Alarm
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.payload_alarms import DIFFERENT, alarms_with_body, unlike_with_body
from frischid.regression.accumulation import accumulate
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.robot.inertia import dynamic_parameters, parameter_transform, pseudo_inertia
from frischid.robot.robot import LINK_PARAMETERS, Robot

USUAL_REACH = 0.15
"""m. Standard deviation of the body's centre of mass from the flange, and of its radius of gyration, in its prior."""
FRICTION_CHANGE = 0.2
"""Share. Friction and offsets change by so much from day to day, and with temperature (one standard deviation)."""
FLANGES = ("tool0", "flange", "link_ee", "ee_link", "link8", "tool")
"""Parts of the names that flange frames have in URDFs, the usual ones first."""
BODY_NUMBERS = ("mass", "x", "y", "z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True, eq=False)
class IdentifiedPayload:
    """A body on a robot's last link, in the axes of a frame of the flange.

    Attributes
    ----------
    frame : str
        Frame of the URDF, or ``"joint <name>"``.
    carrier : str
        Joint of the link that carries the body.
    mass : float
        kg.
    centre : ndarray, shape (3,)
        Centre of mass, m.
    inertia : ndarray, shape (3, 3)
        About the centre of mass, kg·m².
    bound : dict of str to float
        Half width of the 95 % bound of ``mass``, ``x``, ``y``, ``z``, ``Ixx``, ..., ``Izz``.
    from_log : dict of str to float
        How well the log determines each number, 0 to 1: 1 − its variance ÷ the variance without a log. Without a log,
        the centre and the radius of gyration of a body of this mass are within `USUAL_REACH`.
    error, error_without : float
        Mean NRMSE of the joints with the body, and without it.
    notes : tuple of str
    alarms : tuple of Alarm
        Reasons not to enter these numbers: the logs differ from the model in another way, too.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> body = fr.IdentifiedPayload("tool0", "wrist_3", 2.5, np.array([0, 0, 0.1]), 0.01 * np.eye(3), {}, {}, 0.05, 0.4)
    >>> body.ur()
    'set_target_payload(2.5, [0.0, 0.0, 0.1], [0.01, 0.01, 0.01, 0.0, 0.0, 0.0])'
    """

    frame: str
    carrier: str
    mass: float
    centre: Array
    inertia: Array
    bound: dict[str, float]
    from_log: dict[str, float]
    error: float
    error_without: float
    notes: tuple[str, ...] = ()
    alarms: tuple[Alarm, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "frame": self.frame,
            "carrier": self.carrier,
            "mass": self.mass,
            "center_of_mass": self.centre.tolist(),
            "inertia": self.inertia.tolist(),
            "bound_95": dict(self.bound),
            "from_log": dict(self.from_log),
            "nrmse": self.error,
            "nrmse_without": self.error_without,
            "notes": list(self.notes),
            "alarms": [alarm.to_dict() for alarm in self.alarms],
            "enter": {"franka": self.franka(), "ur": self.ur(), "kuka": self.kuka()},
        }

    @property
    def values(self) -> dict[str, float]:
        """The ten numbers by the names of `bound`."""
        at = self.inertia
        six = (at[0, 0], at[0, 1], at[1, 1], at[0, 2], at[1, 2], at[2, 2])
        return dict(zip(BODY_NUMBERS, map(float, (self.mass, *self.centre, *six)), strict=True))

    def franka(self) -> str:
        """Fields of Franka's ``SetLoad`` (libfranka: ``robot.setLoad``), inertia column by column."""
        fields = {
            "mass": _short(self.mass),
            "center_of_mass": [_short(x) for x in self.centre],
            "load_inertia": [_short(x) for x in self.inertia.T.ravel()],
        }
        return json.dumps(fields)

    def ur(self) -> str:
        """A line of URScript."""
        v = self.values
        six = ", ".join(f"{_short(v[k])}" for k in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))
        centre = ", ".join(f"{_short(x)}" for x in self.centre)
        return f"set_target_payload({_short(self.mass)}, [{centre}], [{six}])"

    def kuka(self) -> str:
        """KUKA's ``LOAD`` in KRL: mm, principal moments, and their axes as A, B, C in degrees."""
        moments, axes = np.linalg.eigh(self.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # at a quarter turn two angles are one, and the third is zero
            a, b, c = Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)
        x, y, z = (_short(1e3 * u) for u in self.centre)
        j = ", ".join(f"{n} {_short(u)}" for n, u in zip("XYZ", moments, strict=True))
        turned = f"A {a:.1f}, B {b:.1f}, C {c:.1f}"
        return f"LOAD_DATA[1] = {{M {_short(self.mass)}, CM {{X {x}, Y {y}, Z {z}, {turned}}}, J {{{j}}}}}"


def _short(x: float) -> float:
    return float(f"{x:.4g}") + 0.0


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
    body = Payload(joints=(name,), full=True)
    regressor = Regressor(robot, (*model.effects, body), model.reference)
    first = len(Regressor(robot, model.effects, model.reference).columns)
    felt = [LINK_PARAMETERS.index(c.name[1:].removesuffix(str(robot.numbers[name]))) for c in regressor.columns[first:]]
    if LINK_PARAMETERS.index("m") not in felt:
        what = f"{'the mass of ' if felt else ''}a body on the link of {name}"
        raise IdentifiabilityError(f"{what} changes no torque, so no log can weigh it; name another link (carrier)")
    motions = model.motions(logs)
    keep = [*model.base, *range(first, len(regressor.columns))]
    blocks = list(accumulate(regressor, list(motions), model.lowpass, model.joints, base=keep))
    p = len(model.base)
    robot_mass = max(float(robot.nominal[0::10].sum()), 1.0)
    H = robot_frame(robot, name, frame)
    precision = precision_of(_model_covariance(model))
    phi, covariance = np.zeros(10), np.zeros((10, 10))
    mass = 0.3 * robot_mass
    for _ in range(3):  # the spreads of the prior follow the mass
        before = _prior_covariance(mass, H[:3, 3])
        own = np.linalg.inv(before[np.ix_(felt, felt)])
        whole = np.block([[precision, np.zeros((p, len(felt)))], [np.zeros((len(felt), p)), own]])
        mean = np.concatenate([model.estimate.theta, np.zeros(len(felt))])
        fit = wls(blocks, prior=Prior(mean, whole))
        phi[felt], covariance = fit.theta[p:], before.copy()
        covariance[np.ix_(felt, felt)] = fit.covariance[p:, p:]
        mass = max(abs(float(phi[0])), 0.02 * robot_mass)
    moments = total(blocks)
    errors, unlike = _errors(moments, fit.theta, model.estimate.theta), unlike_with_body(model, moments, fit.theta)
    names, chance = (_frame_name(robot, name, frame), name), _by_chance(fit.theta[p:], fit.covariance[p:, p:])
    found = _in_frame((phi, covariance), H, names, errors, tuple(motions.notes), (chance, bool(unlike)))
    return replace(found, alarms=alarms_with_body(model, logs, unlike))


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


def _in_frame(
    found: tuple[Array, Array],
    H: Array,
    names: tuple[str, str],
    errors: tuple[float, float],
    notes: tuple[str, ...],
    doubts: tuple[bool, bool],
) -> IdentifiedPayload:
    """The ten parameters as mass, centre and inertia about it, with bounds by the derivative of this change.

    The doubts are whether chance explains the body, and whether the logs differ from the model in another way.
    """
    by_chance, unlike = doubts
    T = np.linalg.inv(parameter_transform(H))
    phi, covariance = T @ found[0], T @ found[1] @ T.T
    if by_chance or phi[0] <= 0:
        limit = max(float(phi[0]), 0.0) + 2.0 * float(np.sqrt(covariance[0, 0]))
        raise NoBodyError(*names, limit, DIFFERENT if unlike or not by_chance else "")
    slope = np.empty((10, 10))
    for k in range(10):
        step = np.zeros(10)
        step[k] = 1e-4 * max(float(np.sqrt(covariance[k, k])), 1e-9)
        slope[:, k] = (_numbers(phi + step) - _numbers(phi - step)) / (2 * step[k])
    spread = np.sqrt(np.diag(slope @ covariance @ slope.T))
    usual = phi[0] * np.array([1.0, *[USUAL_REACH / phi[0]] * 3, *[USUAL_REACH**2] * 6])
    known = np.clip(1 - (spread / usual) ** 2, 0, 1)
    physical, changed = _physical(phi)
    values = _numbers(physical)
    xx, xy, yy, xz, yz, zz = values[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    half = special.ndtri(0.975) * spread
    if values[0] <= half[0]:
        notes = (*notes, "the mass is within its bound of zero: these logs show the body by its centre and inertia")
    if changed:
        notes = (*notes, "the inertia is the nearest that a body can have: the log determines it weakly")
    return IdentifiedPayload(
        *names,
        float(values[0]),
        values[1:4],
        inertia,
        dict(zip(BODY_NUMBERS, map(float, half), strict=True)),
        dict(zip(BODY_NUMBERS, map(float, known), strict=True)),
        *errors,
        notes,
    )


def _numbers(phi: Array) -> Array:
    """Mass, centre, and inertia about the centre (Ixx, Ixy, Iyy, Ixz, Iyz, Izz)."""
    P = pseudo_inertia(phi)
    c = P[:3, 3] / P[3, 3]
    P[:3, :3] -= P[3, 3] * np.outer(c, c)
    return np.concatenate([[P[3, 3]], c, dynamic_parameters(P)[4:]])


def _physical(phi: Array) -> tuple[Array, bool]:
    """The nearest body that can exist, with the same mass and centre; and whether it differs."""
    P = pseudo_inertia(phi)
    m, c = P[3, 3], P[:3, 3] / P[3, 3]
    values, axes = np.linalg.eigh(P[:3, :3] - m * np.outer(c, c))
    least = 1e-6 * m
    changed = bool(values[0] < least)
    P[:3, :3] = (axes * np.maximum(values, least)) @ axes.T + m * np.outer(c, c)
    return dynamic_parameters(P), changed
