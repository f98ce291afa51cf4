"""The controller of a model as the source of torque of a simulation: closed loop along recorded commands.

    τ(t) = sat( kp dz(q_cmd(t − d) − q) + kd (v_cmd(t − d) − q̇) + τ_ff(t − d) )     with the simulated q and q̇

The law is that of `frischid.logs.controller`, which puts the measured q and q̇ into it to get a torque from a log. Here
the simulated ones close the loop, so the simulated joint makes its own tracking error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.effects.commands import PositionGain
from frischid.forward.torque_sources import PositionController, RecordedTorque, TorqueSource, between
from frischid.logs.command_checks import CommandTravel, check_commands, check_delay
from frischid.logs.controller import PDController
from frischid.logs.delayed_commands import delayed
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Recording, chunks_of, preview_of
from frischid.logs.wraps import TURN, commands_unwrapped, unwrapped, wraps_of
from frischid.model.model import Model


def follows_commands(controller: PDController | None, log: Log | Recording, joints: Sequence[str]) -> bool:
    """Whether the controller, and no measured torque, drives all these joints of a log."""
    head = preview_of(log)
    if controller is None or not set(joints) <= set(head.joints):
        return False
    chosen = head.select(joints)
    return bool((chosen.has("qcmd") & ~chosen.has("tau")).all())


def commanded_source(controller: PDController, log: Log | Recording, joints: Sequence[str]) -> PositionController:
    """The controller with the commands of a log, on the log's clock.

    Parameters
    ----------
    log : Log or Recording
        With commanded positions of all joints. Only the commands of a recording are held in memory.
    joints : sequence of str
        The robot's J joints.

    Raises
    ------
    InputError
        The commands never change, or the delay is longer than `MOST_DELAY_STEPS` steps.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> log = fr.Log(t, ("elbow",), q=np.zeros((100, 1)), qcmd=np.sin(t)[:, None])
    >>> from frischid.forward.commanded_motion import commanded_source
    >>> source = commanded_source(fr.PDController(kp=20.0), log, ["elbow"])
    >>> source.torque(t[50:51], np.zeros((1, 1)), np.zeros((1, 1))).round(3)
    array([[9.589]])
    """
    parts = [chunk.select(joints) for chunk in chunks_of(log)]
    turned = [commands_unwrapped(part) for part in parts]
    for part in turned:
        check_commands(part, whole=False)
    reduce(CommandTravel.joined, map(CommandTravel.of, turned)).check(log.source)
    delay = controller.values("delay", joints)
    check_delay(delay, joints, parts[0])
    t = np.concatenate([part.t for part in parts])

    def commands(channel: str) -> Array | None:
        found = [x for part in parts if (x := getattr(part, channel)) is not None]
        if len(found) < len(parts):
            return None
        whole = np.nan_to_num(np.concatenate(found))
        if channel == "qcmd":
            whole = unwrapped(Log(t, tuple(joints), whole)).q
        return np.column_stack([delayed(t, whole[:, j], d, controller.held) for j, d in enumerate(delay)])

    positions = commands("qcmd")
    assert positions is not None  # `follows_commands` looked
    return PositionController(
        t,
        positions,
        controller.values("kp", joints),
        controller.values("kd", joints),
        commands("vcmd"),
        commands("tauff"),
        controller.values("limit", joints),
        controller.values("dead_band", joints),
    )


def _as_fitted(model: Model, source: PositionController) -> PositionController:
    """The source of a model whose effect `position_gain` corrects a gain: τ + g r = Y θ + g τ_ref, with g r added here.

    r is the controller's torque beside the position error, of the simulated speed. `ForwardDynamics` has g τ_ref.
    """
    columns = columns_of(model.robot, model.effects)
    more = np.ones(len(model.robot.joints))
    for c, soft in zip(columns, model.full_theta.tolist(), strict=True):
        if c.effect == PositionGain.id:
            more[model.robot.joints.index(c.joint)] += soft
    ahead = None if source.feedforward is None else source.feedforward * more
    return source if (more == 1.0).all() else replace(source, kd=source.kd * more, feedforward=ahead)


def moved(
    model: Model, logs: Sequence[Log | Recording], sources: Sequence[TorqueSource] | None = None
) -> Iterator[tuple[Motion, TorqueSource]]:
    """Every motion of some logs with the source of its torque.

    Parameters
    ----------
    sources : sequence of TorqueSource, optional
        Source of each log. By default the model's controller for a log of commands, and the recorded torque otherwise.
    """
    for number, log in enumerate(logs):
        source = None if sources is None else sources[number]
        commanded = None
        if source is None and follows_commands(model.controller, log, model.robot.joints):
            assert model.controller is not None
            commanded = _as_fitted(model, commanded_source(model.controller, log, model.robot.joints))
            turned = _wrapping(log, model.robot.joints)
        for motion in model.motions([log]):
            if commanded is not None:
                yield motion, _in_the_turn_of(motion, commanded, turned)
            else:
                yield motion, RecordedTorque(motion.t, motion.tau) if source is None else source


def _wrapping(log: Log | Recording, joints: Sequence[str]) -> NDArray[np.bool_]:
    """Joints of which a position or a command wraps, (J,)."""
    parts = (part.select(joints) for part in chunks_of(log))
    wraps = [wraps_of(x) for part in parts for x in (part.q, part.qcmd) if x is not None]
    return np.asarray(np.any(wraps, axis=0))


def _in_the_turn_of(motion: Motion, source: PositionController, turned: NDArray[np.bool_]) -> PositionController:
    """The source with its commands less the whole turns by which they are away from the positions of a motion."""
    apart = TURN * np.round(np.median(between(source.t, source.q_cmd, motion.t) - motion.q, axis=0) / TURN)
    return replace(source, q_cmd=source.q_cmd - np.where(turned, apart, 0.0)) if turned.any() else source
