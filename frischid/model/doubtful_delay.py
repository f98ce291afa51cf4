"""The doubt about a controller's delay, as a parameter of the fit.

    τ_computed ≈ Y θ + δ · d/dt (kp q_cmd(t − d) + …),      δ ~ N(d_named − d, s_d²)

A command that acts δ later than the controller says makes an error that is nearly viscous friction of −kp δ. So ranges
of friction that ignore the doubt s_d about the delay are too narrow. δ is fitted beside the other parameters, with the
doubt as its prior: the ranges of friction and armature then hold this doubt, as far as the logs do not remove it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from frischid.effects import Effect
from frischid.effects.commands import CommandDelay
from frischid.estimators.parameter_prior import ParameterPrior
from frischid.logs.controller import PUSH_RATE, PDController
from frischid.logs.preprocessing import Motion
from frischid.regression.regressor import Regressor


def delay_effects(
    controller: PDController | None, effects: Sequence[Effect], motions: Iterable[Motion], joints: Sequence[str]
) -> tuple[Effect, ...]:
    """The effects of a model, and one for a delay that is in doubt.

    Parameters
    ----------
    motions : iterable of Motion
        Of the logs, with the torque of the controller.
    joints : sequence of str
        All joints of the robot.

    Returns
    -------
    tuple of Effect
        `effects` alone where no delay is in doubt, or where they have the delay of commands already.
    """
    doubts = _doubts(controller, joints)
    if not doubts or any(effect.id == CommandDelay.id for effect in effects):
        return tuple(effects)
    seen = list(motions)
    there = [n for n in doubts if all(PUSH_RATE + n in motion.extra for motion in seen)]
    driven = [n for n in there if any(motion.extra[PUSH_RATE + n].any() for motion in seen)]
    if not driven:
        return tuple(effects)
    one = len(driven) == len(joints) and len({doubts[n] for n in driven}) == 1
    return (*effects, CommandDelay(None if one else tuple(driven)))


def with_delay_prior(prior: ParameterPrior, controller: PDController | None, regressor: Regressor) -> ParameterPrior:
    """A prior in which the delay of commands has the spread of the controller's doubt, where there is one.

    Parameters
    ----------
    prior : ParameterPrior
        Of the columns of `regressor`.
    """
    doubts = _doubts(controller, regressor.robot.joints)
    if not doubts:
        return prior
    spread = [
        doubts.get(c.joint, s) if c.effect == CommandDelay.id else s
        for c, s in zip(regressor.columns, prior.spread, strict=True)
    ]
    moved = replace(prior, spread=np.array(spread))
    if controller is None or controller.delay_told is None:
        return moved
    late = np.array([c.effect == CommandDelay.id for c in regressor.columns])
    off = controller.delay_told - controller.values("delay", [regressor.robot.joints[0]])[0]
    return replace(moved, mean=np.where(late, off, prior.mean))


def _doubts(controller: PDController | None, joints: Sequence[str]) -> Mapping[str, float]:
    """Joints whose delay is in doubt, with the standard error, s."""
    if controller is None:
        return {}
    values = controller.values("delay_doubt", joints).tolist()
    return {n: x for n, x in zip(joints, values, strict=True) if x > 0}
