"""The verdict: the model's grade, its largest fault, the next steps, and every warning."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from frischid import figures
from frischid.core.text import listed, sentence
from frischid.diagnosis.clause import missing
from frischid.diagnosis.model_notes import LOADED, TOUCHED, longest_part
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import command_for, pair_of
from frischid.figures.robot_picture import STEPS, WORDS, robot_picture
from frischid.model.events import selection_errors
from frischid.model.grade import between
from frischid.model.headline import Headline, headline_of
from frischid.model.own_logs import paths_of
from frischid.model.speed_range import SpeedRange
from frischid.reports.commands import (
    alone,
    check_command,
    excite_command,
    tested_files,
    with_logs,
    with_maps,
    with_tests,
)
from frischid.reports.study import Study

LISTED = 4  # parameters named in a sentence; the table of parameters has the others
STEPS_PROPOSED = 3
SAME_NRMSE = 1e-3  # relative difference of two errors of one model on the same logs: another version may round
CUT_OUT = {TOUCHED: "the contacts", LOADED: "the times with another load"}
"""Note of a diagnosis -> what changed the parameters of a model that was fitted to it."""
NOT_FOR_USE = ("E", "F")  # grades within one of the five factors of the URDF, or above it


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    return {
        "error": study.headline,
        "speeds": _speeds(study),
        "ladder": _ladder(study),
        "forecast": study.proposed is not None,
        "worst_condition": figures.failure.worst(study.comparison, above=study.comparison.nrmse),
        "missing": "" if study.diagnosis is None else missing(study.diagnosis),
        "refused": study.refusals[0] if study.proposed is None and study.refused else "",
        "next": _next(study, model_path),
        "alarms": study.headline.alarms,
        "warnings": study.warnings(),
        "picture": Markup(_picture(study)),  # the picture escapes its own texts
        "unfitted": len(study.model.joints) < len(study.model.robot.joints),
        "colours": [{"colour": colour, "text": word} for colour, word in zip(STEPS, WORDS, strict=True)],
    }


def _speeds(study: Study) -> str:
    """Up to which speeds the error is usual; empty for a model with further steps, of which nobody knows that."""
    known = study.model.history[-1].get("speed_range") if study.model.history else None
    return f"{sentence(str(SpeedRange(**known)))}." if known else ""


def _picture(study: Study) -> str:
    """The robot in the middle of its motion."""
    joints = {
        name: (study.headline.joints.get(name, fit.nrmse), fit.noise_floor, fit.constant)
        for name, fit in study.verdict.joints.items()
    }
    robot = study.model.robot
    return robot_picture(robot, np.median(study.logs[0].select(robot.joints).q, axis=0), joints)


def _ladder(study: Study) -> list[dict[str, Any]]:
    """Errors from a constant torque down to the sensors' noise, with this model among them."""
    error = study.headline
    more = [(name, x, "other") for name, x in _before(study, error)]
    best = study.proposed
    if best is not None:
        after = error.nrmse * best.error_after / best.error_before
        more.append((f"forecast: with {best.effect}", after, "later"))
    return rungs(error, more)


def rungs(error: Headline, more: Sequence[tuple[str, float, str]] = ()) -> list[dict[str, Any]]:
    """Errors from the largest to the smallest, each with the width of its bar.

    Parameters
    ----------
    more : sequence of (str, float, str)
        Further errors: name, NRMSE, and ``"other"`` or ``"later"``.
    """
    found = [
        ("constant torque", error.constant_nrmse, "other"),
        ("URDF with fitted friction", error.urdf_nrmse, "other"),
        ("this model", error.nrmse, "model"),
        ("sensors' noise alone", error.noise_floor, "floor"),
        *more,
    ]
    found.sort(key=lambda rung: -rung[1])
    low, high = 0.5 * error.noise_floor, found[0][1]
    return [
        {"name": name, "error": x, "kind": kind, "width": between(x, low, high), "here": kind == "model"}
        for name, x, kind in found
    ]


def _before(study: Study, error: Headline) -> list[tuple[str, float]]:
    """The error before the model's steps, where it was measured on the same logs as the headline.

    Logs are compared by name, because a model's file holds paths of the machine that wrote it; that the model's own
    error is the same says that the logs are.
    """
    steps = [(event, found) for event in study.model.history if (found := headline_of(event)) is not None]
    if len(steps) < 2 or not _same(steps[-1][1], error):
        return []
    event, first = steps[-1][0], steps[0][1]
    if len(steps) > 2 and _names(first) == _names(error) and first.measured == error.measured:
        return [("before all added effects", first.nrmse)]
    before = event.get("test_before") if error.measured == "test" else selection_errors(event)[0]
    kinds = dict.fromkeys(text.split("(")[0].split("@")[0] for text in event.get("effects", ()))
    return [] if before is None else [("before " + " + ".join(kinds), float(before))]


def _same(one: Headline, other: Headline) -> bool:
    """Whether two errors are one model's on the same logs."""
    alike = abs(one.nrmse - other.nrmse) < SAME_NRMSE * other.nrmse
    return alike and one.measured == other.measured and _names(one) == _names(other)


def _names(error: Headline) -> list[str]:
    """The logs of an error, without their folders."""
    return [Path(source).name for source in error.logs]


def _logs(study: Study) -> str:
    """The logs in a command to copy: nothing where the model's own serve, which its file names.

    Where the robot changed, the new logs select. They are named with their mapping files; a log without a file is not.
    """
    changed = study.diagnosis is not None and study.diagnosis.situation == "changed"
    if not changed:
        return "" if paths_of(study.model) else " LOG..."
    files = [log.file for log, role in zip(study.logs, study.roles, strict=True) if role == "test"]
    named = [file for file in files if file is not None]
    return with_logs(named, alone) if named and len(named) == len(files) else " LOG..."


def _cut(study: Study, diagnosis: Diagnosis) -> str:
    """Command that keeps the longest part of a log without a contact or a change of the load; else a pattern."""
    cut = {source for source, _, _ in diagnosis.to_cut_out}
    log = next((log for log in study.logs if log.source in cut), None)
    if log is None:
        return "frischid cut LOG --from START --until STOP -o part.csv"
    start, end = (x - float(log.t[0]) for x in longest_part(log, diagnosis.to_cut_out))
    name = Path(log.source)
    out = shlex.quote(f"{name.stem}_part.csv")
    maps = with_maps([] if log.file is None else [log.file], alone)
    return f"frischid cut {shlex.quote(name.name)} --from {start:.1f} --until {end:.1f}{maps} -o {out}"


def _tests(study: Study) -> str:
    """Options that name the report's logs to which the model was not fitted."""
    tested = [log for log, role in zip(study.logs, study.roles, strict=True) if role == "test"]
    named = [log.file for log in tested if log.file is not None]
    return with_tests(named or tested_files(study.model), alone)


def _next(study: Study, model_path: str) -> list[dict[str, Any]]:
    """At most three steps: the kind of each, and what its sentence needs."""
    given = shlex.quote(Path(model_path).name)
    better = "better.json" if given != "better.json" else "still-better.json"
    found: list[dict[str, Any]] = []
    diagnosis, best = study.diagnosis, study.proposed
    robot, logs = study.model.robot, _logs(study)
    pair = [] if diagnosis is None else pair_of(diagnosis.findings, diagnosis.probabilities)
    cause = [] if diagnosis is None else [x for note, x in CUT_OUT.items() if note in diagnosis.notes]
    if diagnosis is not None and cause:
        found.append({"kind": "cut", "what": listed(cause), "command": _cut(study, diagnosis)})
    elif diagnosis is not None and diagnosis.verdict == "unknown" and diagnosis.shown_before:
        known = diagnosis.shown_before[0]
        where = f" --joints {shlex.quote(','.join(known.joints))}" if known.joints else ""
        own = "" if paths_of(study.model) else " LOG..."
        add = f"frischid add {given} {known.effect}{where}{own}{_tests(study) if not own else ''} -o {better}"
        found.append({"kind": "known", "effect": known.effect, "command": add})
    elif diagnosis is not None and diagnosis.verdict == "unknown":
        found.append({"kind": "formula", "command": f"frischid studio {given}{logs}"})
    elif len(pair) == 2:
        effects = listed([f.effect for f in pair])
        found.append({"kind": "separate", "effects": effects, "command": command_for(pair, robot, alone)})
    if best is not None:
        where = f" --joints {shlex.quote(','.join(best.joints))}" if best.joints else ""
        add = f"frischid add {given} {best.effect}{where}{logs}{_tests(study) if not logs else ''} -o {better}"
        refused = listed(study.passed_over)
        found.append({"kind": "add", "effect": best.effect, "change": best.change, "command": add, "refused": refused})
    if weak := study.model.estimate.hardly_known:
        more = " …" * (len(weak) > LISTED)
        plan = excite_command(study.model, alone)
        names = ", ".join(weak[:LISTED]) + more
        found.append({"kind": "excite", "count": len(weak), "names": names, "command": plan})
    if not study.held_out:
        found.append({"kind": "test", "command": f"frischid compare {given} NEW_LOG"})
    if cause:
        return found[:STEPS_PROPOSED]  # neither a grade nor a use of this model is worth a step
    if study.headline.grade in NOT_FOR_USE:
        # The warning is one of the steps that are shown, whatever else there is to do.
        again = f"frischid report {better}{logs}" if best is not None else check_command(study.model, name=alone)
        found = [*found[: STEPS_PROPOSED - 1], {"kind": "wait", "added": best is not None, "command": again}]
    else:
        found.append({"kind": "use", "command": f"frischid export {given if best is None else better} -o controller.c"})
    return found[:STEPS_PROPOSED]
