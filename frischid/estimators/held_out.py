"""Cross-validation over stretches of time: a fit without each stretch, held against that stretch.

    variance_j = Σ_f ‖τ_f − Y_f θ_(without f)‖²_j / n_j

Neighbouring samples are alike, so stretches are contiguous. Moments subtract, so no data are needed again.

Source: Stone 1974, "Cross-validatory choice and assessment of statistical predictions", J. R. Stat. Soc. B 36(2).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.regression.moments import Gram, total

FOLDS = 5
"""Stretches of time that cross-validation leaves out in turn."""


@dataclass(frozen=True, eq=False)
class Fold:
    """A stretch of time, and the parameters fitted to all others.

    Attributes
    ----------
    out : Gram
        Moments of the stretch.
    theta : ndarray, shape (p,)
    """

    out: Gram
    theta: Array


def held_out_stretches(blocks: Sequence[Gram]) -> Iterator[Gram]:
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
    for fold in np.array_split(np.arange(len(blocks)), min(FOLDS, len(blocks))):
        yield total(blocks[fold[0] : fold[-1] + 1])


def held_out_variance(folds: Sequence[Fold]) -> Array:
    """Residual variance of each joint on the stretches that were left out, (J,)."""
    rows = np.sum([fold.out.counts for fold in folds], axis=0)
    return np.asarray(np.sum([fold.out.residual_ss(fold.theta) for fold in folds], axis=0) / np.maximum(rows, 1.0))
