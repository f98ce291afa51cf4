"""The error falls: the staircase of a model's steps, and the steps as a table."""

from __future__ import annotations

import re
from typing import Any

from frischid import figures
from frischid.figures.style import number
from frischid.model.events import measured_on, selection_errors, test_errors
from frischid.reports.chapters.table import Table
from frischid.reports.study import Study

HISTORY_HEADINGS = ("step", "action", "effects", "before", "after", "NRMSE measured on", "on test logs")


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    rows = []
    for i, event in enumerate(study.model.history):
        errors = ["–" if x is None else f"{x:.4f}" for x in selection_errors(event)]
        test = " → ".join(f"{x:.4f}" for x in test_errors(event)) or "–"
        effects = rounded(", ".join(event.get("effects", ())))
        rows.append([str(i), event["action"], effects, *errors, measured_on(event), test])
    caption = f"Steps of the model. {_shapes(study)}"
    return {
        "several": len(study.model.history) > 1,
        "staircase": figures.staircase(study.model, study.headline),
        "steps": Table(HISTORY_HEADINGS, rows, words=3, caption=caption),
    }


def rounded(effects: str) -> str:
    """Effects with the numbers of their shapes as a person writes them."""
    return re.sub(r"\d+\.\d{5,}", lambda found: number(float(found[0])), effects)


def _shapes(study: Study) -> str:
    """Units of the numbers in an effect's parentheses."""
    robot = study.model.robot
    units: dict[str, str] = {}
    for effect in study.model.effects:
        units |= {name: unit for name in effect.parameters if (unit := effect.unit(name, robot))}
    told = [f"{name} {unit if unit.startswith('per ') else 'in ' + unit}" for name, unit in units.items()]
    return f"In parentheses an effect's shape: {', '.join(told)}" if told else ""
