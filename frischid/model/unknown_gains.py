"""Torque per ampere that the user could not name, from logs of currents.

    i_j = κ_j Y_j θ + noise,     κ_j = 1 / K_j

The URDF's links are the scale, as for the gains of a controller (`frischid.estimators.torque_scale`): K_j is known as
well as the links are that move with joint j. Torques of other joints in the same logs are a scale too.

*Sign.* A drive may count its current backwards. Friction opposes the motion, and its coefficients are not negative, so
the signal with the right sign is explained better. Both signs of all currents are tried, and each joint takes the one
that leaves it the smaller residual.

*Joints that the links hardly load.* No scale then exists. The median of the other joints' gains is used (1 without
any), unless the links would then cause more than the whole current, with a doubt of 100 %, and a note names the joint.
Its friction in amperes does not depend on the gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.text import percent
from frischid.core.types import Array
from frischid.effects import BASELINE
from frischid.estimators.torque_scale import TorqueScales, torque_scales
from frischid.estimators.urdf_prior import urdf_prior
from frischid.logs.current_gains import CurrentGains
from frischid.logs.driven import driven
from frischid.logs.filters import LowPass
from frischid.logs.recording import Motions, preview_of
from frischid.logs.summary import Data, held_by, summarise, torque_joints
from frischid.model.drive_parameters import REACH
from frischid.model.found_gains import UNKNOWN_GAIN
from frischid.model.identify_options import IdentifyOptions
from frischid.regression.accumulation import accumulate
from frischid.regression.base_parameters import Reduction
from frischid.regression.moment_blocks import total
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot


def known_currents(
    robot: Robot, logs: Sequence[Data], options: IdentifyOptions, notes: list[str]
) -> CurrentGains | None:
    """The torque per ampere of every joint whose logs hold currents and no torque.

    Parameters
    ----------
    logs : sequence of Log or Recording
        Logs to fit, with the torque of their controller if there is one.
    notes : list of str
        Gets sentences on what was found, and on what it means.

    Returns
    -------
    CurrentGains or None
        The options' own gains where nothing is open.
    """
    given = options.currents
    heads = [preview_of(log) for log in driven(logs, None, given)]
    there = [set(np.compress(head.has("current") & ~head.has("tau"), head.joints)) for head in heads]
    open_joints = [n for n in robot.joints if all(n in names for names in there)]
    if not open_joints:
        return given
    signals = _Signals.of(robot, driven(logs, None, given), options, open_joints)
    wanted = [n for n in open_joints if n in signals.joints]
    if not wanted:
        return given
    backwards, scales = signals.signs(wanted)
    inverse, doubts = {}, {}
    for name in wanted:
        k = signals.joints.index(name)
        found, stderr, most = (float(x[k]) for x in (scales.inverse, scales.stderr, scales.most))
        inverse[name] = min(found, most)
        # a scale beyond its bound by more than its error stands for an error of the model
        seen = REACH * stderr < inverse[name] and found - REACH * stderr <= most
        doubts[name] = stderr / inverse[name] if seen else UNKNOWN_GAIN
    lost = [n for n in wanted if doubts[n] == UNKNOWN_GAIN]
    typical = float(np.median([inverse[n] for n in wanted if n not in lost] or [1.0]))
    for name in lost:  # the other joints' drives are the best guess, unless the links would then cause too much
        inverse[name] = min(typical, float(scales.most[signals.joints.index(name)]))
    gains = {n: (-1.0 if n in backwards else 1.0) / inverse[n] for n in wanted}
    notes += _said(gains, doubts, lost)
    old = given or CurrentGains({})
    return CurrentGains({**old.gain, **gains}, {**old.doubt, **doubts})


def _said(gains: dict[str, float], doubts: dict[str, float], lost: Sequence[str]) -> list[str]:
    found = ", ".join(f"{n} {gains[n]:.4g} ± {percent(doubts[n])}" for n in gains if n not in lost)
    notes = []
    if found:
        notes.append(f"torque per ampere in N·m/A (N/A), from the URDF's masses, with one standard error: {found}")
    if lost:
        notes.append(
            f"torque per ampere of {', '.join(lost)} is unknown: the links in the URDF cause too little of the "
            "current, or their masses are known too roughly. Only figures in amperes hold there"
        )
    notes.append(
        "friction and gravity in amperes do not depend on these gains; the ratios between the joints' torques, and all "
        "masses, are as doubtful as the gains: frischid gains finds them from logs with a weighed payload"
    )
    return notes


@dataclass(frozen=True, eq=False)
class _Signals:
    """Currents of some logs as signals of unknown scale, prepared once."""

    robot: Robot
    logs: tuple[Data, ...]
    options: IdentifyOptions
    joints: list[str]
    lowpass: LowPass
    columns: tuple[Regressor, Reduction]
    known: Array

    @classmethod
    def of(cls, robot: Robot, logs: Sequence[Data], options: IdentifyOptions, open_joints: Sequence[str]) -> _Signals:
        """Prepare logs: joints, filter and columns are the same for both signs."""
        unit = driven(logs, None, CurrentGains(dict.fromkeys(open_joints, 1.0)))
        held, _ = held_by(robot, unit)
        joints = torque_joints(held, unit, options.torque_joints, [])
        lowpass = summarise(held, unit, joints, options.cutoff).lowpass
        regressor = Regressor(held, BASELINE, options.reference)
        known = np.array([n not in open_joints for n in joints])
        return cls(held, tuple(logs), options, joints, lowpass, (regressor, structure(regressor, joints)), known)

    def at(self, signs: dict[str, float]) -> TorqueScales:
        """Scales of the currents, taken with these signs."""
        regressor, reduction = self.columns
        logs = driven(self.logs, None, CurrentGains(signs))
        motions = Motions(logs, self.robot.joints, self.lowpass, self.options.velocity)
        blocks = accumulate(regressor, motions, self.lowpass, self.joints, base=reduction.base)
        whole = total(blocks.described(reduction.base_columns()))
        prior = urdf_prior(regressor, reduction, whole, self.options.prior_criteria)
        rule = self.options.prior_criteria.scale_rule
        return torque_scales(whole, reduction.mapping, prior, self.known.astype(bool), rule)

    def signs(self, wanted: Sequence[str]) -> tuple[set[str], TorqueScales]:
        """Joints whose current counts backwards, and the scales with the signs put right."""
        forward, reverse = (self.at(dict.fromkeys(wanted, sign)) for sign in (1.0, -1.0))
        better = reverse.variance < forward.variance
        backwards = {n for n in wanted if better[self.joints.index(n)]}
        if not backwards:
            return backwards, forward
        return backwards, self.at({n: -1.0 if n in backwards else 1.0 for n in wanted})
