"""Torques without their sign: many servos and meters report the magnitude of a current.

A torque that passes zero is a smooth curve, and its magnitude has a corner there. A torque of one sign that comes near
zero is a smooth curve itself. So each *visit* to zero, the samples between two that are far from zero, is fitted twice
by a parabola in time: as the log has the samples x_i, and with another sign from sample k on, with k one of the
samples next to the smallest. With σ the noise of the channel, the two descriptions have the log likelihoods

    ℓ_one = −Σ (x_i − p(t_i))² / 2σ²,      ℓ_both = max_k −Σ (±x_i − p_k(t_i))² / 2σ².

A magnitude has either at each visit: the curve has passed zero with the probability w = Φ(−x_k/σ) that noise alone
would carry the smallest value there, ½ at zero. A torque of one sign has ℓ_one, but now and then dry friction jumps
just where the torque is near zero: with the probability 2cw, there is a corner too. The evidence that zero reflects the
torque is the sum over all visits of

    log ((1 − w) e^ℓ_one + w e^ℓ_both) − log ((1 − 2cw) e^ℓ_one + 2cw e^ℓ_both),

at most log 1/2c for each visit, so a few corners prove nothing. A drive that reports magnitudes does so for all joints:
where one channel has both signs, none is a magnitude, and the visits of all channels count together. A visit with a
value of exactly zero says nothing: a meter may be zero in the other direction.

Source: Kass and Raftery 1995, "Bayes factors", J. American Statistical Association 90(430).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from scipy import special

from frischid.checks.log_issue import Notebook, span
from frischid.core.types import Array
from frischid.logs.filters import noise_level
from frischid.logs.log import Log

COMPARED_RATE = 100.0
"""Hz. Of faster logs, evenly spread samples are compared: among many samples of a visit, a corner looks round."""
AWAY = 4.0
"""Multiple of the noise beyond which a torque is away from zero, so that noise does not make one visit two."""
BESIDE = 4
"""Samples of each side that are away from zero and belong to the visit: they show where the curve comes from."""
BY_FRICTION = 0.1
"""c, the probability that dry friction makes a corner where a torque of one sign comes near zero."""
SURELY, PROBABLY = float(np.log(1000.0)), float(np.log(100.0))
"""Logarithm of the ratio of likelihoods above which the fault is certain, and likely."""


def check_unsigned(log: Log, notes: Notebook) -> None:
    """Report torques or currents that are magnitudes: they touch zero again and again, and never pass it."""
    channel = "tau" if log.has("tau").any() else "current"
    values = getattr(log, channel)
    if values is None:
        return
    x = np.nan_to_num(np.asarray(values, dtype=float))
    noise = noise_level(x)
    alive = log.has(channel) & (noise > 0)
    if not ((x >= 0).all(axis=0) | (x <= 0).all(axis=0))[alive].all():
        return
    thinned = np.abs(x[:: max(1, round(log.rate / COMPARED_RATE))]) / np.where(noise > 0, noise, 1.0)
    found = [[evidence(v) for v in visits(thinned[:, j])] if alive[j] else [] for j in range(len(noise))]
    ratio = sum(map(sum, found))
    if ratio <= PROBABLY:
        return
    name = {"tau": "torque"}.get(channel, channel)
    counts = np.array([len(own) for own in found])
    notes.add(
        "unsigned torque",
        f"the {name} comes near zero {span(counts[counts > 0].astype(float))} times and turns back with a corner, "
        "as the magnitude of a torque that passes zero does: the sign is missing",
        notes.which(counts > 0),
        "certain" if ratio > SURELY else "likely",
        "record the signed value: of many servos the sign is a bit of its own, or the load and not the current has it",
        blocks=True,
    )


def visits(magnitude: Array) -> Iterator[Array]:
    """The values of each visit of a magnitude (N,) to zero, with the samples beside it.

    Examples
    --------
    >>> import numpy as np
    >>> there = np.array([9.0, 8.0, 7.0, 5.0, 0.5, 0.2, 6.0, 8.0, 9.0, 9.0, 9.0])
    >>> [x.tolist() for x in visits(there)]
    [[9.0, 8.0, 7.0, 5.0, 0.5, 0.2, 6.0, 8.0, 9.0, 9.0]]
    """
    away = np.flatnonzero(magnitude > AWAY)
    for a, b in itertools.pairwise(away):
        part = magnitude[max(a + 1 - BESIDE, 0) : b + BESIDE]
        if b > a + 1 and len(part) > 4 and magnitude[a + 1 : b].min() > 0:
            yield part


def evidence(values: Array) -> float:
    """Evidence of one visit, whose values (n,) are in units of the noise.

    Examples
    --------
    A line that passes zero, as a magnitude, and a parabola that comes near zero:

    >>> import numpy as np
    >>> t = np.arange(-4.5, 5.0)
    >>> evidence(np.abs(8 * t)) > 1, evidence(t**2 + 0.5) < 0
    (True, True)
    """
    t = np.linspace(-1.0, 1.0, len(values))
    basis, _ = np.linalg.qr(np.column_stack([np.ones_like(t), t, t**2]))
    least = int(values.argmin())
    curves = np.array([np.where(np.arange(len(t)) >= k, -values, values) for k in (len(t), least, least + 1)])
    one, *both = np.sum(np.square(curves - (curves @ basis) @ basis.T), axis=1).tolist()
    gain = (one - min(both)) / 2
    passed = special.ndtr(-values.min())
    by_friction = 2 * BY_FRICTION * passed
    ways = [np.logaddexp(np.log1p(-w), np.log(w) + gain) for w in (passed, by_friction)]
    return float(ways[0] - ways[1])
