"""Sensors that record a motion: rates, jitter, quantisation, noise, tachometers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from hidden_physics import STEP, Array, World
from hidden_unknown import smooth

from frischid.logs.log import Log


@dataclass(frozen=True)
class Sensors:
    """A robot's measuring equipment.

    Attributes
    ----------
    rate : float
        Hz.
    bits : int
        Resolution of the encoders for one turn of the joint, bits.
    torque : float
        Noise of the torque channel, share of its standard deviation.
    coloured : float
        Share of that noise with a memory of some milliseconds.
    channels : {"", "v", "va"}
        Measured derivatives.
    tachometer : float
        Bandwidth of the velocity channel, Hz.
    noise : float
        Noise of the velocity channel, share of its standard deviation; the acceleration channel has five times this
        share.
    jitter : float
        Irregularity of the sampling, share of a step; the time stamps contain most of it.
    """

    rate: float
    bits: int
    torque: float
    coloured: float
    channels: str
    tachometer: float
    noise: float
    jitter: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Sensors:
        """Draw sensors as real arms have them."""
        return cls(
            float(rng.choice([100.0, 125.0, 200.0, 250.0, 500.0, 1000.0])),
            int(rng.integers(17, 21)),
            float(np.exp(rng.uniform(np.log(0.003), np.log(0.02)))),
            float(rng.uniform(0.1, 0.5)),
            str(rng.choice(["", "v", "va"], p=[0.5, 0.35, 0.15])),
            float(rng.uniform(40.0, 120.0)),
            float(rng.uniform(0.002, 0.01)),
            float(rng.uniform(0.05, 0.2)) if rng.random() < 0.25 else 0.0,
        )


def record(
    world: World,
    torque: Array,
    scale: Array,
    sensors: Sensors,
    rng: np.random.Generator,
    extra: Mapping[str, Array],
    name: str,
) -> Log:
    """Record a world as a log.

    Parameters
    ----------
    world : World
    torque : ndarray, shape (N, J)
        Whole torque, hidden effects included.
    scale : ndarray, shape (J,)
        Standard deviation of the torque, of which the torque noise is a share, N·m.
    sensors : Sensors
    rng : numpy.random.Generator
    extra : mapping of str to ndarray, shape (N,)
        Further channels.
    name : str
        Name of the log.
    """
    step = 1 / sensors.rate
    nominal = np.arange(1, int((world.path.t[-1] - 2 * step) * sensors.rate)) * step
    shift = sensors.jitter * step * rng.uniform(-1, 1, len(nominal))
    when, stamps = nominal + shift, nominal + 0.9 * shift

    def sampled(x: Array) -> Array:
        return np.stack([np.interp(when, world.path.t, column) for column in x.T], axis=1)

    quantum = 2 * np.pi / 2**sensors.bits
    q = sampled(world.path.q)
    q = quantum * np.round((q + 0.3 * quantum * rng.normal(size=q.shape)) / quantum)
    shape = q.shape
    white = rng.normal(size=shape)
    memory = 0.01
    # The coloured part is computed at the log's own samples, so its time constant is scaled to their step.
    coloured = np.stack([smooth(x, memory * STEP / step) for x in rng.normal(size=shape).T], axis=1)
    share = sensors.coloured
    tau = sampled(torque) + sensors.torque * scale * (np.sqrt(1 - share**2) * white + share * coloured)
    v, a = (
        sampled(_lagged(x, sensors.tachometer)) + level * x.std(axis=0) * rng.normal(size=shape)
        for x, level in ((world.path.v, sensors.noise), (world.path.a, 5 * sensors.noise))
    )
    return Log(
        stamps,
        world.robot.joints,
        q,
        v=v if "v" in sensors.channels else None,
        a=a if "a" in sensors.channels else None,
        tau=tau,
        extra={n: np.interp(when, world.path.t, x) for n, x in extra.items()},
        source=name,
    )


def _lagged(x: Array, bandwidth: float) -> Array:
    """First-order lag of a tachometer."""
    pole = np.exp(-2 * np.pi * bandwidth * STEP)
    unit = np.sqrt(1 - pole**2) / (1 - pole)
    return np.stack([smooth(c - c[0], 1 / (2 * np.pi * bandwidth)) / unit + c[0] for c in x.T], axis=1)
