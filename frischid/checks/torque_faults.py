"""Which simple faults of single torques fit best, for given positions: signs, exchanges, gains, springs.

Given the positions, the faults of torque column j change the error of row j only, or of two rows if two columns are
exchanged. So the best combination follows row by row (`row_fits`): a column is read as it is, with its sign changed, as
a multiple, or less a spring.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from frischid.checks.faults import Fault, cost
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch_motion import COUNTERBALANCE, SPRING, Beside
from frischid.core.types import Array

KNOWN_UNITS = {1e3: "mN·m", 1e-3: "kN·m", 100.0: "N·cm", 0.01: "hundreds of N·m", 1 / 9.81: "kp·m"}
"""Factors of torques that are units."""


@dataclass(frozen=True, eq=False)
class Local:
    """The best faults of single torques: their score, the errors that they leave, (R,), and the corrected torques."""

    score: float
    errors: Array
    faults: tuple[Fault, ...]
    tau: Array
    springs: dict[int, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Reading:
    """One reading of a torque column: score, error, faults, the corrected column and a spring's torque."""

    score: float
    error: float
    faults: tuple[Fault, ...]
    tau: Array
    spring: Array | None = None


def local_fits(fits: RowFits, *, simple: bool = False) -> list[Local]:
    """The best readings of all torque columns: as they are, all reversed, all of one other unit; best first.

    With `simple`, only signs and exchanges are tried.
    """
    R = len(fits.rows)
    found = [_rows(fits, 1.0, (), simple)]
    if R > 1:
        advice = "set torque_sign = -1 for every joint in a mapping file"
        what = "all torques {have|may have} the wrong sign: with the signs changed, the model explains them"
        fix = tuple((n, "torque_sign", -1) for n in fits.names)
        every = Fault("torque sign", what, fits.names, advice, cost(fits.criteria, "all torque signs"), fix=fix)
        found.append(_rows(fits, -1.0, (every,), simple))
        if not simple:
            for c, fault in _common_scales(fits):
                signs = (every,) if c < 0 else ()
                found.append(_rows(fits, 1 / c, (*signs, fault), True))
    return sorted(found, key=lambda x: -x.score)


def _rows(fits: RowFits, factor: float, base: tuple[Fault, ...], simple: bool) -> Local:
    """The best readings of all torque columns, each times a factor."""
    best = [max(_either_sign(fits, k, factor, simple), key=lambda x: x.score) for k in range(len(fits.rows))]
    corrected = factor * fits.sketch.tau
    faults = list(base)
    errors = [x.error for x in best]
    score = sum(x.score for x in best) - sum(f.cost for f in base)
    springs = {}
    free = set(range(len(fits.rows)))
    exchanges = _exchanges(fits, factor, [x.score for x in best])
    for gain, (i, k), exchanged, fault in sorted(exchanges, key=lambda x: -x.gain):
        if gain <= 0 or not {i, k} <= free:
            continue
        score += gain
        faults.append(fault)
        errors[i], errors[k] = exchanged
        corrected[:, [fits.rows[i], fits.rows[k]]] = factor * fits.sketch.tau[:, [fits.rows[k], fits.rows[i]]]
        free -= {i, k}
    for k in sorted(free):
        faults += _with_torque(fits, k, best[k])
        corrected[:, fits.rows[k]] = best[k].tau
        if best[k].spring is not None:
            springs[fits.rows[k]] = np.asarray(best[k].spring)
    return Local(score, np.array(errors), tuple(faults), corrected, springs)


def _with_torque(fits: RowFits, k: int, reading: Reading) -> tuple[Fault, ...]:
    """The faults of a reading of row k; a spring, the last of them, with its torque along the sketch."""
    if reading.spring is None:
        return reading.faults
    torque = np.zeros_like(fits.sketch.tau)
    torque[:, fits.rows[k]] = reading.spring
    return (*reading.faults[:-1], replace(reading.faults[-1], torque=torque))


class Exchange(NamedTuple):
    """Two torque columns exchanged: the score that this gains, the two rows and their errors, the fault."""

    gain: float
    rows: tuple[int, int]
    errors: tuple[float, float]
    fault: Fault


def _exchanges(fits: RowFits, factor: float, scores: list[float]) -> list[Exchange]:
    """Pairs of torque columns that may gain by an exchange."""
    if len(fits.rows) < 2:
        return []
    most = fits.values(fits.least_errors(factor)) - np.array(scores)[:, None]
    promising = np.triu(most + most.T > _price_of_exchange(fits), 1)
    return [_exchange(fits, i, k, factor, scores[i] + scores[k]) for i, k in np.argwhere(promising).tolist()]


def _price_of_exchange(fits: RowFits) -> float:
    R = len(fits.rows)
    return cost(fits.criteria, "swapped torques", R * (R - 1) // 2)


def _exchange(fits: RowFits, i: int, k: int, factor: float, before: float) -> Exchange:
    """The columns of two rows exchanged, against the score of the best readings of both as they are."""
    pair, tau = (fits.names[i], fits.names[k]), fits.sketch.tau
    spread_i, spread_k = abs(factor) * fits.spreads[[i, k], [k, i]]
    errors = (
        fits.error(i, factor * fits.of(i, tau, fits.rows[k]), spread_i),
        fits.error(k, factor * fits.of(k, tau, fits.rows[i]), spread_k),
    )
    fault = Fault(
        "swapped torques",
        "their torques {are|may be} exchanged: the model of each joint explains the torque of the other",
        pair,
        "exchange the two torque columns in the mapping file",
        _price_of_exchange(fits),
        fix=((pair[0], "tau", pair[1]), (pair[1], "tau", pair[0])),
    )
    gain = fits.value(i, errors[0]) + fits.value(k, errors[1]) - fault.cost - before
    return Exchange(gain, (i, k), errors, fault)


def _either_sign(fits: RowFits, k: int, factor: float, simple: bool) -> list[Reading]:
    """Readings of one torque column times a factor: as it is, and with its sign changed."""
    name = fits.names[k]
    sign = Fault(
        "torque sign",
        "the torque {has|may have} the wrong sign: with the sign changed, the model explains the torque",
        (name,),
        "set torque_sign = -1 for it in a mapping file, or check the sign of its current gain",
        cost(fits.criteria, "torque sign", len(fits.rows)),
        fix=((name, "torque_sign", -1),),
    )
    turned = [
        replace(x, score=x.score - sign.cost, faults=(sign, *x.faults)) for x in _readings(fits, k, -factor, simple)
    ]
    return [*_readings(fits, k, factor, simple), *turned]


def _readings(fits: RowFits, k: int, factor: float, simple: bool) -> list[Reading]:
    """Readings of one torque column times a factor, whose sign is right; each row is read once."""
    return fits.once(k, (factor, simple), lambda own: _with_its_sign(own, k, factor, simple))


def _with_its_sign(fits: RowFits, k: int, factor: float, simple: bool) -> list[Reading]:
    """Readings of one torque column times a factor, whose sign is right: as it is, in another unit, with a spring."""
    y, whole = factor * fits.of(k, fits.sketch.tau), factor * fits.sketch.tau[:, fits.rows[k]]
    spread = abs(factor) * float(fits.spreads[k, k])
    error = fits.error(k, y, spread)
    found = [Reading(fits.value(k, error), error, (), whole)]
    if simple or error <= fits.criteria.bad_nrmse:
        return found
    rms, gain = fits.gain(k, y)
    if gain > 0 and _is_far_from_one(gain, fits.criteria.odd_factor) and fits.follows_load(k, y, rms / spread, spread):
        fault = _scale_fault(fits, k, gain)
        score = fits.value(k, rms / spread) - fault.cost
        found.append(Reading(score, rms / spread, (fault,), whole / gain))
    return found + _springs(fits, k, y, whole, spread)


def _scale_fault(fits: RowFits, k: int, gain: float) -> Fault:
    name, n = fits.names[k], float(fits.weight[k])
    what = f"the load in its torque {{is|may be}} {gain:.3g} times that of the URDF, while the friction fits"
    advice = "check its unit and its current gain; without a usable unit leave its torque row out (--torque-joints)"
    price = cost(fits.criteria, "torque scale", len(fits.rows), 1, n)
    return Fault("torque scale", what, (name,), advice, price, False, False)


def _springs(fits: RowFits, k: int, y: Array, whole: Array, spread: float) -> list[Reading]:
    """The torque `whole`, y at the samples of row k, less a spring or a counterbalance of the joint."""
    j, name, n, R = fits.rows[k], fits.names[k], float(fits.weight[k]), len(fits.rows)
    kinds: dict[str, Beside] = {"a spring": SPRING}
    quantity, unit, place = ("force", "N", "position") if fits.sketch.robot.prismatic[j] else ("torque", "N·m", "angle")
    if not fits.sketch.robot.prismatic[j]:
        kinds["a counterbalance"] = COUNTERBALANCE
    found = []
    for numbers, (word, kind) in enumerate(kinds.items(), start=1):
        rms, torque = fits.beside(k, y - fits.nominal[k], kind)
        fault = Fault(
            "spring",
            f"a {quantity} of {np.ptp(torque) / 2:.3g} {unit} (half its range) follows the joint's {place} alone: "
            f"{word} {{acts|may act}} on it",
            (name,),
            "nothing is wrong with the log: identify. Where links of another weight have the same torque, the links "
            "take it up; else frischid diagnose measures the spring, and frischid improve adds it to the model",
            cost(fits.criteria, "spring", R, numbers, n),
            False,
            False,
        )
        found.append(Reading(fits.value(k, rms / spread) - fault.cost, rms / spread, (fault,), whole, torque))
    return found


def _common_scales(fits: RowFits) -> list[tuple[float, Fault]]:
    """One factor for all torques, positive or negative."""
    found = []
    for sign in (1.0, -1.0):
        gains = []
        for k in range(len(fits.rows)):
            y = sign * fits.of(k, fits.sketch.tau)
            rms, gain = fits.gain(k, y)
            if gain > 0 and rms < fits.criteria.heard_share * max(float(y.std()), 1e-300):
                gains.append(gain)
        if len(gains) < 2:
            continue
        common = float(np.median(gains))
        if not _is_far_from_one(common, fits.criteria.odd_factor):
            continue
        exact, unit = next(
            ((f, u) for f, u in KNOWN_UNITS.items() if abs(common / f - 1) < fits.criteria.unit_tolerance), (1.0, "")
        )
        what = f"all torques {{are|may be}} about {common:.3g} times those that the URDF predicts"
        what += f": their unit looks like {unit}" if unit else ""
        advice = "check their unit, whether they are currents, and whether the URDF is of a smaller or larger robot"
        price = cost(fits.criteria, "common scale", 1, 1, float(fits.weight.mean()))
        # a factor beside the unit, and one that is no unit, may be an error of the URDF: it is not undone
        fix = tuple((n, "torque_factor", float(f"{1 / exact:.4g}")) for n in fits.names if unit)
        found.append((sign * common, Fault("torque scale", what, fits.names, advice, price, False, False, fix)))
    return found


def _is_far_from_one(gain: float, factor: float) -> bool:
    """Whether a factor is larger than the errors of masses in URDFs."""
    return abs(float(np.log(gain))) > float(np.log(factor))
