"""The spectrum of a joint's residual within the filter's band, octave by octave.

The N rows of a joint in a motion of n filtered samples, h apart, have the periodogram, with zero where there is no row,

    P_k = 2 |Σ_i r_i e^{−2πi k i/n}|² / (n N),    f_k = k / (n h),    k = 1 ... n/2,

whose sum is the variance of the residual. For noise that is nearly stationary, each P_k is the sum of two independent
squares, and of 2 N / n where there are fewer rows than samples.

Source: Percival and Walden 1993, Spectral Analysis for Physical Applications, chapter 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.logs.filters import LowPass

_CELLS = 8  # in an octave: the spectra of noise are nearly constant over a cell
_FILTER_LENGTHS = 8  # lengths of the filter, so that interpolation between frequencies is exact enough


@dataclass(frozen=True, eq=False)
class ResidualSpectrum:
    """Power of the residual in O octaves below the filter's cut-off, those that say something of noise."""

    centres: Array
    """Middles of C cells of these octaves, Hz, (O, C)."""
    passed: Array
    """Integral of the filter's |H|² over each cell, Hz, (O, C)."""
    powers: Array
    """Variance of the residual in each octave, as without the fit, (N·m)² (N²), (O,)."""
    independent: Array
    """Number of independent squares in each octave that the fit has left, (O,)."""

    @classmethod
    def of(cls, full: CrossValidator, row: int, cutoff: float) -> ResidualSpectrum:
        """The spectrum of the residual of joint ``row``, over all motions, below a cut-off in Hz.

        A fit follows the slowest part of the noise. So as many squares say nothing as the rows determine parameters,
        and an octave of which some are left has the power of these.
        """
        lowpass = full.model.lowpass
        joints = list(full.data.motions_of(row))
        longest = max(x.motion.step * x.motion.raw for x in joints)
        octaves = max(1, int(np.ceil(np.log2(max(4 * cutoff * longest, 2.0)))))
        sums, rows = np.zeros((3, octaves * _CELLS)), sum(map(len, joints))
        for joint, residual in zip(joints, full.residuals(row, full.theta), strict=True):
            step, samples = joint.motion.step, joint.motion.t.shape[0]
            if not len(residual) or not np.isfinite(step):
                continue
            apart = step * lowpass.decimation(step)
            filled = np.zeros(fft.next_fast_len(samples, real=True))
            filled[joint.picked] = residual
            f = np.arange(1, len(filled) // 2 + 1) / (len(filled) * apart)
            cell = (_CELLS * np.log2(cutoff / f)).astype(int)
            below = f <= cutoff
            parts = (
                2 * np.abs(np.fft.rfft(filled)[1:]) ** 2 / len(filled),
                len(residual) * _passed(lowpass, step, f) / (len(filled) * apart),
                np.full(len(f), 2 * len(residual) / len(filled)),
            )
            sums += [np.bincount(cell[below], x[below], minlength=sums.shape[1]) for x in parts]
        power, passed, squares = sums.reshape(3, octaves, _CELLS)
        power, passed = power / max(rows, 1), passed / max(rows, 1)
        found = squares.sum(axis=1)
        slower = np.append(np.cumsum(found[::-1])[::-1], 0.0)
        left = np.clip(slower[:-1] - full.fit.determined[row], 0.0, found)
        says = left > 0
        middles = cutoff * 2.0 ** (-(np.arange(octaves * _CELLS) + 0.5) / _CELLS).reshape(octaves, _CELLS)
        unfitted = np.divide(found, left, out=np.ones(octaves), where=says)
        total = np.maximum(power.sum(axis=1) * unfitted, 1e-300)
        return cls(middles[says], passed[says], total[says], left[says])

    def integrated(self, spectrum: Array) -> Array:
        """Variance in each octave, (O,), of noise that the filter passes and whose power for each Hz is (O, C)."""
        return np.asarray((spectrum * self.passed).sum(axis=1))


def _passed(lowpass: LowPass, step: float, f: Array) -> Array:
    """|H|² of the filter at some frequencies, Hz: interpolated, because the filter has few taps beside a motion."""
    taps = lowpass.taps(step)
    size = fft.next_fast_len(_FILTER_LENGTHS * len(taps), real=True)
    response = np.abs(np.fft.rfft(taps, size)) ** 2
    return np.asarray(np.interp(f, np.arange(len(response)) / (size * step), response))
