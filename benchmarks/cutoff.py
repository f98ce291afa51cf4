"""The automatic cut-off of the parallel filter against the best of a scan.

Simulated arms, whose noise-free torque is known. For every cut-off two errors over the torque's spread (median joint):

- *torque*: the true model along the motion that the sensors saw, through the filter, against the noise-free torque
  through the same filter; samples at standstill are left out;
- *model*: the model identified from the noisy log, along the noise-free motion of another log, unfiltered.

The held-out error of a user is between these and the noise: the same models on a log of the other motion, recorded by
the same sensors. All models are compared through the automatic filter.

With --measured, which needs FRISCHID_DATA: the held-out error of `trust.pairs`, through the automatic filter too. The
error through each model's own filter stands beside it: that one falls with the cut-off whatever the model, because
a low cut-off takes ripple and noise out of the measurement too.

The best of a scan is itself an estimate. So the range beside a ratio is that of a block bootstrap (Künsch 1989): blocks
of a second of the held-out log are drawn anew, with the residuals of both models together. And the lowest of a dozen
errors is low by chance. So the ratio that chance gives stands there too: that of cut-offs which are all equally good.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish
from hidden_physics import Drive, World, arm, motion, perturbed, prescribed, rnea
from real_robots import TIAGO_ROWS
from scipy import signal
from trust import Pair, pairs, read

import frischid as fr
from frischid.core.types import Array
from frischid.errors import IdentifiabilityError, InputError
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.filters import LowPass, correlate
from frischid.logs.preprocessing import Motion, prepare

SCAN = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)
"""Cut-offs tried on simulated logs, Hz."""
MEASURED_SCAN = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0, 20.0, 30.0, 50.0)
"""Cut-offs tried on measured logs, Hz."""
MOST_OF_RATE = 0.2
"""Highest cut-off that is tried, share of the sampling rate."""
BLOCK_SECONDS = 1.0
"""s. Residuals are independent after so long; see `frischid.model.residual_conditions`."""
DRAWS = 1000
"""Logs that the bootstrap draws."""
WITHIN = 1.05
"""Error over that of the best cut-off which counts as equal."""
SHARP = 5e-4
"""Speed over which dry friction changes its direction, rad/s."""


@dataclass(frozen=True)
class Sensors:
    """Sensors and motion of a simulated log.

    Attributes
    ----------
    name : str
    rate : float
        Hz.
    bits : int
        Of the encoders, for one turn of the joint.
    torque : float
        Noise of the torque, share of its spread.
    memory : float
        Correlation time of that noise, s; 0: white.
    jitter : float
        Irregularity of the sampling, share of a step; the stamps know nine tenths of it.
    pauses : int
        Stretches in which everything stands still.
    bandwidth : float
        Fastest harmonic of the motion, Hz.
    velocity : float
        Noise of a measured velocity, share of its spread; 0: not measured.
    pink : bool
        Whether the noise of the torque has a power of 1/f, as that of drives.
    """

    name: str
    rate: float = 200.0
    bits: int = 18
    torque: float = 0.02
    memory: float = 0.0
    jitter: float = 0.0
    pauses: int = 0
    bandwidth: float = 0.5
    velocity: float = 0.0
    pink: bool = False


KINDS = (
    Sensors("fine encoder", 500.0, torque=0.005),
    Sensors("white torque noise"),
    Sensors("AR(1) torque noise", memory=0.1),
    Sensors("coarse encoder", bits=12),
    Sensors("coarse encoder, 1 kHz", 1000.0, bits=13, memory=0.1),
    Sensors("very coarse encoder", 100.0, bits=11, torque=0.01),
    Sensors("stamp jitter", 125.0, bits=16, jitter=0.2),
    Sensors("long rests", 250.0, bits=14, pauses=4),
    Sensors("measured velocity", 250.0, bits=14, velocity=0.01),
    Sensors("fast motion", 500.0, bits=15, bandwidth=2.0, memory=0.1),
    Sensors("1/f noise, coarse, long rests", 250.0, bits=13, pauses=6, pink=True),
)


def world(name: str, sensors: Sensors, seed: int) -> tuple[World, World]:
    """Simulate the motion that is fitted and the motion that is held out."""
    robot, rng = arm(name), np.random.default_rng(seed)
    model = perturbed(robot.model, rng)
    plans = [motion(robot, "fourier", 24.0, 10 * seed + k, 0.8, sensors.bandwidth, sensors.pauses) for k in range(2)]
    drive = Drive.plausible(rng, plans[0], rnea(model, robot, plans[0]))
    fitted, held_out = (
        prescribed(model, robot, plan, drive, k, np.tanh(plan.v / SHARP)) for k, plan in enumerate(plans)
    )
    return fitted, held_out


def recorded(true: World, sensors: Sensors, seed: int) -> fr.Log:
    """Record a world with these sensors."""
    rng, step = np.random.default_rng([seed, 1]), 1 / sensors.rate
    nominal = np.arange(1, int((true.path.t[-1] - 2 * step) * sensors.rate)) * step
    shift = sensors.jitter * step * rng.uniform(-1, 1, len(nominal))

    def sampled(x: Array) -> Array:
        return np.stack([np.interp(nominal + shift, true.path.t, column) for column in x.T], axis=1)

    quantum = 2 * np.pi / 2**sensors.bits
    q, tau, v = sampled(true.path.q), sampled(true.base), sampled(true.path.v)
    noise = rng.normal(size=tau.shape)
    if sensors.memory:
        pole = np.exp(-step / sensors.memory)
        noise = signal.lfilter([np.sqrt(1 - pole**2)], [1, -pole], noise, axis=0)
    if sensors.pink:
        spectrum = np.fft.rfft(noise, axis=0) / np.sqrt(np.maximum(np.arange(len(noise) // 2 + 1), 1))[:, None]
        noise = np.fft.irfft(spectrum, len(noise), axis=0)
        noise /= noise.std(axis=0)
    return fr.Log(
        nominal + 0.9 * shift,
        true.robot.joints,
        quantum * np.round(q / quantum + 0.3 * rng.normal(size=q.shape)),
        v=v + sensors.velocity * v.std(axis=0) * rng.normal(size=v.shape) if sensors.velocity else None,
        tau=tau + sensors.torque * tau.std(axis=0) * noise,
        source=sensors.name,
    )


def torque_error(true: World, log: fr.Log, cutoff: float) -> float:
    """Error of the true model along the motion that the sensors saw, both through the filter."""
    lowpass, errors, spread = LowPass(cutoff), [], []
    for seen in prepare(log, lowpass).motions:
        taps, every = lowpass.taps(seen.step), lowpass.decimation(seen.step)
        clean = np.stack([np.interp(seen.t, true.path.t, column) for column in true.base.T], axis=1)
        found = _along(true, seen)
        used = ~(correlate(taps, 1.0 * seen.standstill) > 0.01)[::every]
        errors.append(np.where(used, correlate(taps, found - clean)[::every], np.nan))
        spread.append(np.where(used, correlate(taps, clean)[::every], np.nan))
    return float(np.median(_rms(np.concatenate(errors)) / np.nanstd(np.concatenate(spread), axis=0)))


def _along(true: World, seen: Motion) -> Array:
    return rnea(true.model, true.robot, seen) + true.drive.torque(seen, np.tanh(seen.v / SHARP))


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.nanmean(x**2, axis=0)))


def model_error(held_out: World, model: fr.Model) -> float:
    """Error of a model along a noise-free motion, unfiltered."""
    path = held_out.path
    some = slice(None, None, 7)
    found = model.inverse_dynamics(path.q[some], path.v[some], path.a[some])
    moving = np.abs(path.v[some]) > 20 * SHARP
    error = np.where(moving, found - held_out.base[some], np.nan)
    return float(np.median(_rms(error) / held_out.base.std(axis=0)))


def simulated(name: str, sensors: Sensors, seed: int, scan: Sequence[float]) -> dict[str, Any]:
    """One row of the table of simulated logs."""
    fitted, held_out = world(name, sensors, seed)
    log = recorded(fitted, sensors, seed)
    lowpass = choose_lowpass([log], log.joints)
    auto = lowpass.cutoff
    assert auto is not None
    models = {
        f: fr.identify(fitted.robot, [log], cutoff=f, recursion="none", force=True).model
        for f in (*scan, auto)
        if f <= MOST_OF_RATE * sensors.rate
    }
    tried = {f: model_error(held_out, m) for f, m in models.items()}
    best = min(tried, key=lambda f: tried[f])
    other = recorded(held_out, sensors, seed + 1)
    seen = {f: replace(m, lowpass=lowpass) for f, m in models.items()}
    found = {f: _held_out(m, other) for f, m in seen.items()}
    lowest = min(found, key=lambda f: found[f])
    return {
        "robot": name,
        "log": sensors.name,
        "automatic Hz": auto,
        "best Hz": best,
        "torque error": torque_error(fitted, log, auto),
        "error": tried[auto],
        "best": tried[best],
        "error / best": tried[auto] / tried[best],
        "held-out / best": found[auto] / found[lowest],
        **spread(seen, auto, lowest, other),
    }


def measured(pair: Pair, folder: Path, scan: Sequence[float]) -> dict[str, Any]:
    """One row of the table of measured logs."""
    urdf = next(p for p in sorted(folder.joinpath(pair.robot).glob("*.urdf")) if "with_hand" not in p.name)
    robot = fr.Robot.load(urdf)
    fit = [read(folder, robot, pair.robot, part) for part in pair.fit]
    valid = read(folder, robot, pair.robot, pair.valid)
    options: dict[str, Any] = {"recursion": "none", "force": True}
    if pair.robot == "tiago":
        options["torque_joints"] = TIAGO_ROWS

    def model(cutoff: float | str) -> fr.Model:
        effects = None
        if pair.effects:
            baseline = fr.identify(robot, fit, cutoff=cutoff, **options).model.effects
            effects = (*baseline, *fr.parse_effects(pair.effects))
        return fr.identify(robot, fit, cutoff=cutoff, effects=effects, **options).model

    automatic = model("auto")
    auto, rate = automatic.lowpass.cutoff, min(log.rate for log in [*fit, valid])
    assert auto is not None
    models = {auto: automatic}
    for cutoff in scan:
        if cutoff <= MOST_OF_RATE * rate * (1 + 1e-3):
            with suppress(InputError, IdentifiabilityError):  # the log is shorter than the filter of a very low cut-off
                models[cutoff] = model(cutoff)
    seen = {f: replace(m, lowpass=automatic.lowpass) for f, m in models.items()}
    tried = {f: _held_out(m, valid) for f, m in seen.items()}
    own = {f: _held_out(m, valid) for f, m in models.items()}
    best = min(tried, key=lambda f: tried[f])
    return {
        "robot": pair.robot,
        "log": f"{pair.fit[0]}{' ...' * (len(pair.fit) > 1)} on {pair.valid}",
        "automatic Hz": auto,
        "best Hz": best,
        "error": tried[auto],
        "best": tried[best],
        "error / best": tried[auto] / tried[best],
        **spread(seen, auto, best, valid),
        "lowest through own filter": min(own.values()),
        "at Hz": min(own, key=lambda f: own[f]),
    }


def _held_out(model: fr.Model, valid: fr.Log) -> float:
    """Error on a log; infinite where the filter leaves nothing to compare."""
    try:
        return fr.compare(model, [valid]).nrmse
    except InputError:
        return float("inf")


def spread(models: dict[float, fr.Model], auto: float, lowest: float, valid: fr.Log) -> dict[str, str]:
    """What the held-out log alone does to a ratio, by a block bootstrap: two ranges.

    *range* holds 95 % of the ratios of the two errors. *of equals* is the median and the 95 % quantile of the ratio to
    the lowest error if every cut-off that is not clearly worse were as good as the automatic one.
    """
    found = {}
    for f, model in models.items():
        with suppress(InputError):  # see `_held_out`
            found[f] = fr.compare(model, [valid])
    own = found[auto]
    some = own.residuals.used.any(axis=1)  # a block in which every joint rests has no residual
    used, t = own.residuals.used[some], own.residuals.t[some]
    std = np.array([j.rmse / j.nrmse for j in own.joints])
    block = np.unique(np.floor((t - t[0]) / BLOCK_SECONDS).astype(int), return_inverse=True)[1]
    drawn = np.random.default_rng(0).integers(block.max() + 1, size=(DRAWS, block.max() + 1))

    def sums(values: Array) -> Array:
        return np.array([np.bincount(block, x) for x in values.T]).T

    count = sums(1.0 * used)[drawn].sum(axis=1)
    errors: dict[float, Array] = {}
    relative: list[Array] = []
    for f, c in found.items():
        squares = sums(np.where(used, c.residuals.residual[some] ** 2, 0.0))[drawn].sum(axis=1)
        with np.errstate(invalid="ignore"):  # a joint may rest in all blocks of a draw
            errors[f] = np.nanmean(np.sqrt(squares / count) / std, axis=1)
    for f, c in found.items():
        ratio = errors[f] / errors[auto]
        if np.quantile(ratio, 0.025) <= 1.0:  # a clearly worse model is not one of equals, and its error varies more
            relative.append(ratio * own.nrmse / c.nrmse)
    low, high = np.quantile(errors[auto] / errors[lowest], (0.025, 0.975))
    usual, most = np.quantile(1.0 / np.min(relative, axis=0), (0.5, 0.95))
    return {"range": f"{low:.2f} to {high:.2f}", "of equals": f"{usual:.2f}, up to {most:.2f}"}


def summary(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Geometric mean and worst of the ratios to the best cut-off."""
    ratios = np.array([row["error / best"] for row in rows])
    found = [f"over the best cut-off: geometric mean {np.exp(np.log(ratios).mean()):.2f}, worst {ratios.max():.2f}"]
    if "held-out / best" in rows[0]:
        ratios = np.array([row["held-out / best"] for row in rows])
        within = int((ratios <= WITHIN).sum())
        found.append(
            f"held-out error within {WITHIN - 1:.0%} of the best: {within} of {len(rows)}, worst {ratios.max():.2f}"
        )
    return found


def main() -> None:
    """Print both tables."""
    options = parser(__doc__)
    options.add_argument("--arms", default="kinova,elbow3,z1,ur10,TwoDofs", help="arms, taken in turn")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--measured", metavar="ROBOT", help="measured logs of a robot, or of all, nothing simulated")
    options.add_argument("--kinds", help="kinds of simulated logs, separated by semicolons; all by default")
    options.add_argument("--quick", action="store_true", help="every second cut-off of the scans")
    chosen = options.parse_args()
    every, arms, folder = slice(None, None, 2 if chosen.quick else 1), chosen.arms.split(","), data_folder()
    if not chosen.measured:
        kinds = KINDS if chosen.kinds is None else [k for k in KINDS if k.name in chosen.kinds.split(";")]
        turns = [(arms[k % len(arms)], kind) for k, kind in enumerate(kinds)]
        if len(kinds) == 1:
            turns = [(name, kinds[0]) for name in arms]
        rows = [simulated(name, kind, chosen.seed, SCAN[every]) for name, kind in turns]
    elif folder is None:
        sys.exit("set FRISCHID_DATA to the folder of measured logs")
    else:
        wanted = [pair for pair in pairs() if chosen.measured in ("all", pair.robot)]
        rows = [measured(pair, folder, MEASURED_SCAN[every]) for pair in wanted]
    publish("the automatic cut-off against the best of a scan", rows, chosen.json, summary(rows))


if __name__ == "__main__":
    main()
