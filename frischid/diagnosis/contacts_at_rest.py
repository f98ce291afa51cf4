"""Logs at standstill in a diagnosis: a torque that appears on a still arm is a contact, and no effect shows there.

At standstill dry friction holds any torque up to break-away, so a model can predict gravity only, and a missing effect
cannot be distinguished from friction. But gravity and friction stay as they are: a torque that appears for a while
comes from outside (`frischid.checks.standing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from frischid.checks.standing import pushes
from frischid.core.text import listed
from frischid.diagnosis.contacts import Contact
from frischid.logs.log import Log
from frischid.logs.poses import in_motion
from frischid.logs.recording import Recording
from frischid.model.model import Model


def contacts_at_rest(model: Model, logs: Sequence[Log | Recording]) -> list[Contact]:
    """Torques that appear while the whole arm stands still, on the model's joints.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
        Long recordings are not searched.

    Returns
    -------
    list of Contact
    """
    found = []
    for log in logs:
        if isinstance(log, Recording):
            continue
        part = log.select(model.robot.joints)
        if part.tau is not None:  # joints without a fitted torque still have to stand still
            tau = part.tau.copy()
            tau[:, [j for j, name in enumerate(part.joints) if name not in model.joints]] = 0.0
            part = replace(part, tau=tau)
        found += [Contact(log.source, p.start, p.stop, list(p.joints), p.strength) for p in pushes(part)]
    return found


def said_of(model: Model, logs: Sequence[Log | Recording]) -> list[str]:
    """A sentence on static logs among logs in which the arm moves; none without any."""
    moving = in_motion(logs, model.robot.joints)
    still = [log.source for log in logs if all(log is not other for other in moving)]
    if not still:
        return []
    return [f"{listed(still)}: the arm stands still, so only contacts are searched there"]
