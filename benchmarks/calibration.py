"""Are the probabilities of a diagnosis right? They are fitted on simulated robots, and checked on others.

Three steps, each a run of this script:

1. `--collect FILE --generator first|second --seed S --count N` simulates and diagnoses N cases, and writes the evidence
   of every hypothesis, and which hypotheses are right. Seeds below 5000 are for fitting, the others for reporting.
2. `--fit FILE...` fits the weights of `frischid.diagnosis.probability` and writes the package's data file.
3. `--report FILE...` prints the reliability table: of the answers given with a probability in a range, the share that
   was right.

What counts as right: an effect that the robot has and the model lacks, so the hidden effect, any of two hidden effects,
and an effect of the background. "Outside the catalogue" is right where the catalogue lacks one of these effects.
"Several small effects" is right where the background is at least as large as the hidden effect, or where nothing else
is hidden; "none" for a robot with nothing but a background below one percent of the torque.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import itertools
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import hidden_cases
import numpy as np
import second_cases
from common import parser, publish, record
from hidden_cases import Case, Truth
from hidden_unknown import UNKNOWN
from numpy.typing import NDArray

from frischid.core.files import write_text
from frischid.core.types import Array
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.probability import DATA, Weights, chances, fitted
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import MOST_RIVALS
from frischid.model.identification import identify

GENERATORS = {"first": hidden_cases, "second": second_cases}
FIRST_REPORTED = 5000
PAIRS = (("backlash", "gear_play"), ("thermal_drift", "self_heating"))
SAME = {name: pair for pair in PAIRS for name in pair}
"""Names in the catalogue of one cause: slow and fast motion of a gear with play; friction that changes as it warms."""
NAMELESS = {*UNKNOWN, *second_cases.OUTSIDE}
"""Effects that the catalogue does not have."""
EDGES = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
SMALL_BACKGROUND = 0.01  # share of the torque
LEAST_OWN = -5.0  # log share of the largest error that one effect alone explains; the evidence has no smaller value


def right_answers(kind: str, truth: Truth) -> list[str]:
    """Hypotheses that are right."""
    if kind == "contact":
        return ["contact"]
    there = [n for name in truth.background_effects for n in names(name)]
    if kind == "healthy":
        small = truth.background <= SMALL_BACKGROUND
        return list(dict.fromkeys([*there, *(["several"] if truth.background else []), *(["none"] if small else [])]))
    hidden = ["outside"] if kind == "unknown" else [n for name in truth.effects for n in names(name)]
    small = truth.background >= max(truth.sizes, default=0.0)
    return list(dict.fromkeys([*hidden, *there, *(["several"] if small else [])]))


def names(effect: str) -> tuple[str, ...]:
    """Hypotheses that are right where a robot has an effect."""
    return ("outside",) if effect in NAMELESS else SAME.get(effect, (effect,))


def collected(case: Case) -> dict[str, Any]:
    """Diagnose a case; a crash is reported and counts as a wrong answer."""
    start = time.perf_counter()
    model = identify(case.robot, case.reference or case.fit, recursion="none").model
    found = diagnose(model, [*case.fit, *case.valid])
    first = next((f for f in found.findings if f.significant and f.members), None)
    return {
        "verdict": decided_before(found),
        "first": None if first is None else [first.effect, *first.confused_with],
        "situation": found.situation,
        "evidence": found.evidence.to_dict(),
        "ranking": [[f.effect, list(f.joints)] for f in found.findings[:5]],
        "error": found.error,
        "floor": found.noise_floor,
        "joints of the search": found.joints,
        "seconds": time.perf_counter() - start,
    }


def decided_before(found: Diagnosis) -> str:
    """The verdict of the rules, from the evidence of the probabilities."""
    told = {k: v for e in found.evidence.values for k, v in e.items()}
    marks = {"none verdict": "none", "outside verdict": "unknown", "contact found": "contact"}
    return next((verdict for mark, verdict in marks.items() if told[mark]), "effect")


def collect(
    generator: str, seed: int, count: int | None, path: Path, rate: float, arms: Sequence[str], kinds: Sequence[str]
) -> None:
    """Simulate and diagnose; every case is written as soon as it is done. No log has a higher sampling rate."""
    made = GENERATORS[generator]
    done = {row["number"] for row in read([path])} if path.exists() else set()
    specs = [s for s in made.cases(seed, count) if s.number not in done and (not arms or s.arm in arms)]
    specs = [s for s in specs if not kinds or s.kind in kinds]
    order = np.random.default_rng(seed).permutation(len(specs))  # so that a run that is cut short is a fair sample
    with path.open("a") as file:
        for k in order:
            spec = specs[int(k)]
            spec = replace(spec, sensors=replace(spec.sensors, rate=min(spec.sensors.rate, rate)))
            case = made.build(spec)
            truth = case.truth
            row: dict[str, Any] = {"generator": generator, "seed": seed, "number": spec.number, "kind": spec.kind}
            row |= {"right": right_answers(spec.kind, truth), "effects": list(truth.effects), "grade": spec.grade}
            row |= {"background": truth.background, "joints": [list(x) for x in truth.joints], "arm": spec.arm}
            row |= {"visible": list(truth.visible), "sensors": str(spec.sensors)}
            try:
                row |= collected(case)
            except Exception as error:  # a crash is a result of a benchmark, and must not end it
                row |= {"crash": f"{type(error).__name__}: {error}"}
            file.write(json.dumps(row, ensure_ascii=False) + "\n")
            file.flush()


def read(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """All cases of some files."""
    return [json.loads(line) for path in paths for line in path.read_text().splitlines()]


def fit(paths: Sequence[Path]) -> None:
    """Fit the weights and write them with their provenance."""
    rows = [row for row in read(paths) if "crash" not in row]
    if any(row["seed"] >= FIRST_REPORTED for row in rows):
        sys.exit(f"seeds from {FIRST_REPORTED} on are for reporting")
    weights, strength = fitted([(row["evidence"], row["right"]) for row in rows])
    seeds = sorted({(row["generator"], row["seed"]) for row in rows})
    counts = {f"{g} generator, seed {s}": sum((r["generator"], r["seed"]) == (g, s) for r in rows) for g, s in seeds}
    content = {
        "schema": "frischid.probability/1",
        "made by": "benchmarks/calibration.py --fit",
        "cases": counts,
        "ridge": strength,
        "weights": {name: round(value, 4) for name, value in weights.values.items()},
    }
    write_text(DATA, json.dumps(content, indent=1) + "\n")
    print(f"{len(rows)} cases, ridge {strength:g}: {DATA}")


def answer(row: dict[str, Any], weights: Weights) -> tuple[str, float, bool]:
    """The most probable hypothesis, its probability, and whether it is right."""
    if "crash" in row:
        return "crash", 1.0, False
    chance = chances(row["evidence"], weights)
    k = int(np.argmax(chance))
    name = str(row["evidence"][k]["hypothesis"])
    return name, float(chance[k]), name in row["right"]


def report(paths: Sequence[Path], json_path: Path | None, keep: bool) -> None:
    """Reliability of the answers, by generator and together; the file holds every case in one line."""
    rows, weights = read(paths), Weights.load()
    groups = {g: [r for r in rows if r["generator"] == g] for g in GENERATORS} | {"both": rows}
    table, kinds = [], []
    for name, part in groups.items():
        answers = [answer(r, weights) for r in part]
        table += reliability(name, answers)
        kinds += by_kind(name, part, answers)
    publish("probability said, and share that was right", table, None)
    publish("first answer right, by kind of case", kinds, None)
    if json_path is not None:
        lines = kept(json_path, rows) if keep else []
        lines += [flat(row, answer(row, weights)) for row in rows]
        record("Answers of the diagnosis and their probabilities, case by case", lines, json_path)


def kept(path: Path, rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Published cases of other seeds, each as it was when it was run: with the rules and weights of its time."""
    new = {(row["generator"], row["seed"]) for row in rows}
    return [row for row in json.loads(path.read_text())["rows"] if (row["generator"], row["seed"]) not in new]


def flat(row: dict[str, Any], said: tuple[str, float, bool]) -> dict[str, Any]:
    """A case in one line of plain values, from which every table can be counted again."""
    keys = ("generator", "seed", "number", "kind", "effects", "grade", "background", "arm", "right")
    name, probability, correct = said
    where = None
    if row["kind"] == "single" and row["joints"][0] and name in {x for e in row["effects"] for x in SAME.get(e, (e,))}:
        joints = next((joints for effect, joints in row["ranking"] if effect == name), [])
        where = sorted(joints) == sorted(row["joints"][0])
    return (
        {key: row[key] for key in keys}
        | {"answer": name, "probability": probability, "correct": correct}
        | {"alarm": alarm(row, name), "right joints": where, "both": both(row), "beside": beside(row)}
        | {"visible": max(row["visible"], default=0.0), "error": row.get("error"), "floor": row.get("floor")}
    )


def alarm(row: dict[str, Any], name: str) -> bool | None:
    """Whether the answer names something that a healthy robot does not have; None for other robots."""
    if row["kind"] != "healthy":
        return None
    return name not in (*row["right"], "none", "several")


def both(row: dict[str, Any]) -> bool | None:
    """Whether both of two hidden effects are among the first three findings; None where there are not two."""
    if row["kind"] != "pair":
        return None
    first = {effect for effect, _ in row.get("ranking", [])[:3]}
    return all(first & set(SAME.get(name, (name,))) for name in row["effects"])


def beside(row: dict[str, Any]) -> list[bool]:
    """Whether the robot has each of the effects that stand beside the first finding (`frischid.diagnosis.rivals`)."""
    told = {e["hypothesis"]: e for e in row.get("evidence", []) if e.get("effect")}
    named = [told[effect] for effect, _ in row.get("ranking", []) if effect in told and told[effect]["significant"]]
    if row.get("verdict") != "effect" or not named or not named[0]["entered"]:
        return []
    own = [e for e in named[1:] if e["entered"] and not e["rival"] and e["own"] > LEAST_OWN]
    return [e["hypothesis"] in row["right"] for e in own[:MOST_RIVALS]]


def reliability(name: str, answers: Sequence[tuple[str, float, bool]]) -> list[dict[str, Any]]:
    """One row for each range of probability, then the expected calibration error."""
    said = np.array([p for _, p, _ in answers])
    right = np.array([r for *_, r in answers], dtype=float)
    rows = [
        {"generator": name, "said": label, "cases": int(here.sum())}
        | {"mean said": said[here].mean(), "right": right[here].mean()}
        for label, here in ranges(said)
    ]
    if len(said):
        error = calibration_error(said, right)
        whole = {"generator": name, "said": f"all; calibration error {error:.3f}", "cases": len(said)}
        rows.append(whole | {"mean said": said.mean(), "right": right.mean()})
    return rows


def calibration_error(said: Array, right: Array) -> float:
    """Expected calibration error: mean over the answers of |mean probability - share right| of their range."""
    return float(sum(here.mean() * abs(said[here].mean() - right[here].mean()) for _, here in ranges(said)))


def ranges(said: Array) -> list[tuple[str, NDArray[np.bool_]]]:
    """Ranges of probability that have answers, and these answers."""
    found = [(f"{a:.2f} to {b:.2f}", (said >= a) & ((said < b) | (b == 1.0))) for a, b in itertools.pairwise(EDGES)]
    return [(label, here) for label, here in found if here.any()]


def by_kind(
    name: str, rows: Sequence[dict[str, Any]], answers: Sequence[tuple[str, float, bool]]
) -> list[dict[str, Any]]:
    """Right answers of each kind of case: the most probable hypothesis, and the rules' first finding."""
    result = []
    for kind in dict.fromkeys(r["kind"] for r in rows):
        here = [(r, a) for r, a in zip(rows, answers, strict=True) if r["kind"] == kind]
        row = {"generator": name, "kind": kind, "cases": len(here)}
        row["most probable"] = float(np.mean([a[2] for _, a in here]))
        row["rules"] = float(np.mean([rules(r) for r, _ in here]))
        result.append(row)
    return result


def rules(row: dict[str, Any]) -> bool:
    """Whether verdict and first finding were right before there were probabilities."""
    said = {"none": ["none"], "contact": ["contact"], "unknown": ["outside"]}.get(
        row.get("verdict", ""), row.get("first")
    )
    return bool(set(said or []) & set(row["right"]))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--collect", type=Path, metavar="FILE")
    options.add_argument("--generator", choices=list(GENERATORS), default="first")
    options.add_argument("--seed", type=int, default=4001)
    options.add_argument("--count", type=int)
    options.add_argument("--rate", type=float, default=200.0, help="highest sampling rate, Hz: lower costs less time")
    options.add_argument("--arms", nargs="*", default=[], help="only these arms: small ones cost less time")
    options.add_argument("--kinds", nargs="*", default=[], help="only these kinds of cases, such as healthy")
    options.add_argument("--fit", type=Path, nargs="+", metavar="FILE")
    options.add_argument("--report", type=Path, nargs="+", metavar="FILE")
    options.add_argument("--keep", action="store_true", help="keep the cases of other seeds that the JSON file has")
    chosen = options.parse_args()
    if chosen.collect:
        collect(chosen.generator, chosen.seed, chosen.count, chosen.collect, chosen.rate, chosen.arms, chosen.kinds)
    if chosen.fit:
        fit(chosen.fit)
    if chosen.report:
        report(chosen.report, chosen.json, chosen.keep)


if __name__ == "__main__":
    main()
