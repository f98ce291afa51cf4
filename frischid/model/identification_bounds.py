"""The fifth of identification's six stages: bounds of the parameters, and the estimators that need them.

    Frisch simplex and box → bounding-box recursion (BBRF) → best point of the box, or an estimator that knows sensors

The recursion runs over filtered torque rows, each joint's in units of its own residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import EmptyBoxError, IdentifiabilityError
from frischid.estimators.bbrf import Recursion, Variant, bbrf
from frischid.estimators.box_qp import Selection, select
from frischid.estimators.errors_in_variables import eiv
from frischid.estimators.frisch import Box, Simplex, simplex
from frischid.estimators.frisch_selection import select_published
from frischid.estimators.instrumental_variables import iv
from frischid.estimators.least_squares import Estimate
from frischid.estimators.sensor_noise import noise_limits, sensor_moments
from frischid.estimators.sensorwise import sensorwise
from frischid.estimators.state_samples import samples
from frischid.logs.locked_joints import moving_but_locked, standing_elsewhere
from frischid.model.identification_criteria import IdentificationCriteria
from frischid.model.identification_stages import Fit
from frischid.regression.block import Block, stack

NO_INFORMATION = "no information"
"""Printed for a parameter's bounds by a method that says nothing about the parameter (`without_information`)."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Stage 5: bounds, and the estimate they may have changed."""

    fit: Fit
    estimate: Estimate
    """The model's values: least squares', or those of the estimator that was asked for."""
    simplex: Simplex | None
    """The p + 1 least-squares solutions; None where the logs alone do not determine the parameters."""
    boxes: Mapping[str, Box]
    """Bounds by method: ``"frisch"``, ``"bbrf"``, ``"sensorwise"``."""
    recursion: Recursion | None
    selection: Selection | None
    """The point of the box, for the estimators ``"frisch"`` and ``"frisch_squared"``."""


def bound_parameters(fit: Fit) -> Bounds:
    """Stage 5: bounds by the Frisch scheme and its recursion, and the values of an estimator that needs them.

    Raises
    ------
    EmptyBoxError
        The estimator takes a point of the box, and the recursion contradicted itself.
    """
    whole, journal, options = fit.problem.whole, fit.problem.data.journal, fit.problem.data.options
    moments = whole.weighted(fit.estimate.weights) / whole.rows
    triangle = _simplex(fit, moments)
    boxes = {} if triangle is None else {"frisch": triangle.box()}
    journal.stage("bounding-box recursion")
    recursion = None if triangle is None else _recursion(fit)
    if recursion is not None and recursion.box is not None:
        boxes["bbrf"] = recursion.box
    estimate, selection = fit.estimate, None
    if options.estimator in {"frisch", "frisch_squared"}:
        within = recursion.require_box() if recursion is not None else boxes["frisch"]
        unweighted = whole.weighted(np.ones_like(fit.estimate.weights))
        squared = options.estimator == "frisch_squared"
        selection = select(moments, within) if squared else select_published(unweighted, within).selection
        estimate = replace(estimate, theta=selection.theta, estimator=options.estimator)
    if options.estimator in {"sensorwise", "eiv", "iv"}:
        journal.progress(f"estimator {options.estimator}")
        estimate, box = _by_sensors(fit)
        if box is not None:
            boxes["sensorwise"] = box
    locked = fit.problem.data.summary.locked
    journal.warnings += [*estimate.notes, *moving_but_locked(locked.moving, locked.absent)]
    journal.warnings += standing_elsewhere(locked.elsewhere)
    # Nearly every robot has these doubts about its boxes. They are warnings where the values come from a box.
    said = journal.warnings if selection is not None else journal.notes
    said += [] if triangle is None else _doubts(triangle, recursion)
    return Bounds(fit, estimate, triangle, boxes, recursion, selection)


def _simplex(fit: Fit, moments: Array) -> Simplex | None:
    """The Frisch simplex of the logs alone: a prior has no part in bounds that only the data set.

    Raises
    ------
    IdentifiabilityError
        The logs do not determine the parameters, and no prior does.
    """
    try:
        return simplex(moments, fit.problem.whole.names)
    except IdentifiabilityError as error:
        if fit.posterior is None:
            raise
        fit.problem.data.journal.notes.append(f"no Frisch bounds: without the URDF's prior, {error}")
        return None


def _recursion(fit: Fit) -> Recursion | None:
    """The bounding-box recursion, if it is wanted and the rows are enough for two windows."""
    data = fit.problem.data
    if data.options.recursion == "none":
        return None
    rows, p = _weighted_rows(fit), len(fit.estimate.columns)
    window = data.options.window
    if window is None:
        criteria = data.options.criteria
        window = min(max(criteria.bbrf_window, criteria.bbrf_rows_per_parameter * p), len(rows) // 2)
        if window < p + 2:
            data.journal.warnings.append(
                f"BBRF left out: {len(rows)} rows are too few for two windows of more than {p + 2} rows"
            )
            return None
    names, signs = [c.name for c in fit.estimate.columns], [c.sign for c in fit.estimate.columns]
    try:
        return bbrf(rows, names, window=window, signs=signs, variant=cast(Variant, data.options.recursion))
    except IdentifiabilityError as error:
        data.journal.warnings.append(f"BBRF left out: {error}")
        return None


def _weighted_rows(fit: Fit) -> Array:
    """Rows of [Y τ] in order of time, (N, p + 1), each joint's divided by its residual spread."""
    problem, data = fit.problem, fit.problem.data
    index = [data.robot.joints.index(n) for n in data.joints]
    blocks: list[Block] = []
    count = 0
    for block in (b for motion in data.motions for b in problem.regressor.blocks(motion, data.lowpass)):
        if count + block.used[:, index].sum() > data.options.criteria.bbrf_rows:
            data.journal.warnings.append(
                f"BBRF looked at the first {count} rows only: every further one costs a matrix inverse"
            )
            break
        blocks.append(block)
        count += int(block.used[:, index].sum())
    Y, tau, which = stack(blocks, data.robot, data.joints)
    weight = np.sqrt(fit.estimate.weights)[which]
    return np.column_stack([Y[:, list(problem.reduction.base)], tau]) * weight[:, None]


def _by_sensors(fit: Fit) -> tuple[Estimate, Box | None]:
    """Values of an estimator that knows which sensor the noise comes from, and its box if it has one."""
    problem, data, start = fit.problem, fit.problem.data, fit.estimate
    regressor, base, estimator = problem.regressor, problem.reduction.base, data.options.estimator
    if estimator == "iv":
        return iv(regressor, data.motions, data.lowpass, base, start), None
    if estimator == "eiv":
        return eiv(samples(regressor, data.motions, data.lowpass, data.joints, base), start.columns, data.joints), None
    seen = sensor_moments(regressor, data.motions, data.lowpass, data.joints, base, start)
    found = sensorwise(seen, limits=noise_limits(data.motions, data.robot, data.lowpass))
    notes = (*start.notes, *found.notes)
    return replace(start, theta=found.theta, covariance=found.covariance, estimator=estimator, notes=notes), found.box


def _doubts(triangle: Simplex, recursion: Recursion | None) -> list[str]:
    """Assumptions of the theory that these data do not meet."""
    doubts = []
    if not triangle.same_orthant:
        names = triangle.disagreeing
        doubts.append(
            f"the classical Frisch box is no bound here: its theorem needs equal signs in {len(triangle.names) + 1} "
            f"least-squares solutions, and {len(names)} of {len(triangle.names)} parameters change their sign "
            f"({', '.join(names[:6])}{' ...' * (len(names) > 6)})"
        )
    if recursion is not None and recursion.emptied is not None:
        doubts.append(f"the recursive Frisch bounds (BBRF): {EmptyBoxError(*recursion.emptied)}")
    if recursion is not None and recursion.box is not None:
        silent = int((~recursion.box.informs(triangle.box())).sum())
        if silent:
            doubts.append(
                f"the bounding-box recursion ({recursion.variant}) holds no information on {silent} of "
                f"{len(triangle.names)} parameters: their bounds are open, or not narrower than the one-shot Frisch "
                "box; use --estimator sensorwise for bounds that start from the sensors' noise"
            )
    return doubts


def recursion_record(bounds: Bounds, criteria: IdentificationCriteria) -> dict[str, Any] | None:
    """How the recursion's bounds closed in, as `Model.recursion` stores it.

    Steps are few enough to be kept with the model: the first ones, then ever fewer.
    """
    found = bounds.recursion
    if found is None:
        return None
    count, emptied = len(found.steps), found.emptied
    spaced = np.round(np.geomspace(1, max(count, 1), criteria.bbrf_steps_kept)).astype(int)
    rows = np.unique(spaced - 1)[: max(count, 0)]
    return {
        "names": list(found.names),
        "units": [c.unit for c in bounds.estimate.columns],
        "variant": found.variant,
        "windows": found.windows,
        "emptied": None if emptied is None else {"parameter": emptied.parameter, "window": emptied.window},
        "steps": found.steps[rows].tolist(),
        "lower": [_six_digits(found.lower[i]) for i in rows],
        "upper": [_six_digits(found.upper[i]) for i in rows],
    }


def without_information(bounds: Mapping[str, Box]) -> dict[str, NDArray[np.bool_]]:
    """Parameters on which a method's bounds say nothing: open ones, and BBRF's where the one-shot box is as narrow.

    Parameters
    ----------
    bounds : mapping of str to Box
        Bounds by method, as `Model.bounds` holds them.

    Returns
    -------
    dict of str to ndarray of bool, shape (p,)
    """
    silent = {method: ~np.isfinite(box.width) for method, box in bounds.items()}
    if "bbrf" in bounds and "frisch" in bounds:
        silent["bbrf"] = ~bounds["bbrf"].informs(bounds["frisch"])
    return silent


def _six_digits(values: Array) -> list[float | None]:
    return [float(f"{x:.6g}") if np.isfinite(x) else None for x in values]
