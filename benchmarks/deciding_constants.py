"""Which constants decide? Every threshold of the diagnosis is halved and doubled, and the answers are compared.

Each case of both generators of hidden effects (`hidden_cases`, `second_cases`) is simulated and identified once, and
diagnosed with each of the constants of `frischid.diagnosis.criteria` changed alone. Counted are the cases whose answer
(verdict, first effect, its joints) is another one, and the right answers. `--factors 0.001 1000` in place of 0.5 and 2
shows what a rule is worth at all: with one of the two, the rule is off.

A constant whose change alters nothing on many cases is a rule that these cases do not need.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from calibration import GENERATORS, right_answers
from common import multiplied, numbers, parser, publish
from hidden_cases import Case

from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.dataset import RegressionData
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.model_columns import ModelColumns
from frischid.diagnosis.result import Diagnosis
from frischid.estimators.least_squares import Prior
from frischid.logs.log import Log
from frischid.model.identification import identify
from frischid.model.model import Model

OF_THE_CACHE = {
    "folds_of_one_log", "max_folds", "block_seconds", "block_periods", "friction_prior_factor",
}  # fmt: skip
"""Constants that are used before the candidates' columns are computed."""
OF_IMPROVE = {"harmless_rise"}
"""Constants that no diagnosis reads."""


class Answer(NamedTuple):
    """Verdict, first effect and its joints, and whether the most probable hypothesis is right."""

    verdict: str
    effect: str
    joints: tuple[str, ...]
    right: bool


def answer(found: Diagnosis, truth: Sequence[str]) -> Answer:
    first = next((f for f in found.findings if f.significant and f.members), None)
    best = max(found.probabilities, key=found.probabilities.__getitem__)
    said = (first.effect, tuple(sorted(first.joints))) if first is not None else ("", ())
    return Answer(found.verdict, *said, best in truth)


def answers(
    case: Case, kind: str, names: Sequence[str], factors: Sequence[float]
) -> Iterator[tuple[str, float, Answer]]:
    """Answers with the constants as they are (an empty name), then with each of them changed."""
    model = identify(case.robot, case.reference or case.fit, recursion="none").model
    logs, truth = [*case.fit, *case.valid], right_answers(kind, case.truth)
    kept = Kept()
    with mock.patch.object(CrossValidator, "of", kept.of):
        yield "", 1.0, answer(diagnose(model, logs), truth)
        for name in names:
            for factor in factors:
                criteria = multiplied(DIAGNOSIS_CRITERIA, name, factor)
                kept.fresh = name in OF_THE_CACHE
                yield name, factor, answer(diagnose(model, logs, criteria=criteria), truth)


class Kept:
    """Reads the logs once: later diagnoses get the same columns under other criteria.

    Attributes
    ----------
    fresh : bool
        Whether the next diagnosis reads the logs again.
    """

    def __init__(self) -> None:
        self.fresh = False
        self.data: RegressionData | None = None
        self.read = CrossValidator.of

    def of(
        self, model: Model, logs: Sequence[Log], prior: Prior, *, criteria: DiagnosisCriteria, workers: Any = None
    ) -> CrossValidator:
        """In place of `CrossValidator.of`."""
        if self.data is None or self.fresh:
            found = self.read(model, logs, prior, criteria=criteria, workers=workers)
            self.data = self.data or found.data
            return found
        self.data.cache.criteria = criteria
        return CrossValidator._fitted(ModelColumns.of(self.data), prior, np.zeros(len(self.data.model.joints)))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--seed", type=int, default=4006)
    options.add_argument("--count", type=int, default=12, help="cases of each generator")
    options.add_argument("--arms", nargs="*", default=["planar2", "elbow3", "TwoDofs", "z1"])
    options.add_argument("--rate", type=float, default=100.0, help="highest sampling rate, Hz")
    options.add_argument("--factors", type=float, nargs=2, default=[0.5, 2.0])
    options.add_argument("--only", nargs="*", help="these constants; all by default")
    chosen = options.parse_args()
    names = chosen.only or [name for name in numbers(DIAGNOSIS_CRITERIA) if name not in OF_IMPROVE]
    base: list[Answer] = []
    found: dict[tuple[str, float], list[Answer]] = {}
    for made in GENERATORS.values():
        specs = [s for s in made.cases(chosen.seed) if s.arm in chosen.arms]
        order = np.random.default_rng(chosen.seed).permutation(len(specs))[: chosen.count]
        for spec in (specs[int(k)] for k in order):
            spec = replace(spec, sensors=replace(spec.sensors, rate=min(spec.sensors.rate, chosen.rate)))
            for name, factor, got in answers(made.build(spec), spec.kind, names, chosen.factors):
                (found.setdefault((name, factor), []) if name else base).append(got)
            print(len(base), spec.kind, spec.effects, spec.arm, base[-1], flush=True)
    low, high = chosen.factors
    rows = []
    for name in names:
        row: dict[str, Any] = {"constant": name, "value": getattr(DIAGNOSIS_CRITERIA, name), "cases": len(base)}
        for factor, word in ((low, f"× {low:g}"), (high, f"× {high:g}")):
            pairs = list(zip(base, found[name, factor], strict=True))
            row[f"other answer {word}"] = sum(a[:3] != b[:3] for a, b in pairs)
            row[f"right {word}"] = sum(b.right for _, b in pairs)
        rows.append(row | {"right": sum(a.right for a in base)})
    publish("answers with a constant changed", rows, chosen.json)


if __name__ == "__main__":
    main()
