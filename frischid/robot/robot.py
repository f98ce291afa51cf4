"""A robot from a URDF; its torques are linear in its inertial parameters.

Pinocchio turns the URDF into a kinematic tree. For every sample, Pinocchio computes the regressor Γ(q, q̇, q̈) with

    τ = Γ(q, q̇, q̈) θ,      θ_link = (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)

(Atkeson, An and Hollerbach 1986), first moments and inertias about the *joint* frame. Three choices change the
parameters without changing the physics:

- another frame of a link: with the pseudo-inertia P = [[Σ, h], [hᵀ, m]] of a body, ``P_joint = H P_frame Hᵀ`` is
  linear in θ_frame, so ``Γ_frame = Γ_joint T`` with a 10 × 10 block T per link;
- mimic joints: q_full = G q + g, and virtual work gives ``τ = Gᵀ τ_full``;
- known parameters: their columns are removed from Γ, and their torque is subtracted from τ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from frischid.core.arguments import check_number
from frischid.core.types import Array, Column
from frischid.errors import InputError, UnknownNameError
from frischid.robot.inertia import parameter_transform
from frischid.robot.joint_limits import JointLimits, read_limits
from frischid.robot.mimics import MimicRule, mimic_rules
from frischid.robot.mjcf_reading import stated_gravity
from frischid.robot.motion_arrays import motion_of
from frischid.robot.pinocchio_model import build_model, configurations, frame_placement, gravity_in_base, with_inertias
from frischid.robot.urdf_numbers import LARGEST_QUANTITY
from frischid.robot.urdf_reading import joint_armature, joint_dynamics, parse_urdf, read_urdf

LINK_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
LINK_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot with J independent one-degree-of-freedom joints and L moving bodies.

    Build one with `Robot.load`. Torques are linear in the rigid parameters, ``τ = Γ(q, q̇, q̈) θ``; `regressor` gives Γ.

    Attributes
    ----------
    name : str
        Name in the URDF.
    source : str
        Path or name that the robot was loaded from.
    urdf : str
        The URDF's text, so that a saved model needs no other file.
    gravity : tuple of float
        Gravity in the base frame, m/s².
    locked : dict of str to float
        Joints that are fixed, with their angle, rad (m).
    frames : str or dict
        ``"joint"``, ``"far_end"``, or joint name -> URDF frame in which the link's parameters are expressed.
    known : dict of str to float
        Known rigid parameters; they are not fitted and have no column.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2", known={"my1": 0.0})
    >>> robot.joints, len(robot.columns)
    (('joint1', 'joint2'), 19)
    """

    name: str
    source: str
    urdf: str = field(repr=False)
    gravity: tuple[float, float, float] = GRAVITY
    locked: Mapping[str, float] = field(default_factory=dict)
    frames: str | Mapping[str, str] = "joint"
    known: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.known:
            if name not in self.all_names:
                raise UnknownNameError("parameter", name, self.all_names, self.source)
        for what, values in (("gravity", self.gravity), ("lock", self.locked.values()), ("known", self.known.values())):
            for x in values:
                check_number(f"{self.source}: {what}", x)
            if not all(abs(x) <= LARGEST_QUANTITY for x in values):
                raise InputError(f"{self.source}: {what} holds a number above {LARGEST_QUANTITY:g}, or not finite")
        _ = self.model, self.transforms  # errors (no joint to move, an unknown frame) come now, not at the first sample

    @classmethod
    def load(
        cls,
        robot: str | Path,
        *,
        joints: Sequence[str] | None = None,
        lock: Mapping[str, float] | Sequence[str] = (),
        gravity: Sequence[float] | None = None,
        base_rpy: Sequence[float] | None = None,
        frames: str | Mapping[str, str] = "joint",
        known: Mapping[str, float] | None = None,
    ) -> Robot:
        """Read a robot from a URDF or MJCF file, or by name from those of frischid or example-robot-data.

        Parameters
        ----------
        robot : str or Path
            Path of a URDF or MJCF file, or a name such as ``panda``.
        joints : sequence of str, optional
            Joints that move; all others are locked. All joints by default.
        lock : mapping or sequence of str
            Joints to lock, with their angle in rad (m); without an angle, at zero, or the nearest value in the limits.
        gravity : sequence of 3 float, optional
            Gravity in the world frame, m/s²; that of the MJCF file by default, else 9.81 downwards.
        base_rpy : sequence of 3 float, optional
            Roll, pitch and yaw (rad) of the base in the world.
        frames : str or mapping
            ``"joint"`` (URDF joint frames), ``"far_end"`` (same axes, origin at the next joint or the tip, similar to
            Denavit-Hartenberg frames), or joint name -> name of a URDF link fixed to that body.
        known : mapping of str to float, optional
            Known rigid parameters, for example ``{"my1": 0.0}``.

        Raises
        ------
        InputError
            The file is not a URDF, or has joints that frischid cannot handle.
        UnknownNameError
            There is no such robot, joint, frame or parameter.
        """
        source, text = read_urdf(robot)
        tree = parse_urdf(text, source)
        whole = cls(name=tree.get("name", Path(source).stem), source=source, urdf=text)
        for name in [*(joints or ()), *lock]:
            if name not in whole.joints:
                raise UnknownNameError("joint", name, whole.joints, source)
        if gravity is None:
            gravity = stated_gravity(tree.attrib["gravity"], source) if "gravity" in tree.attrib else GRAVITY
        angles = dict(lock) if isinstance(lock, Mapping) else dict.fromkeys(lock, math.nan)
        for name, angle in angles.items():
            check_number(f"the angle of {name}", angle)
        if joints is not None:
            angles |= {j: angles.get(j, math.nan) for j in whole.joints if j not in joints}
        return cls(
            name=whole.name,
            source=source,
            urdf=text,
            gravity=gravity_in_base(gravity, base_rpy),
            locked={j: whole.angle_at_lock(j) if math.isnan(x) else float(x) for j, x in angles.items()},
            frames=frames if isinstance(frames, str) else dict(frames),
            known=dict(known or {}),
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything needed to build this robot again, as plain JSON values."""
        return {
            "name": self.name,
            "source": self.source,
            "urdf": self.urdf,
            "gravity": list(self.gravity),
            "locked": dict(self.locked),
            "frames": self.frames if isinstance(self.frames, str) else dict(self.frames),
            "known": dict(self.known),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Robot:
        """Inverse of `to_dict`."""
        return cls(**{**data, "gravity": tuple(data["gravity"])})

    def keep(self, joints: Sequence[str]) -> Robot:
        """Lock every joint that is not in `joints`, at zero or the nearest value in its limits.

        Raises
        ------
        InputError
            A parameter is known by its number, and the locks give the links other numbers and masses.
        UnknownNameError
            One of the joints is not the robot's.
        """
        for name in joints:
            if name not in self.joints:
                raise UnknownNameError("joint", name, self.joints, self.source)
        extra = {j: self.angle_at_lock(j) for j in self.joints if j not in set(joints)}
        if not extra:
            return self
        if self.known:
            raise InputError(
                f"{self.source}: with locked joints, links have other numbers, and {', '.join(self.known)} would be "
                "known of another link: load the robot with lock= and known= together"
            )
        frames = self.frames
        if not isinstance(frames, str):
            frames = {j: f for j, f in frames.items() if j not in extra}
        return replace(self, locked={**self.locked, **extra}, frames=frames)

    @cached_property
    def model(self) -> Any:
        """Pinocchio model with the locked joints removed and the gravity set."""
        return build_model(self.urdf, self.source, self.locked, self.gravity)

    @cached_property
    def data(self) -> Any:
        """Pinocchio's work space for `model`."""
        return self.model.createData()

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Joint names of all L moving bodies in tree order, mimic joints included."""
        return tuple(self.model.names[1:])

    @cached_property
    def mimics(self) -> dict[str, MimicRule]:
        """Rules of the mimic joints by name; every leader is an independent joint."""
        return {n: rule for n, rule in mimic_rules(self.urdf).items() if n in self.bodies}

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the J independent joints, in tree order: the columns of q, v, a and τ."""
        return tuple(n for n in self.bodies if n not in self.mimics)

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Number of each body's joint, 1 to L: the index in parameter names."""
        return {name: i + 1 for i, name in enumerate(self.bodies)}

    @cached_property
    def prismatic(self) -> NDArray[np.bool_]:
        """Whether each independent joint is prismatic, shape (J,)."""
        return np.array([self.model.joints[self.numbers[n]].shortname().startswith("JointModelP") for n in self.joints])

    @cached_property
    def limits(self) -> JointLimits:
        """URDF limits of the independent joints, rad, rad/s, N·m (m, m/s, N); infinite where the URDF gives none."""
        return read_limits(self.model, [self.numbers[n] for n in self.joints])

    @cached_property
    def dynamics(self) -> dict[str, tuple[float, float]]:
        """URDF damping and friction of each independent joint (N·m·s/rad, N·m); a simulator's damping counts as 0."""
        found = joint_dynamics(self.urdf)
        return {j: found.get(j, (0.0, 0.0)) for j in self.joints}

    @cached_property
    def armature(self) -> dict[str, float]:
        """Reflected rotor inertia that an MJCF file gives each independent joint, kg·m² (kg); zero without one."""
        found = joint_armature(self.urdf)
        return {j: found.get(j, 0.0) for j in self.joints}

    @cached_property
    def _leaders(self) -> tuple[NDArray[np.intp], Array, Array]:
        """For each body: column of its independent joint, multiplier, offset."""
        where = {n: i for i, n in enumerate(self.joints)}
        rules = [self.mimics.get(n, MimicRule(n, 1.0, 0.0)) for n in self.bodies]
        leader, factor, shift = zip(*rules, strict=True)
        return np.array([where[n] for n in leader]), np.array(factor), np.array(shift)

    @cached_property
    def all_names(self) -> tuple[str, ...]:
        """Names of all 10 L rigid parameters, known ones included."""
        return tuple(f"{p}{i}" for i in self.numbers.values() for p in LINK_PARAMETERS)

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the rigid regressor: all rigid parameters that are not `known`."""
        owners = [(n, u) for n in self.bodies for u in LINK_UNITS]
        return tuple(
            Column(name, unit, joint, "rigid", sign=1 if name.rstrip("0123456789") in {"m", "Ixx", "Iyy", "Izz"} else 0)
            for name, (joint, unit) in zip(self.all_names, owners, strict=True)
            if name not in self.known
        )

    @cached_property
    def transforms(self) -> Array | None:
        """Blocks T with θ_joint = T θ_frame, shape (L, 10, 10); None when all frames are joint frames."""
        if self.frames == "joint":
            return None
        return np.stack([parameter_transform(self.frame_placement(n).homogeneous) for n in self.bodies])

    @cached_property
    def nominal(self) -> Array:
        """The URDF's own values of `all_names`, about the chosen frames: kg, kg·m and kg·m², shape (10 L,)."""
        theta = np.stack([self.model.inertias[i].toDynamicParameters() for i in self.numbers.values()])
        if self.transforms is not None:
            theta = np.linalg.solve(self.transforms, theta[:, :, None])[:, :, 0]
        return np.asarray(theta.ravel())

    def frame_placement(self, joint: str) -> Any:
        """Pose (pinocchio.SE3) of the parameter frame of a body in its joint frame."""
        return frame_placement(self.model, joint, self.frames, self.source)

    def angle_at_lock(self, joint: str) -> float:
        """Angle at which a joint is locked if none is given, rad (m): zero, or the nearest value in its limits."""
        i = self.joints.index(joint)
        return float(np.clip(0.0, self.limits.lower[i], self.limits.upper[i]))

    def configuration(self, q: Array) -> Array:
        """Pinocchio configurations of joint positions: (N, J) -> (N, nq), (cos, sin) for continuous joints."""
        if not self.mimics:
            return configurations(self.model, np.asarray(q))
        leader, factor, shift = self._leaders
        return configurations(self.model, np.asarray(q)[:, leader] * factor + shift)

    def full_rates(self, x: Array) -> Array:
        """Velocities or accelerations of all bodies' joints: (N, J) -> (N, L)."""
        if not self.mimics:
            return np.ascontiguousarray(x)
        leader, factor, _ = self._leaders
        return np.ascontiguousarray(np.asarray(x)[:, leader] * factor)

    def project(self, torque: Array, axis: int) -> Array:
        """Virtual work of the mimic joints: ``τ = Gᵀ τ_full`` along `axis`, (.., L, ..) -> (.., J, ..)."""
        if not self.mimics:
            return torque
        leader, factor, _ = self._leaders
        G = np.zeros((len(self.joints), len(self.bodies)))
        G[leader, np.arange(len(self.bodies))] = factor
        return np.moveaxis(np.tensordot(G, torque, axes=(1, axis)), 0, axis)

    def pinocchio(self, theta: Array | None = None, armature: Mapping[str, float] | None = None) -> Any:
        """Build a Pinocchio model with other inertias.

        Parameters
        ----------
        theta : ndarray, shape (10 L,), optional
            Values of `all_names`, in the frames of this robot; the URDF's own by default.
        armature : mapping of str to float, optional
            Reflected rotor inertia of joints, kg·m² (kg).

        Returns
        -------
        pinocchio.Model
            Locked joints removed; mimic joints are joints of their own, as in `configuration`.
        """
        blocks = None if theta is None else np.asarray(theta, dtype=float).reshape(-1, 10)
        if blocks is not None and self.transforms is not None:
            blocks = (self.transforms @ blocks[:, :, None])[:, :, 0]
        return with_inertias(self.model, blocks, {self.numbers[n]: x for n, x in (armature or {}).items()})

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Rigid-body torque with the URDF's own parameters (recursive Newton-Euler): (N, J) each -> (N, J)."""
        q, v, a = motion_of(self.joints, q=q, v=v, a=a)
        model, data = self.model, self.data
        rows = zip(self.configuration(q), self.full_rates(v), self.full_rates(a), strict=True)
        torque = np.array([pin.rnea(model, data, x, y, z) for x, y, z in rows]).reshape(-1, model.nv)
        return self.project(torque, axis=1)

    def regressor(self, q: Array, v: Array, a: Array, out: Array) -> None:
        """Write the rigid regressor of N samples into `out`.

        Parameters
        ----------
        q, v, a : ndarray, shape (N, J)
            Positions (rad, m), velocities and accelerations.
        out : ndarray, shape (N, C, J)
            Receives Γᵀ of each sample: ``τ[k] = out[k].T @ θ`` with the C parameters of `columns`.
        """
        plain = self.transforms is None and not self.known and not self.mimics
        full = out if plain else np.empty((len(q), len(self.all_names), len(self.bodies)))
        model, data, compute = self.model, self.data, pin.computeJointTorqueRegressor
        rates = self.full_rates(v), self.full_rates(a)
        arrays = map(compute, repeat(model), repeat(data), self.configuration(q), *rates)
        # Pinocchio's array is (joint, parameter), row by row: a copy is fastest if the rows of `out` are so too.
        for target, Y in zip(full.transpose(0, 2, 1), arrays, strict=True):
            target[...] = Y
        if plain:
            return
        if self.transforms is not None:
            blocks = full.reshape(len(full), len(self.bodies), 10, -1)
            full = (self.transforms.transpose(0, 2, 1) @ blocks).reshape(full.shape)
        unknown = [i for i, n in enumerate(self.all_names) if n not in self.known]
        out[:] = self.project(full, axis=2)[:, unknown]

    def known_torque(self, q: Array, v: Array, a: Array) -> Array | None:
        """Torque of the `known` parameters, (N, J); None when all of them are zero."""
        if not any(self.known.values()):
            return None
        out = np.empty((len(q), len(self.all_names), len(self.joints)))
        self._without_known.regressor(q, v, a, out)
        return np.asarray(np.einsum("ncj,c->nj", out, [self.known.get(n, 0.0) for n in self.all_names]))

    _without_known = cached_property(lambda self: replace(self, known={}))  # once: a model is built from XML
