"""Simulated beside measured positions along one log: the robot that the model makes, as a ghost beside the real one.

q_sim(0) = q(0),  q̇_sim(0) = q̇(0);     afterwards the model follows the recorded commands in closed loop
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.forward.commanded_motion import follows_commands, moved
from frischid.forward.forward_dynamics import LARGEST_STEP, ForwardDynamics, Starts
from frischid.logs.log import Log
from frischid.logs.recording import Recording, chunks_of
from frischid.logs.stretch import stretch
from frischid.model.model import Model

BESIDE_SECONDS = 20.0
"""s. Beginning of a log that is simulated: a reader follows no longer motion, and it takes one to three seconds."""


@dataclass(frozen=True, eq=False)
class SimulatedBeside:
    """Measured and simulated positions of one log.

    Attributes
    ----------
    source : str
    t : ndarray, shape (N,)
        Time since the log's beginning, s.
    measured, simulated : ndarray, shape (N, J)
        rad (m); NaN after a simulated motion became unstable.
    """

    source: str
    t: Array
    measured: Array
    simulated: Array

    @property
    def rms(self) -> Array:
        """Position error of each joint, rad (m), shape (J,); infinite where the simulated motion became unstable."""
        error = np.sqrt(((self.simulated - self.measured) ** 2).mean(axis=0))
        return np.asarray(np.where(np.isfinite(error), error, np.inf))


def simulated_beside(model: Model, logs: Sequence[Log | Recording]) -> SimulatedBeside | str | None:
    """Simulate the beginning of the first log of commands.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
        As read, without the torque of the model's controller.

    Returns
    -------
    SimulatedBeside, str or None
        The reason where the model cannot be simulated; None without a log whose joints all follow commands.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.forward.simulated_beside import simulated_beside
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=1), rate=100.0)
    >>> simulated_beside(fr.identify(robot, [log], recursion="none").model, [log]) is None
    True
    """
    for log in logs:
        if not follows_commands(model.controller, log, model.robot.joints):
            continue
        head = next(chunks_of(log))
        try:
            part = stretch(head, stop=BESIDE_SECONDS)
            motion, source = next(moved(model, [part]))
            extra = {name: (motion.t, values) for name, values in motion.extra.items()}
            forward = ForwardDynamics(model, extra=extra, begin=motion.start)
            first = np.zeros(1, np.intp)
            speed = np.where(motion.standstill, 0.0, motion.v)
            start = Starts(
                motion.q[:1], speed[:1], motion.t[:1], remembered=forward.remembered(motion.t, motion.v, first)
            )
            times = motion.t - motion.t[0]
            found = forward.simulate(source, start, times, step=min(LARGEST_STEP, motion.step))
        except InputError as error:
            return str(error)
        return SimulatedBeside(log.source, motion.t - motion.t[0], motion.q, found.q[0])
    return None
