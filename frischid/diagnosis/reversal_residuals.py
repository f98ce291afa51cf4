"""Is a joint's error only where it reverses or stands still? There dry friction is undetermined.

At standstill dry friction takes any value between ±F; the value depends on how the joint came to a stop. A drive that
sticks for a hundredth of a second, or a controller that lets go a little early, shifts the jump of friction in time.
The error is then a spike at every reversal and zero in between. With e the residual, σ the sensor noise and s the speed
over its rms, all of the error is of this kind when

    Σ (e² − σ²) |s|  <  s₀ Σ (e² − σ²),      Σ (e² − σ²)  <  κ F² · (number of samples with |s| < s₀),

with s₀ = ``criteria.slow_speed`` and κ = ``criteria.reversal_energy_share``. The second condition limits the error to
about a third of F; a larger error has other causes. An error of this kind does not ask for an explanation, but an
effect that explains nearly all of the error is still named.

Source: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, "A survey of models, analysis tools and compensation methods
for the control of machines with friction", Automatica 30(7).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.residual_variables import speeds


def only_at_reversals(validator: CrossValidator, floor: Array, theta: Array | None = None) -> NDArray[np.bool_]:
    """Joints whose error above the sensor noise is only at reversals and standstill, and small beside dry friction.

    Parameters
    ----------
    validator : CrossValidator
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    theta : ndarray, shape (P,), optional
        Parameters of the model whose error it is; those of the fit by default.

    Returns
    -------
    ndarray of bool, shape (J,)
    """
    slow_speed, theta = validator.criteria.slow_speed, validator.theta if theta is None else theta
    energy, moving, slow = np.zeros((3, len(validator.joints)))
    for number, relative in enumerate(speeds(validator)):
        for row, noise in enumerate(floor):
            data = validator.data.of_motion(row, number)
            speed = np.abs(relative[data.picked, row])
            above = (data.tau - validator.columns.predicted(data, theta)) ** 2 - noise**2
            energy[row] += above.sum()
            moving[row] += above @ speed
            slow[row] += (speed < slow_speed).sum()
    dry = validator.data.cache.regressor.dry[list(validator.model.torque_index)]
    most = validator.criteria.reversal_energy_share * slow * dry**2
    return np.asarray((energy > 0) & (moving < slow_speed * energy) & (energy < most))
