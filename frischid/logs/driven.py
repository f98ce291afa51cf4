"""Logs with the torque of their drives: from commands and a controller, or from currents and a torque per ampere.

    τ_j = controller(q_cmd,j, q_j, q̇_j)        or        τ_j = K_j i_j

A joint whose torque was measured keeps it. Every later stage reads these logs as if the torque had been measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from frischid.core.remembered import Remembered
from frischid.errors import InputError
from frischid.logs.command_checks import MOST_DELAY_STEPS, CommandTravel
from frischid.logs.controller import SPLINE_SAMPLES, PDController, commanded
from frischid.logs.current_gains import CurrentGains
from frischid.logs.log import Log
from frischid.logs.recording import Recording, joined, preview_of
from frischid.logs.wraps import commands_unwrapped

_DRIVEN = Remembered[Log | None]()
"""Logs with their torque, by the drive; None where the log needs none."""


def driven(
    logs: Iterable[Log | Recording], controller: PDController | None, currents: CurrentGains | None = None
) -> tuple[Log | Recording, ...]:
    """Logs with the torque that a controller gives, or that currents give; as they are without both."""
    found = tuple(logs)
    if controller is not None:
        found = tuple(
            _driven_recording(x, controller) if isinstance(x, Recording) else _driven(x, controller) for x in found
        )
    if currents is not None:
        found = tuple(_with_currents(x, currents) if isinstance(x, Recording) else _driven(x, currents) for x in found)
    return found


def idle(logs: Iterable[Log | Recording], controller: PDController | None) -> list[str]:
    """A sentence where a controller was named and no log has a command: the controller makes no torque then.

    Raises
    ------
    InputError
        kp is not known either, and no command can show it.
    """
    if controller is None or any(preview_of(log).has("qcmd").any() for log in logs):
        return []
    said = (
        "no log has commanded positions (qcmd_<joint>): the controller makes no torque and takes no part in the fit; "
        "name the columns of the commands in a mapping file, or leave the controller out"
    )
    if not controller.kp:
        raise InputError(said)
    return [said]


def _driven(log: Log, drive: PDController | CurrentGains) -> Log:
    """A log in memory with its torque; the same object for the same log and drive, so its motions are kept as well."""

    def changed() -> Log | None:
        found = drive.drive(log)
        return None if found is log else found  # a log that is kept beside itself would live for ever

    found = _DRIVEN.of(log, repr(drive), changed)
    return log if found is None else found


def _with_currents(log: Recording, currents: CurrentGains) -> Recording:
    """A recording whose chunks have the torque of their currents."""

    def read(samples: int) -> Iterator[Log]:
        return (currents.drive(chunk) for chunk in log.read(samples))

    return replace(log, read=read)


def _driven_recording(log: Recording, controller: PDController) -> Recording:
    """A recording whose chunks have torques; each chunk sees the end of the one before, for its delays and slopes."""

    def read(samples: int) -> Iterator[Log]:
        tail: Log | None = None
        travel: CommandTravel | None = None
        for chunk in log.read(samples):
            whole = chunk if tail is None else joined(tail, 0, chunk)
            driven_whole = controller.drive(whole, whole=False)
            if commanded(chunk):
                here = CommandTravel.of(commands_unwrapped(chunk))
                travel = here if travel is None else travel.joined(here)
            yield driven_whole.slice(int(np.searchsorted(driven_whole.t, chunk.t[0])))
            tail = whole.slice(-min(len(whole), MOST_DELAY_STEPS + SPLINE_SAMPLES))
        if travel is not None:
            travel.check(log.source)

    return replace(log, read=read)
