"""Probability of every hypothesis of a diagnosis: a choice among hypotheses by their evidence.

With the evidence x_h of hypothesis h (`hypotheses`) and weights w,

    P(h) = exp(w·x_h) / Σ_k exp(w·x_k),

the conditional logit of McFadden 1974, "Conditional logit analysis of qualitative choice behavior". The weights come
from simulated robots whose truth is known: they maximise the probability of the right hypotheses there,

    Σ_cases log Σ_{h right} P(h)  −  ½ λ Σ w²,

and λ is the largest whose cross-validated likelihood is within one standard error of the best one, which keeps the
weights small where the cases do not need them (Breiman, Friedman, Olshen and Stone 1984, section 3.4.3).
`benchmarks/calibration.py` makes the cases, fits the weights, and checks on other seeds that a probability of 0.9 is
right nine times out of ten. The weights and the cases they come from stand in the data file beside this module.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from frischid.core.types import Array
from frischid.diagnosis.hypotheses import Evidence

DATA = Path(__file__).with_name("probability.json")
"""The weights, and the cases they come from."""
RIDGES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Values of λ that a fit tries."""
_FOLDS = 8  # of the cross-validation that chooses λ

Case = tuple[Sequence[Mapping[str, Any]], Sequence[str]]
"""Evidence of every hypothesis (`Evidence.to_dict`), and the names of the right ones."""


@dataclass(frozen=True)
class Weights:
    """Weight of each number of evidence.

    Attributes
    ----------
    values : mapping of str to float
    """

    values: Mapping[str, float]

    @classmethod
    def load(cls) -> Weights:
        """The weights of the package."""
        return _shipped()


@cache
def _shipped() -> Weights:
    return Weights(json.loads(DATA.read_text(encoding="utf-8"))["weights"])


def chances(evidence: Sequence[Mapping[str, Any]], weights: Weights) -> Array:
    """Probability of each hypothesis, summing to one.

    Parameters
    ----------
    evidence : sequence of mapping
        Numbers of each hypothesis by name; a name without weight counts nothing.
    weights : Weights
    """
    scores = np.array(
        [sum(weights.values.get(k, 0.0) * float(x) for k, x in e.items() if k != _NAME) for e in evidence]
    )
    return _softmax(scores)


def probabilities(evidence: Evidence) -> dict[str, float]:
    """Probability of each hypothesis by its name: the effects of findings, and `hypotheses.OTHERS`; they sum to one."""
    found = chances(evidence.to_dict(), Weights.load())
    return dict(zip(evidence.names, map(float, found), strict=True))


_NAME = "hypothesis"


def _softmax(scores: Array) -> Array:
    odds = np.exp(scores - scores.max())
    return np.asarray(odds / odds.sum())


# ---------------------------------------------------------------------- the fit


def fitted(cases: Sequence[Case]) -> tuple[Weights, float]:
    """Fit the weights to cases whose right hypotheses are known.

    A case without any right hypothesis among its own is left out.

    Returns
    -------
    (Weights, float)
        And the λ that was chosen.
    """
    names = list(dict.fromkeys(k for evidence, _ in cases for e in evidence for k in e if k != _NAME))
    used = [x for x in (_numbers(case, names) for case in cases) if x[1].any()]
    scale = np.maximum(np.sqrt(np.mean(np.concatenate([x for x, _ in used]) ** 2, axis=0)), 1e-9)
    used = [(x / scale, right) for x, right in used]
    tried = {ridge: _held_out(used, ridge) for ridge in RIDGES}
    top = max(tried.values(), key=lambda x: float(x.sum()))
    error = {ridge: float(np.sqrt(len(x)) * (x - top).std()) for ridge, x in tried.items()}  # of the sum's difference
    best = max(ridge for ridge, x in tried.items() if float((top - x).sum()) <= error[ridge])
    weights = _fit(used, best) / scale
    return Weights(dict(zip(names, map(float, weights), strict=True))), best


def _numbers(case: Case, names: Sequence[str]) -> tuple[Array, Array]:
    """Evidence as a matrix (H, n), and which hypotheses are right, (H,)."""
    evidence, right = case
    x = np.array([[float(e.get(k, 0.0)) for k in names] for e in evidence])
    return x, np.array([e[_NAME] in right for e in evidence])


def _fit(cases: Sequence[tuple[Array, Array]], ridge: float) -> Array:
    def loss(w: Array) -> tuple[float, Array]:
        value, slope = 0.5 * ridge * float(w @ w), ridge * w
        for x, right in cases:
            p = _softmax(x @ w)
            mass = max(float(p[right].sum()), 1e-300)
            value -= np.log(mass)
            slope = slope + x.T @ p - x[right].T @ (p[right] / mass)
        return value, slope

    start = np.zeros(cases[0][0].shape[1])
    return np.asarray(optimize.minimize(loss, start, jac=True, method="L-BFGS-B").x)


def _held_out(cases: Sequence[tuple[Array, Array]], ridge: float) -> Array:
    """Log probability of the right hypotheses of each case, which is predicted by a fit to others."""
    found = np.zeros(len(cases))
    for fold in range(_FOLDS):
        w = _fit([c for k, c in enumerate(cases) if k % _FOLDS != fold], ridge)
        for k in range(fold, len(cases), _FOLDS):
            x, right = cases[k]
            found[k] = np.log(max(float(_softmax(x @ w)[right].sum()), 1e-300))
    return found
