"""Measured and predicted torque: the errors as a table, and one figure per joint."""

from __future__ import annotations

from typing import Any

from frischid import figures
from frischid.figures.style import number
from frischid.model.standstill_joints import standstill_note
from frischid.reports.chapters.table import Table
from frischid.reports.study import Study

OWN_LOGS = (
    ". On the logs the model was fitted to, these are the errors of the fit: smaller than the cross-validated error at "
    "the top"
)
ERRORS_CAPTION = (
    "Errors joint by joint, over all logs of this page. NRMSE is the rms error over the torque's standard "
    "deviation. The next three columns are NRMSE too: of the sensors' noise alone, and of two simpler models. "
    "fit = 100 (1 − NRMSE)"
)
ERROR_HEADINGS = (
    "joint",
    "unit",
    "rms error",
    "bias",
    "NRMSE",
    "noise floor",
    "URDF with friction",
    "constant torque",
    "fit, %",
)
DRAWN_OPEN = 2  # joints whose curves stand open; the others are folded
ROUNDING = 1e-9  # share of the rms error below which a bias is rounding


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    contacts = study.diagnosis.contacts if study.diagnosis is not None else ()
    rows, own = [], len(study.held_out) < len(study.logs)
    for name, j in study.comparison.joints.items():
        bias = j.bias if abs(j.bias) > ROUNDING * j.rmse else 0.0
        errors = [number(j.rmse), number(bias), f"{j.nrmse:.4f}", f"{j.noise_floor:.4f}"]
        rows.append([name, study.unit_of(name), *errors, f"{j.nominal:.3f}", f"{j.constant:.3f}", f"{j.fit:.1f}"])
    drawings = [
        figures.measured(study.prediction, study.comparison, name, contacts, study.unit_of(name))
        for name in sorted(study.comparison.joints.names, key=lambda name: -study.comparison.joints[name].nrmse)
    ]
    return {
        "errors": Table(ERROR_HEADINGS, rows, words=2, caption=f"{ERRORS_CAPTION}{OWN_LOGS * own}"),
        "still": standstill_note(study.comparison.not_compared),
        "standstill": study.comparison.standstill,
        "nrmse_with_standstill": study.comparison.nrmse_with_standstill,
        "contacts": bool(contacts),
        "several": len(study.logs) > 1,
        "drawings": drawings,
        "worst_first": DRAWN_OPEN,
    }
