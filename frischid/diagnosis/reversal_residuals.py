"""Is a joint's error only where it reverses or stands still? There dry friction is undetermined.

At standstill dry friction takes any value between ±F; the value depends on how the joint came to a stop. A drive that
sticks for a hundredth of a second, or a controller that lets go a little early, shifts the jump of friction in time.
The error is then a spike at every reversal and zero in between. With e the residual, σ the sensor noise and s the speed
over its rms, all of the error is of this kind when

    Σ (e² − σ²) |s|  <  s₀ Σ (e² − σ²),      Σ (e² − σ²)  <  κ F² · (number of samples with |s| < s₀),

with s₀ = ``criteria.slow_speed`` and κ = ``criteria.reversal_energy_share``. The second condition limits the error to
about a third of F; a larger error has other causes. An error of this kind does not ask for an explanation, but an
effect that explains nearly all of the error is still named.

Such an effect must be there in motion too, as far as it acts there. A delay shifts the whole torque, while a late jump
of dry friction is at reversals only. With δ the torque by which the effect changes the prediction, the samples with
|s| ≥ s₀ all along the filter's length show the share

    r = Σ e δ / Σ δ²

of the effect. Its standard error follows from the sums over blocks of time. Where r is surely below one half, the
effect is not there in motion.

Source: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, "A survey of models, analysis tools and compensation methods
for the control of machines with friction", Automatica 30(7).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.residual_variables import speeds
from frischid.logs.filters import LowPass


def only_at_reversals(validator: CrossValidator, floor: Array, theta: Array | None = None) -> NDArray[np.bool_]:
    """Joints whose error above the sensor noise is only at reversals and standstill, and small beside dry friction.

    Parameters
    ----------
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
            above = validator.columns.residual(data, theta) ** 2 - noise**2
            energy[row] += above.sum()
            moving[row] += above @ speed
            slow[row] += (speed < slow_speed).sum()
    dry = validator.data.cache.regressor.dry[list(validator.model.torque_index)]
    most = validator.criteria.reversal_energy_share * slow * dry**2
    return np.asarray((energy > 0) & (moving < slow_speed * energy) & (energy < most))


def filtered_width(lowpass: LowPass, step: float) -> int:
    """Filtered samples, an odd number, within the length of a filter whose own samples are `step` seconds apart.

    Examples
    --------
    >>> from frischid.diagnosis.reversal_residuals import filtered_width
    >>> from frischid.logs.filters import LowPass
    >>> len(LowPass(5.0).taps(0.01)), LowPass(5.0).decimation(0.01), filtered_width(LowPass(5.0), 0.01)
    (75, 6, 15)
    """
    return 2 * -(-(len(lowpass.taps(step)) // 2) // lowpass.decimation(step)) + 1


def absent_in_motion(validator: CrossValidator, effect: Candidate, rows: Sequence[int]) -> bool:
    """Whether joints in motion show less than half of an effect that acts there too.

    Parameters
    ----------
    validator : CrossValidator
        Fit without the effect.
    effect : Candidate
        The effect at all its places.
    rows : sequence of int
        Joints by their position among the fitted ones.
    """
    criteria, wider = validator.criteria, validator.extended(effect)
    found: list[Array] = []
    for number, (t, relative) in enumerate(zip(validator.data.times, speeds(validator), strict=True)):
        width = filtered_width(validator.model.lowpass, validator.data.cache.motions[number].step)
        slowest = ndimage.minimum_filter1d(np.abs(relative), width, axis=0)
        block = ((t - t[:1]) // criteria.block_seconds).astype(int)
        sums = np.zeros((block.max(initial=-1) + 1, 2))
        for row in rows:
            data = validator.data.of_motion(row, number)
            before = validator.columns.predicted(data, validator.theta)
            error, change = data.tau - before, wider.columns.predicted(data, wider.theta) - before
            moving = slowest[data.picked, row] >= criteria.slow_speed
            products = np.column_stack([error * change, change**2])[moving] / validator.spread[row] ** 2
            np.add.at(sums, block[data.picked][moving], products)
        found.append(sums[sums[:, 1] > 0])
    product, square = np.concatenate(found).T
    if len(square) < 2:
        return False
    share = product.sum() / square.sum()
    doubt = np.sqrt(((product - share * square) ** 2).sum() * len(square) / (len(square) - 1)) / square.sum()
    reach = -special.stdtrit(len(square) - 1, criteria.block_p_value)
    return bool(share + reach * doubt < criteria.half_explained)
