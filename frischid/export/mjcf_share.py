"""Which torque of a model's effects an MJCF file has by itself, and which a Python file beside it must add.

    viscous, Coulomb, armature, a linear spring with its offset: of the joint
    joint_coupling:  f = fvm ṡ + fcm sgn ṡ + Iam s̈ with s = q_i + ratio q_j is a fixed tendon of length s
    a payload:       part of the inertia of its body
    elasticity, backlash:  a second joint of the body (`frischid.export.mjcf_gears`)
    a coupled rotor: Im ratio² is the joint's armature; only its reaction on the joints before it is left

MuJoCo refuses negative values of all these, and a body that no mass distribution can have: such a coefficient goes to
the other file. A `time_delay` is an error of the recording and no force, so it is in neither.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from frischid.core.types import Array
from frischid.effects import Effect, JointCoupling, JointSpring, Offset, Payload, RotorInertia, TimeDelay
from frischid.export.code_columns import CodeModel
from frischid.export.mjcf_gears import GearTrain, has_gears, trains_of
from frischid.model.model import Model
from frischid.robot.inertia import is_physical

LEAST_LOSS = 1e-9
"""N·m (N). Dry friction of a joint whose friction is in the other file: MuJoCo makes no constraint for zero."""
FIT_ROUNDING = 1e-9
"""A coefficient above minus this is zero in the XML: a negative value so small is rounding of the fit."""
JOINT_ATTRIBUTES = {
    "armature": ("rotor_inertia", "Ia"),
    "damping": ("viscous", "fv"),
    "frictionloss": ("coulomb", "fc"),
}
"""Attribute of a joint -> effect and symbol of its value."""
_SYMBOLS = {"damping": "fvm", "frictionloss": "fcm", "armature": "Iam"}  # a tendon's attribute -> coefficient


@dataclass(frozen=True)
class Tendon:
    """A fixed tendon for one motor of two joints: its joints, ratio, and the values that are not negative."""

    first: str
    second: str
    ratio: float
    number: str
    values: dict[str, float]


@dataclass(frozen=True, eq=False)
class Share:
    """Torque that the XML has."""

    held: frozenset[str]
    """Names of the parameters whose torque the XML has."""
    joints: dict[str, dict[str, float]]
    """Joint -> attribute of MJCF -> value."""
    tendons: tuple[Tendon, ...]
    links: Array
    """Inertial parameters with the payload, about the joints' frames, (L, 10)."""
    gears: dict[str, GearTrain]
    """Joint -> the gears behind its motor."""
    behind: dict[str, float]
    """Joint -> dry friction behind its gears, on the link, N·m (N)."""


def forces(model: Model) -> Model:
    """The model with the effects that are forces on the robot."""
    kept = tuple(e for e in model.effects if not (e.of_controller or isinstance(e, TimeDelay)))
    return replace(model, effects=kept)


def share_of(model: Model) -> Share:
    """The part of a model with physical links that the XML has.

    Raises
    ------
    InputError
        The model has base parameters only.
    """
    held: set[str] = set()
    joints: dict[str, dict[str, float]] = {name: {} for name in model.robot.joints}
    tendons: list[Tendon] = []
    carried: tuple[Effect, ...] = ()
    links = _links(model, carried)
    for effect in model.effects:
        if isinstance(effect, JointCoupling):
            tendons += _tendons(model, effect)
        elif isinstance(effect, RotorInertia) and effect.coupled:
            for joint, x in model.of_effect(effect.id, "Im").items():
                if x >= 0.0:
                    joints[joint]["armature"] = x * effect.ratio**2
        elif isinstance(effect, Payload):
            heavier = _links(model, (*carried, effect))
            if is_physical(heavier).all():
                links, carried = heavier, (*carried, effect)
                held |= {c.name for c in effect.columns(model.robot)}
        elif has_gears(model, effect):
            held |= {column.name for column in effect.columns(model.robot)}
        else:
            held |= _of_joints(model, effect, joints)
    for tendon in tendons:
        held |= {f"{_SYMBOLS[key]}{tendon.number}" for key in tendon.values}
    gears, behind = trains_of(model), {}
    for joint, train in gears.items():
        own = joints[joint]
        own["armature"] = own.get("armature", 0.0) or train.rotor
        if train.rubbing and own.get("frictionloss"):
            behind[joint] = train.rubbing * own["frictionloss"]
            own["frictionloss"] = max(own["frictionloss"] - behind[joint], 0.0)
    for joint in dry_joints(model, frozenset(held)):
        joints[joint]["frictionloss"] = max(joints[joint].get("frictionloss", 0.0), LEAST_LOSS)
    return Share(frozenset(held), joints, tuple(tendons), links, gears, behind)


def dry_joints(model: Model, held: frozenset[str]) -> tuple[str, ...]:
    """Joints with dry friction that the XML has not, whose level the other file sets."""
    robot, found = model.robot, []
    for effect in model.effects:
        if rubs(effect):
            found += [c.joint for c in effect.columns(robot) if c.name not in held]
    return tuple(name for name in robot.joints if name in found)


def rubs(effect: Effect) -> bool:
    """Whether the effect is dry friction of single joints, which can hold them at rest."""
    return effect.dry and effect.smooths_sign and not isinstance(effect, JointCoupling)


def delays(model: Model) -> dict[str, float]:
    """Joint -> time by which its recorded torque is late, s."""
    found = dict.fromkeys(model.robot.joints, 0.0)
    for effect in model.effects:
        if isinstance(effect, TimeDelay):
            for k, (_, name, _) in enumerate(effect.acts_on(model.robot)):
                column = effect.columns(model.robot)[0 if effect.joints is None else k]
                found[name] += model.parameter(column.name)
    return {name: x for name, x in found.items() if x}


def _of_joints(model: Model, effect: Effect, joints: dict[str, dict[str, float]]) -> set[str]:
    """Fill in the attributes of the joints of one effect; the names of the parameters that they have."""
    numbers, held = model.robot.numbers, set()
    for key, (own, symbol) in JOINT_ATTRIBUTES.items():
        if effect.id == own:
            for joint, x in model.of_effect(own, symbol).items():
                joints[joint][key] = max(x, 0.0) + 0.0  # the sum makes 0.0 of -0.0
                held |= {f"{symbol}{numbers[joint]}"} if x >= -FIT_ROUNDING else set()
    if isinstance(effect, JointSpring):
        offsets = model.of_effect(Offset.id, "off")
        for joint, x in model.of_effect(effect.id, "ks").items():
            if x > 0:
                joints[joint] |= {"stiffness": x, "springref": -offsets.get(joint, 0.0) / x}
                held |= {f"ks{numbers[joint]}"} | ({f"off{numbers[joint]}"} if joint in offsets else set())
    return held


def _tendons(model: Model, effect: JointCoupling) -> list[Tendon]:
    robot, found = model.robot, []
    for first, second in effect.pairs(robot):
        number = effect.number(robot, first, second)
        values = {key: model.parameter(f"{symbol}{number}") for key, symbol in _SYMBOLS.items()}
        possible = {key: max(x, 0.0) for key, x in values.items() if x >= -FIT_ROUNDING}
        found.append(Tendon(first, second, effect.ratio, number, possible))
    return found


def _links(model: Model, payloads: tuple[Effect, ...]) -> Array:
    """Inertial parameters about the joints' frames, (L, 10), with payloads."""
    return CodeModel.of(replace(model, effects=payloads, reference=None)).links
