"""Simulated logs and planned motions, as pages."""

from __future__ import annotations

from frischid.excitation import Plan
from frischid.log import Log
from frischid.show.page import Page


def excitation(planned: Plan, output: str, picture: str | None) -> Page:
    """What was planned, and which limits could not be met."""
    lines = [
        f"{planned.criterion} {planned.cost:.4g} after {planned.evaluations:,} evaluations in {planned.seconds:.1f} s",
        *(f"limit not met: {v}" for v in planned.violations),
        *planned.notes,
        f"motion of {planned.trajectory.duration:g} s written to {output}",
    ]
    if picture:
        lines.append(f"picture written to {picture}")
    data = {
        "criterion": planned.criterion,
        "cost": planned.cost,
        "evaluations": planned.evaluations,
        "seconds": planned.seconds,
        "violations": [str(v) for v in planned.violations],
        "notes": list(planned.notes),
        "output": output,
        "picture": picture,
    }
    return Page(data, lines)


def simulated(log: Log, output: str, noisy: bool) -> Page:
    """Where a simulated log went."""
    data = {
        "output": output,
        "samples": len(log),
        "seconds": log.duration,
        "rate_hz": log.rate,
        "joints": list(log.joints),
    }
    exact = "" if noisy else "; no noise (see --noise-q, --noise-tau)"
    return Page(data, [f"{output}: {len(log)} samples of {len(log.joints)} joints, {log.duration:.4g} s{exact}"])
