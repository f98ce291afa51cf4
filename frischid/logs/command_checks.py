"""Commands that cannot be right: they never move, are too old, or have another unit or sign than the positions.

*Unit.* A servo's position q follows its command c: with both centred, q ≈ c up to the servo's error. If q ≈ s c for
the factor s of a usual mistake, and is three times closer to s c than to c and to standstill, the command lacks this
factor. Only the slower half of the motion is compared, because a servo follows slow commands best.

*Sign.* Friction and the drive's damping take energy, and the drive gives this energy: kp ∫ (c − q) dq > 0 on a closed
path. On an open path, springs and weight store energy, so a part of c − q that is linear in q is taken out. A command
is reversed if q is nearer to −c than to c and to standstill, and the drive would take energy from the joint.

*Standstill.* A joint with a constant command stays where it is, up to the servo's error. If the joint moves as far as
joints that are commanded to move, and farther than their servos err, its command was not recorded. A chunk of a long
recording says nothing of this, because the robot may rest throughout the chunk: `CommandTravel` joins the chunks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from frischid.core.text import each_of, listed
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


def check_commands(log: Log, *, whole: bool = True) -> None:
    """Refuse (InputError) a log whose commands never move, or have another unit or sign than its positions.

    Parameters
    ----------
    whole : bool
        Whether the log is no chunk of a longer one. In a chunk, no command needs to move.
    """
    if log.qcmd is None:
        return
    travel = CommandTravel.of(log)
    if whole:
        travel.check_any_moves(log.source)
    for factor, words in MISTAKES.items():
        names = [
            n for j, n in enumerate(log.joints) if log.has("qcmd")[j] and _needs(factor, log.qcmd[:, j], log.q[:, j])
        ]
        if names:
            raise InputError(f"{log.source}: the commanded positions of {listed(names)} {words}")
    if whole:
        travel.check_each_moves(log.source)


class CommandTravel(NamedTuple):
    """How far the J joints with commands, their commands, and the errors between both move in some samples."""

    joints: tuple[str, ...]
    samples: int
    lower: Array
    upper: Array
    """`lower`, `upper`: Ends of each command, rad (m), (J,)."""
    position: Array
    error: Array
    """`position`, `error`: Mean and variance of each position, and of each position less its command, (2, J)."""

    @classmethod
    def of(cls, log: Log) -> CommandTravel:
        """The travel in a log that has commands."""
        assert log.qcmd is not None
        there = np.flatnonzero(log.has("qcmd"))
        q, c = log.q[:, there], log.qcmd[:, there]
        names = tuple(log.joints[j] for j in there)
        return cls(names, len(log), c.min(axis=0), c.max(axis=0), _mean_and_variance(q), _mean_and_variance(q - c))

    def joined(self, other: CommandTravel) -> CommandTravel:
        """The travel in the samples of both; that of the joints which have commands in both."""
        if self.joints != other.joints:
            both = [n for n in self.joints if n in other.joints]
            if not both:
                return other
            return self._of_joints(both).joined(other._of_joints(both))
        lower, upper = np.minimum(self.lower, other.lower), np.maximum(self.upper, other.upper)
        share = other.samples / (self.samples + other.samples)
        position, error = (
            np.stack([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1] + (1 - share) * (b[0] - a[0]) ** 2)])
            for a, b in ((self.position, other.position), (self.error, other.error))
        )
        return CommandTravel(self.joints, self.samples + other.samples, lower, upper, position, error)

    def _of_joints(self, names: Sequence[str]) -> CommandTravel:
        at = [self.joints.index(n) for n in names]
        ends = self.lower[at], self.upper[at]
        return CommandTravel(tuple(names), self.samples, *ends, self.position[:, at], self.error[:, at])

    def check(self, source: str) -> None:
        """Refuse (InputError) commands that never move, of all joints or of one."""
        self.check_any_moves(source)
        self.check_each_moves(source)

    def check_any_moves(self, source: str) -> None:
        """Refuse (InputError) commands of which none ever moves."""
        span = (self.upper - self.lower).max()
        if span < STANDSTILL_SPAN:
            raise InputError(
                f"{source}: the commanded positions (qcmd_<joint>) never move (largest range {span:.3g} rad): were the "
                "commands recorded, or a constant? check the columns, or record a motion"
            )

    def check_each_moves(self, source: str) -> None:
        """Refuse (InputError) a constant command of a joint that moves like joints with commands."""
        commanded = self.upper - self.lower >= STANDSTILL_SPAN
        if commanded.all() or not commanded.any():
            return
        moved, error = np.sqrt(self.position[1]), np.sqrt(self.error[1])
        far = moved > max(FOLLOWS * float(np.median(moved[commanded])), float(np.median(error[commanded])))
        if names := [name for name, wrong in zip(self.joints, far & ~commanded, strict=True) if wrong]:
            raise InputError(
                f"{source}: the commanded position of {each_of(names)} never moves, and the joint itself moves as "
                "the other joints do: is this column the command of another joint? correct the column, or leave it out"
            )


def _mean_and_variance(x: Array) -> Array:
    return np.stack([x.mean(axis=0), x.var(axis=0)])


def _needs(factor: float, command: Array, position: Array) -> bool:
    """Whether the position follows the command times a factor, and not the command as it is."""
    known = np.isfinite(command) & np.isfinite(position)
    if not known.any() or min(np.ptp(command[known]), np.ptp(position[known])) < STANDSTILL_SPAN:
        return False
    c, q = _slower_half(command[known], position[known])
    apart = np.std(q - factor * c) / min(np.std(q), np.std(q - c))
    if factor == -1.0:
        return bool(apart < 1.0 and _takes_energy(command[known], position[known]))
    return bool(apart < FOLLOWS)


def _takes_energy(command: Array, position: Array) -> bool:
    """Whether c − q falls with the velocity, with the part that a spring would explain taken out of both."""
    gap, step = (command - position)[:-1], np.diff(position)
    spring = np.column_stack([np.ones(len(gap)), 0.5 * (position[1:] + position[:-1])])
    gap = gap - spring @ np.linalg.lstsq(spring, gap, rcond=None)[0]
    return bool(gap @ step < 0.0)


def _slower_half(command: Array, position: Array) -> tuple[Array, Array]:
    """Both, centred and without the frequencies above the median of the command's power."""
    spectra = np.fft.rfft(np.stack([command - command.mean(), position - position.mean()]))
    power = np.cumsum(np.abs(spectra[0]) ** 2)
    spectra[:, np.searchsorted(power, 0.5 * power[-1]) + 1 :] = 0.0
    slow = np.fft.irfft(spectra, len(command))
    return slow[0], slow[1]


def check_delay(delay: Array, joints: Sequence[str], log: Log) -> None:
    """Refuse (InputError) a delay longer than `MOST_DELAY_STEPS` steps of a log."""
    longest, step = int(np.argmax(delay)), 1.0 / log.rate
    if delay[longest] > MOST_DELAY_STEPS * step:
        raise InputError(
            f"{log.source}: a delay of {delay[longest]:.4g} s of {joints[longest]} is {delay[longest] / step:.0f} "
            f"steps of {1e3 * step:.3g} ms, and at most {MOST_DELAY_STEPS} are possible; is the delay in seconds?"
        )
