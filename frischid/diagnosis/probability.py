"""Probability of every hypothesis of a diagnosis: a choice among hypotheses by their evidence.

With the evidence x_h of hypothesis h (`hypotheses`) and weights w,

    P(h) = exp(w·x_h) / Σ_k exp(w·x_k),

the conditional logit of McFadden 1974, "Conditional logit analysis of qualitative choice behavior". Several hypotheses
may be right at once: a robot may have two hidden effects, or a background. So P(h) is the probability of one of several
events that exclude each other: h is right, and no hypothesis of higher probability is. The weights come from simulated
robots whose truth is known. They maximise the probability of these events there,

    Σ_cases log max_{h right} P(h)  −  ½ λ Σ w²,

by turns: find the first right hypothesis of each case, then maximise its probability (Celeux and Govaert 1992, "A
classification EM algorithm for clustering and two stochastic versions"). λ has the best cross-validated likelihood.
With the sum of P over the right hypotheses in place of the maximum, P of an answer would be smaller than the share of
right answers, because several right hypotheses would share the probability.

`benchmarks/calibration.py` makes the cases, fits the weights, and checks on other seeds that a probability of 0.9 is
right nine times out of ten. The weights and the cases they come from stand in the data file beside this module.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from frischid.core.types import Array
from frischid.diagnosis.hypotheses import Evidence

DATA = Path(__file__).with_name("probability.json")
"""The weights, and the cases they come from."""
RIDGES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Values of λ that a fit tries."""
_FOLDS, _DIVISIONS = 8, 4  # of the cross-validation that chooses λ: one division of the cases chooses by chance
_MOST_TURNS = 30  # at most; a handful is usual

Case = tuple[Sequence[Mapping[str, Any]], Sequence[str]]
"""Evidence of every hypothesis (`Evidence.to_dict`), and the names of the right ones."""


@dataclass(frozen=True)
class Weights:
    """Weight of each number of evidence."""

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


@dataclass(frozen=True, eq=False)
class _Cases:
    """Hypotheses of all cases in one matrix."""

    x: Array
    """Evidence, (H, n)."""
    right: NDArray[np.bool_]
    """Whether a hypothesis is right, (H,)."""
    sizes: NDArray[np.intp]
    """Number of hypotheses of each case, one case after another, (C,)."""

    @classmethod
    def of(cls, cases: Sequence[Case], names: Sequence[str]) -> _Cases:
        """Cases that have a right hypothesis among their own."""
        used = [(e, np.array([h[_NAME] in right for h in e])) for e, right in cases]
        used = [(e, right) for e, right in used if right.any()]
        x = np.array([[float(h.get(k, 0.0)) for k in names] for e, _ in used for h in e])
        return cls(x, np.concatenate([right for _, right in used]), np.array([len(right) for _, right in used]))

    def some(self, chosen: NDArray[np.bool_]) -> _Cases:
        """A part of the cases."""
        kept = np.repeat(chosen, self.sizes)
        return _Cases(self.x[kept], self.right[kept], self.sizes[chosen])

    @property
    def starts(self) -> NDArray[np.intp]:
        """First hypothesis of each case."""
        return np.concatenate([[0], np.cumsum(self.sizes)[:-1]])

    def log_chances(self, weights: Array) -> Array:
        """Logarithm of the probability of each hypothesis, (H,)."""
        scores = self.x @ weights
        scores = scores - np.repeat(np.maximum.reduceat(scores, self.starts), self.sizes)
        return np.asarray(scores - np.repeat(np.log(np.add.reduceat(np.exp(scores), self.starts)), self.sizes))

    def first_right(self, weights: Array) -> NDArray[np.intp]:
        """The right hypothesis of the highest probability of each case."""
        scores = np.where(self.right, self.log_chances(weights), -np.inf)
        ends = self.starts + self.sizes
        return np.array([a + int(np.argmax(scores[a:b])) for a, b in zip(self.starts, ends, strict=True)])


def fitted(cases: Sequence[Case]) -> tuple[Weights, float]:
    """Fit the weights to cases whose right hypotheses are known.

    A case without any right hypothesis among its own is left out.

    Returns
    -------
    (Weights, float)
        And the λ that was chosen.
    """
    names = list(dict.fromkeys(k for evidence, _ in cases for e in evidence for k in e if k != _NAME))
    used = _Cases.of(cases, names)
    scale = np.maximum(np.sqrt(np.mean(used.x**2, axis=0)), 1e-9)
    used = replace(used, x=used.x / scale)
    best = max(RIDGES, key=lambda ridge: _held_out(used, ridge))
    weights = _fit(used, best) / scale
    return Weights(dict(zip(names, map(float, weights), strict=True))), best


def _fit(cases: _Cases, ridge: float) -> Array:
    """Weights, from those that maximise the probability that any right hypothesis is drawn."""
    weights = _maximised(cases, ridge, np.zeros(cases.x.shape[1]), None)
    first = cases.first_right(weights)
    for _ in range(_MOST_TURNS):
        weights = _maximised(cases, ridge, weights, first)
        before, first = first, cases.first_right(weights)
        if np.array_equal(before, first):
            break
    return weights


def _maximised(cases: _Cases, ridge: float, start: Array, first: NDArray[np.intp] | None) -> Array:
    """Weights that maximise the probability of one right hypothesis of each case, or of all right ones together."""
    right = cases.right if first is None else np.isin(np.arange(len(cases.x)), first)

    def loss(w: Array) -> tuple[float, Array]:
        p = np.exp(cases.log_chances(w))
        of_right = np.where(right, p, 0.0)
        mass = np.maximum(np.add.reduceat(of_right, cases.starts), 1e-300)
        slope = ridge * w + cases.x.T @ (p - of_right / np.repeat(mass, cases.sizes))
        return 0.5 * ridge * float(w @ w) - float(np.log(mass).sum()), slope

    return np.asarray(optimize.minimize(loss, start, jac=True, method="L-BFGS-B").x)


def _held_out(cases: _Cases, ridge: float) -> float:
    """Log probability of the first right hypothesis, summed over cases that are predicted by a fit to others."""
    rng, total = np.random.default_rng(0), 0.0
    for _ in range(_DIVISIONS):
        fold = rng.permutation(len(cases.sizes)) % _FOLDS
        for k in range(_FOLDS):
            weights, tested = _fit(cases.some(fold != k), ridge), cases.some(fold == k)
            total += float(tested.log_chances(weights)[tested.first_right(weights)].sum())
    return total
