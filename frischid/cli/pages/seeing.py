"""A report that was written, as a page."""

from __future__ import annotations

from pathlib import Path

from frischid.cli.pages.page import Page, headline_line, warning_lines
from frischid.core.text import listed
from frischid.diagnosis.clause import missing
from frischid.reports.study import Study


def report(study: Study, output: str) -> Page:
    """The report's file, and its verdict in a line."""
    warnings = study.warnings()
    size = Path(output).stat().st_size
    data = {
        "report": output,
        "bytes": size,
        "headline": study.headline.to_dict(),
        "held_out": list(study.held_out),
        "warnings": warnings,
        "diagnosis": None if study.diagnosis is None else study.diagnosis.to_dict(),
        "logs": [q.to_dict() for q in study.qualities],
    }
    if study.beside is not None:
        data["beside"] = {
            "logs": list(study.beside.logs),
            "seen": study.beside.seen,
            "nrmse": {name: found.nrmse for name, found in study.beside.models.items()},
            "joints": {
                name: {j: joint.nrmse for j, joint in found.joints.items()}
                for name, found in study.beside.models.items()
            },
        }
    said = f"{missing(study.diagnosis)}." if study.diagnosis is not None else ""
    return Page(
        data,
        [
            headline_line(study.headline),
            *([said] if said else []),
            *_beside(study),
            *warning_lines(warnings),
            f"report written to {output} ({size / 1e6:.1f} MB)",
        ],
        study.headline.alarms,
    )


def _beside(study: Study) -> list[str]:
    """The mean error of each of several models, on the same logs."""
    if study.beside is None:
        return []
    errors = ", ".join(f"{name} {found.nrmse:.4f}" for name, found in study.beside.models.items())
    logs = listed([Path(source).name for source in study.beside.logs])
    return [f"side by side on {logs}: NRMSE {errors}{' (one of them was fitted to these logs)' * study.beside.seen}"]
