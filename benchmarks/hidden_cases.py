"""Simulated robots with a hidden effect, and the truth about it.

`cases` draws the cases, and `build` simulates one. A case has the nominal robot (the URDF that its user would have), a
log to fit, a second log, the truth, and where the effect is a change, a log from before the change. Everything follows
from the seed.

The *size* of an effect is the rms of its torque over the standard deviation of the joint's torque without the effect.
(For a gear or a delay, the torque error counts in place of the torque.) Only logs to diagnose in which the effect acts
count. Grade 1 is 10 to 20 %, grade 2 is 3 to 10 %, grade 3 is 1 to 3 %. The part of an effect that the baseline model
cannot absorb (`Truth.visible`) is often much smaller: for v|v|, one tenth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hidden_parts import CHANNELS, GEARS, Baseline, Part, background, channel, gear, shape, torque_scale
from hidden_physics import ARMS, Drive, World, arm, motion, perturbed, prescribed, rms, rnea
from hidden_sensors import Sensors, record
from hidden_shapes import SMALL
from hidden_unknown import UNKNOWN

from frischid.logs.log import Log
from frischid.robot.robot import Robot

GRADES = {1: (0.10, 0.20), 2: (0.03, 0.10), 3: (0.01, 0.03)}
CHANGES = ("payload", "gravity_tilt", *CHANNELS)
EFFECTS = (*SMALL, *GEARS, *CHANGES)
"""Effects to find, by their names in the catalogue."""
COUNTS = {"single": 5, "healthy": 40, "unknown": 20, "contact": 20, "pair": 40}
"""Number of cases of each kind; for single effects, per effect and grade."""
MUJOCO_SHARE = 0.2


@dataclass(frozen=True)
class DrawnCase:
    """Everything that both generators draw before a simulation.

    Attributes
    ----------
    number : int
    seed : tuple of int
    kind : {"single", "healthy", "unknown", "contact", "pair"}
    effects : tuple of str
        Hidden effects, empty for a healthy robot; unknown effects by their names in `hidden_unknown`.
    grade : int
        0 for a healthy robot.
    background : float
        Size of small effects of other kinds on every joint, as a share of the joint's torque.
    arm : str
    duration : float
        Seconds.
    """

    number: int
    seed: tuple[int, int]
    kind: str
    effects: tuple[str, ...]
    grade: int
    background: float
    arm: str
    duration: float


@dataclass(frozen=True)
class CaseSpec(DrawnCase):
    """Everything that the first generator draws before the simulation.

    Attributes
    ----------
    simulator : {"rnea", "two_mass", "mujoco"}
    families : tuple of str
        Families of the motion to fit, of the second one, and of the one before the change.
    scale, bandwidth, pauses : float, float, int
        See `hidden_physics.motion`.
    sensors : Sensors
    """

    simulator: str
    families: tuple[str, str, str]
    scale: float
    bandwidth: float
    pauses: int
    sensors: Sensors


@dataclass(frozen=True)
class Truth:
    """What is hidden in a case; sizes are shares of the joint's torque.

    Attributes
    ----------
    effects : tuple of str
        Names in the catalogue, ``contact`` or ``unknown``; empty for a healthy robot.
    joints : tuple of tuple of str
        Joints of each effect; empty for an effect on the whole robot.
    grade : int
    sizes, visible : tuple of float
        Size of each effect, and size of the part that the baseline model cannot absorb, on the joint where it is
        largest.
    details : tuple of str
        Shape of each effect, for people.
    background, background_visible : float
        The same two sizes of the background: on every joint, and in the mean.
    background_effects : tuple of str
    arm, simulator : str
    channels : str
        Measured derivatives: "", "v" or "va".
    """

    effects: tuple[str, ...]
    joints: tuple[tuple[str, ...], ...]
    grade: int
    sizes: tuple[float, ...]
    visible: tuple[float, ...]
    details: tuple[str, ...]
    background: float
    background_visible: float
    background_effects: tuple[str, ...]
    arm: str
    simulator: str
    channels: str


@dataclass(frozen=True, eq=False)
class Case:
    """The robot as its user knows it, its logs, and the truth; `reference` logs are from before a change."""

    spec: DrawnCase
    robot: Robot
    fit: list[Log]
    valid: list[Log]
    reference: list[Log]
    truth: Truth


def cases(seed: int = 0, count: int | None = None, only: str | None = None) -> list[CaseSpec]:
    """Draw the benchmark's cases.

    Parameters
    ----------
    seed : int
    count : int, optional
        Number of cases, spread evenly over the kinds; all by default.
    only : str, optional
        An effect or a kind; other cases are left out.
    """
    wanted: list[tuple[str, tuple[str, ...], int, bool]] = []
    for k in range(COUNTS["single"]):
        wanted += [
            ("single", (effect,), grade, (k + i + grade) % 2 == 1)
            for i, effect in enumerate(EFFECTS)
            for grade in GRADES
        ]
    wanted += [("healthy", (), 0, k % 2 == 1) for k in range(COUNTS["healthy"])]
    strange = list(UNKNOWN)
    for k in range(COUNTS["unknown"]):
        name = strange[k % len(strange)]
        wanted.append(("unknown", (name,), 1 + (k + k // len(strange)) % 3, (k + k // len(strange)) % 2 == 1))
    wanted += [("contact", ("contact",), 1 + k % 3, k % 2 == 1) for k in range(COUNTS["contact"])]
    rng = np.random.default_rng([seed, 10**6])
    wanted += [("pair", _pair(rng, k), 1 + (k // 4) % 2, (k + k // 8) % 2 == 1) for k in range(COUNTS["pair"])]
    specs = [_spec(seed, k, *what) for k, what in enumerate(wanted)]
    specs = [s for s in specs if only is None or only == s.kind or only in s.effects]
    if count is None or count >= len(specs):
        return specs
    return [specs[int(k)] for k in (np.arange(count) + 0.5) * len(specs) / count]


def _pair(rng: np.random.Generator, k: int) -> tuple[str, str]:
    """Two effects that were there from the start, or two changes; at most one of them is in a gear."""
    if k % 4 == 3:
        a, b = rng.choice(CHANGES, 2, replace=False)
    else:
        a, b = rng.choice([*SMALL, GEARS[k % 2]], 2, replace=False)
    return str(a), str(b)


def _spec(seed: int, number: int, kind: str, effects: tuple[str, ...], grade: int, small: bool) -> CaseSpec:
    rng = np.random.default_rng([seed, number])
    geared = bool(set(effects) & set(GEARS))
    # A flexible gear shows in fast motion only; play shows where the load changes its sign, unlike a pendulum's.
    names = [a for a in ARMS if not (a == "planar2" and "backlash" in effects)]
    mujoco = not geared and rng.random() < MUJOCO_SHARE
    low, high = (1.0, 2.0) if geared else (0.4, 1.0)
    return CaseSpec(
        number,
        (seed, number),
        kind,
        effects,
        grade,
        float(rng.uniform(0.005, 0.03)) if small else 0.0,
        str(rng.choice(names)),
        float(rng.integers(20, 26) if mujoco or geared else rng.integers(20, 41)),
        "two_mass" if geared else "mujoco" if mujoco else "rnea",
        ("fourier", str(rng.choice(["fourier", "points"], p=[0.7, 0.3])), "fourier"),
        float(rng.uniform(0.6, 0.9)),
        float(rng.uniform(low, high)),
        0 if geared else int(rng.choice([0, 1, 2], p=[0.6, 0.25, 0.15])),
        Sensors.drawn(rng),
    )


def build(spec: CaseSpec) -> Case:
    """Simulate a case."""
    rng = np.random.default_rng([*spec.seed, 1])
    robot = arm(spec.arm)
    change = bool(set(spec.effects) & set(CHANGES))
    worlds = _worlds(spec, robot, rng, 3 if change else 2)
    scale = torque_scale(worlds)
    low, high = GRADES.get(spec.grade, (0.0, 0.0))
    parts: list[Part] = []
    baseline = Baseline(worlds, scale)
    for name in sorted(spec.effects, key=_order):
        target = float(np.exp(rng.uniform(np.log(1.15 * low), np.log(0.87 * high))))
        if name in GEARS:
            worlds, part = gear(name, worlds, scale, target, rng)
        elif name in CHANNELS:
            part = channel(name, worlds, scale, target, rng, parts, baseline)
        else:
            part = shape(name, worlds, scale, target, rng, baseline)
        parts.append(part)
    small, kinds = background(spec.background, spec.effects, worlds, scale, rng)
    torque = [
        w.base + b + sum((p.torque[k] for p in parts), np.zeros(1))
        for k, (w, b) in enumerate(zip(worlds, small, strict=True))
    ]
    extra = [{n: x for p in parts for n, x in p.extra[k].items()} for k in range(len(worlds))]
    logs = [
        record(w, x, scale, spec.sensors, np.random.default_rng([*spec.seed, 2, w.number]), more, _title(spec, w))
        for w, x, more in zip(worlds, torque, extra, strict=True)
    ]
    left = float(rms(baseline.left(small[0])))
    truth = _truth(spec, robot, parts, kinds, left)
    return Case(spec, robot, logs[:1], logs[1:2], logs[2:], truth)


def _title(spec: CaseSpec, w: World) -> str:
    return f"case {spec.number} {('fit', 'valid', 'reference')[w.number]}"


def _order(name: str) -> int:
    """Gears change the motion and come first; channels act on everything and come last."""
    return -1 if name in GEARS else int(name in CHANNELS)


def _worlds(spec: CaseSpec, robot: Robot, rng: np.random.Generator, count: int) -> list[World]:
    """Build the healthy robot's motions and torques."""
    model = perturbed(robot.model, rng)
    seeds = rng.integers(2**31, size=3)
    plans = [
        motion(robot, spec.families[k], spec.duration, int(seeds[k]), spec.scale, spec.bandwidth, spec.pauses)
        for k in range(count)
    ]
    drive = Drive.plausible(rng, plans[0], rnea(model, robot, plans[0]))
    if spec.simulator == "mujoco":
        from hidden_mujoco import followed  # only these cases need MuJoCo

        stiff = spec.number % 2 == 1
        return [followed(model, robot, plan, drive, k, stiff=stiff) for k, plan in enumerate(plans)]
    return [prescribed(model, robot, plan, drive, k) for k, plan in enumerate(plans)]


def _truth(spec: CaseSpec, robot: Robot, parts: Sequence[Part], kinds: tuple[str, ...], left: float) -> Truth:
    names = sorted(spec.effects, key=_order)
    return Truth(
        ("unknown",) * len(names) if spec.kind == "unknown" else tuple(names),
        tuple(tuple(robot.joints[j] for j in p.joints) for p in parts),
        spec.grade,
        tuple(p.size for p in parts),
        tuple(p.visible for p in parts),
        tuple(p.detail for p in parts),
        spec.background,
        left,
        kinds,
        spec.arm,
        spec.simulator,
        spec.sensors.channels,
    )
