"""A report that was written, as a page."""

from __future__ import annotations

from pathlib import Path

from frischid.cli.pages.page import Page, warning_lines
from frischid.reports.study import Study, missing


def report(study: Study, output: str) -> Page:
    """Where the report is, and its verdict in a line."""
    c = study.verdict
    warnings = study.warnings()
    size = Path(output).stat().st_size
    data = {
        "report": output,
        "bytes": size,
        "nrmse": c.nrmse,
        "held_out": list(study.held_out),
        "warnings": warnings,
        "diagnosis": None if study.diagnosis is None else study.diagnosis.to_dict(),
        "logs": [q.to_dict() for q in study.qualities],
    }
    where = "logs it has never seen" if study.held_out else "logs it was fitted to"
    verdict = f"NRMSE {c.nrmse:.4f} on {where}, noise floor {c.noise_floor:.4f}."
    said = f"{missing(study.diagnosis)}." if study.diagnosis is not None else ""
    return Page(
        data,
        [f"{verdict} {said}", *warning_lines(warnings), f"report written to {output} ({size / 1e6:.1f} MB)"],
    )
