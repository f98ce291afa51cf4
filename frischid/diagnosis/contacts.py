"""Contacts: an outside force for a while, an event to be kept out, not an effect to be added.

A contact leaves residuals that are large on some stretch of a few tenths of a second to a few seconds, in a log that is
otherwise explained. As it also bends the fit of everything else, it is looked for in turns: the residual's energy,
smoothed over a quarter of a second and measured in robust units (median absolute deviation) of each joint, shows the
bursts; without them the parameters are fitted again, until the bursts stay the same (a trimmed estimate: Rousseeuw
and Leroy 1987, Robust Regression and Outlier Detection, Wiley).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import LOOKED_AT, Evidence, thinned
from frischid.diagnosis.reversal_residuals import AT_REST

SMOOTH = 0.25  # s
HIGH, LOW = 30.0, 6.0  # squared robust units at which a burst is seen and where it ends
SMALL = 0.004  # of a joint's torque: its robust unit is not taken smaller, or every reversal is a burst
AROUND = 0.1  # s left out on both sides of a burst, where it fades below the noise
LONGEST, MOST = 0.35, 4  # share of a log that may be bursts, and how many of them; more is not an event
SHARE, CONTRAST = 0.4, 10.0  # of the squares above the noise that are in the bursts; their density there over elsewhere
UNSURE = 0.1  # of the noise's squares, which are not known better: bursts must hold more
STRONG = 18.0  # robust units of a burst on most joints that is an event whatever else is missing
WEAK = 0.03  # of the strongest burst's energy: those below are something else's
ROUNDS = 5


@dataclass(frozen=True)
class Contact:
    """A stretch of time with an outside force.

    Attributes
    ----------
    source : str
        The log.
    start, stop : float
        s
    joints : list of str
        Joints whose torque shows it.
    strength : float
        Largest residual in robust units.
    """

    source: str
    start: float
    stop: float
    joints: list[str]
    strength: float


def stretches(contacts: Sequence[Contact]) -> list[tuple[str, float, float]]:
    """What `Evidence.without` is to leave out."""
    return [(c.source, c.start, c.stop) for c in contacts]


def find_contacts(evidence: Evidence, floor: Array) -> list[Contact]:
    """Bursts of residual that the rest of the log does not show.

    Parameters
    ----------
    evidence : Evidence
    floor : ndarray, shape (J,)
        Sensor noise of each joint; a joint's scale is not taken smaller than that.

    Returns
    -------
    list of Contact
    """
    found: list[Contact] = []
    rest = evidence
    for _ in range(ROUNDS):
        new = _bursts(evidence, rest, floor)
        if not _events(evidence, new):
            return []
        if stretches(new) == stretches(found):
            break
        found = new
        rest = evidence.without(stretches(found))
    felt = max((c.strength for c in found if 2 * len(c.joints) > len(evidence.joints)), default=0.0)
    return found if felt > STRONG or _stands_out(evidence, rest, floor) else []


def _events(evidence: Evidence, found: Sequence[Contact]) -> bool:
    """Few and short enough, in every log, to be events."""
    for source in {c.source for c in found}:
        here = [c for c in found if c.source == source]
        length = sum(t[-1] - t[0] for s, t in zip(evidence.sources, evidence.times, strict=True) if s == source)
        if len(here) > MOST or sum(c.stop - c.start for c in here) > LONGEST * length:
            return False
    return bool(found)


def _stands_out(evidence: Evidence, rest: Evidence, floor: Array) -> bool:
    """Whether much of what the rest's parameters leave above the noise is in the bursts, and densely so."""
    whole = outside = 0.0
    for row, spread in enumerate(evidence.spread):
        whole += evidence.squares(row, rest.theta) / spread**2
        outside += rest.squares(row, rest.theta) / spread**2
    samples = int(evidence.counts.sum()), int(rest.counts.sum())
    inside = whole - outside
    noise = float((evidence.counts.sum(axis=0) * (floor / evidence.spread) ** 2).sum())
    density = inside / max(samples[0] - samples[1], 1)
    return inside > max(SHARE * (whole - noise), UNSURE * noise) and density > CONTRAST * outside / samples[1]


def _bursts(evidence: Evidence, rest: Evidence, floor: Array) -> list[Contact]:
    """Bursts over all rows under the parameters of the rest, without those that are weak beside the strongest."""
    scale = np.maximum(np.maximum(_quiet(rest), floor), SMALL * evidence.spread)
    found: list[tuple[float, Contact]] = []
    ways = zip(evidence.sources, evidence.times, evidence.speeds(), strict=True)
    for number, (source, t, speed) in enumerate(ways):
        z = np.zeros((len(t), len(scale)))
        for row, unit in enumerate(scale):
            part = evidence.data.part(row, number)
            z[part.picked, row] = (part.tau - evidence.predicted(part, rest.theta)) / unit
        found += _of_motion(source, t, z**2, speed, evidence.joints)
    strongest = max((energy for energy, _ in found), default=0.0)
    return [contact for energy, contact in found if energy > WEAK * strongest]


def _quiet(rest: Evidence) -> list[float]:
    """Robust standard deviation of each joint's residual, from at most `LOOKED_AT` samples spread evenly."""
    every = [max(1, -(-n // LOOKED_AT)) for n in rest.counts.sum(axis=0).tolist()]
    left = [thinned(rest.residuals(row, rest.theta), k) for row, k in enumerate(every)]
    return [1.4826 * float(np.median(np.abs(x))) for x in left]


def _of_motion(
    source: str, t: Array, squares: Array, speed: Array, joints: Sequence[str]
) -> list[tuple[float, Contact]]:
    """Bursts of one motion with their energy; (N, J) squared robust units, speeds over their rms."""
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    smooth = ndimage.uniform_filter1d(squares, max(1, round(SMOOTH / step)), axis=0)
    total = smooth.max(axis=1)
    labels, count = ndimage.label(total > LOW)
    found = []
    for label in range(1, count + 1):
        where = np.flatnonzero(labels == label)
        if total[where].max() < HIGH:
            continue
        energy = squares[where]
        if float((energy * np.abs(speed[where])).sum()) < AT_REST * float(energy.sum()):
            continue  # dry friction where a joint stops or starts is anybody's guess, and no contact
        touched = [joints[j] for j in np.flatnonzero(smooth[where].max(axis=0) > LOW).tolist()]
        start, stop = float(t[where[0]]) - AROUND, float(t[where[-1]]) + AROUND
        strength = float(np.sqrt(total[where].max()))
        found.append((float(energy.sum()) * step, Contact(source, start, stop, touched, strength)))
    return found
