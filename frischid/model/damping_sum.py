"""The sum of a drive's damping kd and a joint's viscous friction fv, where the user left kd open.

    (kd + fv) q̇ − kd v_cmd

Both resist the joint's own velocity, so logs know the sum best, and without commanded velocities the sum only. The
standard error of the sum has the correlation of the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.effects import Viscous
from frischid.effects.commands import VelocityGain
from frischid.model.model import Model


@dataclass(frozen=True)
class DampingSum:
    """kd + fv of one joint.

    Attributes
    ----------
    value, stderr : float
        N·m·s/rad (N·s/m).
    apart : bool
        Whether the model has kd as a parameter of its own, beside fv.
    """

    value: float
    stderr: float
    apart: bool


def damping_sum(model: Model, joint: str) -> DampingSum | None:
    """The sum of a joint's kd and viscous friction; None where kd was named, or where the logs do not know the sum.

    Parameters
    ----------
    model : Model
    joint : str
    """
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
