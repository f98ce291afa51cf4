"""Filtered states with the covariance of their errors, and the columns as a function of the state.

Errors-in-variables estimates move the states themselves. The error of a filtered state is a sum of the sensors' errors,
each through the taps of `frischid.estimators.sensor_noise` and through the parallel low-pass.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.estimators.errors_in_variables import Samples
from frischid.estimators.sensor_noise import MOTION_CHANNELS, Sensor, noise_levels, sensors_of
from frischid.estimators.sensorwise import TORQUE
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.block import Block
from frischid.regression.block import Samples as MotionSamples
from frischid.regression.regressor import Regressor

STRETCH_SAMPLES = 256
"""Filtered samples that are corrected at once."""


def samples(
    regressor: Regressor,
    motions: Iterable[Motion],
    lowpass: LowPass,
    joints: Sequence[str],
    base: Sequence[int],
    *,
    sigma: Mapping[str, float] | None = None,
) -> Iterator[Samples]:
    """Filtered samples of motions with the errors of their states, for `frischid.estimators.errors_in_variables`.

    Parameters
    ----------
    motions : iterable of Motion
        Read twice; one motion at a time is in memory.
    joints : sequence of str
        Joints whose torque rows are used.
    base : sequence of int
        Columns of the base parameters.
    sigma : mapping of str to float
        Standard deviations of unfiltered errors by sensor name (``"q joint1"``, ``"torque joint1"``), or by channel
        (``"q"``, ``"v"``, ``"a"``, ``"torque"``) for all joints; others are estimated by `noise_levels`.

    Returns
    -------
    iterator of Samples
        Of stretches of `STRETCH_SAMPLES` filtered samples or a few more, their states [q v a t c] with the further
        channels c that effects read.
    """
    robot = regressor.robot
    levels = noise_levels(motions, robot, lowpass)
    for name in sigma or {}:
        if name not in levels and name not in {known.split()[0] for known in levels}:
            raise InputError(f"noise is given for '{name}'; sensors of this log are {', '.join(levels)}")
    given = {n: (sigma or {}).get(n, (sigma or {}).get(n.split()[0], level)) for n, level in levels.items()}
    columns = list(base)
    index = [robot.joints.index(n) for n in joints]
    torque_given = all(f"{TORQUE} {n}" in (sigma or {}) or TORQUE in (sigma or {}) for n in joints)
    dry_effects = {e.id for e in regressor.effects if e.dry}
    dry = np.array([regressor.columns[i].effect in dry_effects for i in base])
    static = regressor.with_effects([e for e in regressor.effects if not e.memory])
    channels = sorted({name for e in static.effects for name in e.channels(robot)})
    names = tuple(regressor.columns[i].name for i in base)

    def stretches() -> Iterator[Samples]:
        for motion in motions:
            taps = lowpass.taps(motion.step)
            sensors = sensors_of(motion, robot, lowpass)
            directions, ratios = _directions(sensors, given, taps, (len(robot.joints), 1 + len(channels)))
            at = _Columns(static, names, tuple(index), motion.start, tuple(channels))
            torque = np.array([given[f"{TORQUE} {n}"] for n in joints]) * np.linalg.norm(taps)
            for blocks in _stretches(regressor.blocks(motion, lowpass)):
                state = [np.concatenate([b.q, b.v, b.a, _certain(b.t, motion, channels)], axis=1) for b in blocks]
                Y = [np.concatenate([b.Y[:, columns], b.known[:, None]], axis=1)[:, :, index] for b in blocks]
                tau = [(b.tau + b.known)[:, index] for b in blocks]
                used = [b.used[:, index] for b in blocks]
                yield Samples(
                    at,
                    np.concatenate(state),
                    np.concatenate(Y),
                    np.concatenate(tau),
                    np.concatenate(used),
                    directions,
                    ratios,
                    torque,
                    dry,
                    torque_given,
                )

    return stretches()


def _stretches(blocks: Iterable[Block]) -> Iterator[list[Block]]:
    """Groups of consecutive blocks with `STRETCH_SAMPLES` samples together; the last group may have fewer."""
    kept: list[Block] = []
    for block in blocks:
        kept.append(block)
        if sum(len(b.t) for b in kept) >= STRETCH_SAMPLES:
            yield kept
            kept = []
    if kept:
        yield kept


@dataclass(frozen=True, eq=False)
class _Columns:
    """Base columns, and the torque of known parameters as a last one, at states [q v a t c].

    Columns of effects with memory stay zero: their change with the sensors' noise is not counted.
    """

    regressor: Regressor
    base: tuple[str, ...]
    index: tuple[int, ...]
    start: float
    channels: tuple[str, ...]

    def __call__(self, state: Array) -> Array:
        moving = state.shape[1] - 1 - len(self.channels)
        q, v, a = np.split(state[:, :moving], 3, axis=1)
        extra = dict(zip(self.channels, state.T[moving + 1 :], strict=True))
        where = {c.name: i for i, c in enumerate(self.regressor.columns)}
        Y = np.zeros((len(q), len(self.base), q.shape[1]))
        kept = [(k, where[name]) for k, name in enumerate(self.base) if name in where]
        here = MotionSamples(state[:, moving], q, v, a, self.start, extra)
        Y[:, [k for k, _ in kept]] = self.regressor.evaluate(here)[:, [i for _, i in kept]]
        known = self.regressor.robot.known_torque(q, v, a)
        known = np.zeros_like(q) if known is None else known
        return np.concatenate([Y, known[:, None, :]], axis=1)[:, :, list(self.index)]


def _certain(t: Array, motion: Motion, channels: Sequence[str]) -> Array:
    """The part of the states without error, (M, 1 + C): the times (M,), and the further channels at these times."""
    return np.column_stack([t, *(np.interp(t, motion.t, motion.extra[name]) for name in channels)])


def _directions(
    sensors: Sequence[Sensor], sigma: Mapping[str, float], filtered: Array, sizes: tuple[int, int]
) -> tuple[Array, Array]:
    """Root of the covariance of a filtered state's errors (D, 3J + E), and the unfiltered variances' ratio to it.

    `sizes` are the number of joints, J, and that of the last entries of a state, E, which are exact.
    """
    J, exact = sizes
    rows, ratios = [], []
    for sensor in sensors:
        if not sigma[sensor.name] > 0:
            continue
        length = max(len(t) for t in sensor.taps.values())
        raw = np.zeros((3, length))
        for channel, taps in sensor.taps.items():
            cut = (length - len(taps)) // 2
            raw[MOTION_CHANNELS.index(channel), cut : length - cut] = taps
        smooth = np.stack([np.convolve(r, filtered) for r in raw])
        values, vectors = np.linalg.eigh(smooth @ smooth.T)
        for value, vector in zip(values, vectors.T, strict=True):
            if value > 1e-12 * values[-1]:
                row = np.zeros((3, J))
                row[:, sensor.joint] = sigma[sensor.name] * np.sqrt(value) * vector
                rows.append(np.append(row, np.zeros(exact)))
                ratios.append(float(vector @ raw @ raw.T @ vector / value))
    return np.array(rows).reshape(-1, 3 * J + exact), np.array(ratios)
