"""Issues of a log's check that an effect in the model answers already.

A check knows only the URDF: it says that the base is tilted, or that the URDF does not explain a torque. Beside a model
that has a tilt, or an added effect on that joint, such a warning is out of date: the model's own error counts there.
"""

from __future__ import annotations

from frischid.checks.log_issue import LogIssue
from frischid.checks.position_faults import JOINT_ZERO
from frischid.effects import BASELINE
from frischid.model.model import Model

UNEXPLAINED_TORQUE = "unexplained torque"
ANSWERS = {
    "mounting": "gravity_tilt", "payload": "payload", "motor coupling": "joint_coupling", "spring": "joint_spring",
    JOINT_ZERO: "encoder_zero", "torque scale": "drive_gain", "late torque": "time_delay", "early torque": "time_delay",
}  # fmt: skip
"""Kind of issue -> the effect that answers it. An unexplained torque of a joint is answered by any effect that was
added on this joint by name."""


def is_answered(model: Model, issue: LogIssue) -> bool:
    """Whether effects of the model act on all joints of an issue, as the issue asks for.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.checks.log_issue import LogIssue
    >>> from frischid.model.answered_issues import is_answered
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(tau=0.1))
    >>> spring = (*fr.BASELINE, *fr.parse_effects("joint_spring@joint2"))
    >>> model = fr.identify(robot, [log], effects=spring, recursion="none").model
    >>> issues = [LogIssue("spring", "a spring may pull", (name,), "possible", "") for name in robot.joints]
    >>> [is_answered(model, issue) for issue in issues]
    [False, True]
    """
    usual = {effect.id for effect in BASELINE}
    if issue.kind == UNEXPLAINED_TORQUE:
        found = [e for e in model.effects if e.joints and e.id not in usual]
    else:
        found = [e for e in model.effects if e.id == ANSWERS.get(issue.kind)]
    acting = {name for e in found for name in e.joints or model.robot.joints}
    return bool(found) and acting.issuperset(issue.where)
