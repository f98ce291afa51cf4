"""The cut-off of the parallel filter, chosen from the spectra of the logs.

Every joint's *bandwidth* B holds 99 % of the power of its velocity,

    ∫_0^B f² S_q(f) df = 0.99 ∫_0^∞ f² S_q(f) df,

as the spectrum S_q of its position shows it above ten times its own noise floor (the median of the upper third). The
cut-off is ten times the median bandwidth: dry friction is a square wave of the velocity's frequency, and the first
harmonics of that wave carry the information. Where the torque's spectrum sinks to ten times its noise floor earlier,
the cut-off is there, but never below four bandwidths.

Source of the spectra: P. Welch, IEEE Trans. Audio and Electroacoustics 15(2), 1967.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import signal

from frischid.core.types import Array
from frischid.logs.filters import LowPass
from frischid.logs.log import STANDSTILL_SPAN, Log
from frischid.logs.time_grid import uniform


def choose_lowpass(logs: Sequence[Log], joints: Sequence[str]) -> LowPass:
    """Choose the cut-off from the spectra of the logs, as the module says.

    Parameters
    ----------
    logs : sequence of Log
    joints : sequence of str
        Joints whose torque is fitted.

    Returns
    -------
    LowPass
    """
    bands = Bandwidths()
    for log in logs:
        bands.add(log, joints)
    return bands.lowpass()


class Bandwidths:
    """Bandwidths of the motion and of the torque above its noise, gathered log by log; see `choose_lowpass`."""

    def __init__(self) -> None:
        self.bands: list[float] = []
        self.clear: list[float] = []
        self.rate = np.inf

    def add(self, log: Log, joints: Sequence[str]) -> None:
        """Take in one log, or one chunk of a recording; `joints` are those whose torque is fitted."""
        chosen = log.select(joints)
        self.rate = min(self.rate, log.rate)
        t, q, tau = uniform(log.t, chosen.q, np.full_like(chosen.q, np.nan) if chosen.tau is None else chosen.tau)
        step = (t[-1] - t[0]) / (len(t) - 1)
        f, power, floor = _spectrum(q, step)
        velocity = np.where(power > 10 * floor, power - floor, 0.0) * (f**2)[:, None]
        share = np.cumsum(velocity, axis=0) / np.maximum(velocity.sum(axis=0), 1e-300)
        moving = (np.ptp(q, axis=0) > STANDSTILL_SPAN) & velocity.any(axis=0)
        edge = f[np.minimum((share < 0.99).sum(axis=0), len(f) - 1)]
        self.bands += edge[moving].tolist()
        f, power, floor = _spectrum(np.nan_to_num(tau), step)
        # below the motion's bandwidth the torque's spectrum may have holes, above it noise
        noisy = (power < 10 * floor) & (f[:, None] > edge)
        self.clear += [float(f[noisy[:, j].argmax()]) for j in np.flatnonzero(moving & noisy[1:].any(axis=0))]

    def lowpass(self) -> LowPass:
        """Filter for all logs that were taken in."""
        if not self.bands:
            return LowPass(None, "no joint's motion stands out of its noise")
        band = float(np.median(self.bands))
        sinks = float(np.median(self.clear)) if self.clear else np.inf
        cutoff = float(f"{min(max(4 * band, min(10 * band, sinks)), 0.2 * self.rate):.2g}")
        if cutoff < 9.5 * band:
            return LowPass(cutoff, f"chosen where the torque nears its noise; the motion's bandwidth is {band:.2g} Hz")
        return LowPass(cutoff, f"chosen as ten times the motion's bandwidth of {band:.2g} Hz")


def _spectrum(x: Array, step: float) -> tuple[Array, Array, Array]:
    """Frequencies, power spectral density and its floor per column."""
    f, power = signal.welch(x, 1 / step, nperseg=min(len(x), round(8 / step)), detrend="linear", axis=0)
    return f, power, np.median(power[2 * len(f) // 3 :], axis=0)
