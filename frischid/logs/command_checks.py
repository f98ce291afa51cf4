"""Commands that cannot be right: they never move, are too old, or have another unit or sign than the positions.

A servo's position q follows its command c: with both centred, q ≈ c up to the servo's error. If q ≈ s c for the factor
s of a usual mistake, and is three times closer to s c than to c and to standstill, the command lacks this factor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import STANDSTILL_SPAN, Log

MOST_DELAY_STEPS = 50
"""Steps of a log. A command that is older than this says nothing about the joint's motion now."""
FOLLOWS = 1.0 / 3.0
"""Rms of q − s c, over the rms of q and of q − c, below which the position follows s c and not c. A servo far beyond
its bandwidth hardly moves, so neither of the two explains its position."""
MISTAKES = {
    -1.0: "have the opposite sign of the positions; change the sign of one of the two columns",
    np.pi / 180: "are in degrees beside positions in rad; convert them",
    -np.pi / 180: "are in degrees, with the opposite sign, beside positions in rad; convert them",
    180 / np.pi: "are in rad beside positions in degrees; convert one of the two columns",
}
"""Factor s -> what is wrong with the commands."""


def check_commands(log: Log) -> None:
    """Refuse a log whose commands never move, or have another unit or sign than its positions.

    Raises
    ------
    InputError
    """
    if log.qcmd is None:
        return
    span = np.ptp(log.qcmd[:, log.has("qcmd")], axis=0).max()
    if span < STANDSTILL_SPAN:
        raise InputError(
            f"{log.source}: the commanded positions (qcmd_<joint>) never move (largest range {span:.3g} rad): were the "
            "commands recorded, or a constant? check the columns, or record a motion"
        )
    for factor, words in MISTAKES.items():
        names = [
            n for j, n in enumerate(log.joints) if log.has("qcmd")[j] and _needs(factor, log.qcmd[:, j], log.q[:, j])
        ]
        if names:
            raise InputError(f"{log.source}: the commanded positions of {listed(names)} {words}")


def _needs(factor: float, command: Array, position: Array) -> bool:
    """Whether the position follows the command times a factor, and not the command as it is."""
    known = np.isfinite(command) & np.isfinite(position)
    if not known.any() or np.ptp(position[known]) < STANDSTILL_SPAN:
        return False
    c, q = (x[known] - x[known].mean() for x in (command, position))
    return bool(np.std(q - factor * c) < FOLLOWS * min(np.std(q), np.std(q - c)))


def check_delay(delay: Array, joints: Sequence[str], log: Log) -> None:
    """Refuse a delay longer than `MOST_DELAY_STEPS` steps of a log.

    Raises
    ------
    InputError
    """
    longest, step = int(np.argmax(delay)), 1.0 / log.rate
    if delay[longest] > MOST_DELAY_STEPS * step:
        raise InputError(
            f"{log.source}: a delay of {delay[longest]:.4g} s of {joints[longest]} is {delay[longest] / step:.0f} "
            f"steps of {1e3 * step:.3g} ms, and at most {MOST_DELAY_STEPS} are possible; is the delay in seconds?"
        )
