"""Hidden effects as torques along a motion, in shapes that are close to the catalogue's columns but not the same.

Examples are a friction peak with another exponent, a counterbalance that is not quite a spring, ripple with a second
harmonic, warming with two time constants, and friction with memory, integrated in time. Every maker here draws an
effect's shape at random and returns a `Hidden`: a torque of unit size, which is scaled later.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from hidden_physics import STEP, Array, World, direction, rms, rnea

Torque = Callable[[World], Array]


@dataclass(frozen=True, eq=False)
class Hidden:
    """An effect that the baseline model does not have.

    Attributes
    ----------
    torque : callable
        World -> torque of unit size, (N, J).
    joints : tuple of int
        Joints the effect acts on; empty for the whole robot.
    detail : str
        Its shape, for people.
    size : callable, optional
        World -> the part of the torque whose size counts; the whole torque by default.
    extra : callable, optional
        World -> further measured channels by name.
    """

    torque: Torque
    joints: tuple[int, ...]
    detail: str = ""
    size: Torque | None = None
    extra: Callable[[World], Mapping[str, Array]] | None = field(default=None)


Maker = Callable[[np.random.Generator, World, int], Hidden]
"""Random numbers, the motion to fit, and a joint -> an effect on that joint (or on several, where it needs several)."""


def loaded_joint(rng: np.random.Generator, fit: World, scale: Array) -> int:
    """Draw a joint with a noticeable torque from links and gravity, not only from its own drive."""
    share = fit.load.std(axis=0) / scale
    good = np.flatnonzero(share > 0.3)
    return int(rng.choice(good)) if len(good) else int(np.argmax(share))


def stribeck(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Friction peak at low speed, exponent between 0.7 and 1.8."""
    speed, power = rng.uniform(0.06, 0.25) * rms(fit.path.v)[j], rng.uniform(0.7, 1.8)
    return Hidden(
        lambda w: w.on(j, w.sign[:, j] * np.exp(-((np.abs(w.path.v[:, j]) / speed) ** power))),
        (j,),
        f"vs={speed:.3g}, delta={power:.2g}",
    )


def quadratic_viscous(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Drag whose exponent is not quite two."""
    power = rng.uniform(1.8, 2.3)
    return Hidden(
        lambda w: w.on(j, np.sign(w.path.v[:, j]) * np.abs(w.path.v[:, j]) ** power), (j,), f"|v|^{power:.2g}"
    )


def asymmetric_viscous(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Viscous friction in one direction only, with a soft corner."""
    corner, way = rng.uniform(0.0, 0.1) * rms(fit.path.v)[j], rng.choice([-1.0, 1.0])
    return Hidden(
        lambda w: w.on(j, way * (np.sqrt(w.path.v[:, j] ** 2 + corner**2) + way * w.path.v[:, j]) / 2),
        (j,),
        f"{way:+.0f}",
    )


def load_friction(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Dry friction that grows nearly in proportion to the load."""
    power = rng.uniform(0.85, 1.1)
    return Hidden(lambda w: w.on(j, w.sign[:, j] * np.abs(w.load[:, j]) ** power), (j,), f"|load|^{power:.2g}")


def hysteresis(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """LuGre bristles; their size is that of their difference from dry friction."""
    distance, peak, speed = rng.uniform(0.01, 0.06), rng.uniform(0.0, 0.05), 0.05
    return Hidden(
        lambda w: w.on(j, lugre(w.path.v[:, j], distance, peak, speed)),
        (j,),
        f"presliding {distance:.3g} rad",
        size=lambda w: w.on(j, lugre(w.path.v[:, j], distance, peak, speed) - w.sign[:, j]),
    )


def lugre(v: Array, distance: float, peak: float, speed: float, damping: float = 0.002) -> Array:
    """Friction of unit size with internal state: ``ż = v − |v| z / g(v)``, integrated exactly for v constant in a step.

    C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, "A new model for control of systems with friction",
    IEEE Trans. Automatic Control 40(3), 1995.
    """
    level = 1 + peak * np.exp(-((v / speed) ** 2))
    decay = np.exp(-np.abs(v) / (distance * level) * STEP)
    target = np.sign(v) * level
    z, state = np.empty_like(v), 0.0
    for k, (d, goal) in enumerate(zip(decay.tolist(), target.tolist(), strict=True)):
        state = goal + (state - goal) * d
        z[k] = state
    return z + damping * np.gradient(z, STEP)


def cogging(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Torque ripple with a second harmonic."""
    least = max(3.0, 2 * 2 * np.pi / np.ptp(fit.path.q[:, j]))
    count = round(np.exp(rng.uniform(np.log(least), np.log(max(32.0, 1.5 * least)))))
    phase, second = rng.uniform(0, 2 * np.pi, 2), rng.uniform(0.0, 0.15)

    def torque(w: World) -> Array:
        angle = count * w.path.q[:, j]
        return w.on(j, np.sin(angle + phase[0]) + second * np.sin(2 * angle + phase[1]))

    return Hidden(torque, (j,), f"N={count}")


def joint_spring(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A spring that hardens, a hydraulic counterbalance with its geometry, or a hose that pulls in one direction."""
    kind = int(rng.integers(3))
    q = fit.path.q[:, j]
    centre, reach = q.mean() + rng.uniform(-0.5, 0.5) * np.ptp(q), np.ptp(q) / 2
    if kind == 0:
        cubic = rng.uniform(0.1, 0.4) / reach**2
        return Hidden(
            lambda w: w.on(j, (w.path.q[:, j] - centre) + cubic * (w.path.q[:, j] - centre) ** 3), (j,), "hardening"
        )
    if kind == 1:
        arm, rest = rng.uniform(0.2, 0.5), rng.uniform(0.2, 0.5)

        def cylinder(w: World) -> Array:
            angle = w.path.q[:, j] - centre
            length = np.sqrt(1 + arm**2 - 2 * arm * np.cos(angle))
            return w.on(j, arm * np.sin(angle) / length * (length - rest))

        return Hidden(cylinder, (j,), "hydraulic")
    soft = rng.uniform(0.3, 0.8) * reach
    return Hidden(lambda w: w.on(j, np.logaddexp(0.0, (w.path.q[:, j] - centre) / soft)), (j,), "hose")


def joint_coupling(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A motor that turns with the sum or difference of two neighbouring joints."""
    i = min(j, fit.path.q.shape[1] - 2)
    way = rng.choice([-1.0, 1.0])

    def motor(w: World) -> tuple[Array, Array]:
        return w.path.v[:, i] + way * w.path.v[:, i + 1], w.path.a[:, i] + way * w.path.a[:, i + 1]

    v, a = motor(fit)
    share = rng.uniform(0.3, 1.0, 3) / [rms(v), 1.0, rms(a)] * [1.0, 1.0, 0.5]

    def torque(w: World) -> Array:
        v, a = motor(w)
        f = share[0] * v + share[1] * direction(v[:, None])[:, 0] + share[2] * a
        return w.on(i, f) + w.on(i + 1, way * f)

    return Hidden(torque, (i, i + 1), f"sign {way:+.0f}")


def thermal_drift(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Friction that falls or grows while the gear warms up, with two time constants; temperature measured in some."""
    fast, slow, share = rng.uniform(3.0, 8.0), rng.uniform(15.0, 60.0), rng.uniform(0.4, 0.8)
    measured, falls = rng.random() < 0.35, rng.random() < 0.7
    viscous, coulomb = fit.drive.viscous[j], fit.drive.coulomb[j]

    def friction(w: World) -> Array:
        return viscous * w.path.v[:, j] + coulomb * w.sign[:, j]

    def warmth(w: World) -> Array:
        before = 8.0 if measured and w.number == 1 else 0.0
        t = w.path.t + before
        return 1 - share * np.exp(-t / fast) - (1 - share) * np.exp(-t / slow)

    def temperature(w: World) -> Mapping[str, Array]:
        noise = np.random.default_rng(w.number).normal(scale=0.05, size=len(w.path.t))
        return {f"temperature_{w.robot.joints[j]}": 25.0 + 15.0 * warmth(w) + noise}

    return Hidden(
        lambda w: w.on(j, (1 - warmth(w) if falls else warmth(w)) * friction(w)),
        (j,),
        f"{'falls' if falls else 'grows'}, {fast:.0f} s and {slow:.0f} s{', temperature measured' if measured else ''}",
        extra=temperature if measured else None,
    )


def payload(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A body gripped by the last link."""
    last = fit.model.njoints - 1
    lever = tip(fit.model) * rng.uniform(0.8, 1.3) + rng.normal(scale=0.02, size=3)
    radius = rng.uniform(0.02, 0.05)
    body = pin.Inertia(1.0, lever, 0.4 * radius**2 * np.eye(3))

    def torque(w: World) -> Array:
        return rnea(loaded(w.model, body), w.robot, w.path) - w.load

    return Hidden(torque, (last - 1,), "on the last link")


def loaded(model: Any, body: Any) -> Any:
    """Copy of a model whose last link carries another body."""
    other = pin.Model(model)
    other.inertias[model.njoints - 1] = model.inertias[model.njoints - 1] + body
    return other


def tip(model: Any) -> Array:
    """Farthest fixed frame on the last link, in its joint frame."""
    on_last = [f.placement.translation for f in model.frames if f.parentJoint == model.njoints - 1]
    far = max(on_last, key=lambda x: float(np.linalg.norm(x)))
    return far if np.linalg.norm(far) > 0.02 else np.array([0.03, 0.0, 0.05])


def gravity_tilt(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Gravity turned by a small angle about a horizontal axis; the torque is proportional to the angle."""
    g = np.array(fit.model.gravity.linear)
    heading = rng.uniform(0, 2 * np.pi)
    aside = np.linalg.norm(g) * np.array([np.cos(heading), np.sin(heading), 0.0])

    def torque(w: World) -> Array:
        other = pin.Model(w.model)
        other.gravity.linear = g + aside
        return rnea(other, w.robot, w.path) - w.load

    return Hidden(torque, (), f"heading {heading:.2g} rad")


def contact(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Pushes against the tip, one to three in a log; in some cases also in the second log."""
    seeds = rng.integers(2**31, size=3)
    touched = [True, bool(rng.random() < 0.3), False]

    def torque(w: World) -> Array:
        out = np.zeros_like(w.path.q)
        draw = np.random.default_rng(seeds[w.number])
        for _ in range(int(draw.integers(1, 4)) if touched[w.number] else 0):
            length, direction3 = draw.uniform(0.3, 2.0), draw.normal(size=3)
            start = draw.uniform(1.0, w.path.t[-1] - 1.0 - length)
            rows = np.flatnonzero((w.path.t >= start) & (w.path.t <= start + length))
            x = (w.path.t[rows] - start) / length
            strength = np.clip(np.minimum(x, 1 - x) / draw.uniform(0.05, 0.5), 0, 1)
            force = direction3 / np.linalg.norm(direction3) * draw.uniform(0.6, 1.0)
            out[rows] -= strength[:, None] * _tip_torque(w, rows, force)
        return out

    return Hidden(torque, (), "pushes at the tip")


def _tip_torque(w: World, rows: Array, force: Array) -> Array:
    """Jᵀ f of a force in the world frame at the tip, (len(rows), J)."""
    model, data, last = w.model, w.model.createData(), w.model.njoints - 1
    point = tip(model)
    out = np.empty((len(rows), model.nv))
    for k, q in enumerate(w.robot.configuration(w.path.q[rows])):
        pin.computeJointJacobians(model, data, q)
        J = pin.getJointJacobian(model, data, last, pin.LOCAL)
        local = data.oMi[last].rotation.T @ force
        out[k] = J[:3].T @ local + J[3:].T @ np.cross(point, local)
    return out


SHAPES: dict[str, Maker] = {
    maker.__name__: maker
    for maker in (
        stribeck,
        quadratic_viscous,
        asymmetric_viscous,
        load_friction,
        hysteresis,
        cogging,
        joint_spring,
        joint_coupling,
        thermal_drift,
        payload,
        gravity_tilt,
        contact,
    )
}
"""Effects that are a torque along a given motion, by their name in the catalogue."""
SMALL = (
    "stribeck",
    "quadratic_viscous",
    "asymmetric_viscous",
    "load_friction",
    "hysteresis",
    "cogging",
    "joint_spring",
    "joint_coupling",
    "thermal_drift",
)
"""Effects of a background, which may also have torques outside the catalogue."""
