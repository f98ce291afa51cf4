"""Simulated logs and planned motions, as pages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from rich.table import Table

from frischid.cli.pages.page import Page, table_of
from frischid.core.text import counted, listed
from frischid.logs.log import Log
from frischid.model.alarms import Alarm
from frischid.motions.discrimination import Apart
from frischid.motions.plan import Plan
from frischid.motions.programme import NEAREST_MEASURED, Nearest, Programme

PEAKS = "largest values, of the limits that the plan may use (positions from the middle of the range)"
INFLATED = 10.0  # standard error of a parameter that is named, over that with all others known
MOST_NAMED = 5  # such parameters
NOTABLY_SHARPER = 1.05  # ratio of standard errors above which a planned motion is called better


def excitation(
    planned: Plan, motion: Programme, output: str, picture: str | None, aim: Apart | dict[str, float] | None = None
) -> Page:
    """A planned motion with its ways, its peaks against the limits, and the limits that it does not keep.

    `aim`: what the motion was planned for besides all parameters, two effects or the drives' parameters.
    """
    told = []
    apart = aim if isinstance(aim, Apart) else None
    narrower = aim if isinstance(aim, dict) else None
    if narrower is not None:
        each = ", ".join(f"{name} {x:.1f} times" for name, x in narrower.items())
        told = [f"standard errors that the URDF lets expect, smaller than on a random motion: {each}"]
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
    lines: list[Any] = [
        *told,
        f"{planned.criterion} {planned.cost:.4g} after {planned.evaluations:,} evaluations in {planned.seconds:.1f} s",
        *([] if aim else [_least_determined(planned.inflation)]),
        *planned.notes,
        _peaks(motion),
        *_distance(motion),
        _ways(planned, motion),
        f"motion of {motion.duration:.4g} s written to {output}",
    ]
    if picture:
        lines.append(f"picture written to {picture}")
    data = {
        "criterion": planned.criterion,
        "cost": planned.cost,
        "evaluations": planned.evaluations,
        "seconds": planned.seconds,
        "inflation": planned.inflation,
        "violations": [str(v) for v in planned.violations],
        "seconds_of_motion": motion.duration,
        "approach_seconds": motion.approach,
        "return_seconds": motion.back,
        "peaks": [{**vars(p), "limit": p.limit if np.isfinite(p.limit) else None} for p in motion.peaks],
        "nearest": None if motion.nearest is None else _nearest(motion.nearest),
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
    if narrower is not None:
        data["standard_errors_smaller_by"] = narrower
    return Page(data, lines, unsafe(planned))


def _least_determined(inflation: Mapping[str, float]) -> str:
    """The parameters that resemble others along the motion; a condition number says only that there are some.

    Examples
    --------
    >>> _least_determined({"m8": 168.2, "m9": 163.9, "fc1": 1.4})
    'least determined: m8 and m9 (standard errors 168 and 164 times as large as with all other parameters known)'
    >>> _least_determined({"fc2": 1.31, "fc1": 1.2})
    'every standard error is at most 1.3 times as large as with all other parameters known'
    """
    named = [name for name in inflation if inflation[name] > INFLATED][:MOST_NAMED]
    known = "as large as with all other parameters known"
    if not named:
        return f"every standard error is at most {max(inflation.values()):.2g} times {known}"
    errors = "standard error" if len(named) == 1 else "standard errors"
    times = listed([f"{inflation[name]:.3g}" for name in named])
    return f"least determined: {listed(named)} ({errors} {times} times {known})"


def unsafe(planned: Plan) -> list[Alarm]:
    """The alarm that a motion does not keep all limits; nothing where it does."""
    if not planned.violations:
        return []
    told = "; ".join(map(str, planned.violations))
    kinds = {v.kind for v in planned.violations}
    remedy = "Do not run the motion. Plan it again with a larger --budget, another --seed, or another --duration."
    if "torque" in kinds:
        remedy += " A torque that is too large at every pose needs a larger --limits, or other efforts in the URDF."
    if "distance" in kinds:
        remedy += " Bodies that are too near in every pose need another --floor, or other collision shapes."
    return [Alarm("limit-not-kept", "severe", f"The motion does not keep all limits: {told}.", remedy)]


def _peaks(motion: Programme) -> Table:
    """One row per joint: each peak, of its limit."""
    kinds = list(dict.fromkeys(p.kind for p in motion.peaks))
    table = table_of("joint", *kinds, title=PEAKS)
    for joint in motion.joints:
        of = {p.kind: p for p in motion.peaks if p.joint == joint}
        cells = (f"{p.value:.3g} of {p.limit:.3g}" if np.isfinite(p.limit) else f"{p.value:.3g}" for p in of.values())
        table.add_row(joint, *cells)
    return table


def _distance(motion: Programme) -> Iterator[str]:
    """The least distance; nothing without collision shapes, of which a note of the plan tells."""
    near = motion.nearest
    if near is None:
        return
    if not np.isfinite(near.distance):
        yield f"no two bodies, nor a body and the floor, come nearer than {NEAREST_MEASURED:g} m"
        return
    yield (
        f"least distance: {near.bodies}, {near.distance:.3g} m at {near.time:.1f} s (margin {near.margin:g} m); the "
        "floor is at the height of the base, or as --floor says"
    )


def _nearest(near: Nearest) -> dict[str, Any]:
    return {**vars(near), "distance": near.distance if np.isfinite(near.distance) else None}


def _ways(planned: Plan, motion: Programme) -> str:
    if motion.approach:
        said = f"from the home pose to the motion: {motion.approach:.3g} s; back: {motion.back:.3g} s"
        ways = f"{said}; at standstill between"
        kept = not any(v.kind == "position" for v in planned.violations)  # then only a way goes beyond
        beyond = [p.joint for p in motion.peaks if p.kind == "position" and p.value > p.limit and kept]
        return f"{ways}; the ways use the URDF's whole range of {listed(beyond)}" if beyond else ways
    first = ", ".join(f"{x:.3g}" for x in motion(np.zeros(1))[0][0])
    return f"the motion begins and ends at standstill; move the robot to ({first}) first, or give --home"


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
    joints = counted(len(log.joints), "joint")
    return Page(data, [f"{output}: {len(log)} samples of {joints}, {log.duration:.4g} s{exact}"])
