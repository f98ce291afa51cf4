"""Payload and mounting of the robot: an unknown body on a link, and a base that is not level.

A payload adds to the inertial parameters of the link that holds it, so the columns of the payload are the columns of
that link. One log alone cannot separate the payload from the link. A model of the robot without the payload can,

    τ = τ_model + Γ_link Δθ_link.

In the frame of a base that is tilted by a small rotation φ, gravity is turned the other way, ``g' = g + g × φ``. Torque
is linear in g.

Sources: Khalil, Gautier and Lemoine 2007, "Identification of the payload inertial parameters of industrial
manipulators", IEEE ICRA; Hollerbach, Khalil and Gautier 2016, Springer Handbook of Robotics, chapter 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.dynamics import LEAST_FELT, RigidDynamics, random_states
from frischid.effects.state import State, Term
from frischid.robot.robot import LINK_PARAMETERS, LINK_UNITS, Robot

PAYLOAD_CHUNK = 1024  # samples of the whole regressor in memory at once


@lru_cache(maxsize=16)
def _all_unknown(robot: Robot) -> Robot:
    """The same robot without known parameters, so that every rigid parameter has its column."""
    return Robot.from_dict({**robot.to_dict(), "known": {}})


def _link_columns(robot: Robot, joints: Sequence[str], q: Array, v: Array, a: Array) -> Array:
    """Torque (N, L, 10, J) per unit of each inertial parameter of the links behind L joints."""
    whole, links = _all_unknown(robot), [robot.numbers[joint] - 1 for joint in joints]
    out = np.empty((len(q), len(joints), 10, len(robot.joints)))
    buffer = np.empty((min(PAYLOAD_CHUNK, len(q)), len(robot.all_names), len(robot.joints)))
    for start in range(0, len(q), PAYLOAD_CHUNK):
        s = slice(start, start + PAYLOAD_CHUNK)
        part = buffer[: len(q[s])]
        whole.regressor(q[s], v[s], a[s], part)
        out[s] = part.reshape(len(part), -1, 10, len(robot.joints))[:, links]
    return out


@lru_cache(maxsize=256)
def _felt_parameters(robot: Robot, joint: str) -> NDArray[np.bool_]:
    """Whether the torque of a joint (column) depends on an inertial parameter of the link (row), (10, J)."""
    columns = _link_columns(robot, [joint], *random_states(robot, 8))[:, 0]
    return np.asarray((np.abs(columns) > LEAST_FELT).any(axis=0))


@lru_cache(maxsize=64)
def _felt_tilts(robot: Robot) -> tuple[int, ...]:
    """Axes of the base about which a tilt changes some torque; never the axis along gravity."""
    gravity, axes = np.array(robot.gravity), np.eye(3)
    level = sorted(np.argsort(np.abs(gravity))[:2].tolist())
    q, body = random_states(robot, 8)[0], RigidDynamics.generic(robot)
    return tuple(k for k in level if (np.abs(body.gravity_torque(q, np.cross(gravity, axes[k]))) > LEAST_FELT).any())


@dataclass(frozen=True)
class Payload(Effect):
    """An unknown rigid body on a link: mass and first moment, or all ten parameters.

    The body is on the last link if no joint is named. Its parameters are given in the frame of the link
    (``Robot.frames``). Parameters on which no torque depends are left out.

    Attributes
    ----------
    full : bool
        True: the columns of the six inertias too.
    """

    id = "payload"
    title = "payload: an unknown body on a link"
    equation = "Γ_link·(dm, dmx, dmy, dmz)  (full: also the six inertias)"
    symbols: ClassVar = {
        "Γ_link": "regressor of the link that holds the load",
        "dm": "identified coefficient: mass",
        "dmx": "identified coefficient: mass times x of its centre; dmy and dmz likewise",
    }
    sentence = "the link behind {joint} carries a body that the model does not contain: a payload or tool"
    looks_like = "errors that follow the pose on all joints up to that link, with the largest errors near the link"
    confused_with = ("gravity_tilt", "drive_gain", "encoder_zero", "joint_spring")
    confirmed_by = "record the same motion with the body and without it; or weigh the body"
    reference = "Khalil, Gautier and Lemoine 2007, IEEE ICRA"

    single = True
    change = True

    full: bool = False

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """On each link, a small body (mass and first moment suffice) or a large one (all ten parameters)."""
        return [[cls((name,), full=full)] for name in robot.joints for full in (False, True)]

    def acts_on(self, robot: Robot) -> list[tuple[int, str, str]]:
        """The named joints; the last joint when none is named."""
        joints = super().acts_on(robot)
        return joints if self.joints is not None else joints[-1:]

    def terms(self, state: State) -> list[Term]:
        """Four or ten columns per link, in the rows of the joints that carry the link."""
        links = self.acts_on(state.robot)
        values = _link_columns(state.robot, [name for _, name, _ in links], state.q, state.v, state.a)
        return [
            term
            for k, (_, name, number) in enumerate(links)
            for term in self._of_link(state.robot, name, number, values[:, k])
        ]

    def _of_link(self, robot: Robot, name: str, number: str, values: Array) -> list[Term]:
        felt = _felt_parameters(robot, name)
        return [
            Term(
                self.column(f"d{LINK_PARAMETERS[k]}", LINK_UNITS[k], name, number),
                {j: values[:, k, j] for j in np.flatnonzero(felt[k]).tolist()},
            )
            for k in range(10 if self.full else 4)
            if felt[k].any()
        ]


@dataclass(frozen=True)
class GravityTilt(Effect):
    """The base is tilted by small angles about its two axes that are perpendicular to gravity."""

    id = "gravity_tilt"
    title = "tilted base"
    equation = "tilt_x·∂τ/∂g·(g × x) + tilt_y·∂τ/∂g·(g × y)"
    symbols: ClassVar = {
        "tilt_x": "identified coefficient: angle by which the base is turned about its x axis, as with --base-rpy",
        "tilt_y": "identified coefficient: angle by which the base is turned about its y axis",
        "x": "x axis of the base; of a base on a wall, the first axis across gravity",
        "y": "y axis of the base; of a base on a wall, the second axis across gravity",
    }
    sentence = "gravity acts on {joint} in another direction than in the model: the base is slightly tilted"
    looks_like = "errors that follow the pose at any speed, also on a first joint with a vertical axis"
    confused_with = ("payload", "encoder_zero", "joint_spring", "offset")
    confirmed_by = "put a spirit level on the base; or turn the stretched arm slowly about its first axis"
    reference = "Hollerbach, Khalil and Gautier 2016, Springer Handbook of Robotics, chapter 6"

    loaded = True
    candidate = "robot"

    def terms(self, state: State) -> list[Term]:
        """One column for each axis about which a tilt changes some torque, rad."""
        return [self._about(state, axis) for axis in _felt_tilts(state.robot)]

    def _about(self, state: State, axis: int) -> Term:
        turned = np.cross(np.array(state.robot.gravity), np.eye(3)[axis])
        torque = state.rigid.gravity_torque(state.q, turned)
        rows = {i: torque[:, i] for i, _, _ in self.acts_on(state.robot)}
        return Term(self.column("tilt_", "rad", state.robot.joints[0], "xyz"[axis]), rows)
