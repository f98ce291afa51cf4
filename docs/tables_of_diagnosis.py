"""Tables of the diagnosis: hidden effects named or not, stated probabilities, healthy robots, planted effects."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from table_parts import Row, data, middle, rows_of, share, table


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


def hidden_effects() -> str:
    """Shares of right answers, by kind of case."""
    rows = rows_of("hidden_effects")
    kinds = {kind: [row for row in rows if row["kind"] == kind] for kind in dict.fromkeys(row["kind"] for row in rows)}
    single = kinds.get("single", [])
    clean = [row for row in single if not row["background"]]
    dirty = [row for row in single if row["background"]]
    strong = [row for row in dirty if min(row["sizes"]) >= 2 * row["background"]]
    weak = [row for row in dirty if min(row["sizes"]) < 2 * row["background"]]
    healthy = kinds.get("healthy", [])
    right = [row for row in clean if row["after"] is not None]
    lines = [
        ("one effect, no background: named first, grades 1 and 2", share(row for row in clean if row["grade"] < 3)),
        ("the same, grade 3", share(row for row in clean if row["grade"] == 3)),
        ("one effect at least twice its background: named first", share(strong)),
        ("one effect smaller than twice its background: named first", share(weak)),
        ("right joints, where the effect is right", share(single, "right joints")),
        ("two effects, both added by `improve` in three steps", share(kinds.get("pair", []))),
        ("healthy, no background: no alarm", share(row for row in healthy if not row["background"])),
        ("healthy, with a background: no wrong name", share(row for row in healthy if row["background"])),
        (
            "contact, or something outside the catalogue: recognised",
            share(kinds.get("contact", []) + kinds.get("unknown", [])),
        ),
        ("error over noise floor with the right effect added, median, no background", over_floor(right)),
    ]
    seeds = ", ".join(dict.fromkeys(str(row["seed"]) for row in rows))
    return table((f"{len(rows)} cases of seed {seeds}", "share, and cases"), lines)


def over_floor(rows: Sequence[Row]) -> str:
    """Median ratio of the error with the right effect and the noise floor."""
    return f"{middle(row['after'] / row['floor'] for row in rows):.2f}" if rows else "–"


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


EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Limits of the ranges of probability."""


def calibration() -> str:
    """Reliability: stated probability against the share of right answers."""
    return reliability(rows_of("calibration"))


def calibration_later() -> str:
    """The same of a later version, on other seeds."""
    return reliability(rows_of("calibration_later"))


def found_later() -> str:
    """True effects named first, and alarms on healthy robots, by the size of the background; of the later version."""
    rows, lines = rows_of("calibration_later"), []
    for name, low, high in BACKGROUNDS:
        here = [row for row in rows if low <= row["background"] < high]
        hidden = [row for row in here if row["kind"] in ("single", "pair")]
        well = [row for row in here if row["kind"] == "healthy"]
        alarms = sum(row["verdict"] != "none" and not row["rules right"] for row in well)
        lines.append((name, share(hidden, "named right"), share(hidden, "right joints"), f"{alarms} of {len(well)}"))
    head = ("background", "a true effect named first, or with it", "right joints", "alarms on healthy robots")
    return table(head, lines)


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
    seeds = dict.fromkeys((row["generator"], row["seed"]) for row in rows)
    parts = [(g, s, [row for row in rows if (row["generator"], row["seed"]) == (g, s)]) for g, s in seeds]
    of = " and ".join(f"{len(part)} of the {g} generator (seed {s})" for g, s, part in parts)
    crashes = sum(row["answer"] == "crash" for row in rows)
    errors = " and ".join(f"{calibration_error(part):.2f} on the {g}" for g, _, part in parts)
    wrong = [f"`{row['answer']}` for {cause(row)} ({row['arm']})" for row in sure if not row["correct"]]
    misses = f" The others say {', '.join(wrong)}." if wrong else ""
    return (
        f"{len(rows)} cases: {of}; {crashes} crashed. Of the {len(sure)} answers with a probability of 0.9 or more, "
        f"{sum(row['correct'] for row in sure)} are right.{misses}\n\nThe expected calibration error (mean distance "
        "between stated probability and share of right answers) "
        f"is {calibration_error(rows):.2f}: {errors} generator.\n"
    )


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


def found_by_background() -> str:
    """Whether a true effect is named first, and on the right joints, by the size of the background."""
    rows = [row for row in rows_of("calibration") if row["kind"] in ("single", "pair")]
    lines = []
    for name, low, high in BACKGROUNDS:
        here = [row for row in rows if low <= row["background"] < high]
        lines.append((name, share(here, "named right"), share(here, "right joints")))
    gears = [row for row in rows if "backlash" in row["effects"] or "gear_play" in row["effects"]]
    lines.append(
        ("gears with play, with and without background", share(gears, "named right"), share(gears, "right joints"))
    )
    head = (
        "background",
        "a true effect named first, or with it",
        "exactly the right joints, one effect hidden and named",
    )
    return table(head, lines)


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
        alarms = sum(row["verdict"] != "none" and not row["rules right"] for row in here)
        lines.append((name, str(len(here)), str(alarms)))
    return table(("background of small effects", "healthy robots", "alarms"), lines)


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
