"""The cut-off of the parallel filter, chosen from the spectra of the logs.

**Motion.** A joint's *bandwidth* B holds 99 % of the power of its velocity,

    ∫_0^B f² S_q(f) df = 0.99 ∫_0^F f² S_q(f) df,

where F is the frequency at which the spectrum S_q of its position sinks to ten times its noise floor S_0 for an octave.
Above F there is no motion: held samples, quantisation and irregular stamps raise single lines there. Dry friction is a
square wave of the velocity's frequency, and the first harmonics of that wave carry the information: the cut-off is ten
times the median bandwidth, unless noise begins earlier.

**Position noise.** Two derivatives raise the floor S_0 with the fourth power of the frequency. Up to the cut-off f it
makes this share of the acceleration's power P:

    (1/P) ∫_0^f (2πx)⁴ S_0 dx = (2π)⁴ S_0 f⁵ / (5 P).

Such noise is in the columns of the regressor, where it biases the parameters. The cut-off is where the share reaches
`ACCELERATION_NOISE`.

**Torque noise.** Where the spectrum of the torque sinks to ten times its own floor, more bandwidth adds noise only.

The lowest of the three counts, but no less than four bandwidths: a narrower filter blurs the motion itself.

Source of the spectra: P. Welch, IEEE Trans. Audio and Electroacoustics 15(2), 1967.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from frischid.core.remembered import Remembered
from frischid.core.types import Array
from frischid.logs.filters import LowPass, power_spectrum
from frischid.logs.log import FEWEST_SAMPLES, STANDSTILL_SPAN, Log
from frischid.logs.poses import is_static
from frischid.logs.preprocessing import Motion
from frischid.logs.time_grid import retimed, uniform
from frischid.logs.wraps import unwrapped

HARMONICS = 10.0
"""Cut-off over bandwidth where no noise begins earlier: the fifth harmonic of a square wave, and its filter's slope."""
LEAST_HARMONICS = 4.0
"""Cut-off over bandwidth whatever the noise: below, the filter blurs the motion and the torque of dry friction."""
ABOVE_FLOOR = 10.0
"""A spectrum stands out of its noise floor by more than this factor of power."""
BAND_POWER = 0.99
"""Share of the velocity's power within the bandwidth."""
ACCELERATION_NOISE = 0.005**2
"""Most position noise in the filtered acceleration, share of power: one part in two hundred of its rms.

Experiment: `benchmarks/cutoff.py`, ten kinds of simulated logs. Error of the identified model over that at the best
cut-off, geometric mean and worst: 1.18 and 1.7; without this limit 1.85 and 18. The frequency follows its fifth root.
"""
CUTOFF_AT_REST = 5.0
"""Hz. Cut-off of a model whose logs hold no motion: a few times the bandwidth of ordinary arms (see the six robots)."""
MOST_OF_RATE = 0.2
"""Highest cut-off, share of the sampling rate."""


class JointSpectrum(NamedTuple):
    """Figures from the spectra of one joint's position and torque."""

    band: float
    """Bandwidth of the motion, Hz."""
    noise: float
    """``S_0 / 5 ∫ f⁴ S_q df``: share of the acceleration's power that is position noise, at a cut-off of 1 Hz. Zero
    where the log holds a measured acceleration."""
    clear: float
    """Frequency at which the torque nears its noise floor, Hz; NaN: nowhere."""


@dataclass(frozen=True)
class LogSpectra:
    """Spectra of some logs, joint by joint; those of several logs add."""

    joints: tuple[JointSpectrum, ...] = ()
    """Of every joint of every log that moves."""
    rate: float = np.inf
    """Lowest sampling rate, Hz."""
    at_rest: bool = False
    """Whether the arm stands still in one of the logs."""

    def __add__(self, other: LogSpectra) -> LogSpectra:
        at_rest = self.at_rest or other.at_rest
        return LogSpectra((*self.joints, *other.joints), min(self.rate, other.rate), at_rest)

    def noise_share(self, cutoff: float | None) -> float:
        """Share of the filtered acceleration's power that is position noise, 0 to 1, median joint.

        Parameters
        ----------
        cutoff : float or None
            Hz; None: nothing is filtered.
        """
        if not self.joints:
            return 0.0
        noise = self._median("noise") * min(cutoff or np.inf, 0.5 * self.rate) ** 5
        return float(noise / (1.0 + noise))

    def lowpass(self) -> LowPass:
        """Filter for all these logs, as the module says."""
        if not self.joints:
            if not self.at_rest:
                return LowPass(None, "no joint's motion stands out of its noise")
            cutoff = min(CUTOFF_AT_REST, MOST_OF_RATE * self.rate)
            return LowPass(float(f"{cutoff:.2g}"), "usual for arms; these logs hold no motion that tells more")
        band = self._median("band")
        wanted = {
            "ten times the motion's bandwidth": HARMONICS * band,
            "where the noise of the positions reaches the acceleration": self._noise_begins,
            "where the torque nears its noise": self._median("clear"),
        }
        reason = min(wanted, key=lambda name: wanted[name])
        cutoff = min(max(wanted[reason], LEAST_HARMONICS * band), MOST_OF_RATE * self.rate)
        return LowPass(float(f"{cutoff:.2g}"), f"chosen {reason}; the motion's bandwidth is {band:.2g} Hz")

    @property
    def clean_cutoff(self) -> float:
        """The highest cut-off, Hz, that the noise of the positions allows; infinite without motion."""
        return max(self._noise_begins, LEAST_HARMONICS * self._median("band"))

    @property
    def _noise_begins(self) -> float:
        """Cut-off, Hz, at which the noise of the positions reaches the acceleration."""
        return float((ACCELERATION_NOISE / max(self._median("noise"), 1e-300)) ** 0.2)

    def _median(self, name: str) -> float:
        values = np.array([getattr(joint, name) for joint in self.joints])
        known = values[~np.isnan(values)]
        return float(np.median(known)) if len(known) else np.inf


SPECTRUM_WINDOW = 8.0
"""s. Length of the pieces of a log whose spectra are averaged; stamps that are farther apart belong to no piece."""
LEAST_WINDOW = 8  # samples of one spectrum: fewer show no frequency; stamps in another unit leave fewer in 8 s
_SPECTRA = Remembered[LogSpectra]()  # of logs, by joints


def choose_lowpass(logs: Sequence[Log], joints: Sequence[str]) -> LowPass:
    """Choose the cut-off from the spectra of the logs, as the module says.

    Parameters
    ----------
    joints : sequence of str
        Joints whose torque is fitted.
    """
    return sum((spectra_of(log, joints) for log in logs), LogSpectra()).lowpass()


def clean_cutoff(motions: Iterable[Motion]) -> float:
    """Frequency, Hz, up to which the positions of motions show motion and hardly any noise; infinite without motion."""
    return sum((_spectra_of_motion(motion) for motion in motions), LogSpectra()).clean_cutoff


def _spectra_of_motion(motion: Motion) -> LogSpectra:
    joints = tuple(str(j) for j in range(motion.q.shape[1]))
    measured = np.zeros(len(joints), bool) if motion.measured is None else motion.measured[1]
    log = Log(motion.t, joints, motion.q, a=np.where(measured, motion.a, np.nan) if measured.any() else None)
    return LogSpectra(tuple(_of_stretch(log)), 1.0 / motion.step)


def spectra_of(log: Log, joints: Sequence[str]) -> LogSpectra:
    """Spectra of one log, or of one chunk of a recording.

    Parameters
    ----------
    joints : sequence of str
        Joints whose torque is fitted.
    """
    return _SPECTRA.of(log, tuple(joints), lambda: _spectra_of(log, joints))


def _spectra_of(log: Log, joints: Sequence[str]) -> LogSpectra:
    if is_static(log):
        return LogSpectra((), log.rate, at_rest=True)
    chosen = retimed(unwrapped(log)).select(joints)
    found = [_of_stretch(stretch) for stretch in _stretches(chosen)]
    return LogSpectra(tuple(joint for joints_there in found for joint in joints_there), log.rate)


def _stretches(log: Log) -> list[Log]:
    """The log without the gaps that no window bridges: its stretches of at least a window, or else the longest one."""
    steps = np.diff(log.t)
    window = max(SPECTRUM_WINDOW, LEAST_WINDOW * float(np.median(steps)))
    edges = [0, *(np.flatnonzero(steps > window) + 1).tolist(), len(log)]
    if len(edges) == 2:
        return [log]
    parts = sorted(pairwise(edges), key=lambda part: float(log.t[part[1] - 1] - log.t[part[0]]), reverse=True)
    parts = [(a, b) for a, b in parts if b - a >= FEWEST_SAMPLES]
    long = [(a, b) for a, b in parts if log.t[b - 1] - log.t[a] >= window]
    return [log.slice(a, b) for a, b in sorted(long or parts[:1])]


def _of_stretch(chosen: Log) -> list[JointSpectrum]:
    """Spectra of a stretch without long gaps, of every joint that moves there."""
    t, q, tau = uniform(chosen.t, chosen.q, np.full_like(chosen.q, np.nan) if chosen.tau is None else chosen.tau)
    step = (t[-1] - t[0]) / (len(t) - 1)
    f, power, floor = _spectrum(q, step)
    _, torque, torque_floor = _spectrum(np.nan_to_num(tau), step)
    moves, measured = np.ptp(q, axis=0) > STANDSTILL_SPAN, chosen.has("a")
    found = []
    for j in np.flatnonzero(moves):
        motion = _motion_spectrum(f, power[:, j], floor[j])
        velocity = motion * f**2
        if not velocity.any():
            continue
        share = np.cumsum(velocity) / velocity.sum()
        band = float(f[min((share < BAND_POWER).sum(), len(f) - 1)])
        noise = 0.0 if measured[j] else floor[j] / (5 * (velocity * f**2).sum() * f[1])
        # below the motion's bandwidth the torque's spectrum may have holes, above it noise
        noisy = (torque[:, j] < ABOVE_FLOOR * torque_floor[j]) & (f > band)
        found.append(JointSpectrum(band, float(noise), float(f[noisy.argmax()]) if noisy.any() else np.nan))
    return found


def _motion_spectrum(f: Array, power: Array, floor: float) -> Array:
    """Spectrum of the motion alone: from its strongest line up to where an octave sinks to the floor."""
    loud = power > ABOVE_FLOOR * floor
    strongest = int((power * (f > 0)).argmax())
    ends = (
        k for k in range(strongest, len(f)) if np.median(loud[k : np.searchsorted(f, 2 * f[k], side="right")]) < 0.5
    )
    return np.where(loud & (np.arange(len(f)) < next(ends, len(f))), power - floor, 0.0)


def _spectrum(x: Array, step: float) -> tuple[Array, Array, Array]:
    """Frequencies, power spectral density and its floor per column."""
    f, power = power_spectrum(x, step, min(len(x), max(round(SPECTRUM_WINDOW / step), LEAST_WINDOW)))
    return f, power, np.median(power[2 * len(f) // 3 :], axis=0)
