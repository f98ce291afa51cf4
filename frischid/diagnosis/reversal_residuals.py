"""Where a joint turns or rests, dry friction is anybody's guess.

It then takes any value between ±F, according to how the joint came to a stop; a drive that sticks for a hundredth of a
second, or a controller that lets go a little early, moves its jump in time. Such an error is a spike at every reversal
and nothing in between. With e what is left of the torque, σ the sensors' noise and s the speed over its rms, it is all
there when

    Σ (e² − σ²) |s|  <  0.2 Σ (e² − σ²),      Σ (e² − σ²)  <  0.1 F² · (number of samples with |s| < 0.2).

The second keeps it small: wrong by a third of itself, dry friction has other causes. Such an error is not called
missing, unless an effect is found that explains most of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import Evidence

AT_REST = 0.2  # of a joint's rms speed, averaged over the energy of what is left
PART = 0.1  # of dry friction's own energy while the joint is so slow


def at_rest(evidence: Evidence, floor: Array) -> NDArray[np.bool_]:
    """Joints of which nothing is left above the noise but where they turn or rest.

    Parameters
    ----------
    evidence : Evidence
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).

    Returns
    -------
    ndarray of bool, shape (J,)
    """
    energy, moving, slow = np.zeros((3, len(evidence.joints)))
    for number, speeds in enumerate(evidence.speeds()):
        for row, noise in enumerate(floor):
            part = evidence.data.part(row, number)
            speed = np.abs(speeds[part.picked, row])
            left = (part.tau - evidence.predicted(part, evidence.theta)) ** 2 - noise**2
            energy[row] += left.sum()
            moving[row] += left @ speed
            slow[row] += (speed < AT_REST).sum()
    most = PART * slow * evidence.data.regressor.dry[list(evidence.model.torque_index)] ** 2
    return np.asarray((energy > 0) & (moving < AT_REST * energy) & (energy < most))
