"""Quality of a log: its clock, the noise of each channel, its preparation, and the motion of each joint.

Noise is measured in the log by fourth differences (`noise_level`). Excitation is described by the range, the speed and
the acceleration that each joint reaches, next to the URDF's limits, and by the share of time at standstill.

A check knows only the URDF: it says that the base is tilted, or that the URDF does not explain a torque. Beside a model
that has a tilt, or an added effect on that joint, such a warning is out of date: the model's own error counts there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from frischid.checks import inspect
from frischid.checks.log_issue import UNDONE, LogIssue
from frischid.checks.position_faults import JOINT_ZERO
from frischid.core.types import Array
from frischid.effects import BASELINE
from frischid.logs.driven import driven
from frischid.logs.excerpt import Excerpt, excerpt
from frischid.logs.filters import LowPass, noise_level
from frischid.logs.log import Log
from frischid.logs.poses import poses_of
from frischid.logs.preprocessing import Motion, prepare
from frischid.logs.time_grid import retimed
from frischid.logs.wraps import unwrapped
from frischid.model.model import Model
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure


@dataclass(frozen=True, eq=False)
class Quality:
    """One log under a model's filter; arrays have one entry for each of the robot's J joints."""

    source: str
    samples: int
    seconds: float
    rate: float
    """`seconds`, `rate`: s, Hz of the median step."""
    steps: tuple[float, float]
    """Shortest and longest time between samples, s."""
    gaps: int
    """Steps longer than five times the median."""
    kept: float
    """Seconds that remain after trimming and splitting; of an arm at standstill, those of its poses."""
    noise: dict[str, Array]
    """Standard deviation of the white noise of ``q`` and ``tau`` (rad, N·m, (J,); m, N), ``v`` where measured."""
    lower: Array
    upper: Array
    """`lower`, `upper`: Positions reached, (J,)."""
    speed: Array
    acceleration: Array
    """`speed`, `acceleration`: Largest absolute values reached, (J,)."""
    standstill: Array
    """Share of the samples at standstill, (J,)."""
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    """`notes`, `warnings`: Changes of the log's data, and suspicious findings."""
    answered: tuple[str, ...] = ()
    """Suspicious findings that effects of the model answer (`frischid.model.log_quality`)."""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        values = {k: x.tolist() if isinstance(x, np.ndarray) else x for k, x in vars(self).items() if k != "answered"}
        noise = {k: [None if np.isnan(s) else float(s) for s in x] for k, x in self.noise.items()}
        return values | {"noise": noise, "notes": list(self.notes), "warnings": list(self.warnings)}


def quality(model: Model, logs: Sequence[Log | Excerpt]) -> list[Quality]:
    """Measure the quality of logs under the model's filter.

    Parameters
    ----------
    logs : sequence of Log or Excerpt
        Of an excerpt, the clock is that of the whole log, and the checks are those of its first stretch.

    Returns
    -------
    list of Quality
        One per log.
    """
    return [
        _judge(model, excerpt(*driven([x], model.controller, model.currents)) if isinstance(x, Log) else x)
        for x in logs
    ]


def _judge(model: Model, given: Excerpt) -> Quality:
    log = given.log
    chosen = log.select(model.robot.joints)
    prepared = prepare(chosen, model.lowpass, velocity=model.velocity)
    motions = prepared.motions
    channels = {"q": "q", "tau": "tau"} | ({"v": "v"} if chosen.v is not None else {})
    times = retimed(unwrapped(chosen)).t  # where the samples were taken: stamps that jitter would be noise of a motion
    noise = {}
    for name, channel in channels.items():
        # The motion may have a velocity derived from q, so the noise of a measured one is measured in the log.
        parts = [chosen.v] if channel == "v" else [getattr(m, channel) for m in motions]
        weight = np.array([len(x) for x in parts if x is not None], dtype=float)
        levels = np.array([noise_level(x, times if channel == "v" else None) for x in parts if x is not None])
        noise[name] = np.sqrt((weight[:, None] * levels**2).sum(axis=0) / weight.sum())
    stacked = {k: np.concatenate([getattr(m, k) for m in motions]) for k in ("q", "v", "a", "standstill")}
    report = inspect(
        model.robot,
        given.first.select(model.robot.joints),
        lambda: structure(Regressor(model.robot, BASELINE), model.robot.joints),
        prepared=(model.lowpass, motions if given.first is log else motions[:1]),
    )
    issues = [issue for issue in report.issues if issue.kind not in UNDONE]
    return Quality(
        source=log.source,
        samples=given.samples,
        seconds=given.seconds,
        rate=given.rate,
        steps=given.steps,
        gaps=given.gaps,
        kept=_kept(chosen, motions, model.lowpass),
        noise=noise,
        lower=stacked["q"].min(axis=0),
        upper=stacked["q"].max(axis=0),
        speed=np.abs(stacked["v"]).max(axis=0),
        acceleration=np.abs(stacked["a"]).max(axis=0),
        standstill=stacked["standstill"].mean(axis=0),
        notes=(*log.notes, *prepared.notes),
        warnings=tuple(issue.short for issue in issues if not is_answered(model, issue)),
        answered=tuple(issue.short for issue in issues if is_answered(model, issue)),
    )


def _kept(log: Log, motions: Sequence[Motion], lowpass: LowPass) -> float:
    """Seconds of a log that its motions show after the filter, or its poses where the arm stands still."""
    if any(m.at_poses for m in motions):
        return float(sum(log.t[part.stop - 1] - log.t[part.start] for part in poses_of(log).parts))
    return float(sum(m.t[-1] - m.t[0] - (len(lowpass.taps(m.step)) - 1) * m.step for m in motions))


UNEXPLAINED_TORQUE = "unexplained torque"
ANSWERS = {
    "mounting": "gravity_tilt", "payload": "payload", "motor coupling": "joint_coupling", "spring": "joint_spring",
    JOINT_ZERO: "encoder_zero", "torque scale": "drive_gain", "late torque": "time_delay", "early torque": "time_delay",
}  # fmt: skip
"""Kind of issue -> the effect that answers it. An unexplained torque of a joint is answered by any effect that was
added on this joint by name."""


def is_answered(model: Model, issue: LogIssue) -> bool:
    """Whether effects of the model act on all joints of an issue, as the issue asks for."""
    usual = {effect.id for effect in BASELINE}
    if issue.kind == UNEXPLAINED_TORQUE:
        found = [e for e in model.effects if e.joints and e.id not in usual]
    else:
        found = [e for e in model.effects if e.id == ANSWERS.get(issue.kind)]
    acting = {name for e in found for name in e.joints or model.robot.joints}
    return bool(found) and acting.issuperset(issue.where)
