"""Where the model fails: a table of joints and conditions, then each joint's residual over every variable."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from frischid import figures
from frischid.core.text import listed
from frischid.forward.simulated_beside import RESTART
from frischid.reports.study import Study

AXES = ("q", "v", "a", "load", "t")
DEPENDENT = 0.01  # p-value below which a residual is said to depend on a variable


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template; the worst joint is unfolded."""
    shown = study.comparison
    structure = shown.residuals.structure()
    worst = max(shown.joints, key=lambda joint: joint.nrmse).name
    joints = []
    for name, fit in shown.joints.items():
        on = [figures.style.VARIABLE_WORDS[v] for v, p in structure[name].depends_on.items() if p < DEPENDENT]
        slides = study.sliding(name)
        drawings = [figures.against(study.prediction, name, v, slides) for v in AXES]
        drawings.append(figures.plane(study.prediction, name, slides))
        joints.append(
            {"name": name, "nrmse": fit.nrmse, "depends_on": listed(on), "drawings": drawings, "open": name == worst}
        )
    mixed = 0 < len(study.held_out) < len(study.logs)
    return {"mixed": mixed, "matrix": figures.matrix(shown), "joints": joints, **_simulated(study)}


def _simulated(study: Study) -> dict[str, Any]:
    """The simulated robot beside the measured one."""
    beside, robot = study.simulated, study.model.robot
    if beside is None or isinstance(beside, str):
        return {"moved": None, "not_moved": beside}
    drawings = [figures.position_error(beside, robot)]
    if np.isfinite(beside.simulated[:2]).all():
        drawings.append(figures.ghost(beside, robot))
    along = {"moved_along": Path(beside.source).name, "commanded": beside.closed, "restart": RESTART}
    return {"moved": drawings, "not_moved": None, **along}
