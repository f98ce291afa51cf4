"""Simulated robots with something hidden in them, and the truth about it.

`cases` draws what to simulate, `build` simulates it: the nominal robot its user would have, logs to fit, a log held
out, a log from before the change where the effect is a change, and the truth. Everything follows from the seed.

The *size* of an effect is the rms of its torque (of a gear or a delay: of the torque error it makes) over the joint's
standard deviation of torque without it, on the log to fit: 10 to 20 % in grade 1, 3 to 10 % in grade 2, 1 to 3 % in
grade 3. How much of it the baseline model cannot absorb (`Truth.visible`) is often much less: of v|v|, a tenth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from hidden_physics import ARMS, STEP, Array, Drive, World, arm, motion, perturbed, prescribed, rms, rnea
from hidden_sensors import Sensors, record
from hidden_shapes import SHAPES, SMALL, Hidden, loaded_joint
from hidden_two_mass import elastic, loose, reversing, simulated, slow_size
from hidden_unknown import UNKNOWN

from frischid.log import Log
from frischid.robot import Robot

GRADES = {1: (0.10, 0.20), 2: (0.03, 0.10), 3: (0.01, 0.03)}
GEARS = ("elasticity", "backlash")
CHANNELS = ("drive_gain", "time_delay")
CHANGES = ("payload", "gravity_tilt", *CHANNELS)
EFFECTS = (*SMALL, *GEARS, *CHANGES)
"""Effects to find, by their names in the catalogue."""
COUNTS = {"single": 5, "healthy": 40, "unknown": 20, "contact": 20, "pair": 40}
"""Cases of each kind; of single effects, for each effect and grade."""
MUJOCO_SHARE = 0.2


@dataclass(frozen=True)
class CaseSpec:
    """What to simulate: everything that is drawn before the simulation.

    Attributes
    ----------
    number : int
    seed : tuple of int
    kind : {"single", "healthy", "unknown", "contact", "pair"}
    effects : tuple of str
        Hidden effects, empty for a healthy robot; of unknown ones, their names in `hidden_unknown`.
    grade : int
        0 for a healthy robot.
    background : float
        Small effects of other kinds on every joint, share of its torque.
    arm : str
    simulator : {"rnea", "two_mass", "mujoco"}
    duration : float
        Seconds.
    families : tuple of str
        Of the motion to fit, the one held out, and the one before the change.
    scale, bandwidth, pauses : float, float, int
        See `hidden_physics.motion`.
    sensors : Sensors
    """

    number: int
    seed: tuple[int, int]
    kind: str
    effects: tuple[str, ...]
    grade: int
    background: float
    arm: str
    simulator: str
    duration: float
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
        Of each effect; empty for what acts on the whole robot.
    grade : int
    sizes, visible : tuple of float
        Of each effect: all of it, and what the baseline model cannot absorb, on the joint where it is largest.
    details : tuple of str
        Shape of each effect, for people.
    background : float
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
    background_effects: tuple[str, ...]
    arm: str
    simulator: str
    channels: str


@dataclass(frozen=True, eq=False)
class Case:
    """A robot as its user has it, its logs, and the truth; `reference` logs are from before a change."""

    spec: CaseSpec
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
        How many of the whole benchmark, spread evenly over its kinds; all by default.
    only : str, optional
        An effect or a kind to keep.
    """
    wanted: list[tuple[str, tuple[str, ...], int]] = []
    for _ in range(COUNTS["single"]):
        wanted += [("single", (effect,), grade) for effect in EFFECTS for grade in GRADES]
    wanted += [("healthy", (), 0)] * COUNTS["healthy"]
    wanted += [("unknown", (list(UNKNOWN)[k % len(UNKNOWN)],), 1 + k % 3) for k in range(COUNTS["unknown"])]
    wanted += [("contact", ("contact",), 1 + k % 3) for k in range(COUNTS["contact"])]
    rng = np.random.default_rng([seed, 10**6])
    wanted += [("pair", _pair(rng, k), 1 + k % 2) for k in range(COUNTS["pair"])]
    specs = [_spec(seed, k, *what) for k, what in enumerate(wanted)]
    specs = [s for s in specs if only is None or only == s.kind or only in s.effects]
    if count is None or count >= len(specs):
        return specs
    return [specs[int(k)] for k in (np.arange(count) + 0.5) * len(specs) / count]


def _pair(rng: np.random.Generator, k: int) -> tuple[str, str]:
    """Two effects that were both there from the start, or two changes; at most one of them in a gear."""
    if k % 4 == 3:
        a, b = rng.choice(CHANGES, 2, replace=False)
    else:
        a, b = rng.choice([*SMALL, GEARS[k % 2]], 2, replace=False)
    return str(a), str(b)


def _spec(seed: int, number: int, kind: str, effects: tuple[str, ...], grade: int) -> CaseSpec:
    rng = np.random.default_rng([seed, number])
    geared = bool(set(effects) & set(GEARS))
    # A gear needs fast motion to show, and play a load that changes its sign: not a pendulum's.
    names = [a for a in ARMS if not (a == "planar2" and "backlash" in effects)]
    mujoco = not geared and rng.random() < MUJOCO_SHARE
    low, high = (1.0, 2.0) if geared else (0.4, 1.0)
    return CaseSpec(
        number,
        (seed, number),
        kind,
        effects,
        grade,
        float(rng.uniform(0.005, 0.03)) if (number + grade) % 2 else 0.0,
        str(rng.choice(names)),
        "two_mass" if geared else "mujoco" if mujoco else "rnea",
        float(rng.integers(20, 26) if mujoco or geared else rng.integers(20, 41)),
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
    scale = worlds[0].base.std(axis=0)
    parts: list[_Part] = []
    for name in sorted(spec.effects, key=_order):
        low, high = GRADES[spec.grade]
        target = float(np.exp(rng.uniform(np.log(1.15 * low), np.log(0.87 * high))))
        if name in GEARS:
            worlds, part = _gear(name, worlds, scale, target, rng)
        elif name in CHANNELS:
            part = _channel(name, worlds, scale, target, rng, parts)
        else:
            part = _shape(name, worlds, scale, target, rng)
        parts.append(part)
    background, kinds = _background(spec, worlds, scale, rng)
    torque = [w.base + b + sum((p.torque[k] for p in parts), np.zeros(1)) for k, (w, b) in enumerate(zip(worlds, background, strict=True))]
    extra = [{n: x for p in parts for n, x in p.extra[k].items()} for k in range(len(worlds))]
    logs = [
        record(w, x, scale, spec.sensors, np.random.default_rng([*spec.seed, 2, w.number]), more, _title(spec, w))
        for w, x, more in zip(worlds, torque, extra, strict=True)
    ]
    truth = _truth(spec, robot, worlds, scale, parts, kinds)
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
        from hidden_mujoco import followed  # MuJoCo is needed for these cases only

        return [followed(model, robot, plan, drive, k) for k, plan in enumerate(plans)]
    return [prescribed(model, robot, plan, drive, k) for k, plan in enumerate(plans)]


@dataclass(frozen=True, eq=False)
class _Part:
    """A hidden effect at its size: its torque and further channels in every world, and what counts as its size."""

    joints: tuple[int, ...]
    torque: list[Array]
    extra: list[Mapping[str, Array]]
    size: float
    detail: str
    error: Array


def _part(hidden: Hidden, worlds: Sequence[World], scale: Array, target: float) -> _Part:
    """Scale an effect and let it act on everything that is not from before the change."""
    counted = (hidden.size or hidden.torque)(worlds[0])
    factor = target / float((rms(counted) / scale).max())
    torque = [factor * hidden.torque(w) if w.number < 2 else np.zeros_like(w.base) for w in worlds]
    extra = [hidden.extra(w) if hidden.extra else {} for w in worlds]
    return _Part(hidden.joints, torque, extra, target, f"{hidden.detail} × {factor:.3g}", torque[0])


def _shape(name: str, worlds: Sequence[World], scale: Array, target: float, rng: np.random.Generator) -> _Part:
    fit = worlds[0]
    joint = loaded_joint(rng, fit, scale) if name == "load_friction" else int(rng.integers(len(scale)))
    return _part((SHAPES | UNKNOWN)[name](rng, fit, joint), worlds, scale, target)


def _gear(
    name: str, worlds: Sequence[World], scale: Array, target: float, rng: np.random.Generator
) -> tuple[list[World], _Part]:
    """Put a gear into one joint of a robot whose motions are given."""
    fit = worlds[0]
    j = loaded_joint(rng, fit, scale) if name == "elasticity" else int(rng.choice(reversing(fit, scale)))
    gear = (elastic if name == "elasticity" else loose)(fit, j, target, float(scale[j]))
    made = [simulated(w, j, gear) for w in worlds]
    detail = f"k={gear.stiffness:.3g}" + (f", gap={gear.gap:.3g}" if gear.gap else "")
    torque = [x for _, x in made]
    size = slow_size(torque[0][:, j]) / float(scale[j])
    return [w for w, _ in made], _Part((j,), torque, [{}] * len(worlds), size, detail, torque[0])


def _channel(
    name: str, worlds: Sequence[World], scale: Array, target: float, rng: np.random.Generator, parts: Sequence[_Part]
) -> _Part:
    """Mis-scale one torque channel, or delay one or all of them."""
    J = len(scale)
    whole = [w.base + sum((p.torque[k] for p in parts), np.zeros(1)) for k, w in enumerate(worlds)]
    j = int(rng.integers(J))
    if name == "drive_gain":
        gain = target * rng.choice([-1.0, 1.0]) / float(rms(whole[0])[j] / scale[j])
        torque, joints, detail = [w.on(j, gain * x[:, j]) for w, x in zip(worlds, whole, strict=True)], (j,), f"{gain:+.3f}"
    else:
        joints = (j,) if rng.random() < 0.5 else ()
        rows = np.array(joints or range(J))
        delay = 0.02
        for _ in range(4):
            size = float((rms(_late(worlds[0], whole[0], rows, delay)) / scale).max())
            delay *= float(np.clip(target / size, 0.2, 5.0))
        torque, detail = [_late(w, x, rows, delay) for w, x in zip(worlds, whole, strict=True)], f"{1e3 * delay:.3g} ms"
    torque = [x if w.number < 2 else np.zeros_like(x) for w, x in zip(worlds, torque, strict=True)]
    size = float((rms(torque[0]) / scale).max())
    return _Part(joints, torque, [{}] * len(worlds), size, detail, torque[0])


def _late(w: World, torque: Array, joints: Array, delay: float) -> Array:
    """What a delay of some joints' torque channel adds to them."""
    out = np.zeros_like(torque)
    for j in joints:
        out[:, j] = np.interp(w.path.t - delay, w.path.t, torque[:, j]) - torque[:, j]
    return out


def _background(
    spec: CaseSpec, worlds: Sequence[World], scale: Array, rng: np.random.Generator
) -> tuple[list[Array], tuple[str, ...]]:
    """Two to four small effects of other kinds on every joint, together of the given size."""
    total = [np.zeros_like(w.base) for w in worlds]
    if not spec.background:
        return total, ()
    choices = [n for n in [*SMALL, *UNKNOWN] if n not in spec.effects]
    kinds = tuple(str(n) for n in rng.choice(choices, int(rng.integers(2, 5)), replace=False))
    for j in range(len(scale)):
        column = [np.zeros(len(w.base)) for w in worlds]
        for kind in kinds:
            hidden = (SHAPES | UNKNOWN)[kind](rng, worlds[0], j)
            weight = rng.uniform(0.5, 1.0) / float(rms(hidden.torque(worlds[0]))[j])
            for k, w in enumerate(worlds):
                column[k] += weight * hidden.torque(w)[:, j]
        factor = spec.background * scale[j] / float(rms(column[0]))
        for k in range(len(worlds)):
            total[k][:, j] = factor * column[k]
    return total, kinds


def _truth(
    spec: CaseSpec, robot: Robot, worlds: Sequence[World], scale: Array, parts: Sequence[_Part], kinds: tuple[str, ...]
) -> Truth:
    names = sorted(spec.effects, key=_order)
    return Truth(
        ("unknown",) * len(names) if spec.kind == "unknown" else tuple(names),
        tuple(tuple(robot.joints[j] for j in p.joints) for p in parts),
        spec.grade,
        tuple(p.size for p in parts),
        tuple(visible(worlds, scale, p.error) for p in parts),
        tuple(p.detail for p in parts),
        spec.background,
        kinds,
        spec.arm,
        spec.simulator,
        spec.sensors.channels,
    )


def visible(worlds: Sequence[World], scale: Array, torque: Array, every: int = 50) -> float:
    """Share of a torque that links, viscous and dry friction, offsets and rotors cannot take over.

    Of a change, the log from before it holds the parameters in their place.
    """
    used = [w for w in worlds if w.number != 1]
    Y = np.concatenate([_baseline(w, every) for w in used])
    y = np.concatenate([torque[::every], *(np.zeros_like(w.base[::every]) for w in used[1:])]) / scale
    Y = Y / scale[:, None]
    X = Y.reshape(-1, Y.shape[2])
    left = y.ravel() - X @ np.linalg.lstsq(X, y.ravel(), rcond=1e-9)[0]
    return float(rms(left.reshape(y.shape)[: len(torque[::every])]).max())


def _baseline(w: World, every: int) -> Array:
    """Regressor of the baseline model at some samples, (M, J, C)."""
    q, v, a = (x[::every] for x in (w.path.q, w.path.v, w.path.a))
    M, J = q.shape
    rigid = np.empty((M, len(w.robot.columns), J))
    w.robot.regressor(q, v, a, rigid)
    drives = [x[:, :, None] * np.eye(J) for x in (v, np.tanh(v / 0.005), np.ones_like(v), a)]
    return np.concatenate([rigid.transpose(0, 2, 1), *drives], axis=2)
