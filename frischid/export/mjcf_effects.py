"""A Python file beside an MJCF file: the effects for which the XML has no place, as passive forces of MuJoCo.

    M q̈ + bias = τ_actuators + τ_native − f(q, q̇, q̈, state),     f the torque of exactly those effects

The file needs NumPy and MuJoCo. Its ``attach(model)`` sets MuJoCo's passive-force callback. The callback runs in every
stage of every integrator, in viewers and in ``mj_inverse``; a force in ``qfrc_applied`` would be that of the state
before the step. What the callback decides:

- *State.* A time that grew commits the state of the evaluation before. The same time (a stage of RK4, a second
  ``mj_forward``) is tried again from there, and a time that fell (``mj_resetData``) starts anew. Each MjData has a
  state of its own.
- *Dry friction* as a force would be stiff: 5 N·m over 5 mrad/s on 0.1 kg·m² is unstable with steps beyond 0.2 ms. So
  the mean of the friction forwards and backwards is a force, and half of their difference is the level of MuJoCo's own
  friction constraint of this moment, which holds a joint at rest. The XML has the constraint for every such joint.
- *Acceleration.* The other forces of this step are not known yet. So q̈ is that of the last evaluation, corrected for
  the change of the effects: ``M δ + f(q̈ + δ) = f_last``. Otherwise an effect whose inertia is larger than that of the
  links would make the simulation unstable at every step, however short.
- *Presliding* follows the path of the positions, because the mean of the speeds lags half a step behind.

`elasticity` and `backlash` are joints of the XML (`frischid.export.mjcf_gears`). As explicit forces they would depend
on derivatives of the acceleration itself: 1 ms steps of a three-joint arm became unstable within 0.2 s.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from frischid.effects import RotorInertia
from frischid.effects.state import SIGN_WIDTH
from frischid.export.code import PARTS, filled_in, python_values
from frischid.export.code_body import Body, NumPy
from frischid.export.code_columns import CodeColumn, CodeModel, Made
from frischid.export.mjcf_gears import has_gears
from frischid.export.mjcf_share import Share, dry_joints, forces, rubs, share_of
from frischid.export.names import number
from frischid.export.reach import left_out
from frischid.forward.effect_torques import CRAWL
from frischid.model.model import Model

MARK = "The effects that an MJCF file written by frischid lacks"
"""In the first line of a written file: such a file may be replaced by a new export."""


HELP = """    model = mujoco.MjModel.from_xml_path("ROBOT.xml")
    effects = ROBOT_effects.attach(model)  # from now on, MuJoCo applies the effects in every simulation of the model

The effects act as passive forces. Resetting an MjData, or setting its time back, makes its memory new."""


class _Passive(NumPy):
    """NumPy whose Dahl state follows the path of the positions, and starts unbent."""

    def made(self, quantity: Made) -> str:
        """The call of the quantity's function."""
        if quantity.kind != "slide":
            return super().made(quantity)
        place, joint = f"state.slide[{quantity.number}]", quantity.joint
        path = f"q[0, {joint}] - state.q[{joint}]"
        call = f"_slid({place}, {path}, v[0, {joint}], {number(quantity.values[0])}, state.started)"
        return self.value(f"{quantity.name} = {place}", call)


class _Rest(Body):
    """Statements that add the torque of the columns that the XML lacks."""

    def __init__(self, model: Model, share: Share) -> None:
        inside = any(c.name in share.held for e in model.effects if e.id == "payload" for c in e.columns(model.robot))
        code = CodeModel.of(model, payload_in_links=inside)
        super().__init__(code, _Passive())
        self.held = share.held
        sharp = replace(model, effects=tuple(e.with_sign_width(1e-3 * CRAWL) for e in model.effects))
        self.sharp = {c.name: c for c in CodeModel.of(sharp, payload_in_links=inside).columns}
        reading = [k for k, c in enumerate(code.columns) if c.reads("torque")]
        last = reading[-1] if reading else -1
        self.columns = [c for k, c in enumerate(code.columns) if self._is_left(c) or (c.reference != 0.0 and k < last)]

    def _is_left(self, column: CodeColumn) -> bool:
        return column.name not in self.held and column.theta != 0.0

    @property
    def reads_acceleration(self) -> bool:
        """Whether the torque depends on the acceleration."""
        texts = [text for c in self.columns for text in c.rows.values()]
        fed = any(m.kind in ("slope", "spin", "extra") for c in self.columns for m in c.made)
        return fed or any(re.search(r"\b(a|load|torque)\[", text) for text in texts)

    def passive(self) -> Iterator[str]:
        """The body of ``step``."""
        language, reading = self.language, [k for k, c in enumerate(self.columns) if c.reads("torque")]
        yield from language.inputs(self.code)
        yield from self._prepared(self.columns)
        if reading:
            yield language.copy("torque", "load")
        for first, group in self._by_effect(self.columns):
            values = list(self._values(group, first, "torque", "x"))
            yield from (line for line, *_ in values)
            for _, column, joint, name in values:
                if self._is_left(column):
                    yield from self._left(column, joint, name)
                if column.reference and reading and first < reading[-1]:
                    yield language.add("torque", joint, f"{number(column.reference)} * {name}")

    def _left(self, column: CodeColumn, joint: int, name: str) -> Iterator[str]:
        language, effect, theta = self.language, column.effect, number(column.theta)
        if rubs(effect) and not (effect.id == "coulomb" and column.theta < 0):
            text = self.sharp[column.name].rows[joint]
            for out, speed in (("ahead", "fore"), ("back", "aft")):
                sharp = language.spelled(re.sub(r"\bv\[", f"{speed}[", text))
                yield language.add(out, joint, f"{theta} * ({sharp})")
            return
        yield language.add("rest", joint, f"{theta} * {name}")
        if isinstance(effect, RotorInertia) and effect.coupled and column.theta >= 0:  # the XML has the armature
            own = column.made[0].joint
            if self.code.model.robot.bodies[own] == self.code.model.robot.joints[joint]:
                yield language.add("rest", joint, f"{number(-column.theta * effect.ratio**2)} * a[:, {joint}]")


def effects_source(model: Model) -> str | None:
    """Python source of the effects that the MJCF file of a model lacks; None if the XML has the whole model.

    Raises
    ------
    InputError
        As for `frischid.export.code.c_source`, but an effect whose class states no code is left out.
    """
    lost = left_out(model, "MJCF")
    torques = forces(model)
    torques = replace(torques, effects=tuple(e for e in torques.effects if str(e) not in lost))
    share = share_of(torques)
    rest = _Rest(replace(torques, effects=tuple(e for e in torques.effects if not has_gears(torques, e))), share)
    if not any(rest._is_left(c) for c in rest.columns):
        return None
    dry = dry_joints(torques, share.held)
    joints = torques.robot.joints
    native = "\n".join(f"    {name!a}: {_numbers(share.joints[name])}," for name in joints)
    values = python_values(rest.code, rest.language) | {
        "imports": "import weakref\n\nimport mujoco\nimport numpy as np",
        "native": native,
        "dry": repr(tuple(joints.index(name) for name in dry)),
        "reads": str(rest.reads_acceleration),
        "width": number(SIGN_WIDTH),
        "crawl": number(CRAWL),
        "slides": str(sum(m.kind == "slide" for m in rest.code.made)),
        "heats": str(sum(m.kind == "heat" for m in rest.code.made)),
        "effects": "\n".join(rest.passive()),
    }
    values["head"] = f"{MARK}.\n\n{HELP}\n\n{values['head']}"
    parts = {"slide": "bend.txt"}
    needed = [parts.get(part, f"{part}.txt") for part in PARTS if part in set(rest.parts) - {"sign"}]
    return filled_in("control_py.txt", [*needed, "mujoco.txt"], values)


def _numbers(values: dict[str, float]) -> str:
    kept = {name: x for name, x in values.items() if name != "springref"}
    return "{" + ", ".join(f"{name!a}: {number(x)}" for name, x in kept.items()) + "}"
