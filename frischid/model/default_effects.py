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
    a motion, where dry friction changes its direction. So a torque of each joint's position is fitted beside, where
    the logs suffice.
    """
    some = [motion for motion in data.some_motions if not motion.at_poses]
    if not some:
        return BASELINE
    effects = with_damping(data, delay_effects(data.options.controller, BASELINE, some, data.robot.joints))
    for beside in ((*effects, JointSpring(form="cubic")), effects):
        reduction = structure(Regressor(data.robot, beside), data.joints)
        dry = dry_friction(data.robot, some, data.lowpass, data.joints, reduction, beside)
        if dry is not None:
            break
    if dry is None:
        return BASELINE
    ahead = f", {1e3 * dry.lead:g} ms ahead of the motion" if dry.lead else ""
    data.journal.notes.append(
        f"dry friction changes its direction over ±{dry.width:g} rad/s (m/s){ahead}, chosen by cross-validation"
    )
    return baseline(dry)
