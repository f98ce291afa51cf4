"""A term outside the catalogue that explains far more than the first finding: then the finding is not the cause.

The catalogue has no effect for the action of one joint on another, nor for a torque that jumps at a few angles of a
gear, nor for a motor that gives less torque per ampere at a high current, nor for a gear out of centre, whose torque
changes with the angle at the same load, nor for dry friction that is another function of the angle than a straight
line, as of a bearing worn at one place. Yet some effect of the catalogue may resemble such a torque and be found. So
the best of these *unmodelled terms* is compared with the first finding, on the joint where the finding explains most.
Each of the two is fitted together with all other effects that entered. The finding is not the cause if

    NRMSE²(with the term) − floor²  <  ½ (NRMSE²(with the finding) − floor²).

Another joint may have an error, beside all findings, that is larger than what the first finding explains. Only its part
above the error of the healthy twin (`healthy_twin`) counts here: noise in the columns biases the fit of a robot that
misses nothing. A term that explains more than half of the whole error above the sensor noise is a greater cause than
the finding. A smaller share is no proof, because a dozen jumps at angles of their choice follow the twin's part too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.block_test import block_test
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_ranking import Ranking
from frischid.diagnosis.gear_steps import gear_steps, uneven_scale, worn_friction
from frischid.diagnosis.residual_formula import coupling_expressions, expression_of
from frischid.diagnosis.scored_candidate import ScoredCandidate, scored
from frischid.effects import Formula, PositionFriction


@dataclass(frozen=True)
class UnmodelledTerm:
    """A term outside the catalogue that explains far more than the first finding."""

    row: int
    """Position of the joint among the fitted ones."""
    words: str
    """Name of the term, as the subject of a sentence."""
    on_another_joint: bool
    """Whether the term explains an error that no finding explains, on another joint than the first finding."""


def unmodelled_term(ranking: Ranking, floor: Array, least: Array) -> UnmodelledTerm | None:
    """Find a term that explains far more than the first finding does.

    It is sought on the joint where the finding explains most: there it competes with the finding. It is also sought on
    the joint with the largest error above the healthy twin's, beside all findings, where that is more than the first
    finding explains.

    Parameters
    ----------
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    least : ndarray, shape (J,)
        Error of each joint where no effect is missing, N·m (N): the healthy twin's, or the floor where that is larger.

    Returns
    -------
    UnmodelledTerm or None
        None if no such term is far better than the finding.
    """
    if not any(effect.entered for effect in ranking.effects):
        return None
    full, without = ranking.full, ranking.without_first
    after, before = full.predictive_nrmse() ** 2, without.predictive_nrmse() ** 2
    noise, healthy = (floor / full.spread) ** 2, (least / full.spread) ** 2
    first, worst = int(np.argmax(before - after)), int(np.argmax(after - healthy))
    left = full.criteria.half_explained * (after - noise)
    if left[first] >= noise[first]:
        worn = ranking.effects[0].kind is not PositionFriction  # that is the cause, with another curve over the angle
        found = _term_on(without, first, noise[first] + left[first], False, worn=worn)
        if found is not None:
            return found
    if worst != first and after[worst] - healthy[worst] > before[first] - after[first]:
        return _term_on(full, worst, noise[worst] + left[worst], True, worn=False)
    return None


def saturation_expression(validator: CrossValidator, row: int) -> str:
    """Torque of a joint whose scale changes with the torque: at a high current a motor gives less torque per ampere.

    The square of an excavator's torque is too large for a column. So the torque is divided by the power of ten below
    its standard deviation.
    """
    number = validator.model.robot.numbers[validator.joints[row]]
    unit = 10.0 ** np.floor(np.log10(validator.spread[row]))
    return f"tau_model{number}*abs(tau_model{number}/{unit:g})"


def _term_on(
    validator: CrossValidator, row: int, most: float, on_another_joint: bool, *, worn: bool = True
) -> UnmodelledTerm | None:
    """The best term on a joint, if at most some squared NRMSE is left beside the term."""
    term = best_unmodelled(validator, row, worn=worn)
    if term is None or validator.nrmse(term.score.predictive)[row] ** 2 > most:
        return None
    number, expression = validator.model.robot.numbers[validator.joints[row]], expression_of(term)
    words = f"'{expression}'"
    if expression == saturation_expression(validator, row):
        words = "a scale of the torque that changes with the torque, as of a motor that saturates,"
    if f"tau_model{number}*" in expression and len(term.candidate.signs) > 1:
        words = f"a scale of the torque that changes with q{number}, as of a gear or a pulley out of centre,"
    elif len(term.candidate.signs) > 1:
        dry = f"sign(v{number})" in expression
        words = (
            f"dry friction that changes with q{number}"
            if dry
            else f"a torque that jumps from sector to sector of q{number}"
        )
    return UnmodelledTerm(row, words, on_another_joint)


def best_unmodelled(
    validator: CrossValidator, row: int, jumping: bool = True, *, worn: bool = True, significant: bool = True
) -> ScoredCandidate | None:
    """Best term outside the catalogue on one joint, or None.

    Tried are couplings, a motor that saturates, jumps, a gear out of centre, and worn friction.

    Parameters
    ----------
    row : int
        Position of the joint among the fitted ones.
    jumping : bool
        Whether to try functions of the joint's own angle: jumps, a gear out of centre, and dry friction.
    worn : bool
        Whether dry friction is among these.
    significant : bool
        Whether the term must be more than chance. Otherwise it must only explain the error over blocks of time: beside
        a few bursts of error the residual has hardly any independent samples, and no term is significant.
    """
    criteria, joint = validator.criteria, validator.joints[row]
    of_torque = saturation_expression(validator, row)
    terms = [Formula((joint,), e) for e in (*coupling_expressions(validator, joint), of_torque)]
    found = [x for c in validator.candidates(terms) if c.columns and (x := scored(validator, [c])) is not None]
    of_angle = [gear_steps, uneven_scale, *([worn_friction] if worn else [])] if jumping else []
    found += [x for term in of_angle if (x := term(validator, row)) is not None]
    best = min(found, key=lambda x: float(validator.nrmse(x.score.predictive)[row]), default=None)
    if best is None or (significant and best.p_value(len(found)) > criteria.significance):
        return None
    return None if block_test(validator, best.candidate) > criteria.block_p_value else best
