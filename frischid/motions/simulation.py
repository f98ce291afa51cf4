"""Logs of a robot with known parameters, for demonstrations, tests and what-if questions.

    τ = Γ(q, q̇, q̈) θ_rigid + Σ_effects C_e θ_e + e_τ

along a trajectory in closed form. Then every channel gets its own white noise and, if wanted, the quantisation of its
encoder. The motion itself is exact; only the recorded channels have noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.arguments import check_kind, check_number
from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect, columns_of
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Log
from frischid.motions.motion_request import check_rate
from frischid.motions.trajectory import Trajectory
from frischid.regression.block import Samples
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.robot.robot import Robot

MOST_VALUES = 2_000_000
"""Numbers of the regressor that are in memory at once: 16 MB."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise on each channel, and the encoders' step.

    Attributes
    ----------
    q, v, a : float
        rad, rad/s, rad/s² (m, m/s, m/s² for prismatic joints).
    tau : float
        Share of each joint's own torque standard deviation (0.01: one percent).
    quantum : float
        Resolution of the position encoders, rad (m); zero: no quantisation.

    Raises
    ------
    InputError
        A value is negative or not finite.

    Examples
    --------
    >>> import frischid as fr
    >>> fr.Noise(q=1e-5, tau=0.01)
    Noise(q=1e-05, v=0.0, a=0.0, tau=0.01, quantum=0.0)
    """

    q: float = 0.0
    v: float = 0.0
    a: float = 0.0
    tau: float = 0.0
    quantum: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_number(f"noise {name}", value)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"noise {name} must be zero or a positive number, got {value}")


def parameters_of(robot: Robot, effects: Sequence[Effect], values: Mapping[str, float] | None = None) -> Array:
    """True parameter of every column: the URDF's value, or that of `values`.

    Raises
    ------
    UnknownNameError
        A name is not a parameter of this robot with these effects.
    InputError
        A value is not finite.
    """
    names = [c.name for c in Regressor(robot, effects).columns]
    theta = nominal_parameters(robot, effects)
    for name, value in (values or {}).items():
        if name not in names:
            raise UnknownNameError("parameter", name, names)
        check_number(f"the parameter {name}", value)
        if not np.isfinite(value):
            raise InputError(f"the parameter {name} must be a finite number, got {value}")
        theta[names.index(name)] = value
    return theta


def simulate(
    robot: Robot,
    trajectory: Trajectory,
    *,
    rate: float,
    effects: Sequence[Effect] = BASELINE,
    parameters: Mapping[str, float] | None = None,
    noise: Noise | None = None,
    channels: Sequence[str] = ("v", "a"),
    seed: int = 0,
    name: str = "simulated",
) -> Log:
    """Record a log of a simulated robot.

    Parameters
    ----------
    robot : Robot
    trajectory : Trajectory
    rate : float
        Samples per second, Hz.
    effects : sequence of Effect
        Effects that act on the robot besides its links.
    parameters : mapping of str to float
        Values that differ from the URDF's, by parameter name; other parameters without a value in the URDF are zero.
        The load on a gear is that of links with these values.
    noise : Noise, optional
        None: the log is exact.
    channels : sequence of {"v", "a"}
        Derivatives in the log besides q.
    seed : int
        Seed of the noise.
    name : str
        Name of the log in messages.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The rate is not a positive number, a parameter is not finite, or the trajectory has another number of joints.
    UnknownNameError
        A name in `parameters` is not a parameter of this robot with these effects, or a channel is not v or a.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motion = fr.random_fourier(robot, 5.0, seed=0)
    >>> log = fr.simulate(robot, motion, rate=100.0, effects=())
    >>> len(log), log.joints
    (501, ('joint1', 'joint2'))
    >>> bool(np.allclose(log.tau, robot.inverse_dynamics(log.q, log.v, log.a)))
    True
    """
    check_kind("robot", robot, Robot, "robot=frischid.Robot.load(path or name)")
    check_kind("noise", noise or Noise(), Noise, "frischid.Noise(q=1e-5, tau=0.01)")
    if not hasattr(trajectory, "duration"):
        wanted = "a motion such as frischid.random_fourier(robot, 10.0, seed=1)"
        raise InputError(f"trajectory must be {wanted}, got {shortened(trajectory)}")
    check_rate(rate, trajectory.duration, seed)
    for channel in channels:
        if channel not in ("v", "a"):
            raise UnknownNameError("channel", channel, ["v", "a"])
    noise = noise or Noise()
    rng = np.random.default_rng(seed)
    t = np.arange(round(trajectory.duration * rate) + 1) / rate
    q, v, a = trajectory(t)
    if q.shape[1] != len(robot.joints):
        raise InputError(f"the trajectory moves {q.shape[1]} joints, {robot.name} has {len(robot.joints)}")
    theta = parameters_of(robot, effects, parameters)
    tau = torque(robot, effects, theta, t, q, v, a, _with_links(robot, effects, theta))
    tau = tau + noise.tau * tau.std(axis=0) * rng.normal(size=tau.shape)
    q, v, a = (x + s * rng.normal(size=x.shape) for x, s in ((q, noise.q), (v, noise.v), (a, noise.a)))
    if noise.quantum > 0:
        q = noise.quantum * np.round(q / noise.quantum)
    return Log(
        t,
        robot.joints,
        q,
        v=v if "v" in channels else None,
        a=a if "a" in channels else None,
        tau=tau,
        source=name,
        notes=(f"{name}: simulated, {len(t)} samples at {rate:g} Hz, seed {seed}",),
    )


def _with_links(robot: Robot, effects: Sequence[Effect], theta: Array) -> dict[str, float]:
    """The URDF's value of every column, but those of the simulated links, which load the gears."""
    values = nominal_parameters(robot, effects)
    values[: len(robot.columns)] = theta[: len(robot.columns)]
    return dict(zip((c.name for c in columns_of(robot, effects)), values.tolist(), strict=True))


def torque(
    robot: Robot,
    effects: Sequence[Effect],
    theta: Array,
    t: Array,
    q: Array,
    v: Array,
    a: Array,
    reference: Mapping[str, float] | None = None,
) -> Array:
    """Torque of a parameter vector along a motion, (N, J), computed chunk by chunk; `reference` as in `Regressor`."""
    regressor = Regressor(robot, effects, reference)
    parts = []
    # an effect with memory needs the whole motion at once; every chunk needs the time at which the log begins
    most = max(64, MOST_VALUES // (len(regressor.columns) * len(robot.joints)))
    chunk = len(t) if any(effect.memory for effect in effects) else most
    for start in range(0, len(t), chunk):
        s = slice(start, start + chunk)
        Y = regressor.evaluate(Samples(t[s], q[s], v[s], a[s], float(t[0])))
        part = np.einsum("ncj,c->nj", Y, theta)
        known = robot.known_torque(q[s], v[s], a[s])
        parts.append(part if known is None else part + known)
    return np.concatenate(parts)
