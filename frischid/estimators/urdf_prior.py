"""The URDF as a prior: each parameter's value in the URDF, and the usual error of such a value.

    θ ~ N(θ_URDF, d²),   a link of mass m and size L:   d_m = a,   d_first moment = a L,   d_inertia = a L²,

with a = m / 2 + m_max / 10 and L = √(½ tr I / m), the root-mean-square distance of its mass from the joint. If the URDF
does not say what its links weigh, L is that of a rod from the joint to the next one, and all d are so large that the
first of the parameters alone would cause the measured torque. An effect
has mean zero, because the damping in a URDF is not measured. Its standard deviation is the value at which the effect
alone would cause the measured torque, or a usual share of that value (`Effect.usual`). A rotor's inertia on the joint's
side is usually at most ten times the inertia of the links; a torque sensor behind the gear measures little of it, and
possibly a small negative value. The fingers of a hand and small servos with high gear ratios have hundreds of times the
links' inertia.

`frischid.estimators.map_estimate` finds from the data how good this URDF is, link by link, and how large each rotor is.

Source: Gautier, Janot and Vandanjon 2013, IEEE T-CST 21(2), on least squares for robots; Atkeson, An and Hollerbach
1986, IJRR 5(3), on what of a link a motion shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from frischid.core.types import Array, Column
from frischid.effects.dynamics import RigidDynamics, random_states
from frischid.estimators.least_squares import Prior
from frischid.estimators.map_estimate import MapEstimate
from frischid.estimators.parameter_prior import ParameterPrior, ScaleRule
from frischid.regression.base_parameters import Reduction
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor, nominal_parameters, usual_shares
from frischid.robot.robot import Robot
from frischid.robot.scale import RobotScale
from frischid.robot.stated_inertials import length_order, link_lengths, unstated


@dataclass(frozen=True)
class PriorCriteria:
    """Every number that decides the URDF prior.

    The experiment behind them: 25 pairs of measured logs of five robots, held out, and URDFs whose links were wrong by
    factors of 0.5 to 2 (`benchmarks/trust.py`). None was fitted to one robot.
    """

    mass_share: float = 0.5
    """Standard deviation of a link's mass, as a share of that mass."""
    heaviest_share: float = 0.1
    """A further share, of the heaviest link's mass, so that a link which the URDF gives no mass may still have some."""
    least_size: float = 0.05
    largest_size: float = 1.0
    """`least_size`, `largest_size`: m. Bounds of a link's size L, for URDFs whose inertias are zero or impossible, of a
    robot of 1 m; a shorter robot's least and a longer robot's largest size are in proportion (`frischid.robot.scale`).
    """
    rotor: float = 10.0
    """Standard deviation of a rotor's inertia at scale 1, as a multiple of the links' mean inertia about its joint."""
    rotor_opposite: float = 0.3
    """The same on the negative side, which only a sensor behind the gear can show."""
    scale_freedom: float = 4.0
    """Weight of the assumption that a scale is 1, as a number of parameters; a link has ten, a rotor one."""
    least_scale: float = 0.03
    largest_scale: float = 1e4
    """`least_scale`, `largest_scale`: Bounds of a scale."""

    @property
    def scale_rule(self) -> ScaleRule:
        """How a link's scale follows from the data."""
        return ScaleRule(self.scale_freedom, self.least_scale, self.largest_scale)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class UrdfPrior:
    """The prior that a model was fitted with, as part of the model."""

    parameters: ParameterPrior
    """With the scales that the logs gave."""
    rows: float
    """κ, rows that each joint's data counted for."""
    value: Array
    """Every parameter given the logs, in its unit, (C,)."""
    from_log: Array
    """Share of the knowledge of each parameter that came from the logs, (C,)."""

    @classmethod
    def of(cls, fit: MapEstimate) -> UrdfPrior:
        """Of an estimate."""
        return cls(fit.prior, fit.rows, fit.full, fit.from_log)

    def extended(self, columns: Sequence[Column], values: Array) -> UrdfPrior:
        """The same with further parameters, for which the prior is nearly flat.

        Parameters
        ----------
        values : ndarray, shape (k,)
            Their values; the prior is ten times as wide.
        """
        prior, k = self.parameters, len(columns)
        wide = 10.0 * np.maximum(np.abs(values), 1e-9)
        wider = ParameterPrior(
            (*prior.names, *(c.name for c in columns)),
            np.append(prior.mean, np.zeros(k)),
            np.append(prior.spread, wide),
            (*prior.group, *[""] * k),
            np.append(prior.nonnegative, [c.sign > 0 for c in columns]),
            np.append(prior.negative, np.zeros(k)),
            prior.scales,
        )
        return UrdfPrior(wider, self.rows, np.append(self.value, values), np.append(self.from_log, np.ones(k)))

    def moved(self, mapping: Array, theta: Array, covariance: Array) -> UrdfPrior:
        """The same with other base parameters; the prior says how the values of all parameters follow them.

        θ' = θ + G (θ_b − K θ),   C = S − G K S + G C_b Gᵀ,   G = S Kᵀ (K S Kᵀ)⁻¹,   S the prior's covariance

        Parameters
        ----------
        mapping : ndarray, shape (p, C)
            K in ``θ_b = K θ``.
        theta : ndarray, shape (p,)
            The base parameters θ_b.
        covariance : ndarray, shape (p, p)
            Theirs, C_b.
        """
        spread = self.parameters.total_spread
        root = mapping * spread
        gain = (root * spread).T @ gaussian(np.zeros(len(theta)), root).precision
        left = spread**2 - np.einsum("cp,pc->c", gain, root * spread)
        variance = np.maximum(left, 0.0) + np.einsum("cp,pq,cq->c", gain, covariance, gain)
        from_log = np.clip(1.0 - variance / spread**2, 0.0, 1.0)
        return replace(self, value=self.value + gain @ (theta - mapping @ self.value), from_log=from_log)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        prior = self.parameters
        return {
            "kind": "urdf",
            "rows": self.rows,
            "scales": dict(prior.scales),
            "parameters": [
                {
                    "name": name,
                    "mean": float(prior.mean[k]),
                    "spread": float(prior.spread[k]),
                    "negative": float(prior.negative[k]),
                    "nonnegative": bool(prior.nonnegative[k]),
                    "group": prior.group[k],
                    "value": float(self.value[k]),
                    "from_log": float(self.from_log[k]),
                }
                for k, name in enumerate(prior.names)
            ],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> UrdfPrior:
        """Inverse of `to_dict`."""
        rows = data["parameters"]
        column = {key: [row[key] for row in rows] for key in ("mean", "spread", "negative", "value", "from_log")}
        prior = ParameterPrior(
            tuple(row["name"] for row in rows),
            np.array(column["mean"], dtype=float),
            np.array(column["spread"], dtype=float),
            tuple(row["group"] for row in rows),
            np.array([row["nonnegative"] for row in rows], dtype=bool),
            np.array(column["negative"], dtype=float),
            dict(data["scales"]),
        )
        value, from_log = np.array(column["value"], dtype=float), np.array(column["from_log"], dtype=float)
        return cls(prior, float(data["rows"]), value, from_log)


def urdf_prior(
    regressor: Regressor, reduction: Reduction, whole: Gram, criteria: PriorCriteria | None = None
) -> ParameterPrior:
    """The URDF as a prior of all parameters of a regressor.

    Parameters
    ----------
    reduction : Reduction
        Base parameters of `regressor`.
    whole : Gram
        Moments of the base columns, for the size of effects.

    Returns
    -------
    ParameterPrior
        Of the C columns of `regressor`, every link and rotor at scale 1.
    """
    criteria = criteria or PriorCriteria()
    robot, columns = regressor.robot, regressor.columns
    rigid = np.array([c.effect == "rigid" for c in columns])
    rotor = np.array([c.effect == "rotor_inertia" for c in columns])
    links = link_spread(regressor, criteria)
    effects = _effect_spread(reduction, whole) * usual_shares(robot, regressor.effects)
    share = effects[rigid] / links[rigid]
    if unstated(robot) and (share > 0).any():  # the torques say how heavy the robot is
        links = links * share[share > 0].min()
    inertia = _joint_inertias(robot, links, regressor)
    about = np.array([inertia.get(c.joint, 0.0) for c in columns])
    spread = np.where(rigid, links, np.where(rotor, np.minimum(effects, criteria.rotor * about), effects))
    return ParameterPrior(
        tuple(c.name for c in columns),
        np.where(rigid, nominal_parameters(robot, regressor.effects), 0.0),
        spread,
        tuple(_group(c) for c in columns),
        np.array([c.sign > 0 and c.effect != "rigid" for c in columns]),
        np.where(rotor, criteria.rotor_opposite * about, 0.0),
        {},
    )


def _group(column: Column) -> str:
    """Parameters that share a scale: those of a link; a rotor has a scale of its own."""
    return {"rigid": column.joint, "rotor_inertia": f"rotor of {column.joint}"}.get(column.effect, "")


def link_spread(regressor: Regressor, criteria: PriorCriteria | None = None) -> Array:
    """Usual errors of a URDF's rigid parameters.

    Returns
    -------
    ndarray, shape (C,)
        One standard deviation in each parameter's unit; NaN for columns that are not rigid.
    """
    criteria, robot = criteria or PriorCriteria(), regressor.robot
    nominal = dict(zip(robot.all_names, robot.nominal, strict=True))
    length = RobotScale.of(robot).length
    sizes = criteria.least_size * min(length, 1.0), criteria.largest_size * max(length, 1.0)
    heaviest = max(nominal[f"m{i}"] for i in robot.numbers.values()) or 1.0
    spread, size = np.full(len(regressor.columns), np.nan), _sizes(robot, nominal)
    for k, column in enumerate(regressor.columns):
        if column.effect == "rigid":
            body = column.name.lstrip("mxyzI")
            mass = criteria.mass_share * max(nominal[f"m{body}"], 0.0) + criteria.heaviest_share * heaviest
            spread[k] = mass * np.clip(size[int(body)], *sizes) ** length_order(column.name)
    return spread


def _sizes(robot: Robot, nominal: Mapping[str, float]) -> dict[int, float]:
    """Root-mean-square distance of each link's mass from its joint, m; of a rod where the URDF does not say."""
    found: dict[int, float] = {}
    stated, lengths = not unstated(robot), link_lengths(robot)
    for body in robot.numbers.values():
        mass = nominal[f"m{body}"]
        squares = 0.5 * sum(nominal[f"I{axis}{axis}{body}"] for axis in "xyz")
        known = stated and mass > 0
        found[body] = float(np.sqrt(max(squares, 0.0) / mass)) if known else lengths[body] / np.sqrt(3)  # of a rod
    return found


def _joint_inertias(robot: Robot, links: Array, regressor: Regressor) -> dict[str, float]:
    """Mean inertia of the links about each joint, kg·m² (kg); at least the usual error of the URDF's inertia."""
    slopes = RigidDynamics.of(robot, None).slopes(*random_states(robot, 16))
    mean = np.abs(np.einsum("njj->nj", slopes.acceleration)).mean(axis=0)
    sliding = {name for name, slides in zip(robot.joints, robot.prismatic, strict=True) if slides}
    doubt = {
        c.joint: spread
        for c, spread in zip(regressor.columns, links, strict=True)
        if c.name.rstrip("0123456789") == ("m" if c.joint in sliding else "Izz")
    }
    return {name: max(float(x), doubt.get(name, 0.0)) for name, x in zip(robot.joints, mean, strict=True)}


def _effect_spread(reduction: Reduction, whole: Gram) -> Array:
    """Values of each parameter, (C,), at which the parameter alone would cause the measured torque."""
    K = reduction.mapping  # a column is the base columns times its column of K, and so is its power
    power = np.maximum(np.einsum("pc,jpq,qc->jc", K, whole.moments[:, :-1, :-1], K, optimize=True), 0.0)
    measured = whole.moments[:, -1, -1]
    spread = np.ones(power.shape[1])
    for k in range(len(spread)):
        felt = power[:, k] > 1e-12 * power[:, k].max()
        if felt.any():
            spread[k] = np.sqrt((measured[felt] / power[felt, k]).min())
    return spread


def gaussian(mean: Array, scaled: Array) -> Prior:
    """The prior N(mean, scaled scaledᵀ), kept invertible in directions without a spread of their own.

    Parameters
    ----------
    mean : ndarray, shape (p,)
    scaled : ndarray, shape (p, C)
        A root of the covariance.
    """
    correlation, scale = _invertible(scaled)
    return Prior(mean, np.linalg.inv(correlation) / np.outer(scale, scale))


def precision_root(scaled: Array) -> Array:
    """Rows W, (p, p), with WᵀW the precision of `gaussian`; a product WᵀW would lose half of the digits."""
    correlation, scale = _invertible(scaled)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(correlation)) / scale)


def _invertible(scaled: Array) -> tuple[Array, Array]:
    """Correlation of `scaled scaledᵀ`, with something added to its diagonal, and standard deviations (p,)."""
    covariance = scaled @ scaled.T
    scale = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))), np.asarray(scale)
