"""Measured and predicted torque: the errors as a table, and one figure per joint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from frischid import figures
from frischid.core.text import listed
from frischid.figures.style import number
from frischid.model.standstill_joints import standstill_note
from frischid.reports.chapters.table import Table
from frischid.reports.study import Study

OWN_LOGS = " On the logs the model was fitted to, these are the errors of the fit; the error at the top is {top}."
ERRORS_CAPTION = (
    "Errors joint by joint, over all logs of this page. NRMSE is the rms error over the torque's standard "
    "deviation. The next three columns are NRMSE too: of the sensors' noise alone, and of two simpler models. "
    "fit = 100 (1 − NRMSE)."
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
BY_LOG_CAPTION = "The error (NRMSE) on each log alone, joint by joint, and the mean over the joints"
BESIDE_CAPTION = (
    "The models on the same logs ({logs}{seen}): NRMSE of each, joint by joint, and its change against the first"
)
TWO = 2  # logs that can be laid over one another
DRAWN_OPEN = 2  # joints whose curves stand open; the others are folded
ROUNDING = 1e-9  # share of the rms error below which a bias is rounding


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    left_out = {} if study.diagnosis is None else {name: study.diagnosis.left_out(name) for name in study.model.joints}
    top = "that of the test logs alone" if study.held_out else "cross-validated, and therefore larger"
    said = OWN_LOGS.format(top=top) if len(study.held_out) < len(study.logs) else ""
    rows = []
    for name, j in study.comparison.joints.items():
        bias = j.bias if abs(j.bias) > ROUNDING * j.rmse else 0.0
        errors = [number(j.rmse), number(bias), f"{j.nrmse:.4f}", f"{j.noise_floor:.4f}"]
        rows.append([name, study.unit_of(name), *errors, f"{j.nominal:.3f}", f"{j.constant:.3f}", f"{j.fit:.1f}"])
    shown = [figures.Overlay(other.name, other.prediction, k == 0) for k, other in enumerate(study.others)]
    order = sorted(study.comparison.joints.names, key=lambda name: -study.comparison.joints[name].nrmse)
    drawings = [
        figures.measured(
            study.prediction,
            study.comparison,
            name,
            left_out.get(name),
            study.sliding(name),
            overlays=shown,
            motion=True,
        )
        for name in order
    ]
    both = len(study.logs) == TWO
    return {
        "errors": Table(ERROR_HEADINGS, rows, words=2, caption=f"{ERRORS_CAPTION}{said}"),
        "by_log": _by_log(study),
        "beside": _beside(study),
        "others": study.others,
        "others_are": "another model" if study.beside is not None else "the model at an earlier step",
        "still": standstill_note(study.comparison.not_compared),
        "standstill": study.comparison.standstill,
        "nrmse_with_standstill": study.comparison.nrmse_with_standstill,
        "left_out": listed(list(dict.fromkeys(reason for reasons in left_out.values() for reason in reasons))),
        "several": [Path(log.source).name for log in study.logs] if len(study.logs) > 1 else [],
        "drawings": drawings,
        "worst_first": DRAWN_OPEN,
        "overlaid": [figures.two_logs(study.prediction, name, study.sliding(name)) for name in order] if both else [],
    }


def _by_log(study: Study) -> Table | None:
    """The model's error on each log alone."""
    if len(study.by_log) < TWO:
        return None
    joints, rows = study.comparison.joints.names, []
    for log, role, found in zip(study.logs, study.roles, study.by_log, strict=True):
        errors = {name: f"{joint.nrmse:.4f}" for name, joint in found.joints.items()}
        rows.append([Path(log.source).name, role, *(errors.get(name, "–") for name in joints), f"{found.nrmse:.4f}"])
    return Table(["log", "role", *figures.short(joints), "mean"], rows, words=2, caption=BY_LOG_CAPTION)


def _beside(study: Study) -> Table | None:
    """The errors of this model and of the further ones, on the same logs."""
    beside = study.beside
    if beside is None:
        return None
    first, *others = beside.models.values()
    rows = []
    for name in first.joints.names:
        errors = [found.joints[name].nrmse for found in beside.models.values()]
        rows.append([name, f"{first.joints[name].noise_floor:.4f}", *_with_changes(errors)])
    rows.append(["mean", f"{first.noise_floor:.4f}", *_with_changes([found.nrmse for found in (first, *others)])])
    names = list(beside.models)
    changes = [heading for name in names[1:] for heading in (name, f"{name} against {names[0]}")]
    headings = ["joint", "noise floor", names[0], *changes]
    seen = "; one of the models was fitted to some of them" if beside.seen else ", which no model was fitted to"
    logs = listed([Path(source).name for source in beside.logs])
    return Table(headings, rows, caption=BESIDE_CAPTION.format(logs=logs, seen=seen))


def _with_changes(errors: list[float]) -> list[str]:
    """The first error, then each other with its change."""
    first, *others = errors
    changes = [f"{100 * (x / first - 1):+.1f} %".replace("-", "−") for x in others]
    return [f"{first:.4f}", *(text for x, change in zip(others, changes, strict=True) for text in (f"{x:.4f}", change))]
