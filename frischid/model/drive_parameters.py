"""The drive of each joint by a model: gains, delay, armature and friction, with the range of each.

    τ = kp (q_cmd(t − delay) − q) − kd q̇ − fv q̇ − fc sign(q̇),     inertia about the joint = links + armature

Each value has one of seven states. *identified*: the logs gave most of what is known, and the 95 % range lies within
5 % of the value. *roughly*: the logs gave most of what is known, and the range is wider, but excludes zero. *as a
ratio*: one of these two holds of the value over the drive's gain, kp or the torque per ampere, where this gain was
found from the URDF's masses; the value's own range also holds the doubt about the gain. A value over the torque per
ampere is the value in amperes. A gain that the model corrects (`position_gain`) is known as a ratio to the gains of
other joints.
*in a sum*: the logs show the value only together with others (``Izz1 + Ia1 + 0.25 m2``); the URDF divides the sum.
*open*: otherwise; every value of the range explains the logs, so that the range is an honest domain to randomise over.
*given*: the user named the value. *assumed*: nobody named a kd or a delay, and it counts as zero.

*Doubtful gain.* Friction and armature are r/κ: r is the ratio to the gain, which the logs show, and κ is 1 over the
gain. With normal errors of both, the range of r/κ is Fieller's. Where the range of κ reaches zero, the gain and every
value that grows with it have a lowest value, and no largest. The links' inertia about the joint does not grow with the
gain. Logs show the armature beside it, so that armature/kp holds the doubt about (links' inertia)/kp.

Where a drive damps its own joint, logs show ``kd + fv`` only: fv is the rest after
the kd that was named. Where kd was left open and no velocity is commanded, both are in this sum. The table then has
kd = 0 and the sum as fv, which move the robot as any other division does. Commanded velocities tell kd from fv; a value
that they leave open is in the known sum, too.

Source: Fieller 1954, J. Royal Statistical Society B 16(2), equation 9: the range of a ratio.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from frischid.core.types import Array, Column
from frischid.effects import columns_of
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.unknown_damping import DampingSum, damping_sum
from frischid.robot.robot import Robot

Known = Literal["identified", "roughly", "as a ratio", "in a sum", "open", "given", "assumed"]
REACH = 1.96
"""Standard errors on either side of a value that hold 95 % of a normal distribution."""
LEAST_FROM_LOGS = 0.5
"""Share of a value's knowledge that the logs must have given for it to count as identified: more than the prior did."""
CLOSE = 0.05
"""Share of a value within which its 95 % range lies where the value is called identified: what the word promises."""
DRIVE_EFFECTS = {
    "armature": ("rotor_inertia", "Ia"),
    "viscous": ("viscous", "fv"),
    "coulomb": ("coulomb", "fc"),
}
"""Quantity -> effect and symbol of its parameter."""
OPEN_DAMPING = ("velocity_gain", "kd")
"""Effect and symbol of a kd that the user left open."""
NAMED_BY_USER = {"stiffness": "kp", "damping": "kd", "delay": "delay", "effort_limit": "limit"}
"""Quantity -> field of the controller."""
CORRECTIONS = {"command_delay": "delay"}
"""Effect of the model -> quantity that it corrects."""
SOFTER = "position_gain"
"""Effect of the model that corrects the position gain: kp is the named one over 1 + its parameter."""
ALL_LATE = "late"
"""Parameter of `command_delay` for all joints together."""
_Value = tuple[Column, float, float, float]


@dataclass(frozen=True)
class DriveParameter:
    """One value of one joint's drive.

    Attributes
    ----------
    joint : str
    quantity : {"torque_per_ampere", "stiffness", "damping", "delay", "effort_limit", "armature", "viscous", "coulomb"}
    unit : str
    value : float
        In `unit`.
    lower, upper : float
        Range that holds the true value in 95 % of cases, without impossible signs; `upper` is infinite where the gain
        of the drive has no largest value.
    known : {"identified", "roughly", "as a ratio", "in a sum", "open", "given", "assumed"}
    of : str
        What the logs show: the sum for a value that is known in a sum, the ratio to the gain with its 95 % range for a
        value that is known as a ratio; otherwise empty.
    """

    joint: str
    quantity: str
    unit: str
    value: float
    lower: float
    upper: float
    known: Known
    of: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; a range without an end has None there."""
        return asdict(self) | {"upper": self.upper if np.isfinite(self.upper) else None}


def drive_parameters(model: Model) -> tuple[DriveParameter, ...]:
    """Gains, delay, armature and friction of every joint of a model.

    Parameters
    ----------
    model : Model

    Returns
    -------
    tuple of DriveParameter
        Joint by joint; quantities that the model does not have are left out.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0, parameters={"fv1": 0.4})
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> [(x.quantity, x.known) for x in fr.drive_parameters(model) if x.joint == "joint1"]
    [('armature', 'in a sum'), ('viscous', 'identified'), ('coulomb', 'identified')]
    """
    check_model(model)
    values = values_of(model)
    links = dict(zip(model.robot.joints, _links_inertia(model.robot).tolist(), strict=True))
    found: list[DriveParameter] = []
    for joint in model.joints:
        found += [*_of_currents(model, joint), *_of_controller(model, joint, values)]
        doubt, start = _gain(model, joint)[2], len(found)
        for quantity, (effect, symbol) in {"damping": OPEN_DAMPING, **DRIVE_EFFECTS}.items():
            wider = doubt * links[joint] if quantity == "armature" else 0.0
            found += [
                _of_column(model, quantity, (column, value, float(np.hypot(spread, wider)), share), doubt)
                for column, value, spread, share in values
                if (column.joint, column.effect) == (joint, effect) and column.name.rstrip("0123456789") == symbol
            ]
        if (whole := damping_sum(model, joint)) is not None:
            found[start:] = _in_damping_sum(model, joint, whole, found[start:])
    return tuple(found)


def _of_column(model: Model, quantity: str, row: _Value, doubt: float) -> DriveParameter:
    """Row of a column: its value, standard error and share from the logs; `doubt` is that of the drive's gain."""
    column, value, spread, share = row
    seen = value > REACH * spread and share >= LEAST_FROM_LOGS
    of = "" if seen else _sum_with(model, column.name)
    lower, upper = range_of_ratio(value, spread, doubt)
    known: Known = _found(value, lower, upper) if seen else "in a sum" if of else "open"
    if seen and doubt > 0:
        known, of = "as a ratio", _ratio(model, column.joint, quantity, value, spread)
    return DriveParameter(column.joint, quantity, column.unit, max(0.0, value), lower, upper, known, of)


def _in_damping_sum(model: Model, joint: str, whole: DampingSum, rows: list[DriveParameter]) -> list[DriveParameter]:
    """Rows of a joint, with those of kd and viscous friction in their sum where it alone is known."""
    found = [x for x in rows if x.quantity not in ("damping", "viscous")]
    both = [x for x in rows if x.quantity in ("damping", "viscous")]
    if not whole.apart:  # one column stands for both
        both = [replace(x, lower=0.0, known="open") for x in both]
        both += [replace(x, quantity="damping", value=0.0) for x in both]
    if whole.value <= REACH * whole.stderr:
        return [*found, *both]
    name, gain, doubt = _gain(model, joint)
    low, high = _range(whole.value / gain, whole.stderr / gain) if doubt else _range(whole.value, whole.stderr)
    total, value = (f"(kd + viscous) / {name}", whole.value / gain) if doubt else ("kd + viscous", whole.value)
    text = f"{total} = {value:.4g} ({low:.4g} … {high:.4g})"
    return [*found, *(replace(x, known="in a sum", of=text) if x.known == "open" else x for x in both)]


def _found(value: float, lower: float, upper: float) -> Known:
    """The word for a value that the logs show."""
    return "identified" if max(upper - value, value - lower) <= CLOSE * abs(value) else "roughly"


def _range(value: float, stderr: float) -> tuple[float, float]:
    """The 95 % range of a value that is not negative."""
    return max(0.0, value - REACH * stderr), max(0.0, value + REACH * stderr)


def range_of_ratio(value: float, stderr: float, doubt: float) -> tuple[float, float]:
    """The 95 % range of a value r/κ that is not negative, from Fieller's inequality (r − x κ)² ≤ z² (s² + x² d²).

    Parameters
    ----------
    value : float
        r, with κ = 1.
    stderr : float
        s, of r.
    doubt : float
        d, standard error of κ.

    Returns
    -------
    lower, upper : float
        `upper` is infinite where the range of κ reaches zero.

    Examples
    --------
    >>> lower, upper = range_of_ratio(20.0, 0.0, 0.25)
    >>> round(lower, 2), round(upper, 2)
    (13.42, 39.22)
    >>> lower, upper = range_of_ratio(20.0, 0.0, 1.0)
    >>> round(lower, 2), upper
    (6.76, inf)
    """
    a, c = 1 - (REACH * doubt) ** 2, value**2 - (REACH * stderr) ** 2
    root = np.sqrt(max(value**2 - a * c, 0.0))
    lower = c / (value + root) if c > 0 and value > 0 else 0.0
    return float(lower), float(max(0.0, value + root) / a) if a > 0 else np.inf


def _links_inertia(robot: Robot) -> Array:
    """Inertia of the URDF's links about each joint in the neutral pose, kg·m² (kg), (J,)."""
    still, each = np.zeros((1, len(robot.joints))), np.eye(len(robot.joints))
    rest = robot.inverse_dynamics(still, still, still)
    torque = robot.inverse_dynamics(np.zeros_like(each), np.zeros_like(each), each)
    return np.asarray(np.diag(torque - rest))


def _gain(model: Model, joint: str) -> tuple[str, float, float]:
    """Name and value of the gain that turns a joint's signal into torque, and the doubt about it; 1 of a torque."""
    if model.currents is not None and joint in model.currents.gain:
        return "torque_per_ampere", abs(model.currents.gain[joint]), model.currents.doubt.get(joint, 0.0)
    if model.controller is not None and model.controller.knows_gain(joint):
        return "kp", model.controller.gain(joint), model.controller.gain_doubt(joint)
    return "", 1.0, 0.0


def _ratio(model: Model, joint: str, quantity: str, value: float, spread: float) -> str:
    """A value over the drive's gain, which the logs show although the gain is doubtful."""
    name, gain, _ = _gain(model, joint)
    low, high = _range(value / gain, spread / gain)
    return f"{quantity} / {name} = {value / gain:.4g} ({low:.4g} … {high:.4g})"


def _of_currents(model: Model, joint: str) -> list[DriveParameter]:
    """The torque per ampere of a joint whose logs hold currents; none where nothing determines it."""
    if model.currents is None or joint not in model.currents.gain:
        return []
    value, doubt = model.currents.gain[joint], model.currents.doubt.get(joint, 0.0)
    if REACH * doubt >= 1:
        return []
    unit = "N/A" if model.robot.prismatic[model.robot.joints.index(joint)] else "N·m/A"
    ends = sorted((value / (1 + REACH * doubt), value / (1 - REACH * doubt)))  # 1 / gain has the symmetric range
    known = _found(value, *ends) if doubt else "given"
    return [DriveParameter(joint, "torque_per_ampere", unit, value, ends[0], ends[1], known, "")]


def _of_controller(model: Model, joint: str, values: list[_Value]) -> list[DriveParameter]:
    """Gains and delay that the user named or that were found, and the URDF's limit where no other is known.

    The model's effects `command_delay` and `position_gain` correct the delay and the kp that were named.
    """
    pd, robot = model.controller, model.robot
    if pd is None:
        return []
    angle, torque = ("m", "N") if robot.prismatic[robot.joints.index(joint)] else ("rad", "N·m")
    units = {
        "stiffness": f"{torque}/{angle}",
        "damping": f"{torque}·s/{angle}",
        "delay": "s",
        "effort_limit": torque,
    }
    found = []
    for quantity, name in NAMED_BY_USER.items():
        if quantity == "damping" and not pd.knows_damping(joint):
            continue
        value = float(pd.values(name, [joint])[0])
        if quantity == "effort_limit" and not np.isfinite(value):
            value = float(robot.limits.effort[robot.joints.index(joint)])
        lower, upper, of = value, value, ""
        known: Known = "given" if value or quantity not in ("damping", "delay") else "assumed"
        if quantity == "stiffness" and (doubt := pd.gain_doubt(joint)) > 0:
            lower, upper = range_of_ratio(value, 0.0, doubt)
            known = _found(value, lower, upper) if np.isfinite(upper) else "open"
        if quantity == "delay" and (doubt := float(pd.values("delay_doubt", [joint])[0])) > 0:
            lower, upper = _range(value, doubt)
            known = _found(value, lower, upper)
        for column, more, spread, _ in values:
            if quantity == "stiffness" and column.effect == SOFTER and column.joint == joint:
                softer = np.clip([1 + more + k * REACH * spread for k in (0, 1, -1)], 1e-3, None)
                value, lower, upper = (float(value / x) for x in softer)
                known, of = "as a ratio", "kp against the other joints' gains"
            if CORRECTIONS.get(column.effect) == quantity and (column.joint == joint or column.name == ALL_LATE):
                value = value + more  # the doubt about the delay is the prior of its correction
                lower, upper = _range(value, spread)
                value = max(0.0, value)
                known = _found(value, lower, upper)
        if np.isfinite(value):
            found.append(DriveParameter(joint, quantity, units[quantity], value, lower, upper, known, of))
    return found


def _sum_with(model: Model, name: str) -> str:
    """The base parameter that holds a parameter and others, if the logs show this sum; otherwise empty."""
    e = model.estimate
    for k, text in enumerate(model.expressions):
        if text != name and name in re.split(r"[ +-]+", text):
            shown = e.from_data is None or e.from_data[k] >= LEAST_FROM_LOGS
            return text if shown and abs(e.theta[k]) > REACH * e.stderr[k] else ""
    return ""


def values_of(model: Model) -> list[_Value]:
    """Column, value, standard error and share from the logs of every parameter that has these.

    Notes
    -----
    With a prior, every parameter has a value of its own. Without, only those that are base parameters by themselves.
    """
    columns = columns_of(model.robot, model.effects)
    if model.prior is not None:
        prior = model.prior
        spread = prior.parameters.total_spread * np.sqrt(1.0 - prior.from_log)
        return list(zip(columns, prior.value.tolist(), spread.tolist(), prior.from_log.tolist(), strict=True))
    e = model.estimate
    alone = [k for k, (c, text) in enumerate(zip(e.columns, model.expressions, strict=True)) if c.name == text]
    return [(e.columns[k], float(e.theta[k]), float(e.stderr[k]), 1.0) for k in alone]
