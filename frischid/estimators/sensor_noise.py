"""Effect of each sensor's noise on the regressor, on its moments and on the residual.

A *sensor* is one stream of independent errors ε(t): an encoder, a tachometer, an accelerometer. Through its taps it
moves the position, velocity and acceleration of one joint; an encoder whose signal is differentiated twice moves all
three,

    δq_j = h_q * ε,   δq̇_j = h_v * ε,   δq̈_j = h_a * ε      (* is convolution).

The numbers show the sensor of each channel of a motion: a q̇ that equals the derivative filter of q is not a sensor of
its own.

**Moments.** With errors of variance σ_s², ``E[x xᵀ]`` of the rows x = [y τ] grows by σ_s² S_s. Moving the log of
sensor s by ±h w_k, with random signs w_k, and sending both copies through the whole pipeline (regressor, parallel
low-pass, decimation, moments) gives

    S_s = (G(+h) + G(−h) − 2 G(0)) / 2h²  →  ½ Σ_k ∂²(x xᵀ)/∂ε_k².

Differences of *moments* contain the curvature of the columns too (see `sensorwise`). The square of a velocity's sign is
always one, so the sign contributes only real changes by the noise. Without filter and derivatives w_k² = 1 makes this
an exact second difference; with them, products of neighbouring errors w_k w_l cancel in the mean over the log.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.types import Array
from frischid.estimators.least_squares import Estimate
from frischid.estimators.sensorwise import TORQUE, SensorMoments
from frischid.logs.filters import LowPass, correlate, derivative_taps, noise_level
from frischid.logs.preprocessing import Motion
from frischid.regression.accumulation import accumulate
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

MOTION_CHANNELS = ("q", "v", "a")
ONE_TAP = np.ones(1)
NOISE_MARGIN = 1.5  # limit of a sensor's noise over its measured level
SAME_CHANNEL = 2e-7  # relative difference of two channels that is rounding of the derivative's weights


@dataclass(frozen=True)
class Probe:
    """How a sensor is displaced for the differences of moments."""

    step: float = 0.03
    """Displacement as a share of what the sensor's channels span: rms of q̇ and q̈, 1 rad (m) of q."""
    repeats: int = 1
    """Sets of random signs to average over; one is enough unless the log is short and filtered."""
    seed: int = 0
    """Of the random signs."""


PROBE = Probe()


@dataclass(frozen=True, eq=False)
class Sensor:
    """One stream of errors and the channels of one joint it enters."""

    name: str
    """Such as ``"q joint1"``."""
    joint: int
    taps: Mapping[str, Array]
    """Channel (``"q"``, ``"v"``, ``"a"``) -> odd-length filter from the sensor's errors to that channel's."""


def sensors_of(motion: Motion, robot: Robot, lowpass: LowPass) -> list[Sensor]:
    """Find which channels of a motion were measured and which were derived from others.

    Parameters
    ----------
    robot : Robot
        Names the joints.
    lowpass : LowPass
        The one the motion was prepared with, which sets its derivative filters.
    """
    first, second = (derivative_taps(order, motion.step, lowpass.cutoff) for order in (1, 2))
    found = []
    for j, name in enumerate(robot.joints):
        q, v, a = motion.q[:, j], motion.v[:, j], motion.a[:, j]
        taps: dict[str, dict[str, Array]] = {"q": {"q": ONE_TAP}}
        if _derived(v, q, first):
            taps["q"]["v"] = first
        else:
            taps["v"] = {"v": ONE_TAP}
        if _derived(a, q, second):
            taps["q"]["a"] = second
        elif "v" in taps and _derived(a, v, first):
            taps["v"]["a"] = first
        else:
            taps["a"] = {"a": ONE_TAP}
        found += [Sensor(f"{channel} {name}", j, t) for channel, t in taps.items()]
    return found


def _derived(x: Array, source: Array, taps: Array) -> bool:
    """Whether `x` is `source` sent through `taps`, as far as both can be seen."""
    half = len(taps) // 2
    if len(x) <= 2 * half:
        return False
    made = np.convolve(source, taps[::-1], mode="valid")
    inside = x[half : len(x) - half]
    return bool(np.abs(made - inside).max() <= SAME_CHANNEL * max(float(np.abs(inside).max()), 1e-12))


def sensor_moments(
    regressor: Regressor,
    motions: Iterable[Motion],
    lowpass: LowPass,
    joints: Sequence[str],
    base: Sequence[int],
    start: Estimate | None = None,
    probe: Probe = PROBE,
) -> SensorMoments:
    """Moments of the log, and what each sensor's noise adds to them.

    Parameters
    ----------
    motions : iterable of Motion
        Gone through twice, and twice more for every sensor; one at a time is in memory.
    joints : sequence of str
        Joints whose torque rows are used.
    base : sequence of int
        Columns of the base parameters.
    start : Estimate, optional
        Least squares of the same logs: names of the base parameters, and weights of the joints' squared residuals. By
        default the names of the columns, and equal weights.
    probe : Probe
        How sensors are displaced.
    """
    rng = np.random.default_rng(probe.seed)
    per_motion: list[dict[str, Sensor]] = []
    steps: dict[str, float] = {}
    seconds = 0.0
    for motion in motions:
        per_motion.append({s.name: s for s in sensors_of(motion, regressor.robot, lowpass)})
        for name, sensor in per_motion[-1].items():
            steps[name] = min(steps.get(name, np.inf), _step(motion, sensor, probe.step))
        seconds += float(motion.t[-1] - motion.t[0])
    sensors = list(dict.fromkeys(name for found in per_motion for name in found))

    def moments(moved: Iterable[Motion]) -> Sequence[Gram]:
        return accumulate(regressor, moved, lowpass, joints, seconds=seconds)

    def shifted(name: str, size: float) -> Iterator[Motion]:
        """Every motion with random errors of this size on one sensor."""
        for m, found in zip(motions, per_motion, strict=True):
            yield moved(m, found[name], size * _signs(m, found[name], rng)) if name in found else m

    weights = None if start is None else start.weights

    def weighted(grams: Sequence[Gram]) -> Array:
        return np.stack([g.select(list(base)).weighted(weights) for g in grams])

    grams = moments(motions)
    here = weighted(grams)
    noise = np.zeros((len(sensors) + 1, *here.shape))
    for s, name in enumerate(sensors):
        size = steps[name]
        for _ in range(probe.repeats):
            here_in_line, sides = rng.bit_generator.state, []
            for h in (size, -size):
                rng.bit_generator.state = here_in_line  # the same signs on both sides, without keeping them
                sides.append(weighted(moments(shifted(name, h))))
            noise[s] += (sides[0] + sides[1] - 2 * here) / (2 * size**2 * probe.repeats)
    noise[-1, :, -1, -1] = [g.counts.sum() for g in grams]
    columns = [regressor.columns[i] for i in base] if start is None else start.columns
    return SensorMoments(tuple(c.name for c in columns), (*sensors, TORQUE), here, noise)


def moved(motion: Motion, sensor: Sensor, errors: Array) -> Motion:
    """Add errors of one sensor to a motion; `errors` reaches over both ends by half of the longest taps."""
    reach = (len(errors) - len(motion.t)) // 2
    arrays = {}
    for channel, taps in sensor.taps.items():
        cut = reach - len(taps) // 2
        x = getattr(motion, channel).copy()
        x[:, sensor.joint] += correlate(taps, errors[cut : len(errors) - cut])
        arrays[channel] = x
    return replace(motion, **arrays)


def _signs(motion: Motion, sensor: Sensor, rng: np.random.Generator) -> Array:
    reach = max(len(t) for t in sensor.taps.values()) // 2
    return np.asarray(rng.choice([-1.0, 1.0], len(motion.t) + 2 * reach))


def _step(motion: Motion, sensor: Sensor, share: float) -> float:
    """Displacement that moves each of the sensor's channels by `share` of what it spans, the tightest counting."""
    spans = {"q": 1.0, "v": _rms(motion.v, sensor.joint), "a": _rms(motion.a, sensor.joint)}
    return share * min(spans[c] / float(np.linalg.norm(t)) for c, t in sensor.taps.items())


def _rms(x: Array, joint: int) -> float:
    """Spread of a joint's rate; of a joint that hardly moves, a hundredth of the liveliest joint's."""
    rms = np.sqrt(np.mean(x**2, axis=0))
    return float(max(rms[joint], 0.01 * rms.max(), 1e-6))


def noise_levels(motions: Iterable[Motion], robot: Robot, lowpass: LowPass) -> dict[str, float]:
    """Standard deviation of each sensor's errors, from fourth differences of its signal.

    See `frischid.logs.filters.noise_level`. A fast motion sampled slowly also has fourth differences, so this is an
    upper limit rather than a measurement.

    Returns
    -------
    dict of str to float
        By sensor name, median over the motions; ``"torque <joint>"`` for the torques.
    """
    values: dict[str, list[float]] = {}
    for motion in motions:
        for sensor in sensors_of(motion, robot, lowpass):
            channel = getattr(motion, next(iter(sensor.taps)))
            values.setdefault(sensor.name, []).append(float(noise_level(channel[:, sensor.joint])))
        for j in np.flatnonzero(~np.isnan(motion.tau).any(axis=0)):
            name = robot.joints[j]
            values.setdefault(f"{TORQUE} {name}", []).append(float(noise_level(motion.tau[:, j])))
    return {name: float(np.median(v)) for name, v in values.items()}


def noise_limits(motions: Iterable[Motion], robot: Robot, lowpass: LowPass) -> dict[str, tuple[float, float]]:
    """Noise limits for `sensorwise` where there is no data sheet: at most `NOISE_MARGIN` times `noise_levels`.

    They hold for errors that are white; an encoder's eccentricity or a late velocity is more than they allow.
    """
    levels = noise_levels(motions, robot, lowpass)
    return {name: (0.0, NOISE_MARGIN * level) for name, level in levels.items() if not name.startswith(TORQUE)}
