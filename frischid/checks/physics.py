"""Whether the torques are those of this robot: wrong signs, exchanged columns, degrees, payloads, another robot.

A log is accepted when the nominal URDF with fitted friction explains its torques. Otherwise faults are tried against
each other, alone and together (`frischid.checks.explanation`), and the simplest that explains the torques is named with
its probability against its rivals. If no fault explains the error, the URDF may be that of another robot: then the
URDF's rigid part predicts nothing, while freely fitted parameters of the same joints predict the torque.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from frischid.checks.explanation import Explanation, explain
from frischid.checks.kinematic_evidence import KinematicEvidence
from frischid.checks.lag import clear_lag
from frischid.checks.log_issue import Notebook, Sureness, span
from frischid.checks.payload import beats_links, check_payload, payload_errors
from frischid.checks.sketch import Sketch
from frischid.core.text import percent
from frischid.core.types import Array
from frischid.robot.stated_inertials import unstated


def squared(errors: Array, cap: float) -> float:
    """Sum of squared NRMSEs; an NRMSE above the cap counts as the cap."""
    return float(np.sum(np.minimum(errors, cap) ** 2))


def check_physics(sketch: Sketch, free: Callable[[Sketch], Array], notes: Notebook) -> Sketch:
    """Compare the torques with the nominal URDF, and name the faults that explain a bad fit.

    Parameters
    ----------
    free : callable
        Sketch -> NRMSE of freely fitted base parameters on the judged joints, (R,), NaN where unknown; called only when
        needed.

    Returns
    -------
    Sketch
        The log with the named faults undone, and with its torques moved to earlier times where they are clearly late.
    """
    if what := unstated(sketch.robot):
        notes.facts["nominal"] = f"the URDF has {what}: the torques cannot be compared with it"
        return sketch
    if (sketch.excess > notes.criteria.bad_nrmse).any() and (lag := clear_lag(sketch)):
        sketch = sketch.moved_earlier(lag)
    bad = bool((sketch.excess > notes.criteria.bad_nrmse).any())
    few = sketch.thinned(sketch.criteria.few_samples)
    found = explain(few, KinematicEvidence(few, free).contradicts) if bad else None
    if found is None:
        if not check_payload(sketch, notes):
            _unexplained(sketch, free, notes)
        return sketch
    corrected = _say(found, notes)
    if not any(f.kind == "payload" for f in found.best.faults) and not check_payload(corrected, notes):
        _unexplained(corrected, free, notes)
    return corrected


def _say(found: Explanation, notes: Notebook) -> Sketch:
    """Report the faults of the best hypothesis; return the thinned log with them undone."""
    sure: Sureness = "likely" if found.probability > notes.criteria.likely_probability else "possible"
    notes.facts["explanation"] = {
        "faults": [{"kind": f.kind, "joints": list(f.where)} for f in found.best.faults],
        "probability": found.probability,
        "runner_up": [] if found.runner_up is None else [[f.kind, list(f.where)] for f in found.runner_up.faults],
    }
    needed = [f for f in found.best.faults if (f.kind, f.where) in found.needed.key]
    faults, corrected = [], found.best.sketch
    for fault in [*needed, *(f for f in found.best.faults if f not in needed)]:
        if fault.kind == "payload" and fault.torque is not None:
            # the other faults stay undone: a spring would hide the body
            before = replace(found.best.sketch, given_nominal=found.best.sketch.nominal - fault.torque)
            if check_payload(before, notes):
                continue  # said already
            if not beats_links(before, payload_errors(before)):
                corrected = before  # no more than the errors that the URDF's links have anyway
                continue
        faults.append(fault)
    for fault in faults:
        # Behind a fault without fitted numbers, one with fitted numbers may only take up what the URDF misses anyway.
        behind = fault not in needed or (not fault.discrete and any(f.discrete for f in found.best.faults))
        unseen = "seen only with the other faults corrected: correct those, then check again"
        own: Sureness = "possible" if behind else sure
        said = fault.said(possible=own == "possible")
        what = f"{said} ({unseen if behind else found.odds(len(faults))})"
        blocks = fault.blocks and fault in needed
        notes.add(fault.kind, what, fault.where, own, fault.advice, blocks=blocks)
        notes.fix += fault.fix if fault in needed else ()
    return corrected


def _unexplained(sketch: Sketch, free_errors: Callable[[Sketch], Array], notes: Notebook) -> None:
    """Report joints whose torque neither the URDF nor a simple mistake explains."""
    criteria, cap = sketch.criteria, sketch.criteria.nrmse_cap
    bad = sketch.excess > criteria.bad_nrmse
    if not bad.any():
        return
    free = free_errors(sketch)
    before, nominal, best = squared(sketch.without, cap), squared(sketch.asis, cap), squared(np.fmin(free, cap), cap)
    names = tuple(n for n, yes in zip(sketch.names, bad, strict=True) if yes)
    urdf, others = (
        f"NRMSE {span(sketch.asis[bad])}",
        f"{span(sketch.without[bad])} with friction alone, {span(free[bad])} with freely fitted parameters "
        "(cross-validated)",
    )
    rigid = before - min(best, before)
    share = (before - nominal) / rigid if rigid > criteria.rigid_share * before else 1.0
    other = squared(free[bad], cap) < criteria.free_ratio * squared(sketch.asis[bad], cap)
    if np.isfinite(free).all() and other and share < criteria.wrong_robot_share:
        notes.add(
            "wrong robot",
            f"the URDF's inertials explain {percent(max(share, 0))} of the error that freely fitted parameters "
            f"explain: {urdf} with the URDF's inertials and fitted friction, {others}",
            names,
            "likely" if share < criteria.likely_wrong_share else "possible",
            "is it the URDF of the robot that was measured (model, hand, mounting: --base-rpy), and are the "
            "current gains right? Identification replaces the inertials, not the kinematics",
        )
    else:
        notes.add(
            "unexplained torque",
            f"the URDF's inertials with fitted friction leave an error of {urdf} ({others}); where the URDF and the "
            f"log are right, the error of real arms is below {criteria.bad_nrmse:g}",
            names,
            "possible",
            "check the columns of these joints, their signs and units, and whether something touched the robot; if all "
            "are right, an effect may be missing: identify, then frischid diagnose",
        )
