"""A torque that jumps at a few angles of a joint, as the torque of a damaged gear does.

    τ = Σ_k h_k sign(q − e_k)

The angles e_k come from a fine grid over the range of q. They are taken one after another; each next angle is the one
that explains most error beside the angles already taken (orthogonal least squares). The number of jumps is the one with
the smallest held-out error. A few jumps in the right places describe a damaged gear; they do not describe ripple. A
torque that a continuous line with a dozen kinks describes nearly as well is a spring of some kind, not jumps.

Such a line times sign(q̇) is the dry friction of a bearing that is worn at some angles.

A gear or a pulley out of centre, and a universal joint, change the scale of the torque with the angle,

    τ = τ_model (a sin kq + b cos kq),  k a small integer.

Source: Chen, Billings and Luo 1989, Int. J. Control 50(5).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.residual_variables import MOST_ROWS, variables
from frischid.diagnosis.scored_candidate import ScoredCandidate, scored
from frischid.diagnosis.weighted_fit import IN_SPAN
from frischid.effects import Formula

_ORDERS = (1, 2, 3, 4)  # waves per turn: one of a part out of centre, two of a universal joint, more of cranks


def evenly_spaced_jumps(validator: CrossValidator, row: int, count: int) -> list[Formula]:
    """Jumps at `count` angles that divide a joint's range evenly."""
    return _terms(validator, row, "sign({})", count)


def gear_steps(validator: CrossValidator, row: int) -> ScoredCandidate | None:
    """Jumps that predict a joint's held-out data best; None when a continuous torque does nearly as well."""
    criteria = validator.criteria
    found = [c for c in validator.candidates(evenly_spaced_jumps(validator, row, criteria.jump_grid)) if c.columns]
    chosen = [found[k] for k in _order(validator, validator.joined(found), criteria.max_jumps)] if found else []
    best = _best(validator, row, [chosen[:n] for n in range(1, len(chosen) + 1)])
    bent = [*_terms(validator, row, "{}", 1), *_terms(validator, row, "abs({})", criteria.max_jumps)]
    kinked = [c for c in validator.candidates(bent) if c.columns]
    line = _best(validator, row, [kinked] if kinked else [])
    if best is None or (line is not None and _error(best, row) > criteria.half_explained * _error(line, row)):
        return None
    return best


def worn_friction(validator: CrossValidator, row: int) -> ScoredCandidate | None:
    """Dry friction that is a continuous function of the angle, with a dozen kinks; None where the model spans it."""
    number = validator.model.robot.numbers[validator.joints[row]]
    bent = _terms(validator, row, f"abs({{}})*sign(v{number})", validator.criteria.max_jumps)
    kinked = [c for c in validator.candidates(bent) if c.columns]
    return _best(validator, row, [kinked] if kinked else [])


def uneven_scale(validator: CrossValidator, row: int) -> ScoredCandidate | None:
    """A scale of the torque that changes with the angle of a turning joint; None for other joints."""
    robot, joint = validator.model.robot, validator.joints[row]
    if robot.prismatic[robot.joints.index(joint)]:
        return None
    number = robot.numbers[joint]
    waves = [f"tau_model{number}*{wave}({k}*q{number})" for k in _ORDERS for wave in ("sin", "cos")]
    found = validator.candidates([Formula((joint,), wave) for wave in waves])
    return _best(validator, row, [found[2 * n : 2 * n + 2] for n in range(len(_ORDERS))])


def _terms(validator: CrossValidator, row: int, form: str, count: int) -> list[Formula]:
    """A function of the distance to each of `count` angles that divide a joint's range evenly."""
    joint = validator.joints[row]
    own = f"q{validator.model.robot.numbers[joint]}"
    rows = int(validator.counts[:, row].sum())
    q = variables(validator, row, max(1, rows // MOST_ROWS))[own]
    at = np.linspace(q.min(), q.max(), count + 2)[1:-1]
    return [Formula((joint,), form.format(f"{own} - {x:.4g}" if x >= 0 else f"{own} + {-x:.4g}")) for x in at]


def _best(validator: CrossValidator, row: int, sets: Sequence[Sequence[Candidate]]) -> ScoredCandidate | None:
    """The set of columns that predicts a joint's held-out data best."""
    tried = [scored(validator, [validator.joined(columns)]) for columns in sets]
    return min((x for x in tried if x is not None), key=lambda x: _error(x, row), default=None)


def _error(found: ScoredCandidate, row: int) -> float:
    """Held-out sum of squared residuals of a joint."""
    return float(found.score.sse[:, row].sum())


def _order(validator: CrossValidator, together: Candidate, most: int) -> list[int]:
    """Columns in the order in which each explains most beside those before it."""
    equations = validator.fit.eliminated(together)
    if equations is None:
        return []
    S, g = equations
    chosen: list[int] = []
    while len(chosen) < most:
        left: Array = np.diag(S)
        j = int(np.argmax(np.where(left > IN_SPAN, g**2 / np.maximum(left, IN_SPAN), 0.0)))
        if left[j] <= IN_SPAN:
            break
        chosen.append(j)
        share = S[:, j] / S[j, j]
        g = g - share * g[j]
        S = S - np.outer(share, S[j])
    return chosen
