"""A body on a robot's last link: its numbers with bounds, and the lines by which controllers take them.

    m = φ₁,    c = (φ₂, φ₃, φ₄)/m,    I_c = I − m (cᵀc 1 − c cᵀ)

The logs determine the ten standard parameters φ = (m, mc, I). Controllers ask for the centre of mass c and the inertia
I_c about it; their covariance is that of φ, carried on by the derivative of this change.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special
from scipy.spatial.transform import Rotation

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.estimators.least_squares import HARDLY_KNOWN
from frischid.model.alarms import Alarm
from frischid.robot.inertia import dynamic_parameters, pseudo_inertia

USUAL_REACH = 0.15
"""m. Standard deviation of the body's centre of mass from the flange, and of its radius of gyration, in its prior."""
BODY_NUMBERS = ("mass", "x", "y", "z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True, eq=False)
class IdentifiedPayload:
    """A body on a robot's last link, in the axes of a frame of the flange.

    Attributes
    ----------
    frame : str
        Frame of the URDF, or ``"joint <name>"``.
    carrier : str
        Joint of the link that carries the body.
    mass : float
        kg.
    centre : ndarray, shape (3,)
        Centre of mass, m.
    inertia : ndarray, shape (3, 3)
        About the centre of mass, kg·m².
    bound : dict of str to float
        Half width of the 95 % bound of ``mass``, ``x``, ``y``, ``z``, ``Ixx``, ..., ``Izz``.
    from_log : dict of str to float
        How well the log determines each number, 0 to 1: 1 − its variance ÷ the variance without a log. Without a log,
        the centre and the radius of gyration of a body of this mass are within `USUAL_REACH`.
    error, error_without : float
        Mean NRMSE of the joints with the body, and without it.
    notes : tuple of str
    alarms : tuple of Alarm
        Reasons not to enter these numbers: the logs differ from the model in another way, too.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> body = fr.IdentifiedPayload("tool0", "wrist_3", 2.5, np.array([0, 0, 0.1]), 0.01 * np.eye(3), {}, {}, 0.05, 0.4)
    >>> body.ur()
    'set_target_payload(2.5, [0.0, 0.0, 0.1], [0.01, 0.01, 0.01, 0.0, 0.0, 0.0])'
    """

    frame: str
    carrier: str
    mass: float
    centre: Array
    inertia: Array
    bound: dict[str, float]
    from_log: dict[str, float]
    error: float
    error_without: float
    notes: tuple[str, ...] = ()
    alarms: tuple[Alarm, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "frame": self.frame,
            "carrier": self.carrier,
            "mass": self.mass,
            "center_of_mass": self.centre.tolist(),
            "inertia": self.inertia.tolist(),
            "bound_95": dict(self.bound),
            "from_log": dict(self.from_log),
            "nrmse": self.error,
            "nrmse_without": self.error_without,
            "notes": list(self.notes),
            "alarms": [alarm.to_dict() for alarm in self.alarms],
            "enter": {"franka": self.franka(), "ur": self.ur(), "kuka": self.kuka()},
        }

    @property
    def values(self) -> dict[str, float]:
        """The ten numbers by the names of `bound`."""
        at = self.inertia
        six = (at[0, 0], at[0, 1], at[1, 1], at[0, 2], at[1, 2], at[2, 2])
        return dict(zip(BODY_NUMBERS, map(float, (self.mass, *self.centre, *six)), strict=True))

    def franka(self) -> str:
        """Fields of Franka's ``SetLoad`` (libfranka: ``robot.setLoad``), inertia column by column."""
        fields = {
            "mass": _short(self.mass),
            "center_of_mass": [_short(x) for x in self.centre],
            "load_inertia": [_short(x) for x in self.inertia.T.ravel()],
        }
        return json.dumps(fields)

    def ur(self) -> str:
        """A line of URScript."""
        v = self.values
        six = ", ".join(f"{_short(v[k])}" for k in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))
        centre = ", ".join(f"{_short(x)}" for x in self.centre)
        return f"set_target_payload({_short(self.mass)}, [{centre}], [{six}])"

    def kuka(self) -> str:
        """KUKA's ``LOAD`` in KRL: mm, principal moments, and their axes as A, B, C in degrees."""
        moments, axes = np.linalg.eigh(self.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # at a quarter turn two angles are one, and the third is zero
            a, b, c = Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)
        x, y, z = (_short(1e3 * u) for u in self.centre)
        j = ", ".join(f"{n} {_short(u)}" for n, u in zip("XYZ", moments, strict=True))
        turned = f"A {a:.1f}, B {b:.1f}, C {c:.1f}"
        return f"LOAD_DATA[1] = {{M {_short(self.mass)}, CM {{X {x}, Y {y}, Z {z}, {turned}}}, J {{{j}}}}}"


def _short(x: float) -> float:
    return float(f"{x:.4g}") + 0.0


def payload_of(
    names: tuple[str, str], phi: Array, covariance: Array, errors: tuple[float, float], notes: tuple[str, ...]
) -> IdentifiedPayload:
    """The body with ten standard parameters in the frame of the result.

    Parameters
    ----------
    names : (str, str)
        Frame of the result, and joint of the link that carries the body.
    phi : ndarray, shape (10,)
        Mass, first moments and inertia; the mass is positive.
    covariance : ndarray, shape (10, 10)
    errors : (float, float)
        Mean NRMSE with the body, and without it.
    """
    slope = np.empty((10, 10))
    for k in range(10):
        step = np.zeros(10)
        step[k] = 1e-4 * max(float(np.sqrt(covariance[k, k])), 1e-9)
        slope[:, k] = (_numbers(phi + step) - _numbers(phi - step)) / (2 * step[k])
    spread = np.sqrt(np.diag(slope @ covariance @ slope.T))
    usual = phi[0] * np.array([1.0, *[USUAL_REACH / phi[0]] * 3, *[USUAL_REACH**2] * 6])
    known = np.clip(1 - (spread / usual) ** 2, 0, 1)
    physical, changed = _physical(phi)
    values = _numbers(physical)
    xx, xy, yy, xz, yz, zz = values[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    half = special.ndtri(0.975) * spread
    if values[0] <= half[0]:
        notes = (*notes, "the mass is within its bound of zero: these logs show the body by its centre and inertia")
    if changed:
        notes = (*notes, "the inertia is the nearest that a body can have: the log determines it weakly")
    if open_numbers := [name for name, share in zip(BODY_NUMBERS, known, strict=True) if share < HARDLY_KNOWN]:
        notes = (*notes, _not_measured(open_numbers))
    bound, from_log = (dict(zip(BODY_NUMBERS, map(float, x), strict=True)) for x in (half, known))
    return IdentifiedPayload(*names, float(values[0]), values[1:4], inertia, bound, from_log, *errors, notes)


def _not_measured(names: Sequence[str]) -> str:
    """The sentence on numbers that are in the commands to enter, and that no log has measured."""
    these, them = ("this value is", "it") if len(names) == 1 else ("these values are", "them")
    return (
        f"the log hardly determines {listed(names)}: {these} no measurement. Before you enter {them} into a "
        f"controller, measure or compute {them}, or record a motion that shows more of the body"
    )


def _numbers(phi: Array) -> Array:
    """Mass, centre, and inertia about the centre (Ixx, Ixy, Iyy, Ixz, Iyz, Izz)."""
    P = pseudo_inertia(phi)
    c = P[:3, 3] / P[3, 3]
    P[:3, :3] -= P[3, 3] * np.outer(c, c)
    return np.concatenate([[P[3, 3]], c, dynamic_parameters(P)[4:]])


def _physical(phi: Array) -> tuple[Array, bool]:
    """The nearest body that can exist, with the same mass and centre; and whether it differs."""
    P = pseudo_inertia(phi)
    m, c = P[3, 3], P[:3, 3] / P[3, 3]
    values, axes = np.linalg.eigh(P[:3, :3] - m * np.outer(c, c))
    least = 1e-6 * m
    changed = bool(values[0] < least)
    P[:3, :3] = (axes * np.maximum(values, least)) @ axes.T + m * np.outer(c, c)
    return dynamic_parameters(P), changed
