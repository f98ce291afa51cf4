"""Does a diagnosis find a hidden effect? The simulator does not share the diagnosis' equations.

Each case is a robot that differs from its URDF and has a hidden effect; half of the cases have small effects of other
kinds too. There is noise as of real encoders, one motion to identify from, and a second motion (see `hidden_cases`).
The diagnosis gets both motions, and each is predicted by a fit to the other: no motion is a test log, and the errors
below are cross-validated. A case is a hit when the first finding names the true effect. It is a hit too when the first
finding names several effects that these logs cannot distinguish, and the true effect is one of them.

Needs MuJoCo for a fifth of the cases: ``pip install mujoco``.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # set before numpy is imported: several processes share the cores

import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from common import parser, publish, record
from hidden_cases import EFFECTS, Case, CaseSpec, Truth, build, cases
from hidden_unknown import UNKNOWN

from frischid.model.identification import identify

STEPS = 3
"""Steps that `improve` may take to find two hidden effects: it may first add true small effects of the background."""


@dataclass(frozen=True)
class Outcome:
    """Result of a diagnosis in plain values.

    Attributes
    ----------
    verdict : {"none", "effect", "several", "contact", "unknown"}
    ranking : tuple of tuple of str
        Effects named by each finding, best first; several where a finding names effects that cannot be distinguished.
    joints : tuple of tuple of str
        Joints of each finding.
    after : tuple of float
        Cross-validated error with each finding added.
    error, floor : float
        Cross-validated error before, and error of the sensor noise alone.
    added : tuple of tuple of str
        Effects named by each step of `improve`, where two effects are hidden.
    """

    verdict: str
    ranking: tuple[tuple[str, ...], ...] = ()
    joints: tuple[tuple[str, ...], ...] = ()
    after: tuple[float, ...] = ()
    error: float = float("nan")
    floor: float = float("nan")
    added: tuple[tuple[str, ...], ...] = field(default=())


Diagnose = Callable[[Case], Outcome]


def diagnosed(case: Case) -> Outcome:
    """Diagnose a case with frischid; no other function here uses the interface of the diagnosis."""
    from frischid.diagnosis.diagnosis import diagnose
    from frischid.diagnosis.improvement import improve

    model = identify(case.robot, case.reference or case.fit, recursion="none").model
    logs = [*case.fit, *case.valid]
    found = diagnose(model, logs)
    steps = improve(model, logs, max_steps=STEPS)[0] if case.spec.kind == "pair" else []
    return Outcome(
        found.verdict,
        tuple(_names(f) for f in found.findings),
        tuple(tuple(f.joints or ()) for f in found.findings),
        tuple(float(f.error_after) for f in found.findings),
        float(found.error),
        float(found.noise_floor),
        tuple(_names(step.finding) for step in steps),
    )


def _names(finding: Any) -> tuple[str, ...]:
    return (finding.effect, *finding.confused_with)


def score(kind: str, truth: Truth, said: Outcome) -> dict[str, Any]:
    """Compare an outcome with the truth.

    Returns
    -------
    dict
        ``first``: whether the answer is right; ``top``: whether the right answer is among the first three; ``joints``:
        whether a hit names the right joints (None where there is nothing to name); ``said``: the answer in a word;
        ``after``: error with the right effect added.
    """
    first = said.ranking[0] if said.verdict == "effect" and said.ranking else (said.verdict,)
    where = [k for k, names in enumerate(said.ranking) if set(names) & set(truth.effects)]
    result: dict[str, Any] = {"said": first[0], "top": bool(where and where[0] < 3), "joints": None, "after": None}
    if kind == "healthy":
        # With a background, small effects are really there: naming one is no false alarm. Nor is "unknown", if a part
        # of the background is outside the catalogue.
        there = {"unknown" if name in UNKNOWN else name for name in truth.background_effects}
        small = said.verdict == "several" and truth.background > 0
        result["first"] = said.verdict == "none" or small or bool(set(first) & there)
        return result
    if kind == "pair":
        named = {name for names in said.added for name in names}
        result["first"] = set(truth.effects) <= named
        result["one"] = bool(set(truth.effects) & named)
        return result
    result["first"] = truth.effects[0] in first
    if kind != "single":
        return result
    result["said"] = truth.effects[0] if result["first"] else first[0]
    if result["first"] and truth.joints[0]:
        result["joints"] = set(said.joints[0]) == set(truth.joints[0])
    if where:
        result["after"] = said.after[where[0]]
    return result


def run(spec: CaseSpec, diagnose: Diagnose = diagnosed) -> dict[str, Any]:
    """Simulate, diagnose and score one case; an exception becomes part of the result."""
    start = time.perf_counter()
    case = build(spec)
    built = time.perf_counter()
    row = {"number": spec.number, "kind": spec.kind, "truth": asdict(case.truth), "error": None}
    try:
        said = diagnose(case)
    except Exception as error:  # a case that crashes is a miss, and must not stop the others
        said, row["error"] = Outcome("crash"), f"{type(error).__name__}: {error}"
    row |= score(spec.kind, case.truth, said)
    seconds = {"build": built - start, "diagnose": time.perf_counter() - built}
    return row | {"outcome": asdict(said), "seconds": seconds}


def run_all(specs: Sequence[CaseSpec], workers: int, diagnose: Diagnose = diagnosed) -> list[dict[str, Any]]:
    """Run cases in processes of their own, in order."""
    if workers < 2:
        return [run(spec, diagnose) for spec in specs]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(partial(run, diagnose=diagnose), specs, chunksize=1))


Rows = Sequence[dict[str, Any]]


def rate(rows: Rows, key: str = "first") -> str:
    """Share of rows for which `key` is true, and the number of rows that have a value."""
    counted = [bool(r[key]) for r in rows if r[key] is not None]
    return f"{np.mean(counted):4.0%} of {len(counted)}" if counted else "–"


def split(rows: Rows) -> dict[str, str]:
    """Rates of right answers without background, with a background of at most half the effect, and with any."""
    clean = [r for r in rows if not r["truth"]["background"]]
    dirty = [r for r in rows if r["truth"]["background"]]
    strong = [r for r in dirty if min(r["truth"]["sizes"], default=0.0) >= 2 * r["truth"]["background"]]
    return {"clean": rate(clean), "background ≤ half": rate(strong), "any background": rate(dirty)}


def tables(rows: Rows) -> dict[str, list[dict[str, Any]]]:
    """All printed tables, by title."""
    single = [r for r in rows if r["kind"] == "single"]
    grades = [
        {"grade": str(g), **split(part), "top three": rate(part, "top"), "joints": rate(part, "joints"), **errors(part)}
        for g, part in _by(single, lambda r: r["truth"]["grade"])
    ]
    effects = [
        {"effect": e, **{f"grade {g}": rate([r for r in p if r["truth"]["grade"] == g]) for g in (1, 2, 3)}, **split(p)}
        | {"top three": rate(p, "top"), "joints": rate(p, "joints"), **errors(p)}
        for e, p in _by(single, lambda r: EFFECTS.index(r["truth"]["effects"][0]), lambda k: EFFECTS[k])
    ]
    others = [
        {"kind": kind, **split(part), "one of two": rate(part, "one") if kind == "pair" else "–"}
        for kind, part in _by([r for r in rows if r["kind"] != "single"], lambda r: r["kind"])
    ]
    seconds = [{"step": k, **_quartiles([r["seconds"][k] for r in rows])} for k in ("build", "diagnose")]
    return {
        "Single effects by grade: named first": grades,
        "Single effects: named first": effects,
        "Healthy robots without alarm, contact and unknown recognised, both of two effects found": others,
        "Wrong answers": confusions([r for r in rows if r["kind"] != "pair"]),
        "Seconds per case": seconds,
    }


def flat(row: dict[str, Any], seed: int) -> dict[str, Any]:
    """A case in one line of plain values, from which every table can be counted again."""
    truth, said, after = row["truth"], row["outcome"], row["after"]
    keys = ("effects", "joints", "grade", "sizes", "background", "arm", "simulator")
    result = {"seed": seed, "number": row["number"], "kind": row["kind"], **{key: truth[key] for key in keys}}
    result |= {"said": row["said"], "first": row["first"], "top three": row["top"], "right joints": row["joints"]}
    result |= {"error": said["error"], "after": after, "floor": said["floor"]}
    return result | {"one": row.get("one"), "crash": row["error"]}


def errors(rows: Rows) -> dict[str, str]:
    """Median cross-validated error before, with the right effect added, and the noise floor, in percent."""
    known = [r for r in rows if r["after"] is not None]
    if not known:
        return {"error % → floor": "–", "after / floor": "–"}
    before, floor = (np.array([r["outcome"][k] for r in known]) for k in ("error", "floor"))
    after = np.array([r["after"] for r in known])
    median = [100 * float(np.median(x)) for x in (before, after, floor)]
    return {
        "error % → floor": "{:.2f} → {:.2f} → {:.2f}".format(*median),
        "after / floor": f"{np.median(after / floor):.2f}",
    }


def confusions(rows: Rows) -> list[dict[str, Any]]:
    """For each truth, the wrong answers and their counts."""
    result = []
    for truth, part in _by(rows, lambda r: (r["truth"]["effects"] or ("none",))[0]):
        wrong = Counter(r["said"] for r in part if not r["first"])
        text = ", ".join(f"{name} {count}" for name, count in wrong.most_common())
        result.append({"truth": truth, "cases": len(part), "wrong": sum(wrong.values()), "said": text or "–"})
    return result


def _by(rows: Rows, key: Callable[[Any], Any], name: Callable[[Any], Any] = lambda k: k) -> list[tuple[Any, list[Any]]]:
    return [(name(k), list(part)) for k, part in groupby(sorted(rows, key=key), key)]


def _quartiles(values: Sequence[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "mean": float(np.mean(values)), "longest": float(np.max(values))}


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--count", type=int, help="number of cases, spread over all kinds")
    options.add_argument(
        "--only", metavar="EFFECT", help="an effect, or a kind: single, healthy, unknown, contact, pair"
    )
    chosen = options.parse_args()
    specs = cases(chosen.seed, chosen.count, chosen.only)
    if not specs:
        options.error(f"no case has '{chosen.only}'; effects are {', '.join(EFFECTS)}")
    start = time.perf_counter()
    rows = run_all(specs, chosen.workers)
    result = tables(rows)
    for title, table in result.items():
        if table:
            publish(title, table, None)
    for row in rows:
        if row["error"]:
            print(f"case {row['number']} crashed: {row['error']}")
    print(f"{len(rows)} cases, seed {chosen.seed}, {time.perf_counter() - start:.0f} s")
    if chosen.json is not None:
        notes = [f"{len(rows)} of the {len(cases(chosen.seed))} cases of seed {chosen.seed}"]
        record("Hidden effects, case by case", [flat(row, chosen.seed) for row in rows], chosen.json, notes)


if __name__ == "__main__":
    main()
