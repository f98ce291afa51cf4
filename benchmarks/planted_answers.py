"""Which answers of a diagnosis are right where an effect was planted in a robot's measured logs.

Without a planted effect, the first finding is an effect of the robot itself. A planted effect counts as named when it
is the first finding, or the second after that own one. The answer is the most probable hypothesis; it counts as right
when it is the planted effect or the robot's own first finding, because both are there.

The calibration error of few answers is large even where every probability is right. So it stands beside the one that
chance alone gives to as many answers with these probabilities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from calibration import calibration_error, reliability

DRAWS = 2000
"""Sets of answers that are drawn for the calibration error by chance."""


def case_of(row: dict[str, Any]) -> tuple[str, str]:
    """Robot and situation, which decide the robot's own findings."""
    return row["robot"], row["situation"]


def place(row: dict[str, Any], own: Sequence[str]) -> int | None:
    """Number of findings before the true one, the robot's own findings left out; None where the truth is not found."""
    before = 0
    for names in row["said"]:
        if row["truth"] in names:
            return before
        before += names[0] not in own
    return None


def in_words(answers: Sequence[tuple[str, float, bool]]) -> str:
    """How many of the answers are right, beside what was stated."""
    sure = [right for _, p, right in answers if p >= 0.9]
    return (
        f"{np.mean([right for *_, right in answers]):.0%} of the most probable answers are right, "
        f"{np.mean([p for _, p, _ in answers]):.0%} were stated; {reliability('all', answers)[-1]['said'][5:]}; "
        f"{sum(sure)} of {len(sure)} answers with a probability of 0.9 or more are right"
    )


def by_chance(answers: Sequence[tuple[str, float, bool]]) -> str:
    """Calibration error of as many answers whose probabilities are exactly right: mean, and what 95 % stay below."""
    rng, said = np.random.default_rng(0), np.array([p for _, p, _ in answers])
    errors = [calibration_error(said, (rng.random(len(said)) < said).astype(float)) for _ in range(DRAWS)]
    return (
        f"{len(said)} answers whose probabilities are exactly right have a calibration error of {np.mean(errors):.3f} "
        f"by chance (95 % of such sets stay below {np.quantile(errors, 0.95):.3f})"
    )


def judged(rows: Sequence[dict[str, Any]], rivals: bool = False) -> list[tuple[str, float, bool]]:
    """Robot, stated probability of the answer, and whether the answer is right, of every case with a planted effect.

    With `rivals`, effects that the rules cannot tell from the robot's own first finding are right too: the robot has
    one of them, and a small difference decides which of them comes first.
    """
    most = None if rivals else 1
    own = {case_of(r): names[:most] for r in rows if r["kind"] == "none" for names in r["said"][:1]}
    found = []
    for row in rows:
        truth = "outside" if row["truth"] == "unknown" else row["truth"]
        right = {truth, *own.get(case_of(row), ())}
        if row["kind"] != "none":
            found.append((row["robot"], row["probability"], row["answer"] in right))
    return found


def judged_alone(rows: Sequence[dict[str, Any]]) -> list[tuple[str, float, bool]]:
    """As `judged`, with the planted effect alone as right, and without the answers that stand there without it as well.

    Nobody knows whether those are right: the robot's own effects have not been measured in another way.
    """
    own = {(*case_of(row), row["answer"]) for row in rows if row["kind"] == "none"}
    found = []
    for row in rows:
        right = row["answer"] == ("outside" if row["truth"] == "unknown" else row["truth"])
        if row["kind"] != "none" and (right or (*case_of(row), row["answer"]) not in own):
            found.append((row["robot"], row["probability"], right))
    return found


def counted(here: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """How often the planted effects of one robot in one situation were named: a row of the table."""
    clean = next(r for r in here if r["kind"] == "none")
    own = [names[0] for names in clean["said"][:1]]
    effects = [r for r in here if r["truth"] not in {"none", "contact", "unknown"}]
    events = [r for r in here if r["truth"] in {"contact", "unknown"}]
    places = [place(r, []) for r in effects], [place(r, own) for r in effects]
    robot, situation = case_of(clean)
    return {
        "robot": robot,
        "situation": situation,
        "of its own": own[0] if own else clean["verdict"],
        "effects": len(effects),
        "first": sum(p == 0 for p in places[0]),
        "first but for its own": sum(p == 0 for p in places[1]),
        "top three": sum(p is not None and p < 3 for p in places[0]),
        "contact, unknown": sum(r["verdict"] == r["truth"] for r in events),
        "of": len(events),
        "situation told": sum(r.get("assumed") == situation for r in here),
        "of all": len(here),
    }


def said(row: dict[str, Any]) -> dict[str, Any]:
    """What was planted, and what the diagnosis said."""
    findings = "; ".join("/".join(names) for names in row["said"][:3])
    robot, situation = case_of(row)
    planted = {"planted": row["kind"], "where": row["planted"]}
    return {"robot": robot, "situation": situation} | planted | {"said": findings or row["verdict"]}
