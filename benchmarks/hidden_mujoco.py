"""Motion from MuJoCo: forward dynamics under feedback, with MuJoCo's own friction.

The true tree of bodies is written as MJCF, body by body, with ``armature``, ``damping`` and ``frictionloss``. Friction
loss is a constraint that MuJoCo solves at every step, so that joints really stick. In half of the cases friction is
nearly a step; in the others it has MuJoCo's default, which brakes a joint over 10 ms before the joint turns. The
controller is proportional-derivative feedback plus the gravity torque of the *nominal* URDF, so the arm does not follow
exactly.

Source: E. Todorov, T. Erez and Y. Tassa, "MuJoCo: A physics engine for model-based control", IROS 2012.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from hidden_physics import SMOOTH, STEP, Array, Drive, Path, World, rnea

from frischid.robot.robot import Robot

BANDWIDTH = 2 * np.pi * 12.0
"""Bandwidth of the position control, rad/s."""
STIFF = 'solreffriction="0.002 1" solimpfriction="0.98 0.999 0.001"'
"""Options for dry friction that is nearly a step."""


def followed(model: Any, robot: Robot, plan: Path, drive: Drive, number: int, *, stiff: bool = True) -> World:
    """Let a simulated arm follow a motion.

    Parameters
    ----------
    model : pinocchio.Model
        True bodies.
    robot : Robot
        The user's robot, for the controller's gravity torque.
    plan : Path
        Desired motion.
    drive : Drive
    number : int
        Number of the motion.
    stiff : bool
        Whether dry friction is nearly a step; otherwise it is MuJoCo's default.

    Returns
    -------
    World
        The motion that results, and its torque.
    """
    import mujoco
    from mujoco import rollout

    kp, kd = _gains(model, robot, plan, drive)
    simulated = mujoco.MjModel.from_xml_string(mjcf(model, drive, kp, kd, stiff))
    forward = _gravity(robot, plan.q)
    control = plan.q + (kd * plan.v + forward) / kp
    start = np.zeros(mujoco.mj_stateSize(simulated, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    J = plan.q.shape[1]
    start[1 : 1 + J], start[1 + J : 1 + 2 * J] = plan.q[0], plan.v[0]
    states, _ = rollout.rollout(simulated, mujoco.MjData(simulated), start[None], control[None])
    states = np.concatenate([start[None], np.asarray(states)[0]])
    q, v = states[:-1, 1 : 1 + J], states[:, 1 + J : 1 + 2 * J]
    torque = kp * (control - q) - kd * v[:-1] + drive.offset
    # A symplectic step gives velocities half a step early: they are shifted to the times of positions and forces.
    path = Path(plan.t, q, (v[1:] + v[:-1]) / 2, np.diff(v, axis=0) / STEP)
    return World(model, robot, path, drive, rnea(model, robot, path), torque, np.tanh(path.v / SMOOTH), number)


def mjcf(model: Any, drive: Drive, kp: Array, kd: Array, stiff: bool) -> str:
    """Write a Pinocchio tree of revolute joints as a MuJoCo model with position servos."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    children: dict[int, list[int]] = {}
    for i in range(1, model.njoints):
        children.setdefault(model.parents[i], []).append(i)

    def body(i: int) -> str:
        j = model.joints[i].idx_v
        axis = pin.getJointJacobian(model, data, i, pin.LOCAL)[3:, j]
        place, inertial = model.jointPlacements[i], model.inertias[i]
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        I = inertial.inertia  # noqa: E741
        spin = f'armature="{drive.rotor[j]:.17g}" damping="{drive.viscous[j]:.17g}"'
        dry = f'frictionloss="{drive.coulomb[j]:.17g}" {STIFF if stiff else ""}'
        return (
            f'<body pos="{_row(place.translation)}" quat="{_row([w, x, y, z])}">'
            f'<inertial pos="{_row(inertial.lever)}" mass="{inertial.mass:.17g}" '
            f'fullinertia="{_row([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])}"/>'
            f'<joint name="j{i}" axis="{_row(axis)}" {spin} {dry}/>'
            f"{''.join(body(k) for k in children.get(i, []))}</body>"
        )

    servos = "".join(
        f'<general joint="j{i + 1}" biastype="affine" gainprm="{kp[i]:.17g}" biasprm="0 {-kp[i]:.17g} {-kd[i]:.17g}"/>'
        for i in range(model.nv)
    )
    return (
        f'<mujoco><compiler angle="radian" balanceinertia="true"/>'
        f'<option timestep="{STEP}" integrator="Euler" gravity="{_row(model.gravity.linear)}">'
        f'<flag contact="disable"/></option><worldbody>{"".join(body(i) for i in children[0])}</worldbody>'
        f"<actuator>{servos}</actuator></mujoco>"
    )


def _row(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def _gains(model: Any, robot: Robot, plan: Path, drive: Drive) -> tuple[Array, Array]:
    data = model.createData()
    poses = robot.configuration(plan.q[:: max(1, len(plan.t) // 50)])
    inertia = np.mean([np.diag(pin.crba(model, data, q)) for q in poses], axis=0) + drive.rotor
    return inertia * BANDWIDTH**2, 1.6 * inertia * BANDWIDTH


def _gravity(robot: Robot, q: Array) -> Array:
    model, data = robot.model, robot.data
    return np.array([pin.computeGeneralizedGravity(model, data, x) for x in robot.configuration(q)])
