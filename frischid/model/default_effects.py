"""Effects that an identification chooses by itself: the baseline, its dry friction's smoothing, open damping gains."""

from __future__ import annotations

from collections.abc import Sequence

from frischid.effects import BASELINE, Effect
from frischid.effects.springs import JointSpring
from frischid.estimators.friction_smoothing import baseline, dry_friction
from frischid.model.doubtful_delay import delay_effects
from frischid.model.log_data import LogData
from frischid.model.unknown_damping import damping_effects
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure


def with_damping(data: LogData, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Effects, with the drives' damping where it is open."""
    channels = [motion.extra for motion in data.some_motions]
    return damping_effects(data.options.controller, effects, channels, data.robot.joints)


def default_effects(data: LogData) -> tuple[Effect, ...]:
    """The baseline, with the smoothing of dry friction chosen by cross-validation.

    A spring that the robot has and the baseline lacks would decide the smoothing: its torque is largest at the ends of
    a motion, where dry friction changes its direction. So the choice is made without and with a torque of each joint's
    position beside, and a lead or a wider sign must be clear in both.
    """
    some = [motion for motion in data.some_motions if not motion.at_poses]
    if not some:
        return BASELINE
    effects = with_damping(data, delay_effects(data.options.controller, BASELINE, some, data.robot.joints))
    found = []
    for beside in (effects, (*effects, JointSpring(form="cubic"))):
        reduction = structure(Regressor(data.robot, beside), data.joints)
        found.append(dry_friction(data.robot, some, data.lowpass, data.joints, reduction, beside))
    dry = min((x for x in found if x is not None), key=lambda x: (x.lead, x.width), default=None)
    if dry is None:
        return BASELINE
    ahead = f", {1e3 * dry.lead:g} ms ahead of the motion" if dry.lead else ""
    data.journal.notes.append(
        f"dry friction changes its direction over ±{dry.width:g} rad/s (m/s){ahead}, chosen by cross-validation"
    )
    return baseline(dry)
