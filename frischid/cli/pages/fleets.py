"""A fleet as a page: the parameters its robots share, and the robots that differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from frischid.cli.pages.page import Page, figure, plain, quantities, table_of, warning_lines
from frischid.core.text import counted
from frischid.fleet.deviation import LEAST_ROBOTS
from frischid.fleet.results import Fleet, Member
from frischid.robot.robot import Robot

MOST = 5  # skipped logs and warnings that are listed; of further ones only the number is printed


def fleet(found: Fleet, output: str | None) -> Page:
    """The fleet's parameters, the robots that differ, the logs that were skipped."""
    members, different = found.members, found.different
    logs, samples = sum(m.logs for m in members), sum(m.samples for m in members)
    hours = sum(m.seconds for m in members) / 3600
    parts: list[Any] = [
        f"{counted(len(members), 'robot')}, {counted(logs, 'log')}, {samples} samples ({hours:.3g} robot-hours), "
        f"{found.where}; "
        f"{len(found.model.base)} base parameters, effects {', '.join(str(e) for e in found.model.effects)}",
        *(f"  {escape(n)}" for n in found.notes),
        _parameters(found),
    ]
    if different:
        parts += [
            f"{len(different)} of {len(members)} robots differ from the others, the largest difference first",
            _different(different, found.model.robot),
        ]
        parts += [f"{escape(m.name)}: {escape(sentence(m))}" for m in different if sentence(m)]
    else:
        parts.append(f"none of {len(members)} robots differs from the others by more than is usual in this fleet")
        parts += _largest(members)
    if found.skipped:
        parts.append(f"{counted(len(found.skipped), 'log')} skipped; the figures are those of the other logs:")
        parts += [f"  {escape(s.address)}: {escape(s.reason)}" for s in found.skipped[:MOST]]
        parts += [f"  and {len(found.skipped) - MOST} more"] * (len(found.skipped) > MOST)
    parts += warning_lines(found.warnings[:MOST])
    parts += [f"and {counted(len(found.warnings) - MOST, 'more warning')}"] * (len(found.warnings) > MOST)
    if output:
        parts.append(f"model of the fleet written to {escape(output)}")
    return Page(_data(found), parts, found.alarms)


def _largest(members: Sequence[Member]) -> list[str]:
    """The largest differences of a fleet in which none is called unusual."""
    above = [m for m in members if m.excess > 1][:MOST]
    if not above:
        return []
    named = ", ".join(f"{escape(m.name)} {m.excess:.2g}" for m in above)
    hidden = f"; in a fleet of fewer than {LEAST_ROBOTS} robots, two that differ hide one another: leave one out"
    few = len(above) > 1 and len(members) < LEAST_ROBOTS
    return [f"the largest differences: {named} times the usual one{hidden * few}"]


def _spread(found: Fleet) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Standard deviation of the robots' own parameter values, over robots that do not differ from the fleet."""
    own = [m.deviation.own.theta for m in found.members if m.deviation.own is not None and not m.differs]
    if len(own) < 2:
        return np.full(len(found.model.base), np.nan)
    return np.asarray(np.std(own, axis=0, ddof=1))


def _parameters(found: Fleet) -> Table:
    estimate = found.model.estimate
    table = table_of("parameter", "stands for", "unit", "value", "± s.e.", "robots ±", title="shared parameters")
    rows = zip(estimate.columns, found.model.expressions, estimate.theta, estimate.stderr, _spread(found), strict=True)
    for column, expression, value, error, spread in rows:
        table.add_row(column.name, expression, column.unit, figure(value), figure(error), figure(spread))
    return table


def _different(members: tuple[Member, ...], robot: Robot) -> Table:
    table = table_of("robot", "what", "× usual", "p", "error with the fleet's", "with its own", "parameters")
    for m in members:
        table.add_row(
            escape(m.name),
            escape(m.effect),
            f"{m.excess:.3g}",
            f"{m.p_value:.1e}",
            f"{m.deviation.error_fleet.mean():.4f}",
            f"{m.deviation.error_own.mean():.4f}",
            escape(_values(m, robot)),
        )
    return table


def _values(m: Member, robot: Robot) -> str:
    if m.parameters_explain:
        changed = [f"{n} {old:.4g} → {new:.4g}" for c in m.changes for n, (old, new) in c.values.items()]
        return ", ".join(changed)
    return "" if m.finding is None else quantities(m.finding.found(robot))


def sentence(m: Member) -> str:
    """A sentence on the change of a robot."""
    if m.parameters_explain:
        return "these parameters of the model differ from those of the fleet: " + ", ".join(
            f"{c.effect} of {c.joint}" for c in m.changes
        )
    return "this robot differs, and no effect of the catalogue explains it" if m.finding is None else m.finding.sentence


def _data(found: Fleet) -> dict[str, Any]:
    estimate = found.model.estimate
    columns = zip(estimate.columns, found.model.expressions, strict=True)
    shared = [
        {"name": c.name, "expression": e, "unit": c.unit, "value": float(v), "stderr": float(s), "spread": plain(r)}
        for (c, e), v, s, r in zip(columns, estimate.theta, estimate.stderr, _spread(found), strict=True)
    ]
    return {
        "where": found.where,
        "cutoff_hz": found.model.lowpass.cutoff,
        "parameters": shared,
        "null": {"scale": found.null.scale, "freedom": found.null.freedom, "within": found.null.within},
        "robots": [_member(m) for m in found.members],
        "different": [m.name for m in found.different],
        "skipped": [vars(s) for s in found.skipped],
        "notes": list(found.notes),
        "warnings": list(found.warnings),
        "alarms": [alarm.to_dict() for alarm in found.alarms],
    }


def _member(m: Member) -> dict[str, Any]:
    own = m.deviation.own
    return {
        "name": m.name,
        "logs": m.logs,
        "samples": m.samples,
        "seconds": m.seconds,
        "differs": m.differs,
        "excess": m.excess,
        "p_value": m.p_value,
        "effect": m.effect,
        "error_fleet": float(m.deviation.error_fleet.mean()),
        "error_own": float(m.deviation.error_own.mean()),
        "values": None if own is None else own.theta.tolist(),
        "stderr": None if own is None else own.stderr.tolist(),
        "undetermined": m.deviation.reason,
        "changes": [vars(c) | {"values": {n: list(v) for n, v in c.values.items()}} for c in m.changes],
        "finding": None if m.finding is None else m.finding.to_dict(),
    }
