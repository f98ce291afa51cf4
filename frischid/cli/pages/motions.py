"""Simulated logs and planned motions, as pages."""

from __future__ import annotations

from frischid.cli.pages.page import Page
from frischid.logs.log import Log
from frischid.motions.discrimination import Apart
from frischid.motions.plan import Plan

NOTABLY_SHARPER = 1.05  # ratio of standard errors above which a planned motion is called better


def excitation(planned: Plan, output: str, picture: str | None, apart: Apart | None = None) -> Page:
    """A planned motion, and the limits that it does not keep."""
    told = []
    if apart is not None:
        better = f"{apart.sharper:.1f} times smaller than" if apart.sharper > NOTABLY_SHARPER else "no smaller than"
        whose = "correlation of those parts of their columns that no other parameter explains:"
        if apart.shared:
            whose = (
                f"{apart.second} contains {apart.first}; correlation of the further columns of {apart.second} with all "
                "other columns:"
            )
        told = [
            f"{apart.first} and {apart.second}: their parameters' standard errors are {better} on a random motion",
            f"{whose} {apart.correlation:.2f} ({apart.typical:.2f} on a random motion; at 1 no data can distinguish "
            "the two effects)",
        ]
    lines = [
        *told,
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
    if apart is not None:
        data["separate"] = {
            "effects": [apart.first, apart.second],
            "standard_errors_smaller_by": apart.sharper,
            "correlation": apart.correlation,
            "correlation_of_random_motions": apart.typical,
        }
    return Page(data, lines)


def simulated(log: Log, output: str, noisy: bool) -> Page:
    """The file of a simulated log."""
    data = {
        "output": output,
        "samples": len(log),
        "seconds": log.duration,
        "rate_hz": log.rate,
        "joints": list(log.joints),
    }
    exact = "" if noisy else "; no noise (see --noise-q, --noise-tau)"
    return Page(data, [f"{output}: {len(log)} samples of {len(log.joints)} joints, {log.duration:.4g} s{exact}"])
