"""Torques outside the catalogue of effects: for these the right verdict of a diagnosis is "unknown"."""

from __future__ import annotations

import numpy as np
from hidden_physics import STEP, Array, World, rms
from hidden_shapes import Hidden, Maker
from scipy.signal import lfilter


def other(rng: np.random.Generator, fit: World, j: int) -> int:
    """Another joint than j."""
    rest = [i for i in range(fit.path.q.shape[1]) if i != j]
    return int(rng.choice(rest))


def cable(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A cable that two joints stretch together."""
    i = other(rng, fit, j)
    a, b = fit.path.q[:, j].mean(), fit.path.q[:, i].mean()
    return Hidden(lambda w: w.on(j, (w.path.q[:, j] - a) * (w.path.q[:, i] - b)), (j,), f"cable with joint {i + 1}")


def teeth(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Sectors of a damaged gear: steps of random height and width over the angle."""
    lower, upper = fit.path.q[:, j].min(), fit.path.q[:, j].max()
    edges = np.sort(rng.uniform(lower, upper, int(rng.integers(6, 14))))
    heights = rng.normal(size=len(edges) + 1)
    return Hidden(lambda w: w.on(j, heights[np.searchsorted(edges, w.path.q[:, j])]), (j,), f"{len(edges)} steps")


def crosstalk(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Another joint's torque leaks into this joint's torque channel."""
    i = other(rng, fit, j)
    return Hidden(lambda w: w.on(j, w.base[:, i]), (j,), f"torque of joint {i + 1}")


def chirp(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A disturbance whose frequency rises with time."""
    low, high, phase = rng.uniform(0.1, 0.3), rng.uniform(0.8, 2.0), rng.uniform(0, 2 * np.pi)

    def torque(w: World) -> Array:
        t, T = w.path.t, w.path.t[-1]
        return w.on(j, np.sin(2 * np.pi * (low * t + (high - low) * t**2 / (2 * T)) + phase))

    return Hidden(torque, (j,), f"{low:.2g} to {high:.2g} Hz")


def random_walk(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A slowly varying random torque with a correlation time of about a second, different in every log."""
    seed, memory = int(rng.integers(2**31)), rng.uniform(0.4, 1.5)

    def torque(w: World) -> Array:
        kick = np.random.default_rng([seed, w.number]).normal(size=len(w.path.t))
        return w.on(j, smooth(smooth(kick, memory), 0.1 * memory))

    return Hidden(torque, (j,), f"memory {memory:.2g} s")


def product_rate(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Drag on a joint, proportional to its speed and to that of another joint."""
    i = other(rng, fit, j)
    speed = rms(fit.path.v)[i]
    return Hidden(
        lambda w: w.on(j, w.path.v[:, j] * np.abs(w.path.v[:, i]) / speed), (j,), f"speed of joint {i + 1} counts"
    )


def smooth(x: Array, memory: float) -> Array:
    """First-order low-pass with a time constant in seconds, of unit size for white noise."""
    pole = float(np.exp(-STEP / memory))
    return np.asarray(lfilter([np.sqrt(1 - pole**2)], [1, -pole], x))


UNKNOWN: dict[str, Maker] = {m.__name__: m for m in (cable, teeth, crosstalk, chirp, random_walk, product_rate)}
"""Makers of effects outside the catalogue."""
