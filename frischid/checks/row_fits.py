"""Which simple faults of single torques fit best, for given positions: signs, exchanges, gains, springs.

Given the positions, the faults of torque column j change the error of row j only, or of two rows if two columns are
exchanged. So the best combination follows row by row. Each row is fitted with friction, rotor inertia and offset,

    y_j ≈ τ_nominal,j + fv v + fc sign v + Ia a + off,      fv, fc, Ia ≥ 0,

where y_j is the torque, the torque with its sign changed, a multiple of the torque, or the torque less a spring.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from frischid.checks.faults import Fault, cost
from frischid.checks.sketch import Sketch
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


class RowFits:
    """Fits of single rows of a sketch."""

    def __init__(self, sketch: Sketch) -> None:
        self.sketch, self.criteria = sketch, sketch.criteria
        self.names, self.rows = sketch.names, [int(j) for j in sketch.rows]
        step = float(np.median(np.diff(sketch.t))) if len(sketch) > 1 else 1.0
        seconds = step * np.array([sketch.used[:, j].sum() for j in self.rows])
        self.weight = np.minimum(seconds / self.criteria.independent_time, self.criteria.most_independent)
        self.uses = [sketch.motion.uses(j) for j in self.rows]
        self.nominal = [sketch.nominal[use, j] for use, j in zip(self.uses, self.rows, strict=True)]

    def of(self, k: int, tau: Array, j: int | None = None) -> Array:
        """Samples of a torque column that row k uses."""
        return np.asarray(tau[self.uses[k], self.rows[k] if j is None else j])

    def error(self, k: int, y: Array, spread: float) -> float:
        """NRMSE of row k with the torque y."""
        return self.sketch.motion.fit(self.rows[k]).solve(y - self.nominal[k])[0] / spread

    def beside(self, k: int, y: Array, beside: Beside) -> tuple[float, Array]:
        """RMS of y after the friction of row k and further columns of either sign, and their torque (M,)."""
        motion, j = self.sketch.motion, self.rows[k]
        rms, x = motion.fit(j, beside).solve(y)
        X = motion.columns(j, beside)
        x = x[-2 * X.shape[1] :].reshape(2, -1)
        return rms, X @ (x[0] - x[1])

    def gain(self, k: int, y: Array) -> tuple[float, float]:
        """RMS of y after a multiple ≥ 0 of the nominal torque and friction, and the multiple."""
        A = np.column_stack([self.nominal[k], self.sketch.motion.friction(self.rows[k])[self.uses[k]]])
        x, norm = nnls(A, y)
        return float(norm / np.sqrt(len(y))), float(x[0])

    def value(self, k: int, error: float) -> float:
        """Log-likelihood of row k; below the error that URDFs have anyway, less error is worth nothing."""
        floor = self.criteria.urdf_error
        capped = min(error, self.criteria.nrmse_cap)
        return float(-0.5 * self.weight[k] * np.log(capped**2 + floor**2))

    def total(self, errors: Array) -> float:
        """Log-likelihood of all rows."""
        return sum(self.value(k, float(e)) for k, e in enumerate(errors))


@dataclass(frozen=True, eq=False)
class Option:
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
    sketch, R = fits.sketch, len(fits.rows)
    found = [_rows(fits, sketch.tau, (), simple)]
    if R > 1:
        advice = "set torque_sign = -1 for every joint in a mapping file"
        what = "all torques {have|may have} the wrong sign: with the signs changed, the model explains them"
        fix = tuple((n, "torque_sign", -1) for n in fits.names)
        every = Fault("torque sign", what, fits.names, advice, cost(fits.criteria, "all torque signs"), fix=fix)
        found.append(_rows(fits, -sketch.tau, (every,), simple))
        if not simple:
            for c, fault in _common_scales(fits):
                signs = (every,) if c < 0 else ()
                found.append(_rows(fits, sketch.tau / c, (*signs, fault), True))
    return sorted(found, key=lambda x: -x.score)


def _rows(fits: RowFits, tau: Array, base: tuple[Fault, ...], simple: bool) -> Local:
    R = len(fits.rows)
    spreads = [max(float(fits.of(k, tau).std()), 1e-12) for k in range(R)]
    best = [max(_options(fits, k, tau, spreads[k], simple), key=lambda x: x.score) for k in range(R)]
    corrected = tau.copy()
    faults = list(base)
    errors = [x.error for x in best]
    score = sum(x.score for x in best) - sum(f.cost for f in base)
    springs = {}
    free = set(range(R))
    while len(free) > 1:
        pairs = [(_exchange(fits, i, k, tau), i, k) for i, k in combinations(sorted(free), 2)]
        gains = [(x.score - best[i].score - best[k].score, n) for n, (x, i, k) in enumerate(pairs)]
        gain, n = max(gains)
        if gain <= 0:
            break
        x, i, k = pairs[n]
        score += gain
        faults += x.faults
        errors[i], errors[k] = x.tau
        corrected[:, [fits.rows[i], fits.rows[k]]] = tau[:, [fits.rows[k], fits.rows[i]]]
        free -= {i, k}
    for k in sorted(free):
        faults += best[k].faults
        corrected[:, fits.rows[k]] = best[k].tau
        if best[k].spring is not None:
            springs[fits.rows[k]] = np.asarray(best[k].spring)
    return Local(score, np.array(errors), tuple(faults), corrected, springs)


def _exchange(fits: RowFits, i: int, k: int, tau: Array) -> Option:
    """Two torque columns exchanged; the option's `tau` holds the two errors."""
    pair = (fits.names[i], fits.names[k])
    one, other = fits.of(i, tau, fits.rows[k]), fits.of(k, tau, fits.rows[i])
    errors = fits.error(i, one, max(float(one.std()), 1e-12)), fits.error(k, other, max(float(other.std()), 1e-12))
    R = len(fits.rows)
    fault = Fault(
        "swapped torques",
        "their torques {are|may be} exchanged: the model of each joint explains the torque of the other",
        pair,
        "exchange the two torque columns in the mapping file",
        cost(fits.criteria, "swapped torques", R * (R - 1) // 2),
        fix=((pair[0], "tau", pair[1]), (pair[1], "tau", pair[0])),
    )
    score = fits.value(i, errors[0]) + fits.value(k, errors[1]) - fault.cost
    return Option(score, max(errors), (fault,), np.array(errors))


def _options(fits: RowFits, k: int, tau: Array, spread: float, simple: bool) -> list[Option]:
    """Readings of one torque column."""
    j, name, R = fits.rows[k], fits.names[k], len(fits.rows)
    y, whole = fits.of(k, tau), tau[:, j]
    sign = Fault(
        "torque sign",
        "the torque {has|may have} the wrong sign: with the sign changed, the model explains the torque",
        (name,),
        "set torque_sign = -1 for it in a mapping file, or check the sign of its current gain",
        cost(fits.criteria, "torque sign", R),
        fix=((name, "torque_sign", -1),),
    )
    found = []
    for factor, faults in ((1.0, ()), (-1.0, (sign,))):
        paid = sum(f.cost for f in faults)
        error = fits.error(k, factor * y, spread)
        found.append(Option(fits.value(k, error) - paid, error, faults, factor * whole))
        if simple or error <= fits.criteria.bad_nrmse:
            continue
        rms, gain = fits.gain(k, factor * y)
        if gain > 1e-6 and _is_far_from_one(gain, fits.criteria.odd_factor):
            fault = _scale_fault(fits, k, gain)
            score = fits.value(k, rms / spread) - paid - fault.cost
            found.append(Option(score, rms / spread, (*faults, fault), factor * whole / gain))
        found += _springs(fits, k, factor * tau, spread, faults)
    return found


def _scale_fault(fits: RowFits, k: int, gain: float) -> Fault:
    name, n = fits.names[k], float(fits.weight[k])
    what = f"the load in its torque {{is|may be}} {gain:.3g} times that of the URDF, while the friction fits"
    advice = "check its unit and its current gain; without a usable unit leave its torque row out (--torque-joints)"
    price = cost(fits.criteria, "torque scale", len(fits.rows), 1, n)
    return Fault("torque scale", what, (name,), advice, price, False, False)


def _springs(fits: RowFits, k: int, tau: Array, spread: float, faults: tuple[Fault, ...]) -> list[Option]:
    """The torque less a spring or a counterbalance of the joint."""
    j, name, n, R = fits.rows[k], fits.names[k], float(fits.weight[k]), len(fits.rows)
    y, whole = fits.of(k, tau), tau[:, j]
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
            torque=torque[:, None] * np.eye(fits.sketch.tau.shape[1])[j],
        )
        score = fits.value(k, rms / spread) - fault.cost - sum(f.cost for f in faults)
        found.append(Option(score, rms / spread, (*faults, fault), whole, torque))
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
