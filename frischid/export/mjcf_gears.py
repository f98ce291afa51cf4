"""Elastic gears and gears with play in MJCF: the link turns about a second joint on the axis of its motor.

    q of the motor, x = −δ of the gear; the body turns by q + x

    I_a q̈ + friction(q̇) = τ + s,     M(q + x) (q̈ + ẍ) + h = −s,     s = k x + d ẋ  (elastic),  |x| ≤ g  (play)

The body has both joints, the motor's first. So armature, friction and the actuator of the motor's joint act on q, which
the encoder shows, and the links' inertia and weight act on q + x. MuJoCo integrates the spring by itself; as an
explicit force it would need derivatives of the acceleration. The spring's stiffness is the identified one, 1/ce; its
damping is the share of critical damping with which the diagnosis moves the link. Dry friction behind the gear
(`rubbing`) acts on the length q + x of a fixed tendon.

A motor without inertia has no acceleration of its own, and neither has the middle of two gears in a row. Such a joint
gets `LEAST_ROTOR` of the link's inertia as its armature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.effects import Backlash, Effect, Elasticity
from frischid.effects.dynamics import RigidDynamics
from frischid.effects.link_lag import SWING_DAMPING
from frischid.export.names import number
from frischid.model.model import Model

LEAST_ROTOR = 0.01
"""Armature of a joint that would have no inertia, as a share of the link's inertia."""
STOP = {"solreflimit": "1e-4 1", "solimplimit": "0.9999 0.9999 0.001"}
"""Solver values of the ends of a gap: as hard and as inelastic as MuJoCo allows at a time step."""


@dataclass(frozen=True)
class GearJoint:
    """The joint between a motor and its link."""

    name: str
    """Of the joint in the XML."""
    effect: str
    values: dict[str, float]
    """``stiffness`` and ``damping`` of an elastic gear, and ``armature`` of a gear behind another one."""
    gap: float = 0.0
    """Half the play, rad (m); zero for an elastic gear."""

    def attributes(self) -> dict[str, str]:
        """Attributes of the joint, but for its place."""
        found = {key: number(x) for key, x in self.values.items()}
        ends = {"limited": "true", "range": f"{number(-self.gap)} {number(self.gap)}", **STOP}
        return found | (ends if self.gap else {"limited": "false"})


@dataclass(frozen=True)
class GearTrain:
    """Everything between one motor and its link."""

    gears: tuple[GearJoint, ...]
    rotor: float
    """Armature of the motor's joint where the model has no rotor inertia, kg·m² (kg)."""
    rubbing: float
    """Share of the joint's dry friction that acts on the link."""


def gear_value(model: Model, effect: Effect) -> dict[str, float]:
    """Joint -> compliance or half the play; empty for other effects."""
    columns = effect.columns(model.robot) if isinstance(effect, Elasticity | Backlash) else ()
    return {column.joint: model.parameter(column.name) for column in columns}


def has_gears(model: Model, effect: Effect) -> bool:
    """Whether the effect is one that MJCF has as joints: no spring has a negative compliance, and no gap."""
    return isinstance(effect, Elasticity | Backlash) and all(x >= 0.0 for x in gear_value(model, effect).values())


def trains_of(model: Model) -> dict[str, GearTrain]:
    """Joint -> its gears, of a model with physical links; a joint with a rigid gear (zero) is not there."""
    found: dict[str, list[GearJoint]] = {}
    rubbing: dict[str, float] = {}
    effects = [e for e in model.effects if has_gears(model, e)]
    if not effects:
        return {}
    theta = model.full_theta[: len(model.robot.columns)]
    inertia = dict(zip(model.robot.joints, map(float, RigidDynamics.of(model.robot, theta).inertia), strict=True))
    for effect in effects:
        for joint, x in gear_value(model, effect).items():
            if x <= 0.0:
                continue
            link, before = inertia[joint], found.setdefault(joint, [])
            values = {"armature": LEAST_ROTOR * link} if before else {}
            if isinstance(effect, Elasticity):
                k = 1 / x
                values |= {"stiffness": k, "damping": 2 * SWING_DAMPING * float(np.sqrt(k * link))}
            name = f"{'spring' if isinstance(effect, Elasticity) else 'play'} of {joint}"
            gap = x if isinstance(effect, Backlash) else 0.0
            before.append(GearJoint(name, effect.id, values, gap))
            rubbing[joint] = max(rubbing.get(joint, 0.0), float(getattr(effect, "rubbing", 0.0)))
    return {
        joint: GearTrain(tuple(gears), LEAST_ROTOR * inertia[joint], rubbing[joint]) for joint, gears in found.items()
    }
