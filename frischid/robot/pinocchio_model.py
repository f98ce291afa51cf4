"""A URDF as Pinocchio's model: locked joints removed, gravity set, joints of one degree of freedom only.

    M(q) q̈ + C(q, q̇) q̇ + g(q) = τ

Pinocchio (Carpentier et al. 2019, "The Pinocchio C++ library", SII) builds the model; a locked joint becomes a fixed
one at its angle, and its link a part of the link before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from numbers import Real
from typing import Any

import numpy as np
import pinocchio as pin

from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError
from frischid.robot.mimics import mimic_rules
from frischid.robot.urdf_refusals import cause_of_refusal

MODELS_KEPT = 16
"""Models that are kept, so that a URDF is not read again for a copy of its robot."""


def build_model(urdf: str, source: str, locked: Mapping[str, float], gravity: Sequence[float]) -> Any:
    """Build the Pinocchio model of a URDF.

    Parameters
    ----------
    urdf : str
        Text of the URDF.
    source : str
        Path or name of the URDF, for messages.
    locked : mapping of str to float
        Joints that are fixed, with their angle, rad (m). Mimic joints of a locked leader are locked with it.
    gravity : sequence of 3 float
        Gravity in the base frame, m/s².

    Raises
    ------
    InputError
        Pinocchio refuses the URDF, a joint has several degrees of freedom, or no joint is left to move.
    UnknownNameError
        A locked joint is none of the URDF's moving joints.
    """
    model = _read(urdf, source, tuple(locked.items())).copy()
    model.gravity.linear = np.array(gravity)
    return model


@lru_cache(maxsize=MODELS_KEPT)
def _read(urdf: str, source: str, locked: tuple[tuple[str, float], ...]) -> Any:
    """The model of a URDF with its own gravity; a robot under another gravity needs no second reading."""
    try:
        model = pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as error:
        why = cause_of_refusal(urdf) or str(error).strip()
        raise InputError(f"{source}: Pinocchio cannot build a model from this URDF: {why}") from error
    _check_joints(model, source)
    moving = list(model.names)[1:]  # the first is Pinocchio's name for the base
    angles = dict(locked)
    for name in angles:
        if name not in moving:
            raise UnknownNameError("locked joint", name, moving, source)
    for name, rule in mimic_rules(urdf).items():
        if rule.leader in angles:
            angles[name] = rule.factor * angles[rule.leader] + rule.shift
    if angles:
        model = _without(model, angles, source)
    if model.nv == 0:
        raise InputError(f"{source}: no joint is left to move; the URDF has none, or all are locked")
    return model


def _without(model: Any, angles: Mapping[str, float], source: str) -> Any:
    """Fix joints at their angles."""
    reference = pin.neutral(model)
    for name, angle in angles.items():
        joint = model.joints[model.getJointId(name)]
        value = [math.cos(angle), math.sin(angle)] if joint.nq == 2 else [angle]
        reference[joint.idx_q : joint.idx_q + joint.nq] = value
    try:
        return pin.buildReducedModel(model, [model.getJointId(n) for n in angles], reference)
    except ValueError as error:
        raise InputError(
            f"{source}: Pinocchio cannot lock {', '.join(angles)}: {error}; does a link of the URDF have "
            "the name of the joint? Rename one of them"
        ) from error


def _check_joints(model: Any, source: str) -> None:
    for joint, name in zip(list(model.joints)[1:], list(model.names)[1:], strict=True):
        if joint.nv != 1:
            raise InputError(
                f"{source}: joint '{name}' has {joint.nv} degrees of freedom ({joint.shortname()}); frischid "
                "identifies revolute, continuous and prismatic joints; make it fixed in the URDF"
            )


def gravity_in_base(gravity: Sequence[float], base_rpy: Sequence[float] | None) -> tuple[float, float, float]:
    """Gravity in the base frame, m/s², from that of the world and the base's roll, pitch and yaw, rad.

    Raises
    ------
    InputError
        `gravity` or `base_rpy` is not three finite numbers.
    """
    numbers = np.shape(gravity) == (3,) and all(isinstance(x, Real) for x in gravity)
    g = np.array(gravity if numbers else [], dtype=float)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise InputError(f"gravity must be three finite numbers in m/s², got {shortened(gravity)}")
    if base_rpy is not None:
        if np.shape(base_rpy) != (3,) or not np.isfinite(base_rpy).all():
            raise InputError(f"base_rpy must be three finite numbers in rad, got {shortened(base_rpy)}")
        g = pin.rpy.rpyToMatrix(np.asarray(base_rpy, dtype=float)).T @ g
    return float(g[0]), float(g[1]), float(g[2])


def configurations(model: Any, q: Array) -> Array:
    """Pinocchio configurations (N, nq) of positions (N, nv): a continuous joint is the pair (cos, sin)."""
    if model.nq == model.nv:
        return np.ascontiguousarray(q)
    out = np.empty((len(q), model.nq))
    for i in range(model.nv):
        joint = model.joints[i + 1]
        if joint.nq == 2:
            out[:, joint.idx_q] = np.cos(q[:, i])
            out[:, joint.idx_q + 1] = np.sin(q[:, i])
        else:
            out[:, joint.idx_q] = q[:, i]
    return out


def with_inertias(model: Any, blocks: Array | None, armature: Mapping[int, float]) -> Any:
    """Copy a Pinocchio model with other inertias.

    Parameters
    ----------
    blocks : ndarray, shape (L, 10), optional
        Dynamic parameters of the L bodies, about their joint frames; the model's own by default.
    armature : mapping of int to float
        Pinocchio's index of a joint -> reflected rotor inertia, kg·m² (kg); zero for the others.
    """
    found = model.copy()
    for index, block in enumerate(() if blocks is None else blocks, start=1):
        found.inertias[index] = pin.Inertia.FromDynamicParameters(block)
    values = np.zeros(model.nv)
    for index, x in armature.items():
        values[model.joints[index].idx_v] = x
    found.armature = values
    return found


def frame_placement(model: Any, joint: str, frames: str | Mapping[str, str], source: str) -> Any:
    """Pose (pinocchio.SE3) of a body's parameter frame in the frame of its joint; `frames` as in `Robot`.

    Raises
    ------
    UnknownNameError
        There is no such joint, no such frame on the body, or no such choice of frames.
    """
    if frames == "joint":
        return pin.SE3.Identity()
    bodies, index = tuple(model.names[1:]), model.getJointId(joint)
    if isinstance(frames, Mapping):
        unknown = [j for j in frames if j not in bodies]
        if unknown:
            raise UnknownNameError("joint", unknown[0], bodies, source)
        if joint not in frames:
            return pin.SE3.Identity()
        on_body = {f.name: f.placement for f in model.frames if f.parentJoint == index}
        if frames[joint] not in on_body:
            raise UnknownNameError(f"frame on the body of {joint}", frames[joint], on_body, source)
        return on_body[frames[joint]]
    if frames != "far_end":
        raise UnknownNameError("frame choice", str(frames), ["joint", "far_end"])
    children = [model.jointPlacements[k] for k in range(1, model.njoints) if model.parents[k] == index]
    fixed = [f.placement for f in model.frames if f.parentJoint == index]
    far = children[0] if children else max(fixed, key=lambda placement: float(np.linalg.norm(placement.translation)))
    return pin.SE3(np.eye(3), far.translation)
