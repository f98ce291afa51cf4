"""Comparisons of a model with logs, as pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from frischid.cli.pages.page import Page, depends, figure, headline_line, table_of, warning_lines
from frischid.core.text import listed, percent
from frischid.forward.motion_error import MotionComparison
from frischid.model.comparison import Comparison
from frischid.model.grade import AS_THE_SENSORS
from frischid.model.headline import Headline
from frischid.model.residual_conditions import CONDITION_ORDER
from frischid.model.standstill_joints import pose_note, standstill_note


def comparison(result: Comparison, error: Headline, motion: MotionComparison | None = None) -> Page:
    """The model's error, then the errors behind it: joint by joint, where it fails, and of the simulated motion."""
    parts: list[Any] = [headline_line(error), *error_tables(result)]
    if result.poses < result.samples:
        parts += [*_where(result), *_residual_error(result)]
    data: dict[str, Any] = {"headline": error.to_dict(), "comparison": result.to_dict()}
    if motion is not None:
        parts += [motion_table(motion), *filter(None, [motion.instability])]
        data["simulated"] = motion.to_dict()
    return Page(data, parts, error.alarms)


def motion_table(result: MotionComparison) -> Any:
    """Position errors of the simulated motion against the horizon; the URDF's with friction in the last column."""
    how = "under its controller" if result.closed else "under the recorded torque alone"
    names = list(result.whole.joints)
    table = table_of(
        "horizon", "starts", "tip, mm", *names, "URDF + friction: tip, mm",
        title=f"simulated motion {how}: rms position error, rad (m)", droppable=["starts", *names[::-1]],
    )  # fmt: skip
    for h in (*result.horizons, result.whole):
        table.add_row(
            "whole log" if h.horizon is None else f"{h.horizon:g}\N{NO-BREAK SPACE}s", str(h.starts), _motion(h.tip),
            *(_motion(h.joints[n]) for n in names), _motion(h.urdf_tip),
        )  # fmt: skip
    return table


def _motion(error: float) -> str:
    return figure(float(f"{error:.3g}")) if np.isfinite(error) else "unstable"


def error_tables(result: Comparison) -> list[Any]:
    """Errors joint by joint, and the share of samples left out of them."""
    where = ", ".join(Path(source).name for source in result.sources)
    table = table_of(
        "joint", "RMSE", "NRMSE", "noise floor", "fit %", "bias", "URDF + friction", "constant", "worst error", "at",
        title=f"joint by joint, measured against model on {where} (RMSE, bias and worst error in N·m or N)",
        droppable=("at", "worst error", "bias", "fit %", "constant", "RMSE"),
    )  # fmt: skip
    for name, j in result.joints.items():
        error = j.worst.measured - j.worst.predicted
        table.add_row(
            name, figure(j.rmse), f"{j.nrmse:.4f}", f"{j.noise_floor:.4f}", f"{j.fit:.1f}", figure(j.bias),
            f"{j.nominal:.3f}",
            f"{j.constant:.3f}", figure(error), f"{j.worst.t:.2f}\N{NO-BREAK SPACE}s{_of_log(j.worst.source, result)}",
        )  # fmt: skip
    parts: list[Any] = [
        table,
        *filter(None, [standstill_note(result.not_compared), pose_note(result.poses, result.samples)]),
    ]
    if worse := result.behind_urdf:
        parts += warning_lines([f"the URDF with fitted friction predicts {listed(worse)} better than this model does"])
    if result.standstill > 0:
        parts.append(
            f"{percent(result.standstill, 1)} of the torque samples are left out: the joint is at standstill there or "
            "within the filter's reach, where dry friction is undetermined (NRMSE with them "
            f"{result.nrmse_with_standstill:.4f})"
        )
    return parts


def _of_log(source: str, result: Comparison) -> str:
    """Which log a time belongs to, where there are several."""
    return f" of {Path(source).name}" if len(result.sources) > 1 else ""


def _where(result: Comparison) -> list[Any]:
    """Joint × condition table of ratios to the joint's average; a star where it is more than chance."""
    conditions = result.residuals.conditions()
    if not conditions:
        return []
    names = list(dict.fromkeys(c.condition for c in conditions))
    order = [n for n in CONDITION_ORDER if n in names]
    table = table_of(
        "joint",
        *order,
        title="where the model fails: error under a condition over the joint's average error (* p < 0.01)",
        droppable=("end", "beginning", "middle angles", "high angles", "low angles", "backwards", "forwards", "slow"),
    )
    found = {(c.joint, c.condition): c for c in conditions}
    for joint in result.joints.names:
        cells = [found.get((joint, n)) for n in order]
        table.add_row(joint, *("–" if c is None else f"{c.ratio:.2f}{'*' * (c.p_value < 0.01)}" for c in cells))
    return [table]


def _residual_error(result: Comparison) -> list[str]:
    lines = []
    for joint, found in result.residuals.structure().items():
        on = [name for name, p in found.depends_on.items() if p < 0.01]
        if on or not found.white:
            colour = (
                ""
                if found.white
                else f"correlated over {found.correlation_time:.2g} s (noise: {found.white_time:.2g} s)"
            )
            error = result.joints[joint]
            small = " (the error is that of the sensors: little to gain)" * (
                error.nrmse <= AS_THE_SENSORS * error.noise_floor
            )
            lines.append(f"{joint}: the residual is {' and '.join(filter(None, (colour, depends(on))))}{small}")
    return lines
