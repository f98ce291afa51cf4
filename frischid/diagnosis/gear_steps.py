"""A torque that jumps from sector to sector of a joint's angle, as a damaged gear's does.

    τ = Σ_k h_k sign(q − e_k)

Edges e_k are taken from a fine grid over the range of q, one after another, each the one that explains most beside
those already taken (orthogonal least squares: Chen, Billings and Luo 1989, Int. J. Control 50(5)); as many as data held
out are predicted best with. Few steps in the right places describe such a torque; ripple they cannot, and what a
continuous line describes nearly as well, with a dozen kinks at equal distances, is a spring of some kind.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Projection
from frischid.diagnosis.cross_validation import IN_SPAN, LOOKED_AT, Evidence
from frischid.diagnosis.stepwise_selection import Judged, judged
from frischid.effects import Formula

EDGES = 96  # of a joint's range
MOST = 12  # jumps, and kinks of a continuous line
FAR_BETTER = 0.5  # of the squares that the continuous line leaves


def steps(evidence: Evidence, row: int, edges: int) -> list[Formula]:
    """Steps between equal sectors of a joint's range."""
    return _terms(evidence, row, "sign({})", edges)


def jumps(evidence: Evidence, row: int) -> Judged | None:
    """The torque with jumps that predicts a joint's held-out data best; None when a continuous one does as well."""
    found = [p for p in evidence.project(steps(evidence, row, EDGES)) if p.columns]
    chosen = [found[k] for k in _order(evidence, evidence.joined(found))] if found else []
    best = _best(evidence, row, [chosen[:n] for n in range(1, len(chosen) + 1)])
    bent = [*_terms(evidence, row, "{}", 1), *_terms(evidence, row, "abs({})", MOST)]
    kinked = [p for p in evidence.project(bent) if p.columns]
    line = _best(evidence, row, [kinked] if kinked else [])
    if best is None or (line is not None and _left(best, row) > FAR_BETTER * _left(line, row)):
        return None
    return best


def _terms(evidence: Evidence, row: int, form: str, edges: int) -> list[Formula]:
    """A function of the distance from each of some angles that part a joint's range evenly."""
    joint = evidence.joints[row]
    own = f"q{evidence.model.robot.numbers[joint]}"
    count = int(evidence.counts[:, row].sum())
    q = evidence.variables(row, max(1, count // LOOKED_AT))[own]
    at = np.linspace(q.min(), q.max(), edges + 2)[1:-1]
    return [Formula((joint,), form.format(f"{own} - {x:.4g}" if x >= 0 else f"{own} + {-x:.4g}")) for x in at]


def _best(evidence: Evidence, row: int, sets: Sequence[Sequence[Projection]]) -> Judged | None:
    """Of some sets of columns the one with which a joint's held-out data are predicted best."""
    tried = [judged(evidence, [evidence.joined(columns)]) for columns in sets]
    return min((j for j in tried if j is not None), key=lambda j: _left(j, row), default=None)


def _left(found: Judged, row: int) -> float:
    return float(found.score.sse[:, row].sum())


def _order(evidence: Evidence, together: Projection) -> list[int]:
    """Columns in the order in which each explains most beside those before it."""
    eliminated = evidence.eliminated(*evidence.moments(together), together, None)
    if eliminated is None:
        return []
    S, g = eliminated[0].copy(), eliminated[1].copy()
    chosen: list[int] = []
    while len(chosen) < MOST:
        left: Array = np.diag(S)
        j = int(np.argmax(np.where(left > IN_SPAN, g**2 / np.maximum(left, IN_SPAN), 0.0)))
        if left[j] <= IN_SPAN:
            break
        chosen.append(j)
        share = S[:, j] / S[j, j]
        g = g - share * g[j]
        S = S - np.outer(share, S[j])
    return chosen
