"""Faults that people's logs have, planted in a log: what sensors, file or robot do that the URDF does not say.

Each function changes a `Case` in place and notes what `check` ought to say: the kind of the issue and its joints. Joint
and size are drawn from the case's generator of random numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal
from scipy.spatial.transform import Rotation

from frischid.core.types import Array
from frischid.logs.log import Log
from frischid.robot.robot import Robot


class NoJointError(Exception):
    """The robot has no joint left at which a fault would show."""


@dataclass
class Case:
    """A simulated log and what was done to it: kind of issue, joints (None: any)."""

    robot: Robot
    log: Log
    said: list[tuple[str, tuple[str, ...] | None]]
    rng: np.random.Generator
    used: set[int]
    judged: list[str] | None = None

    def joint(self) -> int:
        """A joint without a fault whose torque is not friction alone: otherwise most faults change nothing."""
        rigid = self.robot.inverse_dynamics(self.log.q, np.zeros_like(self.log.q), self.derivative(2))
        share = rigid.std(axis=0) / np.asarray(self.log.tau).std(axis=0)
        free = [j for j in range(len(self.robot.joints)) if j not in self.used and share[j] > 0.3]
        if not free:
            raise NoJointError
        j = int(self.rng.choice(free))
        self.used.add(j)
        return j

    def derivative(self, order: int) -> Array:
        """Velocity (order 1) or acceleration (2) of the positions, through a window of 0.1 s at least five wide."""
        step = float(np.median(np.diff(self.log.t)))
        width = max(5, 2 * round(0.05 / step) + 1)
        return np.asarray(signal.savgol_filter(self.log.q, width, 3, deriv=order, delta=step, axis=0))

    def column(self, channel: str, j: int, change: Callable[[Array], Array]) -> None:
        """Change one column."""
        values = getattr(self.log, channel)
        if values is None:
            return
        values = np.array(values)
        values[:, j] = change(values[:, j])
        self.log = replace(self.log, **{channel: values})

    def name(self, *columns: int) -> tuple[str, ...]:
        """Names of joints, in the robot's order."""
        return tuple(self.robot.joints[j] for j in sorted(columns))


def all_signs(c: Case) -> None:
    c.log = replace(c.log, tau=-np.asarray(c.log.tau))
    c.said.append(("torque sign", tuple(c.judged or c.robot.joints)))


def one_sign(c: Case) -> None:
    j = c.joint()
    c.column("tau", j, np.negative)
    c.said.append(("torque sign", c.name(j)))


def swapped_torques(c: Case) -> None:
    i, j = c.joint(), c.joint()
    tau = np.array(c.log.tau)
    tau[:, [i, j]] = tau[:, [j, i]]
    c.log = replace(c.log, tau=tau)
    c.said.append(("swapped torques", c.name(i, j)))


def swapped_joints(c: Case) -> None:
    i, j = c.joint(), c.joint()
    order = np.arange(len(c.robot.joints))
    order[[i, j]] = j, i
    v = None if c.log.v is None else c.log.v[:, order]
    c.log = replace(c.log, q=c.log.q[:, order], v=v, tau=np.asarray(c.log.tau)[:, order])
    c.said.append(("swapped joints", c.name(i, j)))


def axis_reversed(c: Case) -> None:
    j = c.joint()
    for channel in ("q", "v", "tau"):
        c.column(channel, j, np.negative)
    c.said.append(("position sign", c.name(j)))


def _seen_zero(c: Case, delta: float) -> int:
    """A joint whose zero changes the torque: that of a vertical first axis does not."""
    q, zero = c.log.q[::50], np.zeros_like(c.log.q[::50])
    own = c.robot.inverse_dynamics(q, zero, zero)
    while True:
        j = c.joint()
        other = c.robot.inverse_dynamics(q + delta * np.eye(q.shape[1])[j], zero, zero)
        if np.abs(other - own).max() > 0.2 * np.abs(own).max():
            return j


def zero_right_angle(c: Case) -> None:
    # not π: at a spherical shoulder a zero that is off by half a turn is the same as a turned neighbouring axis
    delta = float(c.rng.choice([np.pi / 2, -np.pi / 2]))
    j = _seen_zero(c, delta)
    c.column("q", j, lambda q: q - delta)
    c.said.append(("joint zero", c.name(j)))


def zero_free(c: Case) -> None:
    delta = float(c.rng.uniform(0.6, 1.2) * c.rng.choice([-1, 1]))
    j = _seen_zero(c, delta)
    c.column("q", j, lambda q: q - delta)
    c.said.append(("joint zero", c.name(j)))


def one_gain(c: Case) -> None:
    j = c.joint()
    factor = float(c.rng.choice([0.1, 0.3, 3.0, 10.0]))
    c.column("tau", j, lambda x: factor * x)
    c.said.append(("torque scale", c.name(j)))


def unit(c: Case) -> None:
    c.log = replace(c.log, tau=1e3 * np.asarray(c.log.tau))
    c.said.append(("torque scale", tuple(c.judged or c.robot.joints)))


def wrapped(c: Case) -> None:
    """A joint whose angle passes ±π."""
    j = c.joint()
    q = c.log.q[:, j]
    c.column("q", j, lambda x: (x + 2 * np.pi - np.median(q)) % (2 * np.pi) + np.median(q) - 2 * np.pi)
    c.said.append(("wrapped angle", c.name(j)))


def tilted(c: Case) -> None:
    """A base that is tilted: the torque changes by that of the other gravity."""
    axis = c.rng.normal(size=2)
    roll, pitch = c.rng.uniform(0.3, 0.8) * axis / np.linalg.norm(axis)
    turned = Rotation.from_euler("xyz", [roll, pitch, 0.0]).inv().apply(c.robot.gravity)
    other = Robot.from_dict({**c.robot.to_dict(), "gravity": turned.tolist()})
    zero = np.zeros_like(c.log.q)
    more = other.inverse_dynamics(c.log.q, zero, zero) - c.robot.inverse_dynamics(c.log.q, zero, zero)
    c.log = replace(c.log, tau=np.asarray(c.log.tau) + more)
    c.said.append(("mounting", None))


def payload(c: Case) -> None:
    q, v, a = c.log.q, c.derivative(1), c.derivative(2)
    last = [k for k, column in enumerate(c.robot.columns) if column.joint == c.robot.joints[-1]]
    Y = np.empty((len(q), len(c.robot.columns), len(c.robot.joints)))
    c.robot.regressor(q, v, a, Y)
    mass = 0.15 * float(c.robot.nominal[0::10].sum())
    body = mass * np.array([1.0, 0.02, 0.0, 0.1, 0.02, 0, 0.02, 0, 0, 0.01])
    c.log = replace(c.log, tau=np.asarray(c.log.tau) + np.einsum("ncj,c->nj", Y[:, last], body))
    c.said.append(("payload", None))


def spring(c: Case) -> None:
    j = c.joint()
    load = float(np.asarray(c.log.tau)[:, j].std())
    q = c.log.q[:, j]
    c.column("tau", j, lambda x: x + 1.5 * load * (q - q.mean()) / q.std())
    c.said.append(("spring", c.name(j)))


def coupling(c: Case) -> None:
    """A motor that turns with two neighbouring joints, whose torques are judged."""
    free = [i for i in range(len(c.robot.joints) - 1) if not c.used & {i, i + 1}]
    if not free:
        raise NoJointError
    i = int(c.rng.choice(free))
    c.used |= {i, i + 1}
    tau, v, a = np.array(c.log.tau), c.derivative(1), c.derivative(2)
    w = v[:, i] + v[:, i + 1]
    size = float(max(tau[:, i].std(), tau[:, i + 1].std()))
    torque = size * (np.tanh(w / 0.05) + w / w.std() + 0.3 * (a[:, i] + a[:, i + 1]))
    tau[:, [i, i + 1]] += torque[:, None]
    c.log = replace(c.log, tau=tau)
    c.said.append(("motor coupling", c.name(i, i + 1)))


def late(c: Case) -> None:
    delay = float(c.rng.uniform(0.04, 0.1))
    tau = np.column_stack([np.interp(c.log.t - delay, c.log.t, x) for x in np.asarray(c.log.tau).T])
    c.log = replace(c.log, tau=tau)
    c.said.append(("late torque", None))


def arrival(c: Case) -> None:
    stamps = c.log.t + np.minimum(c.rng.exponential(0.15, len(c.log)), 0.9) / c.log.rate
    # messages arrive in order, also where the log's own steps are short
    c.log = replace(c.log, t=np.maximum.accumulate(stamps) + 1e-9 * np.arange(len(stamps)))
    c.said.append(("host clock", None))


FAULTS: dict[str, Callable[[Case], None]] = {
    f.__name__: f
    for f in (
        all_signs, one_sign, swapped_torques, swapped_joints, axis_reversed, zero_right_angle, zero_free, one_gain,
        unit, wrapped, tilted, payload, spring, coupling, late, arrival,
    )
}  # fmt: skip
PHYSICS = {"tilted", "payload", "spring", "coupling"}
"""What the robot has. It acts before the sensors: planted after an exchange, a coupling would couple other joints."""
ALONE = {"all_signs", "unit"}
"""Faults of all joints, which are not planted with another fault of torques' signs or units."""
