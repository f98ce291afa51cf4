"""A damping gain kd that the user left open: one more column of the fit.

    τ_computed = Y θ + kd (q̇ − v_cmd(t − d)),      τ_computed = kp (q_cmd(t − d) − q) + τ_ff(t − d)

The sum of kd and the joint's viscous friction fv is the coefficient of q̇. Only commanded velocities tell one from the
other. Without them, v_cmd = 0, the two columns are the same, and no column is added: fv then stands for kd + fv.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.effects import Effect, Viscous
from frischid.effects.commands import VelocityGain
from frischid.errors import InputError
from frischid.logs.controller import VELOCITY_COMMAND, PDController
from frischid.model.model import Model


def open_damping(controller: PDController | None, joints: Sequence[str]) -> list[str]:
    """The joints whose kd is not known."""
    return [] if controller is None else [n for n in joints if not controller.knows_damping(n)]


def damping_effects(
    controller: PDController | None,
    effects: Sequence[Effect],
    channels: Sequence[Mapping[str, Array]],
    joints: Sequence[str],
) -> tuple[Effect, ...]:
    """The effects of a model, and one for the damping gains that are open and that the logs tell from friction.

    Parameters
    ----------
    channels : sequence of mapping of str to ndarray
        Further channels of each log with the torque of the controller, or of its motions.
    joints : sequence of str
        All joints of the robot.

    Returns
    -------
    tuple of Effect
        `effects` alone where no kd is open, or where only its sum with viscous friction acts on the logs.

    Raises
    ------
    InputError
        Some logs have commands of a joint whose kd is open, and others have its torque.
    """
    found = []
    rubs = {n for e in effects if e.id == Viscous.id for n in e.joints or joints}
    for name in open_damping(controller, joints):
        wanted = [extra.get(VELOCITY_COMMAND + name) for extra in channels]
        known = [x for x in wanted if x is not None]
        if known and len(known) < len(wanted):
            raise InputError(
                f"kd of {name} is open, and some logs have its torque in place of commands: give --kd, or leave these "
                "logs out"
            )
        if any(bool(np.any(x)) for x in known) or (known and name not in rubs):
            found.append(name)
    if not found or any(effect.id == VelocityGain.id for effect in effects):
        return tuple(effects)
    return (*effects, VelocityGain(tuple(found)))


def damping_notes(controller: PDController | None, effects: Sequence[Effect], joints: Sequence[str]) -> list[str]:
    """A sentence on the joints of which only the sum of kd and viscous friction is known.

    Parameters
    ----------
    effects : sequence of Effect
        Of the model.
    joints : sequence of str
        Joints whose torque is fitted.
    """
    apart = {n for e in effects if e.id == VelocityGain.id for n in e.joints or joints}
    summed = [n for n in open_damping(controller, joints) if n not in apart]
    if not summed:
        return []
    return [
        f"kd of {', '.join(summed)} is open and the logs command no velocity (vcmd_<joint>): only the sum of kd and "
        "viscous friction is known, and viscous friction stands for this sum"
    ]


@dataclass(frozen=True)
class DampingSum:
    """kd + fv of one joint: both resist the joint's own velocity, so logs know the sum best."""

    value: float
    stderr: float
    """`value`, `stderr`: N·m·s/rad (N·s/m). The standard error of the sum has the correlation of the two."""
    apart: bool
    """Whether the model has kd as a parameter of its own, beside fv."""


def damping_sum(model: Model, joint: str) -> DampingSum | None:
    """The sum of a joint's kd and viscous friction; None where kd was named, or where the logs do not know the sum."""
    if model.controller is None or model.controller.knows_damping(joint):
        return None
    e = model.estimate
    place = {c.effect: k for k, c in enumerate(e.columns) if c.joint == joint and model.expressions[k] == c.name}
    apart = any(x.id == VelocityGain.id and joint in (x.joints or (joint,)) for x in model.effects)
    wanted = (Viscous.id, VelocityGain.id) if apart else (Viscous.id,)
    if not set(wanted) <= set(place):
        return None
    k = [place[x] for x in wanted]
    return DampingSum(float(e.theta[k].sum()), float(np.sqrt(e.covariance[np.ix_(k, k)].sum())), apart)
