"""Data quality: the logs, their preparation, noise and excitation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from frischid import figures
from frischid.core.text import listed, sentence
from frischid.figures.style import number
from frischid.reports.chapters.table import Table
from frischid.reports.study import Study

VELOCITY = {
    "auto": "velocity as measured where it agrees with the positions, otherwise from them",
    "measured": "velocity as measured",
    "derived": "velocity from the positions",
}
LOGS = ("log", "role", "samples", "seconds", "grid, Hz", "step, ms", "gaps", "seconds kept")
EXCITATION = ("joint", "fastest", "largest acceleration", "at standstill", "noise of q", "noise of torque")


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    model = study.model
    lowpass = model.lowpass
    cut = f"{lowpass.cutoff:g} Hz" if lowpass.cutoff else "nothing"
    drawings = [figures.reach(model.robot, study.qualities)]
    drawings += [figures.noise(model.robot, study.qualities, channel) for channel in ("tau", "q")]
    return {
        "logs": _logs(study),
        "done": [
            f"low-pass: {cut} ({lowpass.reason}), {VELOCITY[model.velocity]}",
            *([sentence(lowpass.lag_in_words)] if lowpass.torque_lag else []),
            *_notes(study),
        ],
        "excitation": _excitation(study),
        "drawings": drawings,
    }


def _logs(study: Study) -> Table:
    rows = []
    for q, role in zip(study.qualities, study.roles, strict=True):
        short, long = (number(1e3 * s, 3) for s in q.steps)
        steps = short if short == long else f"{short} … {long}"
        figures_of_log = [str(q.samples), number(q.seconds), number(q.rate), steps, str(q.gaps), number(q.kept)]
        rows.append([Path(q.source).name, role, *figures_of_log])
    return Table(LOGS, rows, words=2, caption="The logs")


def _excitation(study: Study) -> Table:
    """How each joint moved, and how noisy its channels are, every number with its unit."""
    robot, qualities = study.model.robot, study.qualities
    speed, acceleration = (np.max([getattr(q, k) for q in qualities], axis=0) for k in ("speed", "acceleration"))
    standstill = np.average([q.standstill for q in qualities], axis=0, weights=[q.kept for q in qualities])
    levels = {"q": figures.usual_noise(qualities, "q"), "load": figures.usual_noise(qualities, "tau")}
    rows = []
    for i, name in enumerate(robot.joints):
        unit = figures.style.units_of(study.sliding(name))
        fastest = [f"{number(speed[i], 3)} {unit['v']}", f"{number(acceleration[i], 3)} {unit['a']}"]
        noise = [
            "not measured" if np.isnan(level[i]) else f"{number(level[i], 2)} {unit[c]}" for c, level in levels.items()
        ]
        rows.append([name, *fastest, f"{100 * standstill[i]:.0f} %", *noise])
    caption = f"Excitation; condition number of the regression {number(study.model.estimate.condition, 3)}"
    return Table(EXCITATION, rows, caption=caption)


def _notes(study: Study) -> list[str]:
    """Notes on the preparation of the logs, each once with the logs concerned; notes on most logs come first."""
    found: dict[str, list[str]] = {}
    for q in study.qualities:
        for note in q.notes:
            found.setdefault(note.removeprefix(f"{q.source}: "), []).append(Path(q.source).name)
    count = len(study.qualities)
    every = "both logs" if count == 2 else f"all {count} logs"
    return [
        f"{every if len(logs) == count else listed(logs)}: {note}" if count > 1 else note
        for note, logs in sorted(found.items(), key=lambda item: -len(item[1]))
    ]
