"""Cross-validation over stretches of time: a fit without each stretch, held against that stretch.

    variance_j = Σ_f ‖τ_f − Y_f θ_(without f)‖²_j / n_j

Neighbouring samples are alike, so stretches are contiguous. Moments subtract, so no data are needed again.

Where the joints move one after another, a stretch of time would hold all rows of one joint, and the others say nothing
about this joint's friction. Then each joint is cut by its own rows: stretch f holds the f-th part of the rows of every
joint.

Source: Stone 1974, "Cross-validatory choice and assessment of statistical predictions", J. R. Stat. Soc. B 36(2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.regression.moment_blocks import Blocks
from frischid.regression.moments import Gram

FOLDS = 5
"""Stretches of time that cross-validation leaves out in turn."""
MOST_OF_A_JOINT = 0.5
"""Share of a joint's rows in one stretch above which the others cannot tell about this joint. (jointwise logs)"""


@dataclass(frozen=True, eq=False)
class Fold:
    """A stretch of time, and the parameters fitted to all others."""

    out: Gram
    """Moments of the stretch."""
    theta: Array
    """Shape (p,)."""


def held_out_stretches(blocks: Sequence[Gram]) -> Blocks:
    """Moments of the stretches that are left out in turn.

    Raises
    ------
    IdentifiabilityError
        The log is too short to hold any of it out.
    """
    if len(blocks) < 2:
        raise IdentifiabilityError(
            "the log is too short to hold any of it out of the fit; record longer than two seconds"
        )
    kept = blocks if isinstance(blocks, Blocks) else Blocks(blocks)
    counts = kept.counts
    parts = np.array_split(np.arange(len(kept)), min(FOLDS, len(kept)))
    held = np.array([counts[part].sum(axis=0) for part in parts])
    if (held.max(axis=0) <= MOST_OF_A_JOINT * counts.sum(axis=0)).all():
        return kept.added([len(part) for part in parts])
    before = np.cumsum(counts, axis=0) - counts
    place = ((before + counts / 2) * len(parts) / np.maximum(counts.sum(axis=0), 1.0)).astype(int)
    return Blocks(_of_joints(kept, place == fold) for fold in range(len(parts)))


def _of_joints(blocks: Blocks, taken: NDArray[np.bool_]) -> Gram:
    """Moments of some blocks, chosen for each joint: `taken` (blocks, J)."""
    found = Gram.zeros(blocks[0].columns, blocks[0].joints)
    for block, row in zip(blocks, taken, strict=True):
        if row.any():
            found.moments[row] += block.moments[row]
            found.sums[row] += block.sums[row]
            found.counts[row] += block.counts[row]
    return found


def held_out_variance(folds: Sequence[Fold]) -> Array:
    """Residual variance of each joint on the stretches that were left out, (J,)."""
    rows = np.sum([fold.out.counts for fold in folds], axis=0)
    return np.asarray(np.sum([fold.out.residual_ss(fold.theta) for fold in folds], axis=0) / np.maximum(rows, 1.0))
