"""The verdict: the model's error, its largest fault, the next step, and every warning."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from frischid import figures
from frischid.reports.study import Study, missing

LISTED = 4  # parameters named in a sentence; the table of parameters has the others


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    return {
        "error": study.headline,
        "worst_condition": figures.failure.worst(study.verdict),
        "missing": "" if study.diagnosis is None else missing(study.diagnosis),
        "next": _next(study, model_path),
        "alarms": study.headline.alarms,
        "warnings": study.warnings(),
    }


def _next(study: Study, model_path: str) -> dict[str, Any]:
    """The next step: its kind, and what its sentence needs."""
    diagnosis = study.diagnosis
    if diagnosis is not None and diagnosis.verdict == "unknown":
        return {"kind": "formula"}
    passing = [] if diagnosis is None else [f for f in diagnosis.findings if f.significant and f.members]
    if passing and passing[0].undecided:
        pair = f"{passing[0].effect},{passing[0].undecided[0]}"
        return {"kind": "separate", "command": f"frischid excite ROBOT --separate {pair} -o motion.csv"}
    if passing:
        best = passing[0]
        where = f" --joints {','.join(best.joints)}" if best.joints else ""
        given = Path(model_path).name
        better = "better.json" if given != "better.json" else "still-better.json"
        add = f"frischid add {shlex.quote(given)} {best.effect}{where} LOG... -o {better}"
        return {"kind": "add", "change": best.change, "command": add}
    if study.weak:
        more = " …" * (len(study.weak) > LISTED)
        return {"kind": "excite", "count": len(study.weak), "names": ", ".join(study.weak[:LISTED]) + more}
    return {"kind": "nothing"}
