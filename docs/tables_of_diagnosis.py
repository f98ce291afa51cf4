"""Tables of the diagnosis: hidden effects named or not, stated probabilities, healthy robots, planted effects."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Sequence

from table_parts import Row, data, rows_of, share, table


def hidden_commanded() -> str:
    """Hidden effects of robots that take commands: named or not, and the simulated motion with the finding."""
    rows = data("hidden_commanded")["rows"]
    lines = []
    for kind in dict.fromkeys(row["hidden"] for row in rows):
        mine = [row for row in rows if row["hidden"] == kind]
        ratios = [row["simulated"] for row in mine if row["hit"] and math.isfinite(row["simulated"] or math.nan)]
        fall = f"{100 * (math.exp(sum(map(math.log, ratios)) / len(ratios)) - 1):+.0f} %" if ratios else "not simulated"
        lines.append((f"`{kind}`", str(len(mine)), str(sum(row["hit"] for row in mine)), fall))
    lines.append(("all", str(len(rows)), str(sum(row["hit"] for row in rows)), ""))
    return table(("hidden effect", "cases", "named first", "simulated error with it"), lines)


def planted_effects() -> str:
    """Effects planted in measured logs."""
    head = ("robot", "planted in", "effects", "named first", "first but for the robot's own", "among the first three",
            "contacts and unknown terms recognised")  # fmt: skip
    places = {"always": "all logs", "changed": "the test log"}
    lines = [
        (
            row["robot"],
            places[row["situation"]],
            *(str(row[key]) for key in ("effects", "first", "first but for its own", "top three")),
            f"{row['contact, unknown']} of {row['of']}",
        )
        for row in rows_of("planted_effects")
    ]
    return f"{table(head, lines)}\n{'. '.join(data('planted_effects')['notes'])}.\n"


def carried_loads() -> str:
    """Loads that a robot carries for a part of a log: named or not, and pushes that are taken for loads."""
    head = ("log", "cases", "load named", "mass right", "times right")
    lines = [tuple(str(row[key]) for key in ("log", *head[1:])) for row in rows_of("carried_loads")]
    return table(head, lines)


def any_robot() -> str:
    """Random robots with a hidden cause: named or not, and how the commands ended."""
    head = ("hidden cause", "robots", "named", "commands run", "of these refused in a sentence", "failed")
    keys = ("trials", "named", "commands", "refused", "failed")
    rows = rows_of("any_robot")
    lines = [(row["cause"], *(str(row[key]) for key in keys)) for row in rows]
    lines.append(("all", *(str(sum(row[key] for row in rows)) for key in keys)))
    return f"{table(head, lines)}\n{'. '.join(data('any_robot')['notes'])}.\n"


EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Limits of the ranges of probability."""


def calibration() -> str:
    """Reliability: stated probability against the share of right answers."""
    return reliability(rows_of("calibration"))


def reliability(rows: Sequence[Row]) -> str:
    """Ranges of stated probability with the share of right answers."""
    lines = []
    for low, high in itertools.pairwise(EDGES):
        here = [row for row in rows if low <= row["probability"] < high or row["probability"] == high == 1.0]
        if here:
            said, right = (sum(row[key] for row in here) / len(here) for key in ("probability", "correct"))
            lines.append((f"{low:.2f} to {high:.2f}", str(len(here)), f"{said:.2f}", f"{right:.2f}"))
    head = ("stated probability", "cases", "mean stated probability", "share of right answers")
    return f"{table(head, lines)}\n{sure_in_words(rows)}"


def sure_in_words(rows: Sequence[Row]) -> str:
    """Number of cases, sure answers, and the calibration error."""
    sure = [row for row in rows if row["probability"] >= 0.9]
    parts = [
        (g, [row for row in rows if row["generator"] == g]) for g in dict.fromkeys(row["generator"] for row in rows)
    ]
    of = " and ".join(f"{len(part)} of the {g} generator ({seeds_in_words(part)})" for g, part in parts)
    crashes = sum(row["answer"] == "crash" for row in rows)
    errors = " and ".join(f"{calibration_error(part):.2f} on the {g}" for g, part in parts)
    wrong = [f"`{row['answer']}` for {cause(row)} ({row['arm']})" for row in sure if not row["correct"]]
    misses = f" The others say {', '.join(wrong)}." if wrong else ""
    return (
        f"{len(rows)} cases: {of}; {crashes} crashed. Of the {len(sure)} answers with a probability of 0.9 or more, "
        f"{sum(row['correct'] for row in sure)} are right.{misses}\n\nThe expected calibration error (mean distance "
        "between stated probability and share of right answers) "
        f"is {calibration_error(rows):.2f}: {errors} generator.\n"
    )


def seeds_in_words(rows: Sequence[Row]) -> str:
    """Seeds of some cases."""
    seeds = sorted({str(row["seed"]) for row in rows})
    return f"seed{'s' if len(seeds) > 1 else ''} {' and '.join(seeds)}"


def cause(row: Row) -> str:
    """What a case hides."""
    return " and ".join(row["effects"]) or f"a {row['kind']} robot"


def calibration_error(rows: Sequence[Row]) -> float:
    """Mean distance of stated probability and share of right answers, over the ranges."""
    error = 0.0
    for low, high in itertools.pairwise(EDGES):
        here = [row for row in rows if low <= row["probability"] < high or row["probability"] == high == 1.0]
        error += abs(sum(row["probability"] - row["correct"] for row in here)) / len(rows)
    return error


def by_chance(rows: Sequence[Row]) -> float:
    """Mean calibration error of answers that are right exactly as often as stated: what chance alone causes."""
    draw = random.Random(0)
    drawn = ([{**row, "correct": draw.random() < row["probability"]} for row in rows] for _ in range(1000))
    return sum(map(calibration_error, drawn)) / 1000


def chance_error() -> str:
    """What chance alone causes, over all cases."""
    return f"{by_chance(rows_of('calibration')):.2f}"


def chance_errors() -> str:
    """The same for each generator alone."""
    rows = rows_of("calibration")
    parts = [[row for row in rows if row["generator"] == g] for g in dict.fromkeys(row["generator"] for row in rows)]
    return " and ".join(f"{by_chance(part):.2f}" for part in parts)


def beside_right() -> str:
    """Effects beside the first finding that are really there."""
    told = [right for row in rows_of("calibration") for right in row["beside"]]
    return f"{sum(told)} of {len(told)}"


def beside_right_alone() -> str:
    """Of the cases with one hidden effect and nothing else, those without another effect beside it."""
    rows = [row for row in rows_of("calibration") if row["kind"] == "single" and not row["background"]]
    return f"{sum(not row['beside'] for row in rows)} of {len(rows)}"


def found_by_background() -> str:
    """Whether a true effect is named first, and on the right joints, by the size of the background."""
    rows = [row for row in rows_of("calibration") if row["kind"] in ("single", "pair")]
    groups = {
        f"background: {name}": [row for row in rows if low <= row["background"] < high]
        for name, low, high in BACKGROUNDS
    }
    groups["gears with play"] = [row for row in rows if set(row["effects"]) & {"backlash", "gear_play"}]
    groups["a change of the robot"] = [row for row in rows if set(row["effects"]) & CHANGES]
    groups["two effects"] = [row for row in rows if row["kind"] == "pair"]
    lines = [
        (name, *(share(here, key) for key in ("correct", "right joints", "both"))) for name, here in groups.items()
    ]
    head = (
        "cases",
        "the most probable answer is right",
        "exactly the right joints, where the answer is the hidden effect",
        "both of two effects among the first three",
    )
    return table(head, lines)


SURE = 0.8  # from here on the diagnosis names no rivals
CHANGES = {"payload", "gravity_tilt", "drive_gain", "time_delay"}
BACKGROUNDS = (
    ("none", 0.0, 1e-9),
    ("up to 1.5 % of the torque", 1e-9, 0.015),
    ("1.5 to 3 % of the torque", 0.015, 1.0),
)


def healthy() -> str:
    """Alarms on healthy robots."""
    rows = [row for row in rows_of("calibration") if row["kind"] == "healthy"]
    lines = []
    for name, low, high in BACKGROUNDS:
        here = [row for row in rows if low <= row["background"] < high]
        right = sum(row["correct"] for row in here)
        sure = sum(row["alarm"] and row["probability"] >= SURE for row in here)
        lines.append((name, str(len(here)), str(sum(row["alarm"] for row in here)), str(sure), str(right)))
    head = ("background of small effects", "healthy robots", "alarms", "of these with 0.8 or more", "right answers")
    return table(head, lines)


def planted_log_faults() -> str:
    """Faults in simulated logs: named first, named together, silent without one, certain and right."""
    return _planted_faults("planted_log_faults", "six simulated arms, links off by 10 %")


def planted_measured_faults() -> str:
    """The same in measured logs."""
    return _planted_faults("planted_measured_faults", "logs of five measured arms")


def _planted_faults(name: str, head: str) -> str:
    said = {
        "alone, all": "one fault, named first",
        "two faults": "two faults, both named",
        "clean": "no fault: nothing is named",
        "certain is right": "called certain, and right",
    }
    rows = {row["fault"]: row for row in rows_of(name) if row["runs"]}
    lines = [(text, f"{rows[key]['right']} of {rows[key]['runs']}") for key, text in said.items() if key in rows]
    return table(("", head), lines)
