"""Output error: parameters whose simulated motion is nearest to the measured motion.

    min over θ:   Σ_k Σ_t Σ_j ((q_sim,j(t; θ, s_k) − q_j(t)) / σ_j)²

The logs are cut into stretches. In each, the model moves from the measured start s_k, under the recorded torque or, in
a log of commands, under its controller. No acceleration and no filter is needed. Gauss-Newton starts at the linear
answer. `frischid.forward.tangents` carries the derivatives along the simulation.

The singular values of the Jacobian say what the motion determines: J = U diag(s) Vᵀ in units of the linear answer's
standard errors and of the rms residual. Of a direction with s < 1 the motion knows less
than the linear answer, even if the errors were white. Such a direction stays at the linear answer, and is named. Errors
of simulated positions are correlated in time, because errors of torque add up. So the covariance of the directions that
move comes from leaving out one of K pieces of the motion at a time (the block jackknife),

    C = V diag(κ_i / s_i²) Vᵀ,   κ_i = (1 − 1/K) Σ_k δ_ki²,   δ_k = (I − U_kᵀU_k)⁻¹ U_kᵀ r_k,

with U_k the rows of U in piece k, r_k their residuals, and δ_k the change of the solution without the piece, in the
directions' own units. No κ_i counts as smaller than the mean over the directions.

Sources: Gautier, Janot and Vandanjon 2013, "A new closed-loop output error method for parameter identification of robot
dynamics", IEEE Trans. Control Systems Technology 21(2); Bock 1983, multiple shooting; MacKinnon, Nielsen
and Webb 2023, J. Applied Econometrics 38(5), on leaving out clusters of correlated errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from frischid.core.arguments import check_kind
from frischid.core.shown import Shown
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.estimators.least_squares import Estimate
from frischid.estimators.precision import precision_of
from frischid.estimators.urdf_prior import UrdfPrior
from frischid.forward.motion_error import MotionComparison, compare_simulated
from frischid.forward.shooting import SMALLEST_PATH, Jacobian, OutputErrorOptions, Shooting
from frischid.logs.given import Logs, as_logs
from frischid.logs.mapping import MappingLike
from frischid.logs.poses import need_motion
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.own_logs import log_entry
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

UNSTABLE_ERROR = 1e6
"""Scaled residual of a motion that ran away: the trust region turns back."""
TOLERANCE = 1e-6
"""Relative change of the parameters, and of the sum of squares, at which a fit ends."""
KEPT_SHARE = 0.5
"""Share of a parameter's variance in directions that keep the linear answer, above which the parameter is named."""
KEPT_CHANGE = 1.0
"""Change of a parameter, in standard errors of the linear answer, above which it has not kept its value."""


@dataclass(frozen=True, eq=False)
class OutputError(Shown):
    """A model fitted to motion.

    Attributes
    ----------
    model : Model
    ratio : float
        Rms error of the simulated positions on the fitted logs, over that of the linear answer; each
        joint by its own rms error.
    singular_values : ndarray
        Descending, one for each combination of parameters: its standard error in the linear answer, over the standard
        error that the motion alone would give with white errors. Above 1, the motion knows more.
    kept : tuple of str
        Parameters that keep their linear values within a standard error, and more than half of whose uncertainty lies
        in combinations that the motion does not determine.
    inflation : float
        Factor by which correlation of the errors in time inflates variances.
    tested : (MotionComparison, MotionComparison) or None
        Simulated error on logs that were not fitted, of the linear answer and of this model.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 2.0, seed=1), rate=100.0, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> linear = fr.identify(robot, [log], effects=fr.parse_effects("viscous"), recursion="none").model
    >>> found = fr.output_error(linear, [log], options=fr.OutputErrorOptions(horizon=0.5, rounds=1, iterations=3))
    >>> len(found.singular_values) == len(linear.estimate.theta), found.tested
    (True, None)
    """

    model: Model
    ratio: float
    singular_values: Array
    kept: tuple[str, ...]
    inflation: float
    tested: tuple[MotionComparison, MotionComparison] | None = None

    def __repr__(self) -> str:
        return f"OutputError(position error {self.ratio:.2f} times that of least squares)"

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        tested = None
        if self.tested is not None:
            tested = {"linear": self.tested[0].to_dict(), "output_error": self.tested[1].to_dict()}
        return {
            "position_error_over_linear": self.ratio,
            "singular_values": self.singular_values.tolist(),
            "kept_parameters": list(self.kept),
            "variance_inflation": self.inflation,
            "held_out": tested,
        }


def output_error(
    model: Model,
    logs: Logs,
    *,
    valid: Logs = (),
    options: OutputErrorOptions | None = None,
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
) -> OutputError:
    """Fit a model's parameters to the measured motion, from the linear answer on.

    Parameters
    ----------
    model : Model
        The linear answer, for example of `identify`.
    logs : sequence of Log, Recording or data frame, or one data frame
        Logs to fit, with position and torque, or commands, of all joints.
    valid : sequence of Log, Recording or data frame, or one data frame
        Logs to measure the simulated error on; they decide nothing.
    options : OutputErrorOptions, optional
    progress : callable
        Called with a few words at each fit.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    OutputError

    Raises
    ------
    InputError
        A log lacks a joint or its torque, or the model cannot be simulated or is unstable.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 2.0, seed=1), rate=100.0, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> linear = fr.identify(robot, [log], effects=fr.parse_effects("viscous"), recursion="none").model
    >>> found = fr.output_error(linear, [log], options=fr.OutputErrorOptions(horizon=0.5, rounds=1, iterations=3))
    >>> found.ratio <= 1.0
    True
    """
    check_model(model)
    logs, valid = as_logs(logs, model.robot.joints, mapping), as_logs(valid, model.robot.joints, mapping, "valid")
    options = options or OutputErrorOptions()
    check_kind("options", options, OutputErrorOptions, "frischid.OutputErrorOptions(horizon=0.5)")
    if not logs:
        raise InputError("there is no log to fit the motion of; give at least one")
    model.check(logs)
    shooting = Shooting(model, need_motion(logs, model.robot.joints), options)
    z = np.zeros(len(model.estimate.theta))
    first = last = _weighted(shooting, z)
    V = np.zeros((len(z), 0))
    for number in range(options.rounds):
        progress(f"simulated motion, fit {number + 1} of {options.rounds}")
        V = _determined(shooting.jacobian(z))[1]
        z = _fit(shooting, z, V)
        last = _weighted(shooting, z)
    progress("simulated motion, covariance")
    fit = _Fit(z, V, shooting.jacobian(z), float(np.sqrt(((last / first) ** 2).mean())))
    found = _found(model, fit, shooting, [log_entry(x) for x in logs])
    if not valid:
        return found
    progress("simulating the test logs")
    return replace(found, tested=(compare_simulated(model, valid), compare_simulated(found.model, valid)))


class _Fit(NamedTuple):
    """A solution: scaled parameters (p,), directions that moved (p, k), derivatives there, rms error over the first."""

    z: Array
    directions: Array
    jacobian: Jacobian
    ratio: float


def _weighted(shooting: Shooting, z: Array) -> Array:
    """Weight each joint by its rms error (J,), and return these errors."""
    rms = np.sqrt((shooting.residuals(z) ** 2).mean(axis=(0, 1)))
    if not np.isfinite(rms).all():
        shooting.jacobian(z)  # says why
    shooting.weights = shooting.weights * np.maximum(rms, SMALLEST_PATH)
    return shooting.weights


def _covariance(j: Jacobian, V: Array) -> tuple[Array, float]:
    """Covariance (p, p) of the directions V (p, k), and the mean factor by which correlation inflates variances."""
    k = V.shape[1]
    variance = float((j.residuals**2).sum() / max(1, len(j.residuals) - k))
    if not k:
        return np.zeros((len(V), len(V))), 1.0
    U, sizes, rows = np.linalg.svd(j.parameters @ V, full_matrices=False)
    groups = [j.piece == s for s in np.unique(j.piece)]
    shares = [U[g].T @ U[g] for g in groups]
    # Solutions without each piece in turn, less the solution, in units of the directions' standard errors.
    without = [np.linalg.lstsq(np.eye(k) - M, U[g].T @ j.residuals[g])[0] for g, M in zip(groups, shares, strict=True)]
    each = (1.0 - 1.0 / len(groups)) * np.sum(np.square(without), axis=0)
    mean = max(variance, float(each.mean()))
    half = V @ (rows.T / sizes)
    return (half * np.maximum(each, mean)) @ half.T, mean / variance


def _determined(j: Jacobian) -> tuple[Array, Array]:
    """Singular values in units of the rms residual, and the directions (p, k) of those above one."""
    _, sizes, rows = np.linalg.svd(j.parameters, full_matrices=False)
    sizes = sizes / max(float(np.sqrt((j.residuals**2).mean())), SMALLEST_PATH)
    return sizes, rows[sizes > 1.0].T


def _fit(shooting: Shooting, z: Array, V: Array) -> Array:
    """Gauss-Newton with a trust region over the directions V of the parameters."""
    if not V.shape[1]:
        return z

    size = shooting.residuals(z).size

    def errors(x: Array) -> Array:
        try:
            r = shooting.residuals(z + V @ x).ravel()
        except InputError:  # a step too far: no robot has such inertias, and nothing can be simulated
            return np.full(size, UNSTABLE_ERROR)
        return np.where(np.isfinite(r), r, UNSTABLE_ERROR)

    def slopes(x: Array) -> Array:
        return np.asarray(shooting.jacobian(z + V @ x).parameters @ V)

    most = shooting.options.iterations
    solution = least_squares(errors, np.zeros(V.shape[1]), jac=slopes, max_nfev=most, xtol=TOLERANCE, ftol=TOLERANCE)
    return np.asarray(z + V @ solution.x)


def _found(model: Model, fit: _Fit, shooting: Shooting, entries: list[dict[str, Any]]) -> OutputError:
    """The model at a solution, with its covariance."""
    z, V, j, ratio = fit
    L, p = shooting.root, len(z)
    moved, inflation = _covariance(j, V)
    own = np.eye(p) - V @ V.T
    covariance = L @ (moved + own) @ L.T
    variance, change = np.diag(L @ L.T), L @ z
    share = np.einsum("ij,jk,ik->i", L, own, L) / variance
    # A direction that moves far also moves parameters of which it is a small part.
    keeps = (share > KEPT_SHARE) & (np.abs(change) <= KEPT_CHANGE * np.sqrt(variance))
    kept = tuple(c.name for c, x in zip(model.estimate.columns, keeps, strict=True) if x)
    estimate = replace(
        model.estimate,
        theta=model.estimate.theta + change,
        covariance=covariance,
        estimator="output_error",
        information=precision_of(covariance),
    )
    event = {
        "action": "output_error",
        "effects": [],
        "logs": entries,
        "kept": list(kept),
        "options": vars(shooting.options),
    }
    fitted = replace(
        model,
        estimate=estimate,
        prior=_moved(model, estimate),
        standard=None,
        bounds={},
        recursion=None,
        previous=model,
        history=(*model.history, event),
    )
    return OutputError(fitted, ratio, _determined(j)[0], kept, inflation)


def _moved(model: Model, estimate: Estimate) -> UrdfPrior | None:
    """The model's prior, with the values of all parameters that follow from these base parameters."""
    if model.prior is None:
        return None
    regressor = Regressor(model.robot, model.effects, model.reference)
    mapping = structure(regressor, model.joints).mapping
    return model.prior.moved(mapping, estimate.theta, estimate.covariance)
