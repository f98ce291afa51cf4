"""What is left when nothing in the catalogue explains it: which variables it depends on, and a formula for it.

The residual of the joint that is explained worst is held against every quantity of every joint, by Chatterjee's ξ
(a rank correlation that is 0 only for independence and 1 for any function, S. Chatterjee 2021, J. Am. Stat. Assoc.
116(536)), on samples a correlation time apart. Then terms from a library of simple expressions enter one by one while
held-out data pay for them (orthogonal least squares, as in `ranking`; the library: Brunton, Proctor and Kutz 2016, PNAS
113(15)). The result is a *description*, not a cause: it says where to look.

A description also keeps the catalogue honest. What another joint does to this one is in no catalogue, nor is a torque
that jumps from sector to sector of a gear; yet some effect may resemble it and be found. Where one such term, or such
jumps, leave far less of the error above the noise than the first finding does, that finding is not the cause
(`outdone`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.diagnosis.cross_validation import LOOKED_AT, Evidence, thinned
from frischid.diagnosis.gear_steps import jumps, steps
from frischid.diagnosis.stepwise_selection import SIGNIFICANCE, STEADY, Judged, Ranking, block_test, judged
from frischid.effects import Formula
from frischid.model.comparison_criteria import COMPARISON_CRITERIA

TERMS = 3
FAR_LESS = 0.5  # of what the first finding leaves above the noise
SECTORS = 24  # of a joint's range, in the library
MOSTLY = 0.1  # of what a first finding is held against: if it leaves less, a dozen jumps are no better answer


@dataclass(frozen=True)
class Description:
    """What is left on one joint.

    Attributes
    ----------
    joint : str
    depends_on : dict of str to float
        Variable (``q2``, ``v1``, ...; t: time in the log) -> p value of independence, those that are not independent,
        corrected for all that were tried; the surest first.
    formula : tuple of str
        Expressions, in the language of the effect ``formula``, that describe it.
    removed : float
        Share of the squared held-out error on this joint that the formula removes.
    """

    joint: str
    depends_on: Mapping[str, float]
    formula: tuple[str, ...]
    removed: float

    def __str__(self) -> str:
        depends = ", ".join(self.depends_on) or "no variable alone"
        formula = listed([f"'{f}'" for f in self.formula])
        verb = "describes" if len(self.formula) == 1 else "describe"
        described = f"; {formula} {verb} {self.removed:.0%} of it (a description, not a cause)" if formula else ""
        return f"What is left on {self.joint} depends on {depends}{described}"


@dataclass(frozen=True)
class Stranger:
    """What no effect of the catalogue is, where it describes far more than the first finding explains.

    Attributes
    ----------
    row : int
        Position of the joint among the fitted ones.
    words : str
        What describes it.
    """

    row: int
    words: str


def describe(evidence: Evidence, row: int) -> Description:
    """Describe what is left on a joint."""
    depends = _dependence(evidence, row)
    chosen, removed = _formula(evidence, row)
    return Description(evidence.joints[row], depends, tuple(chosen), removed)


def outdone(ranking: Ranking, floor: Array) -> Stranger | None:
    """Find what describes far more than the first finding explains, on the joint where that removes most.

    Parameters
    ----------
    ranking : Ranking
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).

    Returns
    -------
    Stranger or None
        None: the finding holds.
    """
    if not any(ranked.entered for ranked in ranking.effects):
        return None
    full, without = ranking.full, ranking.without_first
    after = full.nrmse(full.base_sse()) ** 2
    before = without.nrmse(without.base_sse()) ** 2
    row = int(np.argmax(before - after))
    noise = float(floor[row] / full.spread[row]) ** 2
    most = FAR_LESS * (after[row] - noise)
    if most < noise:
        return None
    rival = best_foreign(without, row, after[row] > MOSTLY * before[row])
    if rival is None or without.nrmse(rival.score.sse)[row] ** 2 - noise > most:
        return None
    words = f"'{_expression(rival)}'"
    if len(rival.projection.signs) > 1:
        words = f"a torque that jumps from sector to sector of q{full.model.robot.numbers[full.joints[row]]}"
    return Stranger(row, words)


def best_foreign(evidence: Evidence, row: int, jumping: bool = True) -> Judged | None:
    """What is in no catalogue and describes a joint best: what another joint does, or jumps; None if none is sure."""
    joint = evidence.joints[row]
    foreign = [p for p in evidence.project([Formula((joint,), e) for e in _foreign(evidence, joint)]) if p.columns]
    found = [j for p in foreign if (j := judged(evidence, [p])) is not None]
    found += [j for j in [jumps(evidence, row) if jumping else None] if j is not None]
    best = min(found, key=lambda j: float(evidence.nrmse(j.score.sse)[row]), default=None)
    if best is None or best.chance(len(found)) > SIGNIFICANCE or block_test(evidence, best.projection) > STEADY:
        return None
    return best


def _dependence(evidence: Evidence, row: int) -> dict[str, float]:
    count = int(evidence.counts[:, row].sum())
    apart = max(1, round(evidence.correlation[row]), -(-count // LOOKED_AT))
    if count // apart < COMPARISON_CRITERIA.dependence_samples:
        return {}
    variables, residual = evidence.variables(row, apart), thinned(evidence.residuals(row, evidence.theta), apart)
    found = {}
    for name, x in variables.items():
        if np.ptp(x) > 0:
            found[name] = min(1.0, len(variables) * float(stats.chatterjeexi(x, residual).pvalue))
    return {name: p for name, p in sorted(found.items(), key=lambda item: item[1]) if p < SIGNIFICANCE}


def _formula(evidence: Evidence, row: int) -> tuple[list[str], float]:
    joint = evidence.joints[row]
    terms = [Formula((joint,), e) for e in _library(evidence, joint)] + steps(evidence, row, SECTORS - 1)
    candidates = [p for p in evidence.project(terms) if p.columns]
    start = evidence.nrmse(evidence.base_sse())[row] ** 2
    now, chosen, left = evidence, list[str](), start
    while len(chosen) < TERMS:
        scored = [j for c in candidates if (j := judged(now, [c])) is not None and j.gain > 0]
        passing = [j for j in scored if j.chance(len(candidates)) < SIGNIFICANCE]
        if not passing:
            break
        best = max(passing, key=lambda j: j.removed)
        after = float(now.nrmse(best.score.sse)[row] ** 2)
        if after > 0.95 * left:
            break
        chosen.append(_expression(best))
        left, now = after, now.extended(best.projection)
        candidates = [c for c in candidates if c is not best.projection]
    return chosen, float(1 - left / start)


def _expression(candidate: Judged) -> str:
    effect = candidate.effect
    assert isinstance(effect, Formula)
    return effect.expression


def _library(evidence: Evidence, joint: str) -> list[str]:
    """Simple expressions of the joint's own quantities, of each other joint's, and of both together."""
    own = str(evidence.model.robot.numbers[joint])
    found = [f"{wave}({k}q{own})" for wave in ("sin", "cos") for k in ("", "2*", "3*")]
    found += [f"v{own}**3", f"abs(v{own})", f"v{own}*abs(v{own})", f"abs(tau_model{own})", f"q{own}*v{own}"]
    found += [f"t*sign(v{own})", f"t*v{own}", "t", f"abs(q{own})*sign(v{own})", f"load{own}"]
    found += [form for k in _others(evidence, joint) for form in (f"v{k}", f"sign(v{k})", f"a{k}")]
    return found + _foreign(evidence, joint)


def _foreign(evidence: Evidence, joint: str) -> list[str]:
    """Expressions of what another joint does to this one that no effect of the catalogue has."""
    own, found = str(evidence.model.robot.numbers[joint]), []
    for k in _others(evidence, joint):
        found += [f"q{own}*q{k}", f"q{k}", f"sin(q{k})", f"cos(q{k})", f"tau_model{k}", f"v{own}*abs(v{k})"]
        found += [f"abs(v{own})*v{k}", f"v{own}*v{k}", f"q{k}*v{own}", f"q{k}*sign(v{own})"]
    return found


def _others(evidence: Evidence, joint: str) -> list[str]:
    """Numbers of the other joints."""
    return [str(number) for name, number in evidence.model.robot.numbers.items() if name != joint]
