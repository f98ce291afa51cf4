"""Noise of drives as slow as the motion: it goes on above the filter's band, where a missing effect does not.

The residual of a model holds missing effects and the drives' noise. Noise with a memory (first-order autoregressive,
memory 1 / (2π f₀)) is as slow as the motion, so no filter separates the two. But its spectrum is known,

    S(f) = W + L / (1 + (f/f₀)²),

and above the band of the motion, between reversals, there is nothing but noise. So the octaves there
(`frischid.model.noise_floor.octaves_above`) give W and L f₀², and the noise in the band 0 ... f_c is

    slow_j² = 2 h ∫ S_j df = 2 h (W_j f_c + L_j f₀ arctan(f_c/f₀)),

with h the step of the samples: the larger, the slower. The residual limits f₀ in two ways. A joint's residual
contains its noise. So the variance σ_j² of the residual, from n_j independent samples beyond the fitted parameters, is
below slow_j² only by chance. Drives of an arm are alike, so one f₀ serves all joints. Such noise costs the residuals of
all joints the log likelihood, with x_j = slow_j² / σ_j²,

    D = ½ Σ_{x_j > 1} n_j (log x_j + 1/x_j − 1),

and may be as large as chance makes D on average, J/4: a joint that misses nothing loses about ½ z², with z a standard
normal variable, and only where z > 0. And the noise cannot be correlated over a longer time than the most correlated
residual is,

    T = S(0) / (2 ∫ S df) = 1 / (2 f₀ arctan(f_c/f₀))  ≤  max_j T_j.

The slowest noise within both limits is taken. Where the torque's noise is white, L is zero, and slow_j is the noise
floor of white noise.

Source: Box, Jenkins, Reinsel and Ljung 2015, Time Series Analysis, section 3.2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.model.noise_floor import Octaves, mean_in_band, shares_of_noise, spectra_of_noise

_LEAST_OCTAVES = 2  # one cannot tell noise with a memory from white noise
_CORNERS = np.geomspace(0.05, 50.0, 60)  # Hz, slow first


def slow_noise(octaves: Sequence[Octaves], full: CrossValidator) -> Array:
    """Noise of each joint's torque within the filter's band, as slow as the residual says, N·m (N), (J,).

    Parameters
    ----------
    octaves : sequence of Octaves
        Of the motions.
    full : CrossValidator
        Of the model with all effects that entered: its residual is noise, as far as that is known.

    Returns
    -------
    ndarray, shape (J,)
        Zero where nothing is filtered, or where the samples show too few octaves above the band.
    """
    cutoff = full.model.lowpass.cutoff
    usable = [x for x in octaves if len(x.centres) >= _LEAST_OCTAVES]
    if cutoff is None or not usable:
        return np.zeros(len(full.joints))
    step = float(np.mean([x.step * full.model.lowpass.decimation(x.step) for x in usable]))
    times = 1 / (2 * _CORNERS * np.arctan(cutoff / _CORNERS))
    share = np.array([x.samples for x in usable]) / sum(x.samples for x in usable)
    for corner in _CORNERS[times <= step * full.fit.correlation.max()]:
        squares = share @ np.array([_in_band(x, float(corner), cutoff) for x in usable])
        if _lost(full, squares) <= len(squares) / 4:
            return np.asarray(np.sqrt(squares))
    return np.zeros(len(full.joints))


def _lost(full: CrossValidator, squares: Array) -> float:
    """Log likelihood that the residuals of all joints lose if noise of these variances, (J,), is in them."""
    independent = np.maximum(full.effective - full.fit.determined, 1.0)
    variance = full.fit.sigma**2 * full.effective / independent
    ratio = np.maximum(squares / np.maximum(variance, 1e-300), 1.0)
    return float(0.5 * independent @ (np.log(ratio) + 1 / ratio - 1))


def _in_band(octaves: Octaves, corner: float, cutoff: float) -> Array:
    """Variance of each joint's noise below the cut-off, (J,)."""
    shares = shares_of_noise(
        spectra_of_noise(octaves.centres, corner, octaves.step), np.maximum(octaves.powers, 1e-300)
    )
    return np.asarray(2 * octaves.step * cutoff * (shares @ mean_in_band(corner, cutoff)))
