"""Hidden effects of the second generator: laws from the literature that share no shape with `hidden_shapes`.

Where the first generator bends the catalogue's own columns a little, each effect here is another author's law of the
same cause. Written before any result was seen. Each maker draws constants and returns a `Hidden`.

Sources, one per effect: Hess and Soom 1990 (ASME J. Tribology 112); Changenet and Velex 2007 (J. Mech. Design 129);
Eyring 1936 (J. Chem. Phys. 4); Pennestrì and Freudenstein 1993 (J. Mech. Design 115) on efficiency in both directions
of power; Lampaert, Al-Bender and Swevers 2003 (generalised Maxwell slip); Tuttle and Seering 1996 (IEEE Trans. Robotics
and Automation 12) on the ripple of strain-wave gears; Bittencourt and Axelsson 2014 (IEEE/ASME Trans. Mechatronics 19)
on self-heating; Nordin and Gutman 2002 (Automatica 38) on play; Ruderman, Hoffmann and Bertram 2009 (IEEE Trans.
Industrial Electronics 56) on hardening stiffness.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from hidden_physics import STEP, Array, Path, World, rms, rnea
from hidden_shapes import Hidden, Maker, tip
from scipy.ndimage import gaussian_filter1d


def soft_sign(v: Array, width: float) -> Array:
    """Direction of motion with an algebraic corner."""
    return np.asarray(v / np.sqrt(v**2 + width**2))


def hess_soom(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Friction peak with a rational fall, 1 / (1 + (v/vs)²)."""
    speed = rng.uniform(0.05, 0.25) * rms(fit.path.v)[j]
    return Hidden(
        lambda w: w.on(j, soft_sign(w.path.v[:, j], 0.002) / (1 + (w.path.v[:, j] / speed) ** 2)), (j,), f"{speed:.3g}"
    )


def churning(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Oil churning, |v|^1.75 as of turbulent flow, with a threshold below which it is laminar."""
    edge, top = rng.uniform(0.1, 0.5) * rms(fit.path.v)[j], rms(fit.path.v)[j]

    def torque(w: World) -> Array:
        v = w.path.v[:, j]
        return w.on(j, np.sign(v) * np.maximum(np.abs(v) - edge, 0.0) ** 1.75 / top)

    return Hidden(torque, (j,), f"from {edge:.3g} rad/s")


def one_way_fluid(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Eyring friction asinh(v/vb), in one direction stronger than in the other."""
    knee, way = rng.uniform(0.5, 2.0) * rms(fit.path.v)[j], rng.choice([-1.0, 1.0])
    return Hidden(
        lambda w: w.on(j, np.where(way * w.path.v[:, j] > 0, np.arcsinh(w.path.v[:, j] / knee), 0.0)),
        (j,),
        f"{way:+.0f}",
    )


def ratchet(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Seal that grips in one direction only; it lets go at standstill."""
    way = rng.choice([-1.0, 1.0])
    return Hidden(lambda w: w.on(j, way * np.clip(way * w.path.v[:, j] / 0.01, 0.0, 1.0)), (j,), f"{way:+.0f}")


def gear_loss(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Loss of the teeth: a share of the power, larger when the load drives the motor than when the motor drives."""
    share, rest = rng.uniform(0.3, 0.9), rng.uniform(0.0, 0.2) * rms(fit.load)[j]

    def torque(w: World) -> Array:
        load, v = w.load[:, j], w.path.v[:, j]
        driving = 0.5 * (1 + np.tanh(load * v / (0.1 * rms(fit.load * fit.path.v)[j])))
        return w.on(j, soft_sign(v, 0.002) * (np.abs(load) + rest) * (share + (1 - share) * (1 - driving)))

    return Hidden(torque, (j,), f"share {share:.2f}")


def maxwell_slip(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Six springs in parallel, each of which slips at its own force; the size is that beside dry friction."""
    reach = rng.uniform(0.01, 0.06) * np.linspace(0.15, 2.0, 6)
    force = rng.dirichlet(np.full(6, 3.0))

    def friction(v: Array) -> Array:
        total = np.zeros_like(v)
        for limit, weight in zip(reach.tolist(), force.tolist(), strict=True):
            z, out = 0.0, np.empty_like(v)
            for k, dq in enumerate((v * STEP).tolist()):
                z = min(max(z + dq / limit, -1.0), 1.0)
                out[k] = z
            total += weight * out
        return total

    return Hidden(
        lambda w: w.on(j, friction(w.path.v[:, j])),
        (j,),
        f"slips over {reach[-1]:.3g} rad",
        size=lambda w: w.on(j, friction(w.path.v[:, j]) - w.sign[:, j]),
    )


def strain_wave(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Ripple twice per turn of a wave generator; its height follows the angle of the flexspline slowly."""
    least = max(4.0, 3 * 2 * np.pi / np.ptp(fit.path.q[:, j]))
    count, phase = float(round(rng.uniform(least, least + 30))), rng.uniform(0, 2 * np.pi, 3)

    def torque(w: World) -> Array:
        q = w.path.q[:, j]
        height = 1 + 0.25 * np.sin(q + phase[2])
        return w.on(j, height * np.sin(count * q + phase[0] + 0.2 * np.sin(count * q + phase[1])))

    return Hidden(torque, (j,), f"N={count:.0f}")


def gas_spring(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A gas spring on a crank: nearly constant force, a lever that changes with the angle."""
    q = fit.path.q[:, j]
    zero, base, crank = q.mean() + rng.uniform(-1, 1) * np.ptp(q), rng.uniform(1.5, 3.0), 1.0
    rise = rng.uniform(0.0, 0.4)

    def torque(w: World) -> Array:
        angle = w.path.q[:, j] - zero
        length = np.sqrt(base**2 + crank**2 - 2 * base * crank * np.cos(angle))
        force = (base / length) ** (1 + rise)
        return w.on(j, force * base * crank * np.sin(angle) / length)

    return Hidden(torque, (j,), f"base {base:.2f}")


def differential(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A motor behind two joints: friction with a peak at low speed, and its rotor."""
    i, way = min(j, fit.path.q.shape[1] - 2), rng.choice([-1.0, 1.0])
    parts = rng.uniform(0.4, 1.0, 3)

    def motor(w: World) -> tuple[Array, Array]:
        return w.path.v[:, i] + way * w.path.v[:, i + 1], w.path.a[:, i] + way * w.path.a[:, i + 1]

    v0, a0 = motor(fit)
    scale = rms(v0), rms(a0)

    def torque(w: World) -> Array:
        v, a = motor(w)
        dry = np.arctan(v / 0.003) * 2 / np.pi * (1 + 0.15 / (1 + (v / (0.1 * scale[0])) ** 2))
        f = parts[0] * dry + parts[1] * v / scale[0] + 0.5 * parts[2] * a / scale[1]
        return w.on(i, f) + w.on(i + 1, way * f)

    return Hidden(torque, (i, i + 1), f"sign {way:+.0f}")


def self_heating(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Grease that thins as its own friction heats it: ϑ̇ = power − ϑ/T, viscosity falls as exp(−ϑ)."""
    memory, depth = rng.uniform(8.0, 25.0), rng.uniform(0.4, 1.2)
    viscous, coulomb = fit.drive.viscous[j], fit.drive.coulomb[j]
    power0 = float(np.mean(np.abs(fit.path.v[:, j]) * coulomb + viscous * fit.path.v[:, j] ** 2))

    def torque(w: World) -> Array:
        v = w.path.v[:, j]
        power = (np.abs(v) * coulomb + viscous * v**2) / power0
        heat, out = 0.0, np.empty_like(v)
        for k, p in enumerate(power.tolist()):
            heat += STEP * (p - heat) / memory
            out[k] = heat
        return w.on(j, (np.exp(-depth * out) - 1) * (viscous * v + coulomb * soft_sign(v, 0.002)))

    return Hidden(torque, (j,), f"{memory:.0f} s")


def box(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A box in the gripper, long in one direction and held off its middle."""
    last = fit.model.njoints - 1
    sides = rng.uniform(0.03, 0.25, 3)
    lever = tip(fit.model) * rng.uniform(0.9, 1.5) + rng.uniform(-0.4, 0.4, 3) * sides
    turn = pin.rpy.rpyToMatrix(*rng.uniform(-np.pi, np.pi, 3))
    body = pin.Inertia.FromBox(1.0, *sides)
    held = pin.Inertia(1.0, lever, turn @ body.inertia @ turn.T)

    def torque(w: World) -> Array:
        other = pin.Model(w.model)
        other.inertias[last] = w.model.inertias[last] + held
        return rnea(other, w.robot, w.path) - w.load

    return Hidden(torque, (last - 1,), "box")


def settled_base(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A base that has turned by a finite angle of one to six degrees."""
    axis = rng.normal(size=2)
    angle = np.radians(rng.uniform(1.0, 6.0))
    turn = pin.exp3(angle * np.append(axis / np.linalg.norm(axis), 0.0))

    def torque(w: World) -> Array:
        other = pin.Model(w.model)
        other.gravity.linear = turn.T @ np.array(w.model.gravity.linear)
        return rnea(other, w.robot, w.path) - w.load

    return Hidden(torque, (), f"{np.degrees(angle):.1f} degrees")


def play(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A gear with play that moves slowly: torque of the load through a gap, clipped where the teeth press."""
    knee = rng.uniform(0.05, 0.5) * rms(fit.load - fit.load.mean(axis=0))[j]
    return Hidden(lambda w: w.on(j, np.clip(w.load[:, j] / knee, -1.0, 1.0)), (j,), f"knee {knee:.3g} N·m")


def hardening(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A gear that is soft at small load: the link lags by δ(load) = c asinh(load/l), all joints feel its motion."""
    knee, size = rng.uniform(1.0, 4.0) * rms(fit.load)[j], 1e-3

    def torque(w: World) -> Array:
        lag = size * np.arcsinh(gaussian_filter1d(w.load[:, j], 10) / knee)
        rate = np.gradient(lag, STEP)
        link = [x.copy() for x in (w.path.q, w.path.v, w.path.a)]
        for x, change in zip(link, (lag, rate, np.gradient(rate, STEP)), strict=True):
            x[:, j] -= change
        return rnea(w.model, w.robot, Path(w.path.t, *link)) - w.load

    return Hidden(torque, (j,), f"knee {knee:.3g} N·m")


def current_filter(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """The drive smooths the current it reports: a first-order lag in all joints or in one."""
    memory, joints = 0.01, (j,) if rng.random() < 0.5 else ()

    def torque(w: World) -> Array:
        out = np.zeros_like(w.base)
        pole = float(np.exp(-STEP / memory))
        for i in joints or range(w.base.shape[1]):
            y, late = float(w.base[0, i]), np.empty(len(w.base))
            for k, x in enumerate(w.base[:, i].tolist()):
                y = pole * y + (1 - pole) * x
                late[k] = y
            out[:, i] = late - w.base[:, i]
        return out

    return Hidden(torque, joints, "lag")


def saturating_motor(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Torque per current that changed, and falls a little at large current."""
    way, bend = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 0.1)
    top = np.abs(fit.base[:, j]).max()
    return Hidden(lambda w: w.on(j, way * w.base[:, j] * (1 - bend * (w.base[:, j] / top) ** 2)), (j,), f"{way:+.0f}")


def pushed_elbow(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Somebody leans against the far end of a middle link in one log, once or twice: half a sine over time."""
    seed, after = int(rng.integers(2**31)), min(fit.model.njoints // 2 + 1, fit.model.njoints - 1)

    def torque(w: World) -> Array:
        out = np.zeros_like(w.base)
        if w.number != 0:
            return out
        draw, data = np.random.default_rng(seed), w.model.createData()
        for _ in range(int(draw.integers(1, 3))):
            length = draw.uniform(0.4, 1.5)
            start = draw.uniform(1.0, w.path.t[-1] - 1.0 - length)
            rows = np.flatnonzero((w.path.t >= start) & (w.path.t <= start + length))
            force = draw.normal(size=3)
            force *= draw.uniform(0.6, 1.0) / np.linalg.norm(force)
            for k, q in zip(rows.tolist(), w.robot.configuration(w.path.q[rows]), strict=True):
                pin.computeJointJacobians(w.model, data, q)
                J = pin.getJointJacobian(w.model, data, after, pin.LOCAL_WORLD_ALIGNED)[:3]  # where a link ends
                out[k] -= np.sin(np.pi * (w.path.t[k] - start) / length) * (J.T @ force)
        return out

    return Hidden(torque, (), "leaned against")


def eccentric(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """A ring gear out of centre: a share of the load that follows the angle."""
    phase, turns = rng.uniform(0, 2 * np.pi), float(rng.integers(2, 5))
    return Hidden(lambda w: w.on(j, w.load[:, j] * np.sin(turns * w.path.q[:, j] + phase)), (j,), "out of centre")


def rubbing_cover(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Dry friction in one part of the joint's range only."""
    q = fit.path.q[:, j]
    middle, width = rng.uniform(np.quantile(q, 0.2), np.quantile(q, 0.8)), rng.uniform(0.1, 0.3) * np.ptp(q)

    def torque(w: World) -> Array:
        near = 1 / (1 + ((w.path.q[:, j] - middle) / width) ** 4)
        return w.on(j, near * soft_sign(w.path.v[:, j], 0.002))

    return Hidden(torque, (j,), f"at {middle:.2f} rad")


def slipping_offset(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """The zero of a torque sensor that jumps a few times in a log."""
    seeds = rng.integers(2**31, size=3)

    def torque(w: World) -> Array:
        draw = np.random.default_rng(seeds[w.number])
        edges = np.sort(draw.uniform(0, w.path.t[-1], int(draw.integers(2, 6))))
        return w.on(j, draw.normal(size=len(edges) + 1)[np.searchsorted(edges, w.path.t)])

    return Hidden(torque, (j,), "jumps in time")


MAKERS: dict[str, Maker] = {
    "stribeck": hess_soom,
    "quadratic_viscous": churning,
    "asymmetric_viscous": one_way_fluid,
    "asymmetric_coulomb": ratchet,
    "load_friction": gear_loss,
    "hysteresis": maxwell_slip,
    "cogging": strain_wave,
    "joint_spring": gas_spring,
    "joint_coupling": differential,
    "thermal_drift": self_heating,
    "gear_play": play,
    "elasticity": hardening,
    "time_delay": current_filter,
    "drive_gain": saturating_motor,
    "payload": box,
    "gravity_tilt": settled_base,
    "contact": pushed_elbow,
    "eccentric": eccentric,
    "rubbing_cover": rubbing_cover,
    "slipping_offset": slipping_offset,
}
"""Name in the catalogue (or of a cause outside it) -> maker."""
OUTSIDE = ("eccentric", "rubbing_cover", "slipping_offset")
