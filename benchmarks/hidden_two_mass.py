"""Flexible gears and backlash: the motor and the link of one joint as two masses, simulated under feedback.

    link:   M(q) q̈ + h(q, q̇) + f_link(q̇) = τ_s
    motor:  Ia θ̈ + fv θ̇ + f_motor(θ̇) + off + τ_s = τ_m
    gear:   τ_s = k gap(θ − q, b) + d (θ̇ − q̇) while teeth touch;    gap(x, b) = x − clip(x, −b, b)

τ_m is a feedforward of the rigid arm plus proportional-derivative feedback on θ. The encoder sits on the motor. All
other joints follow their motion exactly; their torques include the reaction to the link's true motion. The link's own
torque is linearised about a path close to the link's, with an error of second order in the deflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import tanh

import numpy as np
import pinocchio as pin
from hidden_physics import SMOOTH, STEP, Array, Path, World, prescribed, rms, rnea
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

SUBSTEPS = 4
BANDWIDTH = 2 * np.pi * 8.0
"""Bandwidth of the position control, rad/s."""


@dataclass(frozen=True)
class Gear:
    """Gear between motor and link: stiffness (N·m/rad), half the gap (rad), damping, link's share of the friction."""

    stiffness: float
    gap: float = 0.0
    damping_ratio: float = 0.04
    link_share: float = 0.3


def simulated(rigid: World, j: int, gear: Gear) -> tuple[World, Array]:
    """Drive joint j through a gear.

    Parameters
    ----------
    rigid : World
        The desired motion, and its torque with a rigid gear.
    j : int
    gear : Gear

    Returns
    -------
    World
        Motion that the encoders measure, and its torque if the gear were rigid.
    ndarray, shape (N, J)
        Additional torque caused by the gear.
    """
    wanted = _smoothed(rigid)
    theta, link, motor = _two_masses(wanted, j, gear)
    seen, true = _replaced(rigid.path, j, theta), _replaced(rigid.path, j, link)
    world = prescribed(rigid.model, rigid.robot, seen, rigid.drive, rigid.number, np.tanh(seen.v / SMOOTH))
    torque = rnea(rigid.model, rigid.robot, true) + rigid.drive.torque(seen, world.sign)
    torque[:, j] = motor
    return world, torque - world.base


def _smoothed(rigid: World) -> World:
    """The same world with the smoothed dry friction of the integrator."""
    sign = np.tanh(rigid.path.v / SMOOTH)
    return replace(rigid, base=rigid.load + rigid.drive.torque(rigid.path, sign), sign=sign)


def error_size(rigid: Sequence[World], j: int, gear: Gear) -> float:
    """Size of the torque that a gear adds to its own joint in some motions."""
    added = []
    for world in rigid:
        theta, _, motor = _two_masses(_smoothed(world), j, gear)
        seen = _replaced(world.path, j, theta)
        drive = world.drive.torque(seen, np.tanh(seen.v / SMOOTH))
        added.append(in_band(motor - rnea(world.model, world.robot, seen)[:, j] - drive[:, j]))
    return float(rms(np.concatenate(added)))


def tuned(rigid: Sequence[World], j: int, gear: Gear, target: float, scale: float) -> Gear:
    """Soften or widen a gear until its torque error on the joint is `target` times `scale`."""
    for _ in range(6):
        size = error_size(rigid, j, gear) / scale
        if 0.88 < size / target < 1.14:
            break
        step = float(np.clip(target / size, 0.02, 20.0))
        gear = replace(gear, gap=gear.gap * step) if gear.gap else replace(gear, stiffness=gear.stiffness / step)
    return gear


def in_band(torque: Array) -> Array:
    """Torque without a gear's oscillation above 10 Hz, which any identification filters out, (N,)."""
    return np.asarray(sosfiltfilt(butter(4, 10.0, fs=1 / STEP, output="sos"), torque))


def reversing(rigid: World, scale: Array, link_share: float = 0.5) -> NDArray[np.intp]:
    """Joints whose gear torque is large enough and changes its sign often enough to show play."""
    through = rigid.load + link_share * rigid.drive.coulomb * rigid.sign
    times = (np.diff(np.sign(through), axis=0) != 0).sum(axis=0)
    good = np.flatnonzero((times >= 6) & (through.std(axis=0) > 0.15 * scale))
    return good if len(good) else np.array([int(np.argmax(times))])


def elastic(rigid: Sequence[World], j: int, target: float, scale: float) -> Gear:
    """Flexible gear with an effect of a given size."""
    fit = rigid[0]
    fall = np.gradient(np.gradient(fit.load[:, j], STEP), STEP) * _inertia(fit, j).mean()
    stiffness = rms(fall) / (target * scale)
    return tuned(rigid, j, Gear(float(stiffness)), target, scale)


def loose(rigid: Sequence[World], j: int, target: float, scale: float) -> Gear:
    """Stiff gear with play, with an effect of a given size."""
    fit = rigid[0]
    inertia, rotor = float(_inertia(fit, j).min()), float(fit.drive.rotor[j])
    stiffness = min(inertia * (2 * np.pi * 25.0) ** 2, rotor * 800.0**2)
    return tuned(rigid, j, Gear(stiffness, 0.05 * target / 0.1, 0.3, 0.5), target, scale)


def _replaced(path: Path, j: int, motion: tuple[Array, Array, Array]) -> Path:
    columns = [x.copy() for x in (path.q, path.v, path.a)]
    for column, values in zip(columns, motion, strict=True):
        column[:, j] = values
    return Path(path.t, *columns)


def _inertia(world: World, j: int, every: int = 20) -> Array:
    """Link-side inertia about joint j along the motion, without the rotor."""
    return _derivatives(world, world.path, j, every)[2]


def _derivatives(world: World, path: Path, j: int, every: int = 20) -> tuple[Array, Array, Array]:
    """∂τ_j/∂q_j, ∂τ_j/∂q̇_j and M_jj along a motion, (N,) each, from every few samples."""
    model, data = world.model, world.model.createData()
    rows = np.arange(0, len(path.t), every)
    found = np.empty((len(rows), 3))
    configurations = world.robot.configuration(path.q[rows])
    for k, (q, v, a) in enumerate(zip(configurations, path.v[rows], path.a[rows], strict=True)):
        pin.computeRNEADerivatives(model, data, q, v, a)
        found[k] = data.dtau_dq[j, j], data.dtau_dv[j, j], data.M[j, j]
    stiffness, damping, inertia = (np.interp(path.t, path.t[rows], x) for x in found.T)
    return stiffness, damping, inertia


Trace = tuple[Array, Array, Array]


def _two_masses(wanted: World, j: int, gear: Gear) -> tuple[Trace, Trace, Array]:
    """Integrate both masses: position, velocity and acceleration of motor and link, and the motor's torque."""
    path, drive = wanted.path, wanted.drive
    sag = wanted.load[:, j] / gear.stiffness if not gear.gap else np.zeros(len(path.t))
    speed = np.gradient(sag, STEP)
    near = _replaced(path, j, (path.q[:, j] - sag, path.v[:, j] - speed, path.a[:, j] - np.gradient(speed, STEP)))
    load = (wanted.load if gear.gap else rnea(wanted.model, wanted.robot, near))[:, j]
    K, D, M = _derivatives(wanted, near, j)
    # τ_link = M q̈ + rest, with rest = load − M a_near + K (q − q_near) + D (q̇ − v_near)
    constant = load - M * near.a[:, j] - K * near.q[:, j] - D * near.v[:, j]
    given = (path.q[:, j], path.v[:, j], wanted.base[:, j], constant, K, D, M)
    fine = np.arange((len(path.t) - 1) * SUBSTEPS + 1) * (STEP / SUBSTEPS)
    rows = zip(*(np.interp(fine, path.t, x).tolist() for x in given), strict=True)

    rotor, viscous, offset = float(drive.rotor[j]), float(drive.viscous[j]), float(drive.offset[j])
    dry_link, dry_motor = gear.link_share * float(drive.coulomb[j]), (1 - gear.link_share) * float(drive.coulomb[j])
    inertia = float(M.mean())
    damping = 2 * gear.damping_ratio * np.sqrt(gear.stiffness * inertia * rotor / (inertia + rotor))
    kp = (inertia + rotor) * BANDWIDTH**2
    kd = 1.4 * (inertia + rotor) * BANDWIDTH
    k, b, h, narrow = gear.stiffness, gear.gap, STEP / SUBSTEPS, SMOOTH
    x, dx = float(path.q[0, j]), float(path.v[0, j])
    y, dy = x - float(load[0]) / k - float(np.copysign(b, load[0])), float(near.v[0, j])
    out = []
    for number, (qr, vr, forward, c, kq, kv, m) in enumerate(rows):
        twist = x - y
        tooth = twist - b if twist > b else twist + b if twist < -b else 0.0
        spring = k * tooth + damping * (dx - dy) if tooth or not b else 0.0
        motor = forward + kp * (qr - x) + kd * (vr - dx)
        ddy = (spring - c - kq * y - kv * dy - dry_link * tanh(dy / narrow)) / m
        ddx = (motor - spring - viscous * dx - dry_motor * tanh(dx / narrow) - offset) / rotor
        if number % SUBSTEPS == 0:
            out.append((x, dx, ddx, y, dy, ddy, motor))
        dx += h * ddx
        dy += h * ddy
        x += h * dx
        y += h * dy
    made = np.array(out).T
    return (made[0], made[1], made[2]), (made[3], made[4], made[5]), made[6]
