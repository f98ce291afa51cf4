"""A residual that no effect explains: the variables it depends on, and a short formula for it.

Each quantity of each joint is tested against the residual with Chatterjee's ξ, on samples a correlation time apart. For
n pairs in the order of x, with r_i the rank of the i-th residual,

    ξ = 1 − 3 Σ |r_{i+1} − r_i| / (n² − 1),

which is about zero if residual and quantity are independent, and one if the residual is a function of the quantity.
Then terms of a library of simple expressions enter one after another while the held-out error falls. The result is a
*description*, not a cause: it says where to look.

Sources: Chatterjee 2021, "A new coefficient of correlation", J. Am. Stat. Assoc. 116(536); the library: Brunton,
Proctor and Kutz 2016, PNAS 113(15).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from frischid.core.text import listed, percent
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.gear_steps import evenly_spaced_jumps
from frischid.diagnosis.residual_variables import MOST_ROWS, thinned, variables
from frischid.diagnosis.scored_candidate import ScoredCandidate, passes, scored
from frischid.effects import Formula
from frischid.estimators.p_values import depends
from frischid.model.comparison_criteria import COMPARISON_CRITERIA

_KNEES = (0.03, 0.1, 0.3, 1.0)  # of a joint's torque (std): loads at which a torque may bend
SAID_VARIABLES = 4  # in a sentence; all of them are in `Description.depends_on`


@dataclass(frozen=True)
class Description:
    """Description of the residual of one joint."""

    joint: str
    depends_on: Mapping[str, float]
    """Variable (``q2``, ``v1``, ...; t: time in the log) -> p value of independence, corrected for the number of
    variables tested. Only variables that pass, the smallest p value first."""
    formula: tuple[str, ...]
    """Expressions, in the language of the effect ``formula``, that describe the residual."""
    removed: float
    """Share of the joint's squared held-out error that the formula explains."""
    joints: dict[str, str]
    """Number in the names of variables -> joint."""

    def __str__(self) -> str:
        if not (self.depends_on or self.formula):
            return (
                f"The residual error of {self.joint} depends on no variable alone, and no formula describes it. Slow "
                "noise of the torque looks like that, and an effect with memory does. Record one motion three times "
                "(frischid excite --repeat 3): only an effect comes again with the motion"
            )
        variables = list(self.depends_on)
        depends = ", ".join(variables) or "no variable alone"
        if len(variables) > SAID_VARIABLES:
            depends = f"{len(variables)} variables, most clearly on {listed(variables[:SAID_VARIABLES])}"
        formula = listed([f"'{f}'" for f in self.formula])
        verb = "describes" if len(self.formula) == 1 else "describe"
        described = f"; {formula} {verb} {percent(self.removed)} of it (a description, not a cause)" if formula else ""
        used = dict.fromkeys(re.findall(r"[a-z](\d+)", f"{depends} {formula}"))
        numbered = [f"joint {k} is {self.joints[k]}" for k in used if self.joints.get(k, f"joint{k}") != f"joint{k}"]
        names = f"; {listed(numbered)}" if numbered else ""
        return f"The residual error of {self.joint} depends on {depends}{described}{names}"


def describe(validator: CrossValidator, row: int) -> Description:
    """Describe the residual of one joint, given by its position among the fitted ones."""
    depends = _dependence(validator, row)
    chosen, removed = _formula(validator, row)
    joints = {str(number): name for name, number in validator.model.robot.numbers.items()}
    return Description(validator.joints[row], depends, tuple(chosen), removed, joints)


def _dependence(validator: CrossValidator, row: int) -> dict[str, float]:
    criteria = validator.criteria
    count = int(validator.counts[:, row].sum())
    apart = max(1, round(validator.fit.correlation[row]), -(-count // MOST_ROWS))
    if count // apart < COMPARISON_CRITERIA.dependence_samples:
        return {}
    tested = variables(validator, row, apart)
    residual = thinned(validator.residuals(row, validator.theta), apart)
    found = {}
    for name, x in tested.items():
        if np.ptp(x) > 0:
            found[name] = min(1.0, len(tested) * depends(x, residual))
    return {name: p for name, p in sorted(found.items(), key=lambda item: item[1]) if p < criteria.significance}


def _formula(validator: CrossValidator, row: int) -> tuple[list[str], float]:
    """Expressions that describe a joint's residual, and the share of its squared held-out error they explain."""
    criteria, joint = validator.criteria, validator.joints[row]
    terms = [Formula((joint,), e) for e in library(validator, joint)]
    terms += evenly_spaced_jumps(validator, row, criteria.formula_sectors - 1)
    candidates = [c for c in validator.candidates(terms) if c.columns]
    start = validator.predictive_nrmse()[row] ** 2
    now, chosen, error = validator, list[str](), start
    while len(chosen) < criteria.formula_terms:
        found = [x for c in candidates if (x := scored(now, [c])) is not None]
        best = max((x for x in found if passes(now, x, len(candidates))), key=lambda x: x.explained, default=None)
        if best is None:
            break
        chosen.append(expression_of(best))
        error, now = float(now.nrmse(best.score.predictive)[row] ** 2), now.extended(best.candidate)
        candidates = [c for c in candidates if c is not best.candidate]
    return chosen, float(1 - error / start)


def expression_of(found: ScoredCandidate) -> str:
    """The expression of a candidate that is a formula."""
    effect = found.effect
    assert isinstance(effect, Formula)
    return effect.expression


def library(validator: CrossValidator, joint: str) -> list[str]:
    """Simple expressions of the joint's own quantities, of those of each other joint, and of both together."""
    own = str(validator.model.robot.numbers[joint])
    found = [f"{wave}({k}q{own})" for wave in ("sin", "cos") for k in ("", "2*", "3*")]
    found += [f"v{own}**3", f"abs(v{own})", f"v{own}*abs(v{own})", f"abs(tau_model{own})", f"q{own}*v{own}"]
    found += [f"t*sign(v{own})", f"t*v{own}", "t", f"abs(q{own})*sign(v{own})", f"load{own}"]
    spread = validator.spread[validator.joints.index(joint)]
    found += [f"tanh(load{own}/{share * spread:.2g})" for share in _KNEES]
    return found + coupling_expressions(validator, joint)


def coupling_expressions(validator: CrossValidator, joint: str) -> list[str]:
    """Expressions for torques on one joint caused by the motion of other joints, which the catalogue lacks."""
    own, found = str(validator.model.robot.numbers[joint]), []
    for k in _others(validator, joint):
        found += [f"v{k}", f"sign(v{k})", f"a{k}", f"q{k}", f"sin(q{k})", f"cos(q{k})", f"tau_model{k}"]
        found += [f"q{own}*q{k}", f"v{own}*abs(v{k})", f"abs(v{own})*v{k}"]
        found += [f"v{own}*v{k}", f"q{k}*v{own}", f"q{k}*sign(v{own})"]
    return found


def _others(validator: CrossValidator, joint: str) -> list[str]:
    """Numbers of the other joints."""
    robot = validator.model.robot  # whose numbers count mimic joints too
    return [str(robot.numbers[name]) for name in robot.joints if name != joint]
