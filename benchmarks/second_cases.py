"""A second generator of simulated robots with hidden effects; it shares no shape of an effect with the first.

Effects are laws of the literature (`second_shapes`). Motions are splines through random points at random times, or
moves with trapezoidal speed. Sensors are worse than the first generator's: in a third of the cases encoders are coarse
(12 to 15 bits) and derivatives come from them, torque noise has a memory of 0.02 to 0.2 s (AR(1)) in half of the cases,
and time stamps jitter in a quarter. What both generators share is Pinocchio's inverse dynamics, the scale of an effect
(`hidden_parts`), and the record of truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hidden_cases import CHANGES, GRADES, Case, DrawnCase, Truth
from hidden_parts import Baseline, Part, acting, torque_scale
from hidden_physics import STEP, Array, Drive, Path, World, arm, perturbed, prescribed, rms, rnea
from hidden_shapes import loaded_joint
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from second_shapes import MAKERS, OUTSIDE, soft_sign

from frischid.logs.log import Log
from frischid.robot.robot import Robot

ARMS = ("planar2", "elbow3", "z1", "ur5", "ur10", "kinova", "xarm7", "panda")
SINGLE = tuple(name for name in MAKERS if name not in (*OUTSIDE, "contact", "asymmetric_coulomb"))
"""Effects to find. Direction-dependent dry friction is an offset as long as a joint moves, so it is background only."""
SMALL = tuple(
    n for n in MAKERS if n not in (*CHANGES, *OUTSIDE, "contact", "elasticity", "joint_coupling", "gear_play")
)
COUNTS = {"single": 4, "healthy": 40, "unknown": 12, "contact": 12}
"""Cases of each kind; for single effects, per effect and grade."""
LOADED = ("load_friction", "elasticity", "gear_play", "eccentric")


@dataclass(frozen=True)
class SecondSensors:
    """Measuring equipment.

    Rate (Hz), bits of the encoder, torque noise (share of its std) and its memory (s), jitter of the time stamps (share
    of a step).
    """

    rate: float
    bits: int
    noise: float
    memory: float
    jitter: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> SecondSensors:
        """Draw sensors; a third of them have coarse encoders."""
        coarse = rng.random() < 1 / 3
        return cls(
            float(rng.choice([100.0, 200.0, 400.0, 1000.0])),
            int(rng.integers(12, 16)) if coarse else int(rng.integers(16, 21)),
            float(np.exp(rng.uniform(np.log(0.003), np.log(0.02)))),
            float(np.exp(rng.uniform(np.log(0.02), np.log(0.2)))) if rng.random() < 0.5 else 0.0,
            float(rng.uniform(0.05, 0.3)) if rng.random() < 0.25 else 0.0,
        )


@dataclass(frozen=True)
class SecondSpec(DrawnCase):
    """Everything that this generator draws before the simulation; `moves`: the second motion is trapezoidal moves."""

    moves: bool
    sensors: SecondSensors


def cases(seed: int, count: int | None = None) -> list[SecondSpec]:
    """Draw the cases; `count` spreads evenly over the kinds."""
    wanted: list[tuple[str, tuple[str, ...], int, bool]] = []
    for k in range(COUNTS["single"]):
        wanted += [
            ("single", (name,), grade, (k + i + grade) % 2 == 0) for i, name in enumerate(SINGLE) for grade in GRADES
        ]
    wanted += [("healthy", (), 0, k % 2 == 0) for k in range(COUNTS["healthy"])]
    wanted += [("unknown", (OUTSIDE[k % len(OUTSIDE)],), 1 + k % 2, k % 2 == 0) for k in range(COUNTS["unknown"])]
    wanted += [("contact", ("contact",), 1 + k % 2, k % 2 == 0) for k in range(COUNTS["contact"])]
    specs = [_spec(seed, k, *what) for k, what in enumerate(wanted)]
    if count is None or count >= len(specs):
        return specs
    return [specs[int(k)] for k in (np.arange(count) + 0.5) * len(specs) / count]


def _spec(seed: int, number: int, kind: str, effects: tuple[str, ...], grade: int, small: bool) -> SecondSpec:
    rng = np.random.default_rng([seed, number, 7])
    return SecondSpec(
        number,
        (seed, number),
        kind,
        effects,
        grade,
        float(rng.uniform(0.005, 0.03)) if small else 0.0,
        str(rng.choice(ARMS)),
        float(rng.integers(20, 36)),
        bool(rng.random() < 0.25),
        SecondSensors.drawn(rng),
    )


def build(spec: SecondSpec) -> Case:
    """Simulate a case."""
    rng = np.random.default_rng([*spec.seed, 8])
    robot = arm(spec.arm)
    change = bool(set(spec.effects) & set(CHANGES))
    model = perturbed(robot.model, rng)
    paths = [motion(robot, spec.duration, spec.moves and k == 1, rng) for k in range(3 if change else 2)]
    drive = Drive.plausible(rng, paths[0], rnea(model, robot, paths[0]))
    worlds = [prescribed(model, robot, path, drive, k, soft_sign(path.v, 5e-4)) for k, path in enumerate(paths)]
    scale = torque_scale(worlds)
    baseline, parts = Baseline(worlds, scale), []
    low, high = GRADES.get(spec.grade, (0.0, 0.0))
    for name in spec.effects:
        parts.append(_part(name, worlds, scale, float(np.exp(rng.uniform(np.log(low), np.log(high)))), rng, baseline))
    small, kinds = _background(spec, worlds, scale, rng)
    logs = []
    for k, w in enumerate(worlds):
        torque = w.base + small[k] + sum((p.torque[k] for p in parts), np.zeros(1))
        noise = np.random.default_rng([*spec.seed, 9, k])
        logs.append(record(w, torque, scale, spec.sensors, noise, f"case {spec.number} log {k}"))
    truth = Truth(
        ("unknown",) * len(parts) if spec.kind == "unknown" else spec.effects,
        tuple(tuple(robot.joints[j] for j in p.joints) for p in parts),
        spec.grade,
        tuple(p.size for p in parts),
        tuple(p.visible for p in parts),
        tuple(p.detail for p in parts),
        spec.background,
        float(rms(baseline.left(small[0]))),
        kinds,
        spec.arm,
        "second",
        "",
    )
    return Case(spec, robot, logs[:1], logs[1:2], logs[2:], truth)


def _part(
    name: str, worlds: list[World], scale: Array, target: float, rng: np.random.Generator, baseline: Baseline
) -> Part:
    """Draw an effect, up to five times until the baseline absorbs less than nine tenths, and scale it."""
    best: Part | None = None
    for _ in range(5):
        j = loaded_joint(rng, worlds[0], scale) if name in LOADED else int(rng.integers(len(scale)))
        hidden = MAKERS[name](rng, worlds[0], j)
        counted = [(hidden.size or hidden.torque)(w) for w in worlds[:2]]
        factor = target / float((acting(counted) / scale).max())
        torque = [factor * hidden.torque(w) if w.number < 2 else np.zeros_like(w.base) for w in worlds]
        part = Part(
            hidden.joints, torque, [{}] * len(worlds), target, float(baseline.left(torque[0]).max()), hidden.detail
        )
        if best is None or part.visible > best.visible:
            best = part
        if part.visible > 0.1 * target:
            break
    assert best is not None
    return best


def _background(
    spec: SecondSpec, worlds: list[World], scale: Array, rng: np.random.Generator
) -> tuple[list[Array], tuple[str, ...]]:
    """Two to four small effects of other kinds, the same kinds on every joint."""
    total = [np.zeros_like(w.base) for w in worlds]
    if not spec.background:
        return total, ()
    kinds = tuple(
        str(n) for n in rng.choice([n for n in SMALL if n not in spec.effects], int(rng.integers(2, 5)), False)
    )
    for j in range(len(scale)):
        column = [np.zeros(len(w.base)) for w in worlds]
        for kind in kinds:
            hidden = MAKERS[kind](rng, worlds[0], j)
            torque = [hidden.torque(w)[:, j] for w in worlds]
            weight = rng.uniform(0.5, 1.0) / max(float(acting(torque)), 1e-12)
            column = [a + weight * b for a, b in zip(column, torque, strict=True)]
        factor = spec.background * scale[j] / max(float(acting(column)), 1e-12)
        for k, x in enumerate(column):
            total[k][:, j] = factor * x
    return total, kinds


def motion(robot: Robot, duration: float, moves: bool, rng: np.random.Generator) -> Path:
    """A quintic spline through random points at random times; or moves with trapezoidal speed and rests between."""
    lower, upper = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    middle, reach = (upper + lower) / 2, 0.7 * (upper - lower) / 2
    t = np.arange(round(duration / STEP) + 1) * STEP
    J = len(middle)
    if moves:
        q = np.empty((len(t), J))
        for j in range(J):
            q[:, j] = _trapezoids(t, middle[j], reach[j], rng)
        q = gaussian_filter1d(q, 0.02 / STEP, axis=0)  # a drive does not jerk
    else:
        gaps = rng.uniform(0.7, 1.6, int(duration / 0.7) + 8)
        knots = np.concatenate([[0.0], np.cumsum(gaps)])
        points = middle + reach * rng.uniform(-1, 1, (len(knots), J)) * rng.uniform(0.3, 1.0, J)
        limit = np.minimum(robot.limits.velocity, 3.0)
        slow = float(np.max(np.abs(np.diff(points, axis=0)) / gaps[:, None] / (0.7 * limit)))
        knots = knots * max(1.0, slow)
        q = make_interp_spline(knots, points, k=5)(t)
        q = middle + (q - middle) / np.maximum(np.abs(q - middle).max(axis=0) / (1.3 * reach), 1.0)  # it overshoots
    v = np.gradient(q, STEP, axis=0)
    return Path(t, q, v, np.gradient(v, STEP, axis=0))


def _trapezoids(t: Array, middle: float, reach: float, rng: np.random.Generator) -> Array:
    """Position of one joint that goes from point to point with trapezoidal speed."""
    now, q, start = float(middle), np.full(len(t), float(middle)), 0.3
    while start < t[-1]:
        goal = middle + reach * rng.uniform(-1, 1)
        ramp, cruise = rng.uniform(0.2, 0.5), rng.uniform(0.3, 1.2)
        x = np.clip(t - start, 0.0, 2 * ramp + cruise)
        up, down = np.minimum(x, ramp), np.maximum(x - ramp - cruise, 0.0)
        way = up**2 / 2 + ramp * np.clip(x - ramp, 0.0, cruise) + ramp * down - down**2 / 2
        share = way / (ramp * (ramp + cruise))
        q = np.where(t >= start, now + (goal - now) * share, q)
        now = goal
        start += 2 * ramp + cruise + float(rng.choice([0.0, rng.uniform(0.2, 1.0)]))
    return q


def record(
    world: World, torque: Array, scale: Array, sensors: SecondSensors, rng: np.random.Generator, name: str
) -> Log:
    """Record positions and torques; speeds and accelerations are left to the user's derivatives."""
    step = 1 / sensors.rate
    when = np.arange(1, int((world.path.t[-1] - 2 * step) * sensors.rate)) * step
    stamps = when + sensors.jitter * step * rng.uniform(-0.5, 0.5, len(when))  # the clock jitters, not the sampling
    q, tau = (np.stack([np.interp(when, world.path.t, c) for c in x.T], axis=1) for x in (world.path.q, torque))
    quantum = 2 * np.pi / 2**sensors.bits
    noise = rng.normal(size=tau.shape)
    if sensors.memory:
        pole = float(np.exp(-step / sensors.memory))
        noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], noise, axis=0)
    return Log(
        stamps,
        world.robot.joints,
        quantum * np.floor(q / quantum + 0.5),
        tau=tau + sensors.noise * scale * noise,
        source=name,
    )
