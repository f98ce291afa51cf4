"""The error of a model as a motion: simulated against measured positions, over a horizon.

    e_j(T) = sqrt( mean over starts s of (q_sim,j(s + T) − q_j(s + T))² ),   q_sim(s) = q(s),  q̇_sim(s) = q̇(s)

Starts are spread evenly over the logs. From each start the model moves under the recorded torque alone (open loop), or
under a controller with the recorded commands. Then the whole log is simulated from its first sample. The same is done
with the URDF's links with fitted friction. The error at the tip is the distance in space.

Open loop is a hard test: an error of the torque is integrated twice, and nothing corrects an arm that falls too fast.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frischid.core.arguments import check_number
from frischid.core.shown import Shown
from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.forward.commanded_motion import follows_commands, moved
from frischid.forward.forward_dynamics import LARGEST_STEP, ForwardDynamics
from frischid.forward.simulated_motion import Starts
from frischid.forward.torque_sources import RecordedTorque, TorqueSource
from frischid.logs.given import Logs, as_logs
from frischid.logs.mapping import MappingLike
from frischid.logs.poses import need_motion
from frischid.logs.preprocessing import Motion
from frischid.model.comparison import urdf_parameters
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.robot.kinematic_tree import tip_joint, tip_positions
from frischid.robot.robot import Robot

HORIZONS = (0.1, 0.5, 1.0, 2.0, 5.0)
"""s. Horizons that are reported, as far as the logs are longer."""
STARTS_PER_LOG = 40
"""Starts per log: the mean of their squares is known to about a tenth, and 40 robots move in the time of four."""


@dataclass(frozen=True)
class HorizonError:
    """Errors of simulated positions at one horizon, or along whole logs.

    Attributes
    ----------
    horizon : float or None
        s; None: the rms error along the whole log, from its first sample.
    starts : int
        Simulations behind the figures.
    joints, urdf : dict of str to float
        Rms position error of each joint, rad (m): the model's, and that of the URDF with fitted friction; infinite
        where a simulated motion became unstable.
    tip, urdf_tip : float
        Rms distance at the tip, mm.
    """

    horizon: float | None
    starts: int
    joints: dict[str, float]
    urdf: dict[str, float]
    tip: float
    urdf_tip: float

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; null where a motion became unstable."""
        return {
            "horizon_s": self.horizon,
            "starts": self.starts,
            "joints": {n: _plain(x) for n, x in self.joints.items()},
            "urdf_joints": {n: _plain(x) for n, x in self.urdf.items()},
            "tip_mm": _plain(self.tip),
            "urdf_tip_mm": _plain(self.urdf_tip),
        }


@dataclass(frozen=True, eq=False)
class MotionComparison(Shown):
    """Simulated against measured motion.

    Attributes
    ----------
    horizons : tuple of HorizonError
        Ascending.
    whole : HorizonError
        Along the whole logs.
    tip : str
        Last joint before the tip.
    sources : tuple of str
        The logs.
    closed : bool
        Whether a controller gave the torque; otherwise the recorded torque did.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.001))
    >>> found = fr.compare_simulated(fr.identify(robot, [log], recursion="none").model, [log], horizons=[0.1, 0.2])
    >>> [h.horizon for h in found.horizons], found.whole.horizon, found.closed
    ([0.1, 0.2], None, False)
    """

    horizons: tuple[HorizonError, ...]
    whole: HorizonError
    tip: str
    sources: tuple[str, ...]
    closed: bool = False

    def __repr__(self) -> str:
        ends = ", ".join(f"{h.tip:.3g} mm after {h.horizon:g} s" for h in self.horizons if h.horizon is not None)
        return f"MotionComparison(tip error {ends})"

    @property
    def instability(self) -> str | None:
        """Says after which time the model's simulated motion runs away, and what to look at; None where it does not."""
        lost = [h for h in (*self.horizons, self.whole) if not np.isfinite(h.tip)]
        if not lost:
            return None
        first = lost[0].horizon
        when = "somewhere along the whole log" if first is None else f"within {first:g} s"
        if self.closed:
            return (
                f"the simulated loop is unstable {when}: this controller cannot hold the model; check the gains (kp, "
                "kd and their units) and the delay"
            )
        return (
            f"the simulated motion runs away {when}, because the recorded torque moves the model away from the "
            "measured motion; look at the shorter horizons, and at the links' masses"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "horizons": [h.to_dict() for h in self.horizons],
            "whole": self.whole.to_dict(),
            "tip_joint": self.tip,
            "logs": list(self.sources),
            "closed_loop": self.closed,
        }


def compare_simulated(
    model: Model,
    logs: Logs,
    *,
    horizons: Sequence[float] = HORIZONS,
    sources: Sequence[TorqueSource] | None = None,
    step: float = LARGEST_STEP,
    mapping: MappingLike = None,
    progress: Callable[[str], None] = lambda _: None,
) -> MotionComparison:
    """Simulate logs and measure the position error.

    Parameters
    ----------
    model : Model
    logs : sequence of Log, Recording or data frame, or one data frame
        At least one, with position and torque of the robot's joints.
    horizons : sequence of float
        s. Horizons longer than every log are left out.
    sources : sequence of TorqueSource, optional
        Source of torque for each log, on the log's clock. By default the log's own torque; for logs of commands,
        the model's controller, which follows the commands.
    step : float
        Longest step of the integration, s.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.
    progress : callable, optional
        Called with a short text before the horizons of a log, and before the whole log.

    Returns
    -------
    MotionComparison

    Raises
    ------
    InputError
        A log lacks a joint or its torque, or is shorter than every horizon; or the model cannot be simulated.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=1), rate=200.0, noise=fr.Noise(tau=0.001))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> found = fr.compare_simulated(model, [log], horizons=[0.1])
    >>> found.horizons[0].tip < found.horizons[0].urdf_tip
    True
    """
    check_model(model)
    logs = as_logs(logs, model.robot.joints, mapping)
    if not logs:
        raise InputError("there is no log to simulate; give at least one")
    if not isinstance(horizons, Sequence | np.ndarray):
        raise InputError(f"horizons must be a list of times in s, got {shortened(horizons)}")
    for h in horizons:
        check_number("a horizon", h)
    if not len(horizons) or not all(0 < h < math.inf for h in horizons):
        raise InputError(f"horizons must be positive times in s, got {list(horizons)}")
    if sources is not None and len(sources) != len(logs):
        raise InputError(f"{len(sources)} sources of torque were given for {len(logs)} logs; give one per log")
    model.check(logs)
    logs = need_motion(logs, model.robot.joints) if sources is None else logs
    if sources is None:
        closed = all(follows_commands(model.controller, log, model.robot.joints) for log in logs)
    else:
        closed = not all(isinstance(source, RecordedTorque) for source in sources)
    thetas = np.stack([model.full_theta, urdf_parameters(model)])
    parts: list[tuple[float, Array]] = []
    wholes: list[Array] = []
    for number, (motion, source) in enumerate(moved(model, logs, sources)):
        k = min(number, len(logs) - 1)  # a log with gaps has several motions
        progress(f"simulating from many instants ({2 * k + 1} of {2 * len(logs)})")
        extra = {name: (motion.t, values) for name, values in motion.extra.items()}
        forward = ForwardDynamics(model, thetas, extra=extra, begin=motion.start)
        parts += _errors_over_horizons(forward, motion, source, (sorted(horizons), step))
        progress(f"simulating the whole log ({2 * k + 2} of {2 * len(logs)})")
        wholes.append(_errors_of_whole(forward, motion, source, step))
    if not parts:
        shortest = min(horizons)
        raise InputError(
            f"no log is longer than the shortest horizon, {shortest:g} s; give a shorter horizon, or longer logs"
        )
    found = [_summary(model, h, [x for length, x in parts if length == h]) for h in sorted({h for h, _ in parts})]
    names = tuple(log.source for log in logs)
    return MotionComparison(tuple(found), _summary(model, None, wholes), tip_joint(model.robot), names, closed)


def _errors_over_horizons(
    forward: ForwardDynamics, motion: Motion, source: TorqueSource, how: tuple[Sequence[float], float]
) -> list[tuple[float, Array]]:
    """Horizon and errors (2, starts, J + 1) of the model and of the URDF; the last column is the tip's."""
    horizons, step = how
    reach = [max(1, round(h / motion.step)) for h in horizons]
    fitting = [n for n in reach if n < len(motion.t)]
    if not fitting:
        return []
    last = len(motion.t) - 1 - max(fitting)
    samples = np.unique(np.linspace(0, last, STARTS_PER_LOG).round().astype(np.intp))
    times, place = np.unique([0, *fitting], return_inverse=True)  # two horizons may round to the same sample
    found = simulated_from(forward, motion, source, samples, (times, step))
    return [
        (horizon, position_errors(forward.robot, found[:, :, k], motion.q[samples + n]))
        for horizon, n, k in zip(horizons, fitting, place[1:], strict=False)
    ]


def _errors_of_whole(forward: ForwardDynamics, motion: Motion, source: TorqueSource, step: float) -> Array:
    """Errors (2, samples, J + 1) along a whole motion."""
    samples = np.arange(len(motion.t))
    found = simulated_from(forward, motion, source, samples[:1], (samples, step))
    return position_errors(forward.robot, found[:, 0], motion.q)


def simulated_from(
    forward: ForwardDynamics, motion: Motion, source: TorqueSource, samples: Any, when: tuple[Any, float]
) -> Array:
    """Positions (2, starts, times, J) of the model and of the URDF, from measured states.

    Parameters
    ----------
    forward : ForwardDynamics
        Of two sets of parameters.
    samples : ndarray of int, shape (starts,)
        Samples of the motion whose states the simulations start from.
    when : tuple of ndarray of int, shape (times,), and float
        Samples after each start, and the longest step of the integration, s.
    """
    K = len(samples)
    remembered = [np.tile(z, (2, 1)) for z in forward.remembered(motion.t, motion.v, samples)]
    speed = np.where(motion.standstill, 0.0, motion.v)  # where a joint stands still, its measured speed is noise
    q, v = (np.tile(x[samples], (2, 1)) for x in (motion.q, speed))
    starts = Starts(q, v, np.tile(motion.t[samples], 2), np.repeat([0, 1], K), remembered)
    steps, step = when
    found = forward.simulate(source, starts, steps * motion.step, step=min(step, motion.step))
    return found.q.reshape(2, K, len(steps), -1)


def position_errors(robot: Robot, simulated: Array, measured: Array) -> Array:
    """Errors of positions and of the tip, shape (2, N, J + 1).

    Parameters
    ----------
    simulated : ndarray, shape (2, N, J)
        rad (m); not finite where a simulated motion became unstable. The errors are infinite there.
    measured : ndarray, shape (N, J)

    Returns
    -------
    ndarray, shape (2, N, J + 1)
        rad (m); the last column is the distance at the tip, mm.
    """
    there = tip_positions(robot, measured)
    stable: NDArray[np.bool_] = np.asarray(np.isfinite(simulated).all(axis=2))
    shown = np.where(stable[:, :, None], simulated, 0.0)
    tips = [tip_positions(robot, positions) for positions in shown]
    distance = 1e3 * np.linalg.norm(np.array(tips) - there, axis=2)
    errors = np.concatenate([simulated - measured, distance[:, :, None]], axis=2)
    return np.where(stable[:, :, None], errors, np.inf)


def _summary(model: Model, horizon: float | None, errors: Sequence[Array]) -> HorizonError:
    rms = np.sqrt((np.concatenate(errors, axis=1) ** 2).mean(axis=1))
    mine, urdf = (dict(zip(model.robot.joints, row[:-1].tolist(), strict=True)) for row in rms)
    count = len(errors) if horizon is None else sum(x.shape[1] for x in errors)
    return HorizonError(horizon, count, mine, urdf, float(rms[0, -1]), float(rms[1, -1]))


def _plain(x: float) -> float | None:
    return x if np.isfinite(x) else None
