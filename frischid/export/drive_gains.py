"""Drive gains, the torque of a joint per ampere or per position error, from a payload of known mass.

    g_j i_j = Y_j θ                        without the payload
    g_j i_j = Y_j θ + L_j x_L              with the payload, whose mass in x_L is known

Currents alone determine θ and g only up to one common factor; the known mass determines this factor (Gautier and Briot
2014, ASME J. Dynamic Systems, Measurement and Control 136(5)). There are three methods, from the same moments:

- *total least squares*: with X = (g, θ, x) and the known torque w of the weight, ``[I_j  −Y_j  −L_j  −w] (X, 1) ≈ 0``.
  Only currents are noisy, so θ and x are eliminated exactly, and g is the eigenvector of the least remaining eigenvalue
  (mixed least squares - total least squares, Van Huffel and Vandewalle 1991, chapter 3);
- *in amperes*: ``i_j = κ_j (Y_j θ + L_j x + w) + noise`` with κ = 1/g, by Gauss-Newton from the first method: the
  maximum likelihood for noisy currents. Its standard errors come from a jackknife over blocks of time, as in
  `frischid.estimators.least_squares`;
- *physically constrained*: the values nearest to the second method, weighted by its information, with physical links, a
  physical payload, and g > 0.

The kp of a position controller is such a gain: its signal is the position error q_cmd(t − d) − q in place of a current.
Damping kd of the drive is one more column where velocities are commanded, and a part of viscous friction where not.

Given gains are checked in the other direction: with them, the identified payload must have its true mass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.arguments import check_kind
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect
from frischid.errors import IdentifiabilityError, InputError
from frischid.estimators.drive_gain_ls import in_amperes, total_least_squares
from frischid.export.drive_gain_problem import Carried, GainProblem, KnownPayload
from frischid.logs.controller import PDController
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.filters import LowPass
from frischid.logs.given import Logs, whole_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.summary import held_by
from frischid.model.identify_options import IdentifyOptions
from frischid.model.unknown_damping import damping_effects
from frischid.model.unknown_drive import known_controller
from frischid.regression.moment_blocks import total
from frischid.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Gains:
    """Drive gains of J joints.

    Attributes
    ----------
    joints : tuple of str
    channel : {"current", "tau", "qcmd"}
        Channel that the gains multiply: currents (N·m/A, N/A), a torque channel with a wrong scale (1), or the position
        error of a controller (N·m/rad, N/m).
    gains, stderr : ndarray, shape (J,)
        The gains to use and their standard errors, by maximum likelihood for noisy currents.
    total_least_squares, constrained : ndarray, shape (J,)
        The gains by two other methods, for comparison: total least squares, and with links that can exist.
    given : ndarray, shape (J,), or None
        Gains to check.
    payload : Carried or None
        The payload identified with the `given` gains; None without these.
    mass : float
        True mass of the payload, kg.
    samples : int
        Number of filtered samples.
    lowpass : LowPass
    notes : tuple of str

    Examples
    --------
    Torques whose scale is right, checked by the weight they give:

    >>> import frischid as fr
    >>> robot, payload = fr.Robot.load("planar2"), fr.parse_effects("payload@joint2")
    >>> motion = fr.random_fourier(robot, 5.0, seed=1)
    >>> unloaded = fr.simulate(robot, motion, rate=100.0)
    >>> loaded = fr.simulate(robot, motion, rate=100.0, effects=(*fr.BASELINE, *payload), parameters={"dm2": 2.0})
    >>> found = fr.find_gains(robot, [unloaded], [loaded], fr.KnownPayload(2.0))
    >>> found.channel, round(found.payload.mass, 3), found.gains.round(3)
    ('tau', 2.0, array([1., 1.]))
    """

    joints: tuple[str, ...]
    channel: str
    gains: Array
    stderr: Array
    total_least_squares: Array
    constrained: Array
    given: Array | None
    payload: Carried | None
    mass: float
    samples: int
    lowpass: LowPass
    notes: tuple[str, ...]


def find_gains(
    robot: Robot,
    unloaded: Logs,
    loaded: Logs,
    payload: KnownPayload,
    *,
    given: Mapping[str, float] | None = None,
    effects: Sequence[Effect] = BASELINE,
    cutoff: float | str | None = "auto",
    controller: PDController | None = None,
    mapping: MappingLike = None,
) -> Gains:
    """Identify drive gains from logs without and with a payload of known mass.

    Parameters
    ----------
    robot : Robot
        Loaded with ``frames="joint"``.
    unloaded, loaded : sequence of Log or data frame, or one data frame
        With positions and currents (A), with torques whose scale is to be checked, or with commanded positions.
    payload : KnownPayload
        What hangs there in the loaded logs.
    given : mapping of str to float, optional
        Gains to check, N·m/A (N/A).
    effects : sequence of Effect
        Effects besides the links, assumed to be the same with and without the payload.
    cutoff : float, "auto" or None
        Cut-off of the filter, Hz; None filters nothing.
    controller : PDController, optional
        Of logs of commanded positions: its kp is to be found, or checked if it is named for all joints. A delay of None
        is found from the unloaded logs.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    Gains

    Raises
    ------
    InputError
        A log lacks currents, torques or commands; or the controller has an effort limit or a feed-forward torque, whose
        unit is not that of the position error.
    UnknownNameError
        The joint that carries the payload is not the robot's.
    IdentifiabilityError
        The logs do not determine the gains, or a joint never moves.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import frischid as fr
    >>> robot, payload = fr.Robot.load("planar2"), fr.parse_effects("payload@joint2")
    >>> def log(effects, values, seed):
    ...     motion = fr.random_fourier(robot, 5.0, seed=seed)
    ...     made = fr.simulate(robot, motion, rate=100.0, effects=effects, parameters=values)
    ...     return replace(made, tau=None, current=made.tau / [12.0, 9.0])
    >>> unloaded = [log(fr.BASELINE, {}, 1)]
    >>> loaded = [log((*fr.BASELINE, *payload), {"dm2": 2.0, "dmx2": 0.1}, 2)]
    >>> found = fr.find_gains(robot, unloaded, loaded, fr.KnownPayload(2.0))
    >>> found.channel, found.gains.round(3)
    ('current', array([12., 9.]))
    """
    check_kind("payload", payload, KnownPayload, "frischid.KnownPayload(2.0)")
    if robot.frames != "joint":
        raise InputError("drive gains are found in joint frames; load the robot without --frames")
    unloaded, loaded = (
        whole_logs(given_logs, robot.joints, mapping, name)
        for name, given_logs in (("unloaded", unloaded), ("loaded", loaded))
    )
    robot, notes = held_by(robot, [*unloaded, *loaded])
    if controller is not None:
        controller, given = _without_gains(robot, unloaded, controller, notes)
        unloaded, loaded = ([_position_errors(log, robot, controller) for log in logs] for logs in (unloaded, loaded))
        effects = damping_effects(controller, effects, [log.extra for log in [*unloaded, *loaded]], robot.joints)
        channel = "qcmd"
    else:
        currents = all(log.has("current")[log.index(robot.joints)].all() for log in [*unloaded, *loaded])
        channel = "current" if currents else "tau"
        unloaded, loaded = ([_measured(log, robot, channel) for log in logs] for logs in (unloaded, loaded))
    _check_given(robot, given)
    problem = GainProblem(robot, effects, payload)
    lowpass = _lowpass([*unloaded, *loaded], robot, cutoff)
    blocks = [
        *problem.blocks(unloaded, lowpass, loaded=False),
        *problem.blocks(loaded, lowpass, loaded=True),
    ]
    arranged, counts, J = [problem.arranged(b) for b in blocks], total(blocks).counts, len(robot.joints)
    if still := [n for n, count in zip(robot.joints, counts, strict=True) if count == 0]:
        raise IdentifiabilityError(
            f"{', '.join(still)}: at standstill in all logs, where dry friction hides the gain; move these joints, or "
            "lock them (--lock JOINT) to find the gains of the others"
        )
    rough, start = total_least_squares(np.sum(arranged, axis=0), counts)
    x, covariance, information = in_amperes(arranged, counts, rough, start, problem.names)
    gains = 1.0 / x[-J:]
    constrained, remark = problem.constrained(x, information)
    values = None
    if given is not None or channel == "tau":
        values = np.array([(given or {}).get(n, 1.0) for n in robot.joints])
    return Gains(
        joints=robot.joints,
        channel=channel,
        gains=gains,
        stderr=gains**2 * np.sqrt(np.diag(covariance)[-J:]),
        total_least_squares=rough,
        constrained=constrained,
        given=values,
        payload=None if values is None else problem.payload(blocks, values),
        mass=payload.mass,
        samples=int(sum(b.counts.max() for b in blocks)),
        lowpass=lowpass,
        notes=(*notes, *remark),
    )


def _without_gains(
    robot: Robot, logs: Sequence[Log], controller: PDController, notes: list[str]
) -> tuple[PDController, dict[str, float] | None]:
    """The controller with kp = 1 and an open kd, so that its torque is the position error; and the kp to check."""
    if controller.limit is not None:
        raise InputError(
            "an effort limit is in N·m (N), and the torque is not known before kp is: leave --effort-limit out, and "
            "give logs in which no drive reaches its limit"
        )
    given = {n: controller.gain(n) for n in robot.joints if controller.knows_gain(n)}
    if controller.delay is None:
        controller = known_controller(robot, logs, IdentifyOptions(controller=controller), notes) or controller
    unit = replace(controller, kp=1.0, kd=None, kp_doubt=0.0, delay_doubt=0.0, kd_near=0.0)
    return unit, given or None


def _position_errors(log: Log, robot: Robot, unit: PDController) -> Log:
    """The log with position errors in place of torques."""
    chosen = log.select(robot.joints)
    if lacks := [n for n, yes in zip(robot.joints, chosen.has("qcmd"), strict=True) if not yes]:
        raise InputError(f"{log.source}: no commanded position qcmd_<joint> of {', '.join(lacks)}; kp needs them all")
    if chosen.tauff is not None and np.nan_to_num(chosen.tauff).any():
        raise InputError(
            f"{log.source}: the drive gets a feed-forward torque (tauff_<joint>) in N·m (N) beside the position error; "
            "kp is found from logs without feed-forward"
        )
    return unit.drive(replace(chosen, tau=None))


def _check_given(robot: Robot, given: Mapping[str, float] | None) -> None:
    missing = [] if given is None else [n for n in robot.joints if n not in given]
    if missing:
        raise InputError(f"gains are given for some joints only; {', '.join(missing)} lack one (give all or none)")


def _measured(log: Log, robot: Robot, channel: str) -> Log:
    """The log with currents in place of torques."""
    chosen = log.select(robot.joints)
    values = getattr(chosen, channel)
    if values is None or np.isnan(values).any():
        raise InputError(
            f"{log.source}: neither current_<joint> nor tau_<joint> for all of {', '.join(robot.joints)}; drive gains "
            "need one of them in every log, or commanded positions qcmd_<joint> and their controller (--controller pd)"
        )
    return replace(chosen, tau=values)


def _lowpass(logs: Sequence[Log], robot: Robot, cutoff: float | str | None) -> LowPass:
    if cutoff == "auto":
        return choose_lowpass(logs, robot.joints)
    return LowPass(None if cutoff is None else float(cutoff))
