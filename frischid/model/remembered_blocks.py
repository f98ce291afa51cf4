"""Blocks of short motions are kept in memory: a click in the studio evaluates the same columns in the fit and after it.

They depend on the robot, the effects with their reference, and the filter; see `frischid.core.remembered`. Effects of
one text are two where their classes are two: a notebook defines its own effect anew.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Sequence

from frischid.core.remembered import Remembered
from frischid.effects import Effect
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.model.model_parts import robot_text
from frischid.regression.block import COLUMNS_BESIDE_Y, Block
from frischid.regression.regressor import Regressor

KEPT_BLOCK_BYTES = 8 * 2**20
"""Bytes of the blocks of one motion up to which they are kept: half a minute of a six-joint arm without decimation."""
_MOTION_BLOCKS = Remembered[tuple[Block, ...]]()


def key_of(effects: Sequence[Effect]) -> Hashable:
    """Everything that the columns of some effects depend on, beside a motion."""
    return tuple((type(effect), json.dumps(effect.to_dict())) for effect in effects)


def blocks_of(regressor: Regressor, motion: Motion, lowpass: LowPass) -> Iterable[Block]:
    """The blocks of a motion, in order; those of a short one are computed once."""
    numbers = (len(regressor.columns) + COLUMNS_BESIDE_Y) * len(regressor.robot.joints)
    if len(motion.t) // lowpass.decimation(motion.step) * numbers * 8 > KEPT_BLOCK_BYTES:
        return regressor.blocks(motion, lowpass)
    filtered = lowpass.cutoff, lowpass.torque_lag
    key = (robot_text(regressor.robot), key_of(regressor.effects), regressor.reference.tobytes(), filtered)
    return _MOTION_BLOCKS.of(motion, key, lambda: tuple(regressor.blocks(motion, lowpass)))
