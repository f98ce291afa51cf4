"""Torques without their sign: many servos and meters report the magnitude of a current.

A torque s ≥ 0 that is measured as x with the noise σ has the sign of s with the probability

    P(x > 0 | |x|)  =  Φ(|x| / σ)

where all s are alike probable. So a torque that comes near zero again and again, each time from far away, is seen on
the other side now and then. If all values of a channel have one sign, the probability of this is the product of Φ over
its visits to zero, of each the smallest |x|. A visit far above the noise has Φ = 1 and says nothing. A visit with a
value of exactly zero says nothing either: a meter may be zero in the other direction. Where the product is small, zero
reflects the torque: the channel holds |τ|.

A drive that reports magnitudes does so for all joints, so the visits of all channels of one sign count together.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy import special

from frischid.checks.log_issue import Notebook, span
from frischid.core.types import Array
from frischid.logs.filters import noise_level
from frischid.logs.log import Log

AWAY = 4.0
"""Multiple of the noise beyond which a torque is away from zero, so that noise does not make one visit two."""
SURELY, PROBABLY = 1e-3, 1e-2
"""Probability of one sign by chance below which the fault is certain, and likely."""


def check_unsigned(log: Log, notes: Notebook) -> None:
    """Report torques or currents that are magnitudes: they touch zero again and again, and never pass it."""
    channel = "tau" if log.has("tau").any() else "current"
    values = getattr(log, channel)
    if values is None:
        return
    x = np.nan_to_num(np.asarray(values, dtype=float))
    noise = noise_level(x)
    one_sign = ((x >= 0).all(axis=0) | (x <= 0).all(axis=0)) & log.has(channel) & (noise > 0)
    seen = [visits(np.abs(x[:, j]) / noise[j]) if one_sign[j] else np.zeros(0) for j in range(x.shape[1])]
    by_chance = float(np.exp(special.log_ndtr(np.concatenate(seen)).sum()))
    if by_chance >= PROBABLY:
        return
    name = {"tau": "torque"}.get(channel, channel)
    counts = np.array([len(own) for own in seen])
    notes.add(
        "unsigned torque",
        f"the {name} comes near zero {span(counts[counts > 0].astype(float))} times and never changes its sign, "
        f"although noise would (p = {by_chance:.1g}): it is a magnitude",
        notes.which(counts > 0),
        "certain" if by_chance < SURELY else "likely",
        "record the signed value: of many servos the sign is a bit of its own, or the load and not the current has it",
        blocks=True,
    )


def visits(magnitude: Array) -> Array:
    """The smallest value of each visit of a magnitude (N,) to zero; a visit lies between values that are away.

    Examples
    --------
    >>> import numpy as np
    >>> visits(np.array([9.0, 5.0, 0.5, 0.2, 6.0, 0.0, 7.0, 0.9, 8.0]))
    array([0.2, 0.9])
    """
    away = np.flatnonzero(magnitude > AWAY)
    between = [magnitude[a + 1 : b] for a, b in itertools.pairwise(away) if b > a + 1]
    return np.array([part.min() for part in between if part.min() > 0])
