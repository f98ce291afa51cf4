"""Noise of drives as slow as the motion: it goes on above the filter's band, where a missing effect does not.

The residual of a model holds missing effects and the drives' noise. Noise with a memory (first-order autoregressive,
memory 1 / (2π f₀)) is as slow as the motion, so no filter separates the two. But its spectrum is known,

    S(f) = W + L / (1 + (f/f₀)²),

and above the band of the motion, between reversals, there is nothing but noise. So the octaves there
(`frischid.model.noise_floor.octaves_above`) give W and L f₀², and the noise in the band 0 ... f_c is

    slow_j² = 2 h ∫ S_j df = 2 h (W_j f_c + L_j f₀ arctan(f_c/f₀)),

with h the step of the samples: the larger, the slower. An error of L is large at low frequencies. So L counts only
where the octaves' likelihood with it is higher than with white noise alone, by more than the price of a parameter for
each joint and motion, ½ log n (Schwarz 1978, Ann. Statist. 6(2)). All joints decide together, because drives of an arm
are alike: where one joint alone seems to have slow noise, its torque jumps for another reason.

The residual limits f₀, because a joint's residual contains its noise. With H the filter, and P_jo the power of the
residual in octave o of the band, noise of this spectrum has there

    E_jo = 2 h ∫_o |H|² S_j df,    x_jo = E_jo / P_jo.

A ratio x_jo above 1 is chance. P_jo is a sum of n_jo independent squares (`residual_spectrum`). So such noise costs the
log likelihood

    D = ½ Σ_{x_jo > 1} n_jo (log x_jo + 1/x_jo − 1).

A short log has few octaves that say something. So the noise may neither be correlated over a longer time than the most
correlated residual,

    T = S(0) / (2 ∫ S df) = 1 / (2 f₀ arctan(f_c/f₀))  ≤  max_j T_j.

One f₀ serves all joints, because the drives are alike. The slowest noise is taken whose D is as small as chance makes
it on average: 1/4 for each octave of each joint, because a share of 1 loses about ½ z², with z a standard normal
variable, and only where z > 0. Where the torque's noise is white, L is zero, and slow_j is the noise floor of white
noise.

Sources: Box, Jenkins, Reinsel and Ljung 2015, Time Series Analysis, section 3.2; Whittle 1953, Estimation and
information in stationary time series, Arkiv för Matematik 2 (the likelihood of a periodogram).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.residual_spectrum import ResidualSpectrum
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
    residuals = [ResidualSpectrum.of(full, row, cutoff) for row in range(len(full.joints))]
    samples = np.array([x.samples for x in usable])
    weights, step = samples / samples.sum(), float(samples @ [x.step for x in usable] / samples.sum())
    telling = sum(len(x.powers) for x in residuals)
    longest = step * full.model.lowpass.decimation(step) * full.fit.correlation.max()
    times = 1 / (2 * _CORNERS * np.arctan(cutoff / _CORNERS))
    white = [_white(x) for x in usable]
    for corner in _CORNERS[times <= longest].tolist() if telling else []:
        mean = np.tensordot(weights, _shares(usable, white, corner), 1)
        noise = [
            2 * step * x.integrated(spectra_of_noise(x.centres, corner, step) @ y)
            for x, y in zip(residuals, mean, strict=True)
        ]
        above = [np.minimum(x.powers / np.maximum(y, 1e-300), 1.0) for x, y in zip(residuals, noise, strict=True)]
        lost = sum(_cost(y, x.independent) for x, y in zip(residuals, above, strict=True))
        if lost <= telling / 4:
            return np.asarray(np.sqrt(2 * step * cutoff * (mean @ mean_in_band(corner, cutoff))))
    return np.zeros(len(full.joints))


def _white(octaves: Octaves) -> Array:
    """Shares of white noise alone in the octaves of a motion, (J, 2)."""
    powers = np.maximum(octaves.powers, 1e-300)
    alone = shares_of_noise(np.ones((len(powers), 1)), powers)
    return np.hstack([np.zeros_like(alone), alone])


def _shares(octaves: Sequence[Octaves], white: Sequence[Array], corner: float) -> Array:
    """Shares of noise with a memory and of white noise in the octaves of M motions, (M, J, 2).

    The noise has no memory where the memory does not pay for its parameters, one for each joint and motion: then the
    shares are those of `white`. A torque without any power in an octave, as one with coarse steps has, says nothing of
    a memory.
    """
    with_memory, gain = [], 0.0
    for x, alone in zip(octaves, white, strict=True):
        spectra = spectra_of_noise(x.centres, corner, x.step)
        both = shares_of_noise(spectra, np.maximum(x.powers, 1e-300))
        seen = (x.powers > 0).all(axis=0)
        P, n = x.powers[:, seen], x.independent[:, seen]
        without, cost = (_cost(P / (spectra @ y[seen].T), n) for y in (alone, both))
        gain += without - cost - 0.5 * float(np.log(np.maximum(n.sum(axis=0), 1.0)).sum())
        with_memory.append(both)
    return np.array(with_memory if gain > 0 else white)


def _cost(ratio: Array, independent: Array) -> float:
    """Log likelihood that powers lose which are the noise's times a ratio, against noise with these powers."""
    return float(0.5 * (independent * (ratio - 1 - np.log(ratio))).sum())
