"""The error of freely fitted base parameters, and the parameters that this log does not determine.

The base parameters are fitted to the `Sketch`, cross-validated over five stretches of time. A parameter counts as
undetermined when its standard error is larger than its own size in the URDF (the sizes of the terms it is made of).
Then the URDF's value is the better estimate, even if it is wrong by 100 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.checks.log_issue import Notebook
from frischid.checks.sketch import Sketch
from frischid.core.text import counted
from frischid.core.types import Array
from frischid.effects import BASELINE
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor, nominal_parameters

_TORQUE_KINDS = ("late torque", "early torque", "torque scale", "wrong robot", "unexplained torque")
"""Issues that are themselves a sufficient reason for a bad fit."""


@dataclass(frozen=True, eq=False)
class FreeFit:
    """Fit of the base parameters to a sketch."""

    errors: Array
    """Cross-validated NRMSE of the judged joints, (R,)."""
    stderr: Array
    """Shape (p,)."""


def free_fit(sketch: Sketch, reduction: Reduction) -> FreeFit | None:
    """Fit the base parameters of the baseline model; None when the sketch is too short for this."""
    criteria = sketch.criteria
    Y = Regressor(sketch.robot, BASELINE)(sketch.t, sketch.q, sketch.v, sketch.a)[:, list(reduction.base)]
    uses = [np.flatnonzero(sketch.used[:, j]) for j in sketch.rows]
    which = np.repeat(np.arange(len(uses)), [len(use) for use in uses])
    X = np.concatenate([Y[use, :, j] for use, j in zip(uses, sketch.rows, strict=True)]) / sketch.spread[which, None]
    y = np.concatenate([sketch.tau[use, j] for use, j in zip(uses, sketch.rows, strict=True)]) / sketch.spread[which]
    if len(y) < criteria.samples_per_parameter * X.shape[1]:
        return None
    norms = np.sqrt((X**2).sum(axis=0))
    scale = np.where(norms > 0, norms, 1.0)
    X = X / scale
    ridge = 1e-10 * np.eye(X.shape[1])  # parameters that no sample excites must not stop the fit
    fold = np.concatenate(uses) * criteria.excitation_folds // len(sketch)
    H, b = X.T @ X, X.T @ y
    left = np.empty_like(y)
    for k in range(criteria.excitation_folds):
        out = fold == k
        theta = np.linalg.solve(H - X[out].T @ X[out] + ridge, b - X[out].T @ y[out])
        left[out] = y[out] - X[out] @ theta
    inside = (y - X @ np.linalg.solve(H + ridge, b)) ** 2
    variance = np.bincount(which, inside)[which] / np.maximum(np.bincount(which)[which] - X.shape[1] / len(uses), 1)
    inverse = np.linalg.inv(H + ridge)
    spread = np.einsum("ij,jk,ki->i", inverse, X.T @ (X * variance[:, None]), inverse)
    # neighbouring samples of a sketch are correlated: half a period of the cut-off counts as one sample
    stderr = np.sqrt(np.maximum(spread, 0) * criteria.sketch_oversampling / 2) / scale
    errors = np.sqrt(np.bincount(which, left**2) / np.bincount(which))
    return FreeFit(errors, np.where(norms > 0, stderr, np.inf))


def check_excitation(
    sketch: Sketch, reduction: Reduction, fit: FreeFit | None, notes: Notebook, *, alone: bool
) -> None:
    """Note the base parameters that the log does not determine; weak excitation is an issue only if it is `alone`."""
    sizes = np.abs(reduction.mapping) @ np.abs(nominal_parameters(sketch.robot, BASELINE))
    columns = reduction.base_columns()
    rigid = np.array([c.effect == "rigid" for c in columns]) & (sizes > 0)
    if fit is None:
        if alone:
            words = f"{len(sketch)} filtered samples of {counted(len(sketch.rows), 'joint')} for "
            words += counted(len(columns), "base parameter")
            notes.add("too short", words, (), "likely", "record a longer log, or several logs")
        return
    unseen = [c.name for c, yes in zip(columns, rigid & (fit.stderr > sizes), strict=True) if yes]
    notes.facts |= {"rigid_parameters": int(rigid.sum()), "unseen_parameters": unseen}
    # one joint whose sensors are as coarse as its motion says nothing of the others
    free, nominal = (float(np.median(x)) for x in (fit.errors, sketch.asis))
    healthy = alone and not any(f.blocks or f.kind in _TORQUE_KINDS for f in notes.issues)
    if healthy and free > max(notes.criteria.weak_nrmse, notes.criteria.weak_ratio * nominal):
        notes.add(
            "weak excitation",
            f"parameters fitted to a part of this log predict the rest with NRMSE {free:.2g}, the URDF's own "
            f"parameters with {nominal:.2g}; {len(unseen)} of {int(rigid.sum())} rigid base parameters have a standard "
            "error above their value in the URDF",
            (),
            "likely",
            "record a motion that excites more (frischid excite), add logs, or use a prior",
        )
