"""A URDF, read as a machine whose torques are linear in its inertial parameters.

Pinocchio turns the URDF into a kinematic tree. For every sample it gives the regressor Γ(q, q̇, q̈) with

    τ = Γ(q, q̇, q̈) θ,      θ_link = (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)

(Atkeson, An and Hollerbach 1986), first moments and inertias about the *joint* frame. Three things change what a
user sees without changing the physics:

- another frame of a link: with the pseudo-inertia P = [[Σ, h], [hᵀ, m]] of a body, ``P_joint = H P_frame Hᵀ`` is
  linear in θ_frame, so ``Γ_frame = Γ_joint T`` with a 10 × 10 block T per link;
- mimic joints: q_full = G q + g, and virtual work gives ``τ = Gᵀ τ_full``;
- parameters known outright: their columns leave Γ and their torque leaves τ.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from frischid.core.types import Array, Column
from frischid.errors import InputError, UnknownNameError
from frischid.robot.inertia import dynamic_parameters, pseudo_inertia

LINK_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
LINK_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Limits:
    """URDF limits of the joints, each of shape (J,): rad (m), rad/s (m/s), N·m (N)."""

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot with J independent one-degree-of-freedom joints and L moving bodies.

    Build one with `Robot.load`.

    Attributes
    ----------
    name : str
        Name in the URDF.
    source : str
        Path or name it was loaded from.
    urdf : str
        The URDF's text, so that a saved model needs no other file.
    gravity : tuple of float
        Gravity in the base frame, m/s².
    locked : dict of str to float
        Joints held still, with the angle (m for prismatic joints) they are held at.
    frames : str or dict
        ``"joint"``, ``"far_end"``, or joint name -> URDF frame the link's parameters are expressed about.
    known : dict of str to float
        Rigid parameters taken as given; they have no column.
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
        _ = self.model, self.transforms  # nothing left to move, an unknown frame: errors now, not at the first sample

    @classmethod
    def load(
        cls,
        robot: str | Path,
        *,
        joints: Sequence[str] | None = None,
        lock: Mapping[str, float] | Sequence[str] = (),
        gravity: Sequence[float] = GRAVITY,
        base_rpy: Sequence[float] | None = None,
        frames: str | Mapping[str, str] = "joint",
        known: Mapping[str, float] | None = None,
    ) -> Robot:
        """Read a robot from a URDF file, or by name from the URDFs that come with frischid or example-robot-data.

        Parameters
        ----------
        robot : str or Path
            Path of a URDF, or a name such as ``panda``.
        joints : sequence of str, optional
            Joints that move; all others are locked. All joints by default.
        lock : mapping or sequence of str
            Joints to lock, with their angle in rad (m), or at zero moved into the joint's limits.
        gravity : sequence of 3 float
            Gravity in the world frame, m/s².
        base_rpy : sequence of 3 float, optional
            Roll, pitch and yaw (rad) of the base in the world.
        frames : str or mapping
            ``"joint"`` (URDF joint frames), ``"far_end"`` (same axes, origin at the next joint or the tip, as
            Denavit-Hartenberg frames have it), or joint name -> name of a URDF link fixed to that body.
        known : mapping of str to float, optional
            Rigid parameters known outright, for example ``{"my1": 0.0}``.

        Returns
        -------
        Robot

        Raises
        ------
        InputError
            The file is not a URDF, or it has joints frischid cannot handle.
        UnknownNameError
            No such robot, joint, frame or parameter.
        """
        source, text = _read_urdf(robot)
        tree = _parse(text, source)
        whole = cls(name=tree.get("name", Path(source).stem), source=source, urdf=text)
        moving = set(whole.joints)
        for name in [*(joints or ()), *lock]:
            if name not in moving:
                raise UnknownNameError("joint", name, whole.joints, source)
        angles = dict(lock) if isinstance(lock, Mapping) else dict.fromkeys(lock, math.nan)
        if joints is not None:
            angles |= {j: angles.get(j, math.nan) for j in whole.joints if j not in joints}
        gravity_base = np.asarray(gravity, dtype=float)
        if gravity_base.shape != (3,) or not np.isfinite(gravity_base).all():
            raise InputError(f"gravity must be three finite numbers in m/s², got {list(gravity)}")
        if base_rpy is not None:
            if np.shape(base_rpy) != (3,) or not np.isfinite(base_rpy).all():
                raise InputError(f"base_rpy must be three finite numbers in rad, got {list(base_rpy)}")
            gravity_base = pin.rpy.rpyToMatrix(np.asarray(base_rpy, dtype=float)).T @ gravity_base
        return cls(
            name=whole.name,
            source=source,
            urdf=text,
            gravity=(float(gravity_base[0]), float(gravity_base[1]), float(gravity_base[2])),
            locked={j: _rest_angle(whole, j) if math.isnan(x) else float(x) for j, x in angles.items()},
            frames=frames if isinstance(frames, str) else dict(frames),
            known=dict(known or {}),
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything needed to build this robot again, as plain JSON values."""
        frames = self.frames if isinstance(self.frames, str) else dict(self.frames)
        return {
            "name": self.name,
            "source": self.source,
            "urdf": self.urdf,
            "gravity": list(self.gravity),
            "locked": dict(self.locked),
            "frames": frames,
            "known": dict(self.known),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Robot:
        """Inverse of `to_dict`."""
        return cls(**{**data, "gravity": tuple(data["gravity"])})

    def keep(self, joints: Sequence[str]) -> Robot:
        """Lock every joint that is not in `joints`, at zero moved into its limits."""
        extra = {j: _rest_angle(self, j) for j in self.joints if j not in set(joints)}
        return Robot.from_dict({**self.to_dict(), "locked": {**self.locked, **extra}}) if extra else self

    # ------------------------------------------------------------------ the tree

    @cached_property
    def model(self) -> Any:
        """Pinocchio model with the locked joints removed and the gravity set."""
        try:
            model = pin.buildModelFromXML(self.urdf)
        except Exception as error:  # Pinocchio raises several unrelated types for a bad URDF
            raise InputError(f"{self.source}: Pinocchio cannot build a model from this URDF: {error}") from error
        _check_joints(model, self.source)
        angles = dict(self.locked)
        for name, (leader, factor, shift) in _mimics(self.urdf).items():
            if leader in angles:
                angles[name] = factor * angles[leader] + shift
        if angles:
            reference = pin.neutral(model)
            for name, angle in angles.items():
                joint = model.joints[model.getJointId(name)]
                value = [math.cos(angle), math.sin(angle)] if joint.nq == 2 else [angle]
                reference[joint.idx_q : joint.idx_q + joint.nq] = value
            try:
                model = pin.buildReducedModel(model, [model.getJointId(n) for n in angles], reference)
            except ValueError as error:
                raise InputError(
                    f"{self.source}: Pinocchio cannot lock {', '.join(angles)}: {error}; does a link of the URDF have "
                    "the name of the joint? Rename one of them"
                ) from error
        if model.nv == 0:
            raise InputError(f"{self.source}: no joint is left to move; the URDF has none, or all are locked")
        model.gravity.linear = np.array(self.gravity)
        return model

    @cached_property
    def data(self) -> Any:
        """Pinocchio's work space for `model`."""
        return self.model.createData()

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Joint names of all L moving bodies in tree order, mimic joints included."""
        return tuple(self.model.names[1:])

    @cached_property
    def mimics(self) -> dict[str, tuple[str, float, float]]:
        """Mimic joints as name -> (leader, multiplier, offset); a leader is an independent joint."""
        return {n: rule for n, rule in _mimics(self.urdf).items() if n in self.bodies}

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
        """Which of the independent joints slide, shape (J,)."""
        return np.array([self.model.joints[self.numbers[n]].shortname().startswith("JointModelP") for n in self.joints])

    @cached_property
    def limits(self) -> Limits:
        """URDF limits of the independent joints; infinite where the URDF gives none."""
        model = self.model
        rows = [model.joints[self.numbers[n]] for n in self.joints]
        bounded = np.array([r.nq == 1 for r in rows])
        lower = np.array(
            [model.lowerPositionLimit[r.idx_q] if b else -np.inf for r, b in zip(rows, bounded, strict=True)]
        )
        upper = np.array(
            [model.upperPositionLimit[r.idx_q] if b else np.inf for r, b in zip(rows, bounded, strict=True)]
        )
        velocity = np.array([model.velocityLimit[r.idx_v] for r in rows])
        effort = np.array([model.effortLimit[r.idx_v] for r in rows])
        unset = lower >= upper
        lower[unset], upper[unset] = -np.inf, np.inf
        velocity[(velocity <= 0) | (velocity > 1e6)] = np.inf
        effort[(effort <= 0) | (effort > 1e6)] = np.inf
        return Limits(lower, upper, velocity, effort)

    @cached_property
    def dynamics(self) -> dict[str, tuple[float, float]]:
        """URDF ``<dynamics damping friction>`` of each independent joint (N·m·s/rad, N·m)."""
        found = {}
        for joint in ET.fromstring(self.urdf).findall("joint"):
            tag = joint.find("dynamics")
            if tag is not None and joint.get("name") in self.joints:
                found[str(joint.get("name"))] = (float(tag.get("damping", 0)), float(tag.get("friction", 0)))
        return {j: found.get(j, (0.0, 0.0)) for j in self.joints}

    @cached_property
    def _leaders(self) -> tuple[NDArray[np.intp], Array, Array]:
        """For each body: column of its independent joint, multiplier, offset."""
        where = {n: i for i, n in enumerate(self.joints)}
        rules = [self.mimics.get(n, (n, 1.0, 0.0)) for n in self.bodies]
        leader, factor, shift = zip(*rules, strict=True)
        return np.array([where[n] for n in leader]), np.array(factor), np.array(shift)

    # ------------------------------------------------------------------ the parameters

    @cached_property
    def all_names(self) -> tuple[str, ...]:
        """Names of all 10 L rigid parameters, known ones included."""
        return tuple(f"{p}{i}" for i in self.numbers.values() for p in LINK_PARAMETERS)

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the rigid regressor: all rigid parameters that are not known outright."""
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
        return np.stack([_parameter_transform(self.frame_placement(n)) for n in self.bodies])

    @cached_property
    def nominal(self) -> Array:
        """The URDF's own values of `all_names`, about the chosen frames."""
        theta = np.stack([self.model.inertias[i].toDynamicParameters() for i in self.numbers.values()])
        if self.transforms is not None:
            theta = np.linalg.solve(self.transforms, theta[:, :, None])[:, :, 0]
        return np.asarray(theta.ravel())

    def frame_placement(self, joint: str) -> Any:
        """Pose (pinocchio.SE3) of the parameter frame of a body in its joint frame."""
        if self.frames == "joint":
            return pin.SE3.Identity()
        model, index = self.model, self.numbers[joint]
        if isinstance(self.frames, Mapping):
            unknown = [j for j in self.frames if j not in self.bodies]
            if unknown:
                raise UnknownNameError("joint", unknown[0], self.bodies, self.source)
            if joint not in self.frames:
                return pin.SE3.Identity()
            on_body = {f.name: f.placement for f in model.frames if f.parentJoint == index}
            if self.frames[joint] not in on_body:
                raise UnknownNameError(f"frame on the body of {joint}", self.frames[joint], on_body, self.source)
            return on_body[self.frames[joint]]
        if self.frames != "far_end":
            raise UnknownNameError("frame choice", str(self.frames), ["joint", "far_end"])
        children = [model.jointPlacements[k] for k in range(1, model.njoints) if model.parents[k] == index]
        fixed = [f.placement for f in model.frames if f.parentJoint == index]
        far = (
            children[0] if children else max(fixed, key=lambda placement: float(np.linalg.norm(placement.translation)))
        )
        return pin.SE3(np.eye(3), far.translation)

    # ------------------------------------------------------------------ the dynamics

    def configuration(self, q: Array) -> Array:
        """Pinocchio configurations of joint positions: (N, J) -> (N, nq), (cos, sin) for continuous joints."""
        leader, factor, shift = self._leaders
        full = np.asarray(q)[:, leader] * factor + shift
        model = self.model
        if model.nq == model.nv:
            return np.ascontiguousarray(full)
        out = np.empty((len(full), model.nq))
        for i in range(len(self.bodies)):
            joint = model.joints[i + 1]
            if joint.nq == 2:
                out[:, joint.idx_q] = np.cos(full[:, i])
                out[:, joint.idx_q + 1] = np.sin(full[:, i])
            else:
                out[:, joint.idx_q] = full[:, i]
        return out

    def _full_rates(self, x: Array) -> Array:
        leader, factor, _ = self._leaders
        return np.ascontiguousarray(np.asarray(x)[:, leader] * factor)

    def _project(self, torque: Array, axis: int) -> Array:
        """Virtual work of the mimic joints: sum ``torque`` (.., L, ..) onto the J independent joints along `axis`."""
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
        model = self.model.copy()
        if theta is not None:
            blocks = np.asarray(theta, dtype=float).reshape(-1, 10)
            if self.transforms is not None:
                blocks = (self.transforms @ blocks[:, :, None])[:, :, 0]
            for index, block in enumerate(blocks, start=1):
                model.inertias[index] = pin.Inertia.FromDynamicParameters(block)
        values = np.zeros(model.nv)
        for name, x in (armature or {}).items():
            values[model.joints[self.numbers[name]].idx_v] = x
        model.armature = values
        return model

    def links_of(self, joint: str) -> dict[str, Array]:
        """Links of the body behind a joint, with their poses (4, 4) in the joint's frame; nearest the joint first."""
        index = self.numbers[joint]
        frames = [f for f in self.model.frames if f.parentJoint == index and f.type == pin.FrameType.BODY]
        return {f.name: f.placement.homogeneous for f in frames}

    def project_mass(self, mass: Array) -> Array:
        """Mass matrix of all bodies' joints (L, L) onto the independent joints (J, J)."""
        return self._project(self._project(mass, axis=0), axis=1)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Rigid-body torque with the URDF's own parameters (recursive Newton-Euler): (N, J) each -> (N, J)."""
        model, data = self.model, self.data
        rows = zip(self.configuration(q), self._full_rates(v), self._full_rates(a), strict=True)
        torque = np.array([pin.rnea(model, data, x, y, z) for x, y, z in rows]).reshape(-1, model.nv)
        return self._project(torque, axis=1)

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
        # Pinocchio's array is column-major: seen as (joint, parameter), source and target run through memory alike.
        rows = zip(
            full.transpose(0, 2, 1), self.configuration(q), self._full_rates(v), self._full_rates(a), strict=True
        )
        for target, x, y, z in rows:
            target[...] = compute(model, data, x, y, z)
        if plain:
            return
        out[:] = self._present(full)[:, self._unknown]

    def known_torque(self, q: Array, v: Array, a: Array) -> Array | None:
        """Torque of the parameters known outright, (N, J); None when all of them are zero."""
        values = np.array([self.known.get(n, 0.0) for n in self.all_names])
        if not values.any():
            return None
        bare = Robot.from_dict({**self.to_dict(), "known": {}})
        out = np.empty((len(q), len(self.all_names), len(self.joints)))
        bare.regressor(q, v, a, out)
        return np.asarray(np.einsum("ncj,c->nj", out, values))

    @cached_property
    def _unknown(self) -> NDArray[np.intp]:
        return np.array([i for i, n in enumerate(self.all_names) if n not in self.known], dtype=int)

    def _present(self, full: Array) -> Array:
        """Rigid regressor in the user's frames and on the independent joints."""
        if self.transforms is not None:
            blocks = full.reshape(len(full), len(self.bodies), 10, -1)
            full = (self.transforms.transpose(0, 2, 1) @ blocks).reshape(full.shape)
        return self._project(full, axis=2)

    def rotor_coupling(self, q: Array, v: Array, a: Array, joint: str, ratio: float) -> Array:
        """Torque of a unit rotor inertia carried by the previous link, on every joint.

        A symmetric rotor spins at ``ratio·q̇_i`` about joint i's axis z_i, mounted on link i−1. Its spin momentum
        ``h = ratio·q̇_i z_i`` loads the rows before i with z_j·ḣ, and row i with the motor's own balance:

            row j < i:  ratio (q̈_i z_j·z_i + q̇_i z_j·(ω_{i−1} × z_i))
            row i:      ratio² q̈_i + ratio z_i·ω̇_{i−1}

        The rotor's inertia about its own axis as a part of link i−1 belongs to that link's parameters.

        Returns
        -------
        ndarray, shape (N, J), in units of torque per kg·m² of motor-side rotor inertia
        """
        model, index = self.model, self.numbers[joint]
        axes = np.empty((len(q), 3, model.nv))
        for row, x in zip(axes, self.configuration(q), strict=True):
            row[...] = pin.computeJointJacobians(model, self.data, x)[3:]
        full_v, full_a = self._full_rates(v)[:, :, None], self._full_rates(a)[:, :, None]
        chain = [model.joints[k].idx_v for k in model.supports[index] if 0 < k < index]
        omega, alpha = np.zeros((2, len(q), 3))
        for k in chain:  # angular velocity and acceleration of the link that carries the motor
            alpha += axes[:, :, k] * full_a[:, k] + np.cross(omega, axes[:, :, k]) * full_v[:, k]
            omega += axes[:, :, k] * full_v[:, k]
        i = model.joints[index].idx_v
        axis = axes[:, :, i]
        rate = full_a[:, i] * axis + full_v[:, i] * np.cross(omega, axis)
        out = np.zeros((len(q), model.nv))
        out[:, chain] = ratio * np.einsum("nck,nc->nk", axes[:, :, chain], rate)
        out[:, i] = ratio**2 * full_a[:, i, 0] + ratio * np.einsum("nc,nc->n", axis, alpha)
        return self._project(out, axis=1)


# ---------------------------------------------------------------------- reading


def robot_names() -> dict[str, Path]:
    """URDFs that can be loaded by name: those of this package, then those of example-robot-data."""
    own = [p for p in (Path(__file__).parents[1] / "urdf", Path(__file__).parents[2] / "urdf") if p.is_dir()]
    files = [p for folder in own[:1] for p in sorted(folder.glob("*.urdf"))]
    try:
        share = metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
        files += sorted(Path(str(share)).rglob("*.urdf"))
    except metadata.PackageNotFoundError:
        pass  # the shipped robots still load by name, and every path does
    stems = [p.stem for p in files]
    names: dict[str, Path] = {}
    for path in files:
        folder = next((part for part in path.parts if part.endswith(("_description", "_data"))), "")
        short = path.stem if stems.count(path.stem) == 1 else f"{folder.rsplit('_', 1)[0]}/{path.stem}"
        names.setdefault(short, path)
    for short in list(names):
        names.setdefault(short.removesuffix("_robot"), names[short])
    return names


def _read_urdf(robot: str | Path) -> tuple[str, str]:
    text = str(robot)
    path = Path(robot).expanduser()
    if not path.exists() and not text.endswith((".urdf", ".xml", ".xacro")):
        names = robot_names()
        if text not in names:
            raise UnknownNameError("robot", text, names)
        path = names[text]
    elif path.is_dir():
        raise InputError(f"{path} is a folder; give the .urdf file inside it")
    elif not path.exists():
        raise InputError(f"{path}: no such URDF file; give a path, or a name that `frischid info` lists")
    try:
        return text, path.read_bytes().decode("utf-8")  # line ends as they are: an export changes nothing else
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: not a UTF-8 text file, so not a URDF ({error.reason} at byte {error.start})"
        ) from None


def _parse(text: str, source: str) -> ET.Element:
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError(f"{source}: not an XML file, so not a URDF: {error}") from None
    if root.tag != "robot":
        raise InputError(f"{source}: the root element is <{root.tag}>, a URDF has <robot>")
    if any("xacro" in element.tag for element in root.iter()):
        raise InputError(f"{source}: this is a xacro file; expand it first (xacro FILE > robot.urdf)")
    return root


def _check_joints(model: Any, source: str) -> None:
    for joint, name in zip(list(model.joints)[1:], list(model.names)[1:], strict=True):
        if joint.nv != 1:
            raise InputError(
                f"{source}: joint '{name}' has {joint.nv} degrees of freedom ({joint.shortname()}); frischid "
                "identifies revolute, continuous and prismatic joints; make it fixed in the URDF"
            )


def _mimics(urdf: str) -> dict[str, tuple[str, float, float]]:
    """Mimic joints of a URDF, chains of mimics resolved to their independent leader."""
    direct = {}
    joints = ET.fromstring(urdf).findall("joint")
    for joint in joints:
        tag = joint.find("mimic")
        if tag is not None and joint.get("type") != "fixed":
            rule = (str(tag.get("joint")), float(tag.get("multiplier", 1)), float(tag.get("offset", 0)))
            direct[str(joint.get("name"))] = rule
    resolved = {}
    for name, (leader, factor, shift) in direct.items():
        seen = {name}
        while leader in direct:
            if leader in seen:
                raise InputError(f"mimic joints {sorted(seen)} follow one another in a circle")
            seen.add(leader)
            leader, inner, more = direct[leader]
            factor, shift = factor * inner, factor * more + shift
        if not any(j.get("name") == leader and j.get("type") != "fixed" for j in joints):
            raise InputError(f"mimic joint '{name}' follows '{leader}', which is no moving joint of the URDF")
        resolved[name] = (leader, factor, shift)
    return resolved


def _rest_angle(robot: Robot, joint: str) -> float:
    i = robot.joints.index(joint)
    return float(np.clip(0.0, robot.limits.lower[i], robot.limits.upper[i]))


def _parameter_transform(placement: Any) -> Array:
    """T with θ_joint = T θ_frame for a frame at `placement` in the joint frame, shape (10, 10)."""
    H = placement.homogeneous
    return dynamic_parameters(H @ pseudo_inertia(np.eye(10)) @ H.T).T
