"""A report that was written, as a page."""

from __future__ import annotations

from pathlib import Path

from frischid.cli.pages.page import Page, headline_line, warning_lines
from frischid.reports.study import Study, missing


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
    said = f"{missing(study.diagnosis)}." if study.diagnosis is not None else ""
    return Page(
        data,
        [
            headline_line(study.headline),
            *([said] if said else []),
            *warning_lines(warnings),
            f"report written to {output} ({size / 1e6:.1f} MB)",
        ],
        study.headline.alarms,
    )
