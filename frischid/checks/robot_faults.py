"""Parts of a robot that its URDF lacks: a tilted base, a body on its last link, motors that turn with two joints.

All three add a torque that is linear in a few parameters and shared by several rows, as gravity does that a controller
took off its torques before they were recorded:

    gravity    Σ_i g_i ∂τ_nominal/∂g_i          body    Γ_last(q, q̇, q̈) φ
    coupling   τ_i += r (Ia ω̇ + fv ω + fc sign ω),  ω = r_i q̇_i + r_k q̇_k,  for rows i and k
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from frischid.checks.carried_load import carried_body
from frischid.checks.faults import Fault, cost
from frischid.checks.payload import CARRIED, LEFT_OFF, last_link, payload_errors
from frischid.checks.position_faults import Moved
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch, shared_fit
from frischid.core.types import Array

CARRIED_LOAD = "carried load"
"""Kind of the fault that the robot carries a body for a part of the log."""

SPHERE_STEPS = 3
"""Gauss-Newton steps of the direction of gravity; the first is within a degree."""


def robot_faults(sketch: Sketch) -> Iterator[Moved]:
    """The sketch with one such cause explained, for every cause; the torques are right, up to this."""
    if not len(sketch.rows):
        return
    fits = RowFits(sketch)
    yield from shared_faults(fits)
    yield from _couplings(fits)


def shared_faults(fits: RowFits) -> Iterator[Moved]:
    """The causes that all torques show: a tilted base, no gravity, a body on the last link, always or for a while."""
    sketch, n = fits.sketch, float(fits.weight.mean())
    yield from _mounting(sketch, n)
    yield from _compensated(sketch)
    body = payload_errors(sketch)
    if body.removed > 0 and body.torque is not None:
        what = f"{{|perhaps }}a body of about {abs(body.mass):.2g} kg on the last link that the "
        what, advice = (f"{what}URDF lacks", CARRIED) if body.mass > 0 else (f"{what}robot lacks", LEFT_OFF)
        price = cost(sketch.criteria, "payload", 1, 10, n)
        fault = Fault("payload", what, (body.joint,), advice, price, False, False, torque=body.torque)
        yield Moved(replace(sketch, given_nominal=sketch.nominal + body.torque), fault)
    yield from _carried(fits, n)


def shared_errors(sketch: Sketch) -> Array:
    """NRMSE of each judged row, (R,), if any gravity and any body on the last link are fitted beside friction."""
    force, last = sketch.motion.gravity_torques, last_link(sketch)
    columns = {int(j): np.column_stack([force[:, :, j].T, last[:, :, j]]) for j in sketch.rows}
    shared = columns[int(sketch.rows[0])].shape[1]
    fitted = shared_fit(sketch, columns, sketch.tau - sketch.nominal)[:shared]
    nominal = sketch.nominal.copy()
    for j, X in columns.items():
        nominal[:, j] += X @ fitted
    return sketch.errors(nominal)


def _carried(fits: RowFits, n: float) -> Iterator[Moved]:
    """A body that the last link carries for a while: each change may be at any sample."""
    sketch, body = fits.sketch, carried_body(fits)
    if body is None:
        return
    what = (
        f"{{|perhaps }}a body of about {body.mass:.2g} kg on the last link for a part of the log, "
        f"{body.times(sketch)}: {{the robot|it may be that the robot}} {body.story}"
    )
    advice = (
        "keep a part of the log without the load, or with the load throughout (frischid cut LOG --from START --until "
        "STOP): one model cannot hold both"
    )
    price = cost(sketch.criteria, CARRIED_LOAD, len(sketch) ** body.changes, 10, n)
    fault = Fault(CARRIED_LOAD, what, (body.joint,), advice, price, True, False, torque=body.torque)
    yield Moved(replace(sketch, given_nominal=sketch.nominal + body.torque), fault)


def _mounting(sketch: Sketch, n: float) -> Iterator[Moved]:
    robot = sketch.robot
    length = float(np.linalg.norm(robot.gravity))
    if not length:
        return
    turned = gravity_of(sketch)
    other = replace(robot, gravity=tuple(turned.tolist()))
    at = ", ".join(f"{x:.3g}" for x in np.round(turned, 2) + 0.0)
    angle = np.rad2deg(np.arccos(np.clip(turned @ np.asarray(robot.gravity) / length**2, -1, 1)))
    what = (
        f"gravity {{points|may point}} along ({at}) m/s² in the base frame, {angle:.3g}° from the URDF's: with this "
        "gravity the model explains the torques"
    )
    advice = "state how the base is mounted (--base-rpy or --gravity)"
    more = np.tensordot(turned - np.asarray(robot.gravity), sketch.motion.gravity_torques, axes=1)
    price = cost(sketch.criteria, "mounting", 1, 2, n)
    fault = Fault("mounting", what, (), advice, price, False, False, torque=more)
    yield Moved(replace(sketch.moving(robot=other), given_nominal=sketch.nominal + more), fault)


def _compensated(sketch: Sketch) -> Iterator[Moved]:
    """The sketch of a robot without gravity: the controller adds what holds the arm, and the record lacks it."""
    robot = sketch.robot
    if not np.any(robot.gravity):
        return
    holding = np.tensordot(np.asarray(robot.gravity), sketch.motion.gravity_torques, axes=1)
    what = (
        "the torques {lack|may lack} what holds the arm against gravity: without gravity the model explains them; "
        "commanded torques of a controller that compensates gravity are such"
    )
    advice = (
        "record the measured torques of the joints, or add the controller's gravity torque; to use the log as it is, "
        "identify with --gravity 0 0 0: the model then has no gravity"
    )
    fault = Fault("no gravity", what, (), advice, cost(sketch.criteria, "no gravity"), torque=-holding)
    yield Moved(
        replace(sketch.moving(robot=replace(robot, gravity=(0.0, 0.0, 0.0))), given_nominal=sketch.nominal - holding),
        fault,
    )


def gravity_of(sketch: Sketch) -> Array:
    """Gravity in the base frame that fits best together with friction, for the nominal inertias, m/s².

    Its length is that of the URDF's gravity. From a free fit on, each step moves gravity along two directions e₁, e₂ at
    right angles to it (Gauss-Newton on the sphere): masses that are wrong must not pass for another length.
    """
    few = sketch.thinned(sketch.criteria.few_samples)
    force = few.motion.gravity_torques
    own, length = np.asarray(few.robot.gravity), float(np.linalg.norm(few.robot.gravity))
    rest = few.tau - (few.nominal - np.einsum("i,inj->nj", own, force))
    gravity = shared_fit(few, {int(j): force[:, :, j].T for j in few.rows}, rest)[:3]
    for _ in range(SPHERE_STEPS):
        gravity = gravity * length / max(float(np.linalg.norm(gravity)), 1e-12)
        across = np.linalg.svd(gravity[None, :])[2][1:]
        columns = {int(j): force[:, :, j].T @ across.T for j in few.rows}
        gravity = gravity + across.T @ shared_fit(few, columns, rest - np.einsum("i,inj->nj", gravity, force))[:2]
    return np.asarray(gravity * length / max(float(np.linalg.norm(gravity)), 1e-12))


def _couplings(fits: RowFits) -> Iterator[Moved]:
    """A motor that turns with two neighbouring joints: its friction and inertia act on both."""
    sketch, n = fits.sketch, float(fits.weight.mean())
    pairs = [(a, b) for a, b in combinations(range(len(fits.rows)), 2) if fits.rows[b] - fits.rows[a] == 1]
    for a, b in pairs:
        i, k = fits.rows[a], fits.rows[b]
        extra = np.zeros_like(sketch.tau)
        for row, other in ((a, k), (b, i)):
            at = fits.rows[row]
            extra[:, at] = fits.beside(row, fits.of(row, sketch.tau) - fits.nominal[row], other)[1]
        names = (sketch.robot.joints[i], sketch.robot.joints[k])
        mixed = sketch.robot.prismatic[i] != sketch.robot.prismatic[k]
        ratio = "RATIO" if mixed else "1"
        screw, gear = (
            "the ratio of a turning and a sliding joint is ±2π/lead of the screw",
            "frischid searches the ratio",
        )
        meaning = screw if mixed else f"without (ratio=1), {gear}"
        what = "torques that depend on the motion of both joints: a motor {turns|may turn} with both (coupled drives)"
        advice = (
            "give positions and torques of the joints, not of the motors, or identify and add the coupled motor: "
            f"frischid add MODEL {shlex.quote(f'joint_coupling(ratio={ratio})@{names[0]}+{names[1]}')}; {meaning}; "
            "this is not a fault of columns, signs or units"
        )
        fault = Fault(
            "motor coupling",
            what,
            names,
            advice,
            cost(sketch.criteria, "motor coupling", len(pairs), 8, n),
            False,
            False,
            torque=extra,
        )
        yield Moved(replace(sketch, given_nominal=sketch.nominal + extra), fault)
