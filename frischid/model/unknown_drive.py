"""Gains and delay of a controller that the user could not name, from logs of commanded positions.

    q_cmd,j(t − d) − q_j = κ_j Y_j θ + noise,     κ_j = 1 / kp_j

*Gains.* The URDF's links are the scale (`frischid.estimators.torque_scale`): a gain is known as well as the links are
that move with its joint. Gains that the user named are a scale too, and so are torques of the controller beside the
position error: feed-forward (`tauff`), and kd (v_cmd − q̇) with a kd that is named.

*Named delay in doubt.* The fit corrects such a delay to first order (`frischid.model.doubtful_delay`), and an error of
two steps is too large for that: it is second order in friction and armature. So the commands are taken at the delay
that minimises L(d) + (d − d_named)²/s², and the prior of the correction keeps its centre at d_named.

*Delay.* A command that acts late shifts the signal. One delay d serves all joints. It minimises twice the negative log
likelihood L(d) of the signals. Its variance is 2 / L''(d) + h² / 12 + (d − d_r)² / 1.96²: a log with the step h does
not show when within a step a command was read, and d_r is the delay at which the residual is the smallest share of the
signal. L counts the residual as noise of a fixed size. A model's error grows with the torque, and L then prefers the
delay at which the commands lie nearest to the positions, because the signal is small there. So where d and d_r differ,
the model's error decides, not the log. A delay whose range reaches zero counts as none.

Without commanded velocities, the drive's own damping kd q̇ and the joint's viscous friction are one: kd then need not be
known to find kp. With them, an open kd is a column beside the others, with the coefficient κ_j kd_j = kd_j / kp_j.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize

from frischid.effects import BASELINE
from frischid.effects.commands import PositionGain, VelocityGain
from frischid.errors import InputError
from frischid.estimators.torque_scale import TorqueScales, torque_scales
from frischid.estimators.urdf_prior import urdf_prior
from frischid.logs.command_checks import MOST_DELAY_STEPS
from frischid.logs.controller import REST, Gains, PDController
from frischid.logs.driven import driven
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.recording import Motions, Recording, preview_of
from frischid.logs.summary import Data, held_by, summarise, torque_joints
from frischid.model.drive_parameters import REACH
from frischid.model.found_gains import gain_notes, with_gains
from frischid.model.identify_options import IdentifyOptions
from frischid.model.unknown_damping import damping_effects, open_damping
from frischid.regression.accumulation import accumulate
from frischid.regression.base_parameters import Reduction
from frischid.regression.moment_blocks import total
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

_COARSE = (0, 1, 2, 3, 5, 8, 12, 18, 26, 36, MOST_DELAY_STEPS)  # steps of the log; between them a smooth minimum
_FINE = 0.25  # steps of the log, for the second derivative
_LINEAR_STEPS = 0.1  # steps of the log: an error of the delay that a correction of first order mends
REACH_OF_DOUBT = 4.0  # standard errors about a named delay in which the logs' own is looked for
_SETTLED_STEPS = 0.02  # steps of the log: far below what a log can tell


def known_controller(
    robot: Robot, logs: Sequence[Data], options: IdentifyOptions, notes: list[str]
) -> PDController | None:
    """The controller with numbers for everything that the user left open.

    Parameters
    ----------
    logs : sequence of Log or Recording
        Logs to fit, as read.
    notes : list of str
        Gets a sentence on what was found.

    Returns
    -------
    PDController or None
        The options' own controller where nothing is open.

    Raises
    ------
    InputError
        The logs determine a gain with the wrong sign.
    """
    controller = options.controller
    if controller is None:
        return None
    joints = _commanded(robot, logs)
    open_gains = [n for n in joints if not controller.knows_gain(n)]
    late = controller.delay is None or controller.values("delay_doubt", joints).any()
    near = [n for n in open_damping(controller, joints) if late]
    if not joints or not (open_gains or late):
        return controller
    beside = _torques_beside(controller, [preview_of(log) for log in logs], open_gains)
    search = _Search(robot, tuple(logs), replace(options, controller=controller), tuple(open_gains), beside)
    delay: Gains = 0.0
    if controller.delay is None:
        found, stderr = search.delay()
        delay = found if found > REACH * stderr else 0.0
        notes.append(f"the logs say that commands act {1e3 * found:.3g} ± {float(f'{1e3 * stderr:.2g}'):g} ms late")
        if not delay:
            notes[-1] += (
                "; this may be no delay at all. The commands are taken without one, and the fit corrects them with "
                "this doubt: the table of drives has the delay that results"
            )
        controller = replace(controller, delay=delay, delay_doubt=stderr)
    else:
        moved = search.near_the_named_delay()
        controller = moved or controller
        notes += [] if moved is None else [_moved_delay(moved)]
        assert controller.delay is not None
        delay = controller.delay
    if near:
        controller = replace(controller, kd_near=search.damping(delay))
    if open_gains:
        controller, lost = with_gains(controller, open_gains, search.at(delay), search.joints)
        notes += gain_notes(controller, [n for n in open_gains if n in search.joints], lost)
    return controller


def _moved_delay(controller: PDController) -> str:
    """A sentence on a doubtful delay that the logs put elsewhere; it is one for all joints."""
    delay, doubt = (float(controller.values(x, [""])[0]) for x in ("delay", "delay_doubt"))
    told = controller.delay_told or 0.0
    return (
        f"the named delay of {1e3 * told:.3g} ± {1e3 * doubt:.2g} ms: the logs put it near {1e3 * delay:.3g} ms, and "
        "are used with this delay"
    )


def _commanded(robot: Robot, logs: Sequence[Data]) -> list[str]:
    """Joints whose torque comes from commands."""
    heads = [preview_of(log) for log in logs]
    there = {n for head in heads for n in np.compress(head.has("qcmd") & ~head.has("tau"), head.joints)}
    return [n for n in robot.joints if n in there]


def _torques_beside(controller: PDController, heads: Sequence[Log], joints: Sequence[str]) -> tuple[str, ...]:
    """Joints with a torque of known size beside the position error: feed-forward, or damping about a velocity.

    Raises
    ------
    InputError
        A joint has an effort limit, which is no linear column.
    """
    for name in joints:
        if np.isfinite(controller.values("limit", [name])[0]):
            raise InputError(
                f"the effort limit of {name} is in N·m (N) and needs its kp: give "
                f"--kp {shlex.quote(f'{name}=VALUE')}, or leave "
                "--effort-limit out where the drive does not reach its limit"
            )

    def beside(head: Log, name: str) -> bool:
        if name not in head.joints:
            return False
        column, damped = head.joints.index(name), controller.values("kd", [name])[0] > 0
        return bool(head.has("tauff")[column] or (damped and head.has("vcmd")[column]))

    return tuple(n for n in joints if any(beside(head, n) for head in heads))


def _without_rest(log: Data, joints: Sequence[str]) -> Data:
    """A driven log in which the signal of some joints is the position error alone."""
    if isinstance(log, Recording):

        def read(samples: int) -> Iterator[Log]:
            return (_error_alone(chunk, joints) for chunk in log.read(samples))

        return replace(log, read=read)
    return _error_alone(log, joints)


def _error_alone(log: Log, joints: Sequence[str]) -> Log:
    assert log.tau is not None
    tau = log.tau.copy()
    for name in joints:
        if REST + name in log.extra:
            tau[:, log.joints.index(name)] -= log.extra[REST + name]
    return replace(log, tau=tau)


@dataclass(frozen=True, eq=False)
class _Search:
    """Signals of some logs at any delay."""

    robot: Robot
    logs: tuple[Data, ...]
    options: IdentifyOptions
    open_gains: tuple[str, ...]
    beside: tuple[str, ...] = ()

    @cached_property
    def held(self) -> Robot:
        return held_by(self.robot, self.logs)[0]

    @cached_property
    def joints(self) -> list[str]:
        return torque_joints(self.held, self._driven(0.0), self.options.torque_joints, [])

    @cached_property
    def lowpass(self) -> LowPass:
        return summarise(self.held, self._driven(0.0), self.joints, self.options.cutoff).lowpass

    @cached_property
    def columns(self) -> tuple[Regressor, Reduction]:
        known = [PositionGain(self.beside)] if self.beside else []
        channels = [preview_of(log).extra for log in self._driven(0.0)]
        effects = damping_effects(self.options.controller, [*BASELINE, *known], channels, self.held.joints)
        regressor = Regressor(self.held, effects, self.options.reference)
        return regressor, structure(regressor, self.joints)

    def _driven(self, delay: Gains) -> tuple[Data, ...]:
        """The logs with the torque of known gains, and the position error where the gain is not known."""
        given = self.options.controller
        assert given is not None
        named = [n for n in self.robot.joints if n not in self.open_gains]

        def of(name: str) -> dict[str, float]:
            return dict(zip(named, map(float, given.values(name, named)), strict=True))

        known = [n for n in named if given.knows_gain(n)]
        gains = dict(zip(known, map(float, given.values("kp", known)), strict=True))
        damping = {
            **of("kd"),
            **{n: float(given.values("kd", [n])[0]) for n in self.beside},
            **dict.fromkeys(open_damping(given, self.robot.joints)),
        }
        unit = replace(given, kp=gains | dict.fromkeys(self.open_gains, 1.0), kd=damping, limit=None, delay=delay)
        limited = replace(unit, limit={n: x for n, x in of("limit").items() if np.isfinite(x)} or None)
        return tuple(_without_rest(log, self.beside) for log in driven(self.logs, limited))

    def at(self, delay: Gains) -> TorqueScales:
        """Gains at a delay."""
        regressor, reduction = self.columns
        motions = Motions(self._driven(delay), self.held.joints, self.lowpass, self.options.velocity)
        blocks = accumulate(regressor, motions, self.lowpass, self.joints, base=reduction.base)
        whole = total(blocks.described(reduction.base_columns()))
        prior = urdf_prior(regressor, reduction, whole, self.options.prior_criteria)
        known = np.array([n not in self.open_gains for n in self.joints])
        of = {c.joint: k for k, c in enumerate(regressor.columns) if c.effect == PositionGain.id}
        means = {j: of[n] for j, n in enumerate(self.joints) if n in of}
        return torque_scales(whole, reduction.mapping, prior, known, self.options.prior_criteria.scale_rule, means)

    def damping(self, delay: Gains) -> dict[str, float]:
        """Open damping gains at a delay, near enough for the torque that a small error of the delay shifts."""
        found, columns = self.at(delay), self.columns[0].columns
        scale = dict(zip(self.joints, found.inverse.tolist(), strict=True))
        values = zip(columns, found.others.tolist(), strict=True)
        return {c.joint: x / scale[c.joint] for c, x in values if c.effect == VelocityGain.id and scale[c.joint] > 0}

    def delay(self) -> tuple[float, float]:
        """The delay of all joints and its standard error, s."""
        step = min(1.0 / preview_of(log).rate for log in self.logs)
        tried: dict[float, TorqueScales] = {}

        def cost(steps: float) -> float:
            found = tried.setdefault(float(steps), self.at(float(steps) * step))
            return float(np.log(found.variance).sum())

        coarse = [cost(k) for k in _COARSE]
        best = int(np.argmin(coarse))
        if best == len(_COARSE) - 1:
            raise InputError(
                f"the likelihood of the logs grows up to a delay of {MOST_DELAY_STEPS} steps "
                f"({1e3 * step * MOST_DELAY_STEPS:.3g} ms), the longest that is tried: do the commands belong to these "
                "positions? give --delay"
            )
        between = _COARSE[max(best - 1, 0)], _COARSE[best + 1]
        found = optimize.minimize_scalar(cost, bounds=between, method="bounded", options={"xatol": _SETTLED_STEPS})
        at = float(found.x) if found.fun < coarse[best] else float(_COARSE[best])
        centre = max(at, _FINE)  # a delay is not negative
        curvature = tried[0.0].rows * (cost(centre - _FINE) - 2 * cost(centre) + cost(centre + _FINE)) / _FINE**2
        widest = MOST_DELAY_STEPS / np.sqrt(12)  # of a delay about which the logs say nothing
        noise = np.sqrt(2 / curvature) if curvature > 2 / widest**2 else widest
        relative = min(tried, key=lambda d: float(np.log(tried[d].share).sum()))
        return at * step, float(np.sqrt(noise**2 + 1 / 12 + ((at - relative) / REACH) ** 2)) * step

    def near_the_named_delay(self) -> PDController | None:
        """The controller with the delay at which the logs and a named, doubtful delay agree; None: that is the same."""
        given = self.options.controller
        assert given is not None
        doubt = given.delay_doubt
        if not isinstance(given.delay, float) or not isinstance(doubt, float) or not doubt:
            return None
        step = min(1.0 / preview_of(log).rate for log in self.logs)
        told = given.delay if given.delay_told is None else given.delay_told

        def cost(steps: float) -> float:
            found = self.at(steps * step)
            return found.rows * float(np.log(found.variance).sum()) + ((steps * step - told) / doubt) ** 2

        reach = REACH_OF_DOUBT * doubt
        bounds = (max(0.0, told - reach) / step, min(MOST_DELAY_STEPS * step, told + reach) / step)
        if bounds[1] - bounds[0] < _LINEAR_STEPS:
            return None
        found = optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": _LINEAR_STEPS / 2})
        delay = float(found.x) * step
        if abs(delay - given.delay) < _LINEAR_STEPS * step:
            return None
        return replace(given, delay=delay, delay_told=told)
