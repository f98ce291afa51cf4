"""Faults of positions: turned, exchanged and shifted joints, degrees. Each gives another rigid torque.

The nominal torque with joint j's zero shifted by δ needs no search: inertias turn with a joint, so they contain the
sine and the cosine of δ at most squared,

    τ(q + δ e_j) = a₀ + a₁ cos δ + b₁ sin δ + a₂ cos 2δ + b₂ sin 2δ,

and five values of δ give the torque for all others exactly. Joints that mimic joint j turn by another angle than δ, so
the torque of each δ is then computed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from frischid.checks.check_criteria import CheckCriteria
from frischid.checks.faults import Fault, Fix, cost
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.core.types import Array

JOINT_ZERO = "joint zero"
"""Kind of fault: the angle of a joint has another zero than the URDF's."""
GRID_DEGREES = 10.0
"""Degrees between the zeros that are tried first; the best is refined."""


@dataclass(frozen=True)
class Moved:
    """A sketch with other positions, and the fault that this undoes."""

    sketch: Sketch
    fault: Fault


def position_faults(sketch: Sketch) -> Iterator[Moved]:
    """The sketch with one fault of the positions undone, for every such fault."""
    robot = sketch.robot
    yield from _signs_and_exchanges(sketch)
    for turning in np.flatnonzero(~robot.prismatic):
        yield from _zeros(sketch, int(turning))
    # within one turn each way: as degrees, the joint would hardly have moved
    far = (np.abs(sketch.q) > 2 * np.pi).any(axis=0) & ~robot.prismatic
    if far.any():
        yield from degree_faults(sketch, far)


def degree_faults(sketch: Sketch, joints: NDArray[np.bool_]) -> Iterator[Moved]:
    """The sketch with some joints, (J,), read in degrees, and with all joints read so: the unit of a file is of all."""
    robot, usual = sketch.robot, "the positions {are|may be} in degrees: in radians the model explains the torques"
    turning, names = ~robot.prismatic, np.array(robot.joints, dtype=object)
    if not (joints == turning).all():
        where = tuple(names[joints])
        what = usual if len(where) > 1 else usual.replace("the positions", "its positions", 1)
        advice = f'set angle_unit = "deg" for {"these joints" if len(where) > 1 else "it"} in a mapping file'
        fix: tuple[Fix, ...] = tuple((name, "angle_unit", "deg") for name in where)
        fault = Fault("degrees", what, where, advice, cost(sketch.criteria, "degrees", len(names)), fix=fix)
        yield Moved(moved(sketch, np.where(joints, np.deg2rad(1.0), 1.0), None), fault)
    sliding = tuple(names[~turning])
    advice = 'set angle_unit = "deg" under [file] in a mapping file'
    advice += f', and angle_unit = "m" for {", ".join(sliding)}, unless it has a unit there' if sliding else ""
    fix = (("", "angle_unit", "deg"), *((name, "angle_unit", "m") for name in sliding))
    fault = Fault("degrees", usual, tuple(names[turning]), advice, cost(sketch.criteria, "degrees"), fix=fix)
    yield Moved(moved(sketch, np.where(turning, np.deg2rad(1.0), 1.0), None), fault)


def _signs_and_exchanges(sketch: Sketch) -> Iterator[Moved]:
    robot, J = sketch.robot, len(sketch.robot.joints)
    for j in range(J):
        turn = np.where(np.arange(J) == j, -1.0, 1.0)
        what = "its positions {have|may have} the wrong sign: with it changed, the model fits"
        advice = "set sign = -1 and torque_sign = -1 for it in a mapping file"
        fix: tuple[Fix, ...] = ((robot.joints[j], "sign", -1), (robot.joints[j], "torque_sign", -1))
        price = cost(sketch.criteria, "position sign", J)
        yield Moved(moved(sketch, turn, None), Fault("position sign", what, (robot.joints[j],), advice, price, fix=fix))
    for i, j in combinations(range(J), 2):
        order = np.arange(J)
        order[[i, j]] = j, i
        pair = (robot.joints[i], robot.joints[j])
        what = "their positions {are|may be} exchanged: with the columns exchanged back, the model explains the torques"
        fix = tuple((a, c, b) for a, b in (pair, pair[::-1]) for c in ("q", "v", "a"))
        price = cost(sketch.criteria, "swapped positions", J * (J - 1) // 2)
        advice = "exchange the columns in the mapping file"
        yield Moved(moved(sketch, None, order), Fault("swapped positions", what, pair, advice, price, fix=fix))


def joint_faults(sketch: Sketch) -> Iterator[Moved]:
    """The sketch with one fault of positions and torques together undone: an axis reversed, two joints exchanged."""
    rows = [int(j) for j in sketch.rows]
    for item in _signs_and_exchanges(sketch):
        at = [sketch.robot.joints.index(name) for name in item.fault.where]
        if set(at) <= set(rows):
            tau = sketch.tau.copy()
            tau[:, at] = -tau[:, at] if len(at) == 1 else tau[:, at[::-1]]
            yield Moved(replace(item.sketch, tau=tau), with_torques(item.fault, len(rows), sketch.criteria))


def with_torques(fault: Fault, rows: int, criteria: CheckCriteria) -> Fault:
    """The fault of positions and torques together that begins as this fault of positions.

    Parameters
    ----------
    fault : Fault
        "position sign" or "swapped positions".
    rows : int
        Number of joints whose torque is judged.
    """
    what = fault.what.replace("its positions", "its positions and torques", 1)
    what = what.replace("their positions", "their positions and torques", 1)
    if fault.kind == "position sign":
        fix = tuple(f for f in fault.fix if f[1] == "sign")
        price = cost(criteria, "position sign", rows)
        return replace(fault, what=what, cost=price, fix=fix, advice=fault.advice.replace(" and torque_sign = -1", ""))
    one, other = fault.where
    price = cost(criteria, "swapped joints", rows * (rows - 1) // 2)
    fix = (*fault.fix, (one, "tau", other), (other, "tau", one))
    return replace(fault, kind="swapped joints", what=what, cost=price, fix=fix)


def merged(faults: Sequence[Fault], joints: int, criteria: CheckCriteria) -> tuple[tuple[Fault, ...], float]:
    """Faults of a joint's positions and torques together are one fault; and the cost that this saves."""
    left, refund = _one_sign_each(faults), 0.0
    for kind, partner in (("position sign", "torque sign"), ("swapped positions", "swapped torques")):
        for one in [f for f in left if f.kind == kind]:
            other = next((f for f in left if f.kind == partner and set(f.where) == set(one.where)), None)
            if other is None:
                continue
            both = with_torques(one, joints, criteria)
            refund += one.cost + other.cost - both.cost
            left = [both if f is one else f for f in left if f is not other]
    return tuple(left), refund


def _one_sign_each(faults: Sequence[Fault]) -> list[Fault]:
    """All torques reversed, and some reversed once more: the others are reversed."""
    signs = [f for f in faults if f.kind == "torque sign"]
    every = next((f for f in signs if len(f.where) > 1), None)
    again = {name for f in signs if f is not every for name in f.where}
    if every is None or not again:
        return list(faults)
    where = tuple(name for name in every.where if name not in again)
    advice = "set torque_sign = -1 for these joints in a mapping file"
    what = "these torques {have|may have} the wrong sign: with the signs changed, the model explains them"
    fix = tuple((name, "torque_sign", -1) for name in where)
    price = sum(f.cost for f in signs)
    rest = [f for f in faults if f.kind != "torque sign"]
    return [replace(every, what=what, where=where, advice=advice, fix=fix, cost=price), *rest]


def moved(sketch: Sketch, factor: Array | None, order: NDArray[np.intp] | None) -> Sketch:
    """The sketch with motions scaled and reordered."""
    J = sketch.q.shape[1]
    take = np.arange(J) if order is None else order
    by = np.ones(J) if factor is None else factor
    changes = {name: getattr(sketch, name)[:, take] * by for name in ("q", "v", "a")}
    changes |= {"sign": sketch.sign[:, take] * np.sign(by), "used": sketch.used[:, take]}
    return sketch.moving(**changes)


class _Shifted:
    """A sketch with the zero of joint j shifted.

    The torque is a sum of `_waves` of the shift: five shifts give it at all. Of a joint that others mimic it is not.
    """

    def __init__(self, sketch: Sketch, j: int) -> None:
        robot = sketch.robot
        self.sketch, self.unit, self.fits = sketch, np.eye(len(robot.joints))[j], RowFits(sketch)
        self._reading = [self.fits.of(k, sketch.tau) for k in range(len(self.fits.rows))]
        self._spread = [max(float(y.std()), 1e-12) for y in self._reading]
        angles = 2 * np.pi * np.arange(5) / 5
        self._leads = robot.joints[j] in {rule.leader for rule in robot.mimics.values()}
        self._torques = np.array([] if self._leads else [self._exact(delta) for delta in angles])
        self._inverse = np.linalg.inv(_waves(angles))
        self._fixed = (self._torques == self._torques[:1]).all(axis=(0, 1)) if len(self._torques) else None

    def _exact(self, delta: float) -> Array:
        sketch = self.sketch
        return sketch.robot.inverse_dynamics(sketch.q + delta * self.unit, sketch.v, sketch.a)

    def nominal(self, delta: float) -> Array:
        """Torque of the URDF's links."""
        if self._leads:
            return self._exact(delta)
        torque = np.asarray(np.tensordot((_waves(np.array([delta])) @ self._inverse)[0], self._torques, axes=1))
        torque[:, self._fixed] = self._torques[0][:, self._fixed]  # to the last digit: joints of another limb
        return torque

    def value(self, delta: float) -> float:
        """How well the shifted robot explains the torques, with the better sign of each."""
        fits, torque, score = self.fits, self.nominal(delta), 0.0
        fits.nominal = [torque[use, i] for use, i in zip(fits.uses, fits.rows, strict=True)]
        for k, (y, spread) in enumerate(zip(self._reading, self._spread, strict=True)):
            score += fits.value(k, min(fits.error(k, y, spread), fits.error(k, -y, spread)))
        return score

    def sketch_at(self, delta: float) -> Sketch:
        """The shifted sketch."""
        moved = self.sketch.moving(q=self.sketch.q + delta * self.unit)
        return replace(moved, given_nominal=self.nominal(delta))


def _zeros(sketch: Sketch, j: int) -> Iterator[Moved]:
    """The zero of joint j shifted by the best multiple of 90° and by the best other angle."""
    J, name, shifted = len(sketch.robot.joints), sketch.robot.joints[j], _Shifted(sketch, j)
    right = max((np.pi / 2, np.pi, -np.pi / 2), key=shifted.value)
    grid = np.deg2rad(np.arange(GRID_DEGREES, 360, GRID_DEGREES))
    free = float(grid[int(np.argmax([shifted.value(x) for x in grid]))])
    for step in (4.0, 1.0, 0.3):
        free = max((free + np.deg2rad(step) * k for k in range(-3, 4)), key=shifted.value)
    n = float(shifted.fits.weight.mean())
    for delta, choices, fitted in ((right, 3 * J, 0), (free, J, 2)):
        delta = (delta + np.pi) % (2 * np.pi) - np.pi
        if abs(delta) < np.deg2rad(1.0):
            continue
        said = f"{np.rad2deg(delta):.3g}°"
        fault = Fault(
            JOINT_ZERO,
            f"the zero of its angle {{is|may be}} off by {said}: with {said} added, the model explains the torques",
            (name,),
            f"set offset = {delta:.6g} for it in a mapping file, or correct the joint's origin in the URDF",
            cost(sketch.criteria, JOINT_ZERO, choices, fitted, n),
            discrete=fitted == 0,
            fix=((name, "offset", float(f"{delta:.6g}")),),
        )
        yield Moved(shifted.sketch_at(delta), fault)


def _waves(delta: Array) -> Array:
    """Constant, sines and cosines of the angles and of twice the angles, (K, 5)."""
    one = np.ones_like(delta)
    return np.column_stack([one, np.cos(delta), np.sin(delta), np.cos(2 * delta), np.sin(2 * delta)])
