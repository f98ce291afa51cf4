"""Gains of a controller from the scale that the URDF's links are, and the joints that have no such scale.

    kp_j = 1 / κ_j,     κ_j ± s_j from the logs (`frischid.estimators.torque_scale`)

*Joints that the links hardly load.* No scale then exists. The median of the other drives' gains is used (of the
joints' own estimates without any), unless the links would then cause more than the whole signal, with a doubt of 100 %.
Only ratios to kp are known there. A named kd is no ratio to kp, so it is open too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from frischid.core.text import percent
from frischid.errors import InputError
from frischid.estimators.torque_scale import TorqueScales
from frischid.logs.controller import PDController
from frischid.model.drive_parameters import REACH

UNKNOWN_GAIN = 1.0
"""Doubt about a gain that nothing determines, as a share of it."""


def with_gains(
    controller: PDController, open_gains: Sequence[str], scales: TorqueScales, joints: Sequence[str]
) -> tuple[PDController, list[str]]:
    """The controller with the gains found, and the joints whose gain the logs and the URDF leave open.

    Parameters
    ----------
    controller : PDController
        With the delay, and without the gains.
    open_gains : sequence of str
        Joints whose kp is not known.
    scales : TorqueScales
        Of `joints`.
    joints : sequence of str
        Joints of the fit.

    Raises
    ------
    InputError
        A gain has the wrong sign.
    """
    gains, doubts, lost = {}, {}, {}
    for name in open_gains:
        if name not in joints:
            continue
        inverse, stderr, most = (float(x[joints.index(name)]) for x in (scales.inverse, scales.stderr, scales.most))
        if -most < inverse < -REACH * stderr:
            raise InputError(
                f"{name}: the torque of the URDF's links pushes against the position error q_cmd − q; is the sign of "
                f"q_{name} or of qcmd_{name} reversed? correct it in the mapping (sign = -1)"
            )
        if inverse < REACH * stderr or inverse > most:
            lost[name] = most
            continue
        gains[name], doubts[name] = 1.0 / inverse, stderr / inverse
    named = [n for n in joints if controller.knows_gain(n)]
    known = dict(zip(named, map(float, controller.values("kp", named)), strict=True))
    drives = [1.0 / x for x in (known | gains).values()]
    guesses = [min(abs(float(scales.inverse[joints.index(n)])), most) for n, most in lost.items()]
    typical = float(np.median(drives or guesses or [1.0]))
    for name, most in lost.items():  # the links would cause more than the whole signal beyond `most`
        gains[name], doubts[name] = 1.0 / min(typical, most), UNKNOWN_GAIN
    found = replace(controller, kp=known | gains, kp_doubt=doubts)
    damped = {n: float(x) for n, x in zip(joints, controller.values("kd", joints), strict=True)}
    open_too = [n for n in joints if n in lost or not controller.knows_damping(n)]
    if any(damped[n] for n in lost):
        found = replace(found, kd=damped | dict.fromkeys(open_too))
    return found, list(lost)


def gain_notes(controller: PDController, open_gains: Sequence[str], lost: Sequence[str]) -> list[str]:
    """Sentences on the gains that were found, and on those that are open.

    Parameters
    ----------
    controller : PDController
        As `with_gains` returns it.
    open_gains, lost : sequence of str
        Joints whose kp was not known, and those of them whose kp is open.
    """
    notes = []
    each = [f"{n} {controller.gain(n):.4g} ± {percent(controller.gain_doubt(n))}" for n in open_gains if n not in lost]
    if each:
        notes.append(f"kp in N·m/rad (N/m), from the URDF's masses, with one standard error: {', '.join(each)}")
    if lost:
        notes.append(
            f"kp of {', '.join(lost)} is open: the links in the URDF cause too little of the torque there, so "
            "they are no scale for it. Only ratios to kp hold: friction / kp, armature / kp, and the motion under "
            "these commands. Masses are as doubtful as kp. Name kp (--kp), such as that of another joint with the "
            "same drive; do commands and positions have the same unit and sign?"
        )
        if any(not controller.knows_damping(n) for n in lost):
            notes.append("the kd of these joints is open with kp: the logs show (kd + viscous friction) / kp")
    return notes
