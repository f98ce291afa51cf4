"""Findings: scored effects with the error they explain, the effects they are confused with, and a sentence.

An effect is *called missing* when three conditions hold: its gain is more than chance, the error it explains is not
negligible, and it explains enough of the error above the sensor noise on its joints (`effect_findings`).

Where the error is well above the noise, any share is enough. Near the noise, the share must reach one half. Where all
of the error lies at reversals and standstill, dry friction is undetermined: the share must reach four fifths, and the
motion must show the effect too, as far as the effect acts there (`reversal_residuals`).

Error that noise of the positions alone explains on the healthy twin is no effect (`healthy_twin`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from frischid.core.text import about, listed, percent
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.effects import EFFECTS, Effect
from frischid.effects.notation import stated_choices
from frischid.model.parameters import joint_numbers
from frischid.robot.robot import Robot

OLD_PARAMETERS = "old_parameters"
"""Identifier of the finding that the identified parameters no longer hold."""


@dataclass(frozen=True, eq=False)
class Finding:
    """One effect with its evidence.

    Attributes
    ----------
    effect : str
        Identifier in the catalogue.
    joints : tuple of str
        Joints the effect acts on; empty for the whole robot.
    error_before, error_after : float
        Cross-validated NRMSE, mean over the joints, without the part that uncertain parameters alone cause. All errors
        of a finding are counted so.
    gain : float
        Rise of the log likelihood on data the effect was not fitted to, less the price ½ k log n of its k parameters.
    removed : float
        Explained error: fall of the summed squared cross-validated NRMSE of the joints.
    share : float
        Explained share of the error above the sensor noise on the effect's joints; zero where that error is negligible.
    floors : float
        Error without the effect over the sensor noise, on the effect's joints; joints whose error is only at reversals
        do not count.
    over_twin : float
        The same over the error of the healthy twin (`frischid.diagnosis.healthy_twin`), which is large at reversals
        too: so all joints count where the error of all is only there. Of a refit of all parameters, over the noise.
    twin_removed : float
        `removed` on the healthy twin, which lacks nothing: the most that noise alone explains. Zero for an effect that
        neither entered nor is a rival of the first.
    p_value : float
        Of the gain, if the model lacked nothing else, corrected for all candidates tried. It decides inside the search
        and is no probability that the finding is right: see `probability`.
    parameters : dict of str to float
        Coefficients and shape parameters.
    confused_with : tuple of str
        Effects that explain these data nearly as well.
    sentence : str
    members : tuple of Effect
        Effects to add to a model: one for every joint, or one for the robot.
    criteria : DiagnosisCriteria
        Thresholds of the properties below.
    entered : bool
        Whether the effect is one of those that explain the data together.
    own : float
        Error that only this effect explains, in summed squared NRMSE; zero unless it entered.
    probability : float
        Probability that the model lacks this effect and no more probable hypothesis is right (`probability`).
    set_aside : str
        Why the effect is not called missing although it passes the rules; empty where it may be.
    elsewhere : tuple of str
        Joints on each of which the same effect instead explains these data nearly as well.
    negligible : bool
        Whether that error is negligible.
    absent_in_motion : bool
        Whether the joints' error is only at reversals, and their motion shows less than half of the effect, which acts
        there too.
    """

    effect: str
    joints: tuple[str, ...]
    error_before: float
    error_after: float
    gain: float
    removed: float
    share: float
    floors: float
    over_twin: float
    twin_removed: float
    p_value: float
    parameters: dict[str, float]
    confused_with: tuple[str, ...]
    sentence: str
    members: tuple[Effect, ...]
    criteria: DiagnosisCriteria = field(default=DIAGNOSIS_CRITERIA, repr=False)
    entered: bool = False
    own: float = 0.0
    probability: float = 0.0
    set_aside: str = ""
    elsewhere: tuple[str, ...] = ()
    negligible: bool = False
    absent_in_motion: bool = False

    @property
    def explains(self) -> str:
        """`share` in words; a dash where the error above the sensor noise is negligible."""
        return "–" if self.negligible else percent(self.share)

    @property
    def sure(self) -> bool:
        """Whether the effect is more than chance, and the error it explains is not negligible."""
        least = self.criteria.smallest_error**2
        return self.gain > 0 and self.p_value < self.criteria.significance and self.removed > least

    @property
    def withheld(self) -> str:
        """Why the effect is not called missing although it may be more than chance; empty where nothing speaks against.

        Sensor noise and undetermined dry friction may cause all of the error that the effect explains, or all its gain.
        """
        if not self.members and self.gain <= 0:
            return ""  # a verdict in place of an effect
        if self.gain > 0 and not self.more_than_noise:
            return "it explains as much error of a robot that misses nothing, because sensor noise biases the fit"
        return self.set_aside or self._against(self.floors)

    @property
    def more_than_noise(self) -> bool:
        """Whether the gain is more than its price, and the explained error more than that of the healthy twin."""
        return self.gain > 0 and self.removed > self.twin_removed

    @property
    def dry_friction_instead(self) -> bool:
        """Whether it explains only a part of an error at reversals: undetermined dry friction is the cause instead.

        An effect that explains nearly all of such an error may be its cause, if the motion shows the effect too.
        """
        return self.floors == 0 and (self.share < self.criteria.nearly_explained or self.absent_in_motion)

    @property
    def pays(self) -> bool:
        """Whether the effect may be added to the model: sure, and more than what sensor noise explains.

        An effect that explains a small part of the error is not called missing, but may still predict other logs
        better.
        """
        above = self.floors > self.criteria.floor_tolerance or not self._against(self.floors)
        return self.sure and self.more_than_noise and above

    @property
    def beyond_twin(self) -> bool:
        """The same where the error of the healthy twin counts as noise."""
        at_reversals = self.floors == 0 and bool(self._against(self.floors))
        return self.sure and not at_reversals and not self._against(self.over_twin)

    def _against(self, floors: float) -> str:
        """Reason against an effect whose error is some multiple of the error that a perfect model has."""
        criteria = self.criteria
        if floors == 0 and self.share > 0:
            least = criteria.nearly_explained
            why = f"and must explain {percent(least)}, because all of that error is at reversals and standstill"
            if self.share < least:
                return f"{self._explained(least)}, {why}"
            said = "all of the error is at reversals and standstill, and the motion shows less than half of the effect"
            return said if self.absent_in_motion else ""
        if floors <= criteria.floor_tolerance:
            return "in this search, the error there is hardly more than the sensor noise"
        if self.negligible:
            return "the error above the sensor noise there is negligible"
        if self.share == 0:
            return "it explains none of the error above the sensor noise there"
        least = criteria.half_explained
        if floors <= criteria.clear_error and self.share < least:
            why = f"because in this search the error is only {floors:.1f} times the noise"
            return f"{self._explained(least)}, and must explain {percent(least)}, {why}"
        return ""

    def _explained(self, least: float) -> str:
        """The share that the effect explains, with a digit more where it would read like the share that it must."""
        digits = int(percent(self.share) == percent(least))
        return f"it explains {percent(self.share, digits)} of the error above the sensor noise there"

    @property
    def significant(self) -> bool:
        """Whether the effect is called missing: sure, and not withheld."""
        return self.sure and not self.withheld

    @property
    def refused(self) -> str:
        """Why the effect is not called missing; empty where it is."""
        if self.gain <= 0 or self.p_value >= self.criteria.significance:
            return "its evidence may be chance"
        if self.removed <= self.criteria.smallest_error**2:
            return "the error that it explains is negligible"
        return self.withheld

    @property
    def undecided(self) -> tuple[str, ...]:
        """Effects these data cannot tell from it, without those that contain it: there it is the simpler answer."""
        return tuple(
            name for name in self.confused_with if name not in EFFECTS or self.effect not in EFFECTS[name].generalises
        )

    @property
    def title(self) -> str:
        """Effect and joints, for a sentence."""
        return f"{self.effect} on {listed(self.joints) or 'the robot'}"

    @property
    def change(self) -> str:
        """Relative change of the mean cross-validated error with this effect alone, in words."""
        if self.error_before <= 0:
            return "–"
        change = round(100 * (self.error_after / self.error_before - 1))
        return f"{change:+d} %" if change else "0 %"

    def found(self, robot: Robot) -> list[tuple[str, float | str, str]]:
        """Name, value and unit of each of `parameters` (unit empty for a pure number), coefficients first.

        A form, a ratio or another choice that is not the usual one is among them. A shape at the end of the values that
        are tried may be smaller, or larger, in truth: the unit says so.
        """
        values: list[tuple[str, float | str, str]] = [
            (c.name, self.parameters[c.name], "" if c.unit == "1" else c.unit)
            for member in self.members
            for c in member.columns(robot)
        ]
        for member in self.members:
            where = f" of {listed(member.joints or ('the robot',))}" if len(self.members) > 1 else ""
            values += [(f"{k}{where}", x, member.unit(k, robot)) for k, x in stated_choices(member).items()]
            shape = {k: x for k, x in shape_of(member).items() if k not in member.internal}
            values += [
                (f"{k}{where}", x, f"{member.unit(k, robot)}{_edge(member, k, x)}".strip()) for k, x in shape.items()
            ]
        return values

    def joint_numbers(self, robot: Robot) -> str:
        """Which joints the numbers in the names of `found` mean; empty where their names end with the number."""
        return joint_numbers({n for member in self.members for n in member.joints or ()}, robot.numbers)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values.

        The p value is that of a test over many candidates. It is far too small beside another effect that is missing,
        so it decides inside the search only and is not among the values.
        """
        values = {k: v for k, v in vars(self).items() if k not in {"members", "criteria", "p_value", "set_aside"}}
        lists = {k: list(values[k]) for k in ("joints", "confused_with", "elsewhere")}
        members = [str(effect) for effect in self.members]
        return values | lists | {"members": members, "significant": self.significant, "withheld": self.withheld}


def with_members(finding: Finding, members: Sequence[Effect], robot: Robot) -> Finding:
    """The finding with some of its effects alone; their shapes are in the effects."""
    joints = joints_of(members)
    kept = {column.name for effect in members for column in effect.columns(robot)}
    return replace(
        finding,
        members=tuple(members),
        joints=joints,
        parameters={name: x for name, x in finding.parameters.items() if name in kept},
        sentence=said_of(members),
    )


def said_of(members: Sequence[Effect]) -> str:
    """What is wrong, in a sentence: that of the effects' class, and where the effect was there before."""
    said = about(joints_of(members), type(members[0]).sentence)
    same = [e for e in members if type(e) is type(members[0])]
    known = [e for e in same if e.changed]
    if not known:
        return said
    before = f"{listed(joints_of(known))}: this" if len(known) < len(same) else "This"
    return f"{said}. {before} effect was there before, and has changed"


def joints_of(members: Sequence[Effect]) -> tuple[str, ...]:
    """The joints that a finding acts on; none where one of its effects acts on the whole robot.

    A delay of all joints may come with a correction on one joint. The delay is then not a delay of this joint alone.
    """
    if any(effect.joints is None for effect in members):
        return ()
    return tuple(dict.fromkeys(name for effect in members for name in effect.joints or ()))


def _edge(effect: Effect, key: str, value: float) -> str:
    """Words on a shape at the end of the values that are tried; empty for others."""
    tried = effect.shapes.get(key, ())
    if len(tried) < 2 or min(tried) < value < max(tried):
        return ""
    return " or less" if value <= min(tried) else " or more"


def shape_of(effect: Effect) -> dict[str, float]:
    """The parameters of an effect that are searched."""
    return {k: float(v) for k, v in effect.parameters.items() if k in effect.searched}
