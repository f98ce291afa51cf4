"""Simulated beside measured positions along one log: the robot that the model makes, as a ghost beside the real one.

q_sim(s) = q(s),  q̇_sim(s) = q̇(s)  at each start s

Along a log of commands, the only start is the first sample, because a controller corrects the model's motion. Along a
log of torque, nothing corrects the model, and an error of the torque is integrated twice. So the model starts anew from
the measured state every second, and its error is a function of the time since the start: the horizon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.forward.commanded_motion import follows_commands, moved
from frischid.forward.forward_dynamics import LARGEST_STEP, ForwardDynamics
from frischid.forward.motion_error import position_errors, simulated_from
from frischid.logs.driven import driven
from frischid.logs.log import STANDSTILL_SPAN, Log
from frischid.logs.poses import need_motion
from frischid.logs.recording import Recording, moving_part, preview_of
from frischid.logs.stretch import stretch
from frischid.model.comparison import urdf_parameters
from frischid.model.model import Model

BESIDE_SECONDS = 20.0
"""s. Beginning of a log, or of its motion, that is simulated: a reader follows no longer motion, and it takes one to
three seconds."""
RESTART = 1.0
"""s. Time between two starts along a log of torque: the middle one of the horizons of ``compare --simulate``."""


@dataclass(frozen=True, eq=False)
class SimulatedBeside:
    """Measured and simulated positions of one log."""

    source: str
    t: Array
    """Time since the log's first sample, s, (N,)."""
    measured: Array
    simulated: Array
    """`measured`, `simulated`: rad (m), (N, J); NaN after a simulated motion became unstable."""
    length: int
    """Samples from one start to the next; N for a log of commands."""
    errors: Array
    """Errors of the model's positions and of those of the URDF with fitted friction, rad (m), (2, N, J + 1); the last
    column is the distance at the tip, mm. Infinite after a simulated motion became unstable."""

    @property
    def closed(self) -> bool:
        """Whether a controller moves the model along commands from a single start."""
        return self.length == len(self.t)

    @property
    def rms(self) -> Array:
        """Position error of each joint, rad (m), shape (J,); infinite where the simulated motion became unstable."""
        error = np.sqrt(((self.simulated - self.measured) ** 2).mean(axis=0))
        return np.asarray(np.where(np.isfinite(error), error, np.inf))

    def over_horizon(self) -> tuple[Array, Array]:
        """Horizons in s, shape (n,), and the rms of the errors over all starts, shape (2, n, J + 1)."""
        each = self.errors.reshape(2, -1, self.length, self.errors.shape[2])
        return self.t[: self.length] - self.t[0], np.sqrt((each**2).mean(axis=1))


def simulated_beside(model: Model, logs: Sequence[Log | Recording]) -> SimulatedBeside | str | None:
    """Simulate the beginning of the first log of commands, or else of the first log with the torque of all joints.

    Parameters
    ----------
    logs : sequence of Log or Recording
        As read, without the torque of the model's controller.

    Returns
    -------
    SimulatedBeside, str or None
        The reason where the model cannot be simulated; None where no log can be simulated.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.forward.simulated_beside import simulated_beside
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=1), rate=100.0)
    >>> beside = simulated_beside(fr.identify(robot, [log], recursion="none").model, [log])
    >>> beside.closed, beside.length  # torque at 100 Hz: a start every second
    (False, 100)
    """
    joints = model.robot.joints
    closed = [log for log in logs if follows_commands(model.controller, log, joints)]
    possible = closed or [log for log in driven(logs, None, model.currents) if _torque_of_all(log, joints)]
    if not possible:
        return None
    try:
        return _beside(model, possible[0], bool(closed))
    except InputError as error:
        return str(error)


def _beside(model: Model, log: Log | Recording, closed: bool) -> SimulatedBeside:
    part = _beginning(log, model.robot.joints)
    motion, source = next(moved(model, [part] if closed else need_motion([part], model.robot.joints)))
    extra = {name: (motion.t, values) for name, values in motion.extra.items()}
    thetas = np.stack([model.full_theta, urdf_parameters(model)])
    forward = ForwardDynamics(model, thetas, extra=extra, begin=motion.start)
    N = len(motion.t)
    n = N if closed else min(N, round(RESTART / motion.step))
    starts = np.arange(N // n) * n
    found = simulated_from(forward, motion, source, starts, (np.arange(n), min(LARGEST_STEP, motion.step)))
    simulated = found.reshape(2, len(starts) * n, -1)
    measured = motion.q[: len(starts) * n]
    errors = position_errors(forward.robot, simulated, measured)
    t = motion.t[: len(measured)] - preview_of(log).t[0]
    return SimulatedBeside(log.source, t, measured, simulated[0], n, errors)


def _beginning(log: Log | Recording, joints: Sequence[str]) -> Log:
    """The beginning of a log; where the arm rests throughout it, the beginning of the motion."""
    chunk = moving_part(log, joints)
    q = chunk.select(joints).q
    moves = (np.abs(q - q[0]) >= STANDSTILL_SPAN).any(axis=1)
    begins = float(chunk.t[moves.argmax()] - chunk.t[0])
    start = begins if begins >= BESIDE_SECONDS else 0.0
    return stretch(chunk, start, start + BESIDE_SECONDS)


def _torque_of_all(log: Log | Recording, joints: Sequence[str]) -> bool:
    head = preview_of(log)
    return set(joints) <= set(head.joints) and bool(head.select(joints).has("tau").all())
