"""Contacts: an outside force for a while, an event to be kept out, not an effect to be added.

A contact leaves residuals that are large on some stretch of a few tenths of a second to a few seconds, in a log that is
otherwise explained. The residual's energy, smoothed over a quarter of a second and measured in robust units
(median absolute deviation) of each joint, is compared with what the rest of the log shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from frischid.evidence import Evidence
from frischid.gram import Array

SMOOTH = 0.25  # s
HIGH, LOW = 30.0, 6.0  # squared robust units, summed over joints, at which a burst is seen and where it ends
LONGEST = 0.15  # of a log may be bursts; more is not an event
SHARE = 0.6  # of the squared residual must lie in the bursts


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


def find_contacts(evidence: Evidence, floor: Array) -> list[Contact]:
    """Bursts of residual that no steady effect would leave.

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
    residuals = [r for _, r in evidence.residuals()]
    scale = np.array([max(1.4826 * float(np.median(np.abs(r))), f) for r, f in zip(residuals, floor, strict=True)])
    inside = energy = 0.0
    offsets = np.zeros(len(residuals), int)
    spans = 0.0
    length = 0.0
    for number, (motion, t) in enumerate(zip(evidence.motions, evidence.times, strict=True)):
        z = np.zeros((len(t), len(residuals)))
        for row, rows in enumerate(evidence.rows):
            keep = rows.picked[number]
            z[keep, row] = residuals[row][offsets[row] : offsets[row] + len(keep)] / scale[row]
            offsets[row] += len(keep)
        step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        smooth = ndimage.uniform_filter1d(z**2, max(1, round(SMOOTH / step)), axis=0)
        total = smooth.max(axis=1)
        labels, count = ndimage.label(total > LOW)
        energy += float((z**2).sum())
        length += len(t)
        for label in range(1, count + 1):
            where = np.flatnonzero(labels == label)
            if total[where].max() < HIGH or t[where[-1]] - t[where[0]] < SMOOTH:
                continue
            inside += float((z[where] ** 2).sum())
            spans += len(where)
            joints = [evidence.joints[j] for j in np.flatnonzero(smooth[where].max(axis=0) > LOW)]
            strength = float(np.sqrt(total[where].max()))
            found.append(Contact(motion.source, float(t[where[0]]), float(t[where[-1]]), joints, strength))
    if not found or spans > LONGEST * length or inside < SHARE * energy or len(found) > 3 * len(evidence.times):
        return []
    return found
