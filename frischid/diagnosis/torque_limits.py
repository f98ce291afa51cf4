"""A torque at its limit: the drive gives no more, or the sensor shows no more. These stretches of time are left out.

With the recorded torque y and that of the model m, both behind the filter, a joint at its limit c has one of two
errors:

    y = clip(m, ±c)     c is recorded, because the drive gives or the sensor shows no more,
    m = clip(y, ±c)     the drive gives c, but the commanded torque is recorded.

Both are zero below the limit and have the slope one beyond; c alone is unknown. A wrong scale or a payload changes the
torque below the limit too, and a push turns other joints as well.

Least squares spreads the error over the whole log. So m first has the robust parameters (`robust_fit`), then those of a
fit without the stretches beyond c; and c is sought again, until the stretches stay the same. With n_j the sensor noise,
a limit is found where

- a joint's error asks for an explanation, and most of its squared error above n_j² lies in the stretches beyond c;
- the clipped curve explains nearly all of that part, although the fit has not seen the stretches;
- in the excursions of the torque that go beyond c, from c/2 up and down again, the clipped curve leaves less error than
  another scale of the torque in each excursion: a load that was dropped or taken during the log is an error of the
  largest torques too, but one that is there before the torque reaches c;
- in one of these stretches at least, no other joint has a burst (`contacts`), as a push would cause; another joint may
  be at its own limit at other times;
- the clipped curve leaves less than half of the error above n_j² that the effects of the catalogue leave together. A
  spring, too, is an error of the largest torques beside a fit to the others.

Source: Tobin 1958, "Estimation of relationships for limited dependent variables", Econometrica 26(1), on observations
that a limit has cut.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.contacts import robust_spread
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.floor import asks_for_explanation
from frischid.diagnosis.robust_fit import robust_parameters
from frischid.diagnosis.stretches import Stretch, in_words, plain, reach_of, wider

_SEARCHES = 8  # of a limit; it usually stays the same after three
_LEVELS = 200  # torques tried as limits, spread evenly over the samples


@dataclass(frozen=True)
class TorqueLimit:
    """A torque at its limit."""

    joint: str
    limit: float
    """N·m (N)."""
    commanded: bool
    """Whether the log holds the commanded torque, which goes beyond the limit."""
    stretches: tuple[Stretch, ...]
    """Log, start and stop, s: where the torque is at its limit."""
    log_starts: Mapping[str, float] = field(default_factory=dict)
    """Log -> its first time stamp, s; none for a recording that is read in pieces."""

    def __str__(self) -> str:
        c, where = f"{self.limit:.3g} N·m (N)", in_words(self.stretches, self.log_starts)
        what = (
            f"the commanded torque is beyond {c}, but the joint moves as with {c}. The drive gives no more, and the "
            "log holds the command"
            if self.commanded
            else f"the torque stays at {c}, and the model needs more. The drive gives no more, or the sensor shows no "
            "more"
        )
        return f"{self.joint}, in {where}: {what}. These stretches are left out of the search"

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        stretches = plain(self.stretches, self.log_starts)
        return {"joint": self.joint, "limit": self.limit, "commanded": self.commanded, "stretches": stretches}


def find_limits(validator: CrossValidator, full: CrossValidator, floor: Array) -> list[TorqueLimit]:
    """Find the joints whose torque is at its limit for a while.

    Parameters
    ----------
    validator, full : CrossValidator
        Without added candidates, and with all effects that entered.
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    """
    criteria, found = validator.criteria, list[TorqueLimit]()
    beside = full.predictive_nrmse()
    asks = asks_for_explanation(beside, floor / validator.spread, validator)
    if not asks.any():
        return found
    unit = np.maximum(floor, criteria.smallest_error * validator.spread)
    theta = robust_parameters(validator, unit)
    for row in np.flatnonzero(asks).tolist():
        most = criteria.half_explained * float((beside[row] * validator.spread[row]) ** 2 - floor[row] ** 2)
        tried = [_limit_of(validator, row, floor, theta, commanded) for commanded in (False, True)]
        best = min((x for x in tried if x is not None), key=lambda x: x[0], default=None)
        found += [] if best is None or best[0] >= most else [best[1]]
    beyond = beyond_limits(validator, found)
    if not beyond or not validator.may_leave_out(beyond):
        return []
    rest = validator.without(beyond)
    unit = np.maximum(unit, robust_spread(rest, rest.theta))
    return [limit for limit in found if not _pushed(validator, limit, rest.theta, unit)]


def beyond_limits(validator: CrossValidator, limits: Sequence[TorqueLimit]) -> list[Stretch]:
    """The stretches as `CrossValidator.without` takes them, as long as the filter spreads them."""
    return wider([x for limit in limits for x in limit.stretches], reach_of(validator.model.lowpass))


def _limit_of(
    validator: CrossValidator, row: int, floor: Array, theta: Array, commanded: bool
) -> tuple[float, TorqueLimit] | None:
    """The mean squared error above the noise that a clipped curve leaves, and its limit; None without one."""
    criteria, margin, name, noise = (
        validator.criteria,
        reach_of(validator.model.lowpass),
        validator.joints[row],
        floor[row] ** 2,
    )
    before: tuple[Stretch, ...] | None = None
    for _ in range(_SEARCHES):
        rows = _Rows.of(validator, row, theta, commanded)
        level = rows.best_level()
        found = TorqueLimit(name, level, commanded, rows.stretches(level, margin))
        error, left = rows.error**2 - noise, rows.left(level) ** 2 - noise
        inside, inside_left = (float(x[rows.size > level].sum()) for x in (error, left))
        unlike = inside_left > (1 - criteria.half_explained) * inside  # other errors cost no further fit
        beyond = beyond_limits(validator, [found])
        if unlike or not beyond or not validator.may_leave_out(beyond):
            return None
        if found.stretches == before:
            break
        before, theta = found.stretches, validator.without(beyond).theta
    held = inside > criteria.half_explained * float(error.sum())
    explained = inside_left < (1 - criteria.nearly_explained) * inside
    if held and explained and not rows.rather_scaled(level, criteria.excursion_share):
        return float(left.mean()), found
    return None


def _pushed(validator: CrossValidator, limit: TorqueLimit, theta: Array, unit: Array) -> bool:
    """Whether another joint has a burst in every stretch at a limit, as a push would cause.

    Under the parameters of a fit without all limits; `unit`, (J,): robust standard deviation of each joint, N·m (N).
    """
    others = [j for j, name in enumerate(validator.joints) if name != limit.joint]
    return all(
        max((_energy(validator, j, stretch, theta) / unit[j] ** 2 for j in others), default=0.0)
        > validator.criteria.burst.energy
        for stretch in beyond_limits(validator, [limit])
    )


def _energy(validator: CrossValidator, row: int, stretch: Stretch, theta: Array) -> float:
    """Mean squared error of a joint within a stretch of time, (N·m)² (N²)."""
    log, start, stop = stretch
    parts = [np.empty(0)]
    for source, data in zip(validator.data.sources, validator.data.motions_of(row), strict=True):
        if source == log:
            t = data.motion.t.read()[data.picked]
            parts.append(validator.columns.residual(data, theta)[(t >= start) & (t <= stop)])
    error = np.concatenate(parts)
    return float(error @ error) / max(len(error), 1)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of a joint under some parameters."""

    error: Array
    """Measured torque less that of the model, N·m (N), (n,)."""
    size: Array
    side: Array
    """`size`, `side`: Absolute value and sign of the torque that a limit would clip, (n,): that of the model, or the
    commanded one."""
    commanded: bool
    times: Sequence[tuple[str, Array, float]]
    """Of each motion: the log, the times of its rows, and the step of the filtered samples, s."""

    @classmethod
    def of(cls, validator: CrossValidator, row: int, theta: Array, commanded: bool) -> _Rows:
        """Rows of one joint, motion by motion."""
        error, clipped, times = list[Array](), list[Array](), list[tuple[str, Array, float]]()
        for source, data in zip(validator.data.sources, validator.data.motions_of(row), strict=True):
            left = validator.columns.residual(data, theta)
            t = data.motion.t.read()
            error.append(left)
            clipped.append(data.measured if commanded else data.measured - left)
            times.append((source, t[data.picked], float(np.median(np.diff(t))) if len(t) > 1 else 0.0))
        torque = np.concatenate(clipped)
        return cls(np.concatenate(error), np.abs(torque), np.sign(torque), commanded, times)

    def left(self, level: float) -> Array:
        """Error of the curve that is clipped at a level, (n,)."""
        excess = self.side * np.maximum(self.size - level, 0.0)
        return self.error - excess if self.commanded else self.error + excess

    def best_level(self) -> float:
        """The level that explains most error."""
        levels = np.quantile(self.size, np.linspace(0.0, 1.0, _LEVELS))
        return float(min(levels, key=lambda level: float((self.left(float(level)) ** 2).sum())))

    def rather_scaled(self, level: float, begin: float) -> bool:
        """Whether a scale of the torque in each excursion beyond a level leaves less error than the clipped curve.

        An excursion begins at a share `begin` of the level.
        """
        clipped, scaled, left, passed = 0.0, 0.0, self.left(level), 0
        for _, t, _ in self.times:
            here = np.arange(passed, passed + len(t))
            passed += len(t)
            kind = np.where(self.size[here] > begin * level, self.side[here], 0.0)
            for run in np.split(here, np.flatnonzero(np.diff(kind)) + 1):
                x, e = self.size[run], self.side[run] * self.error[run]
                if len(run) and x.min() > begin * level and x.max() > level:
                    clipped += float(left[run] @ left[run])
                    scaled += float(e @ e - (x @ e) ** 2 / (x @ x))
        return scaled < clipped

    def stretches(self, level: float, margin: float) -> tuple[Stretch, ...]:
        """Stretches beyond a level; those whose margins meet are one."""
        found, passed = list[Stretch](), 0
        for source, t, step in self.times:
            at = t[self.size[passed : passed + len(t)] > level]
            passed += len(t)
            cuts = np.flatnonzero(np.diff(at) > max(2 * margin, 1.5 * step)) + 1
            found += [(source, float(x[0]), float(x[-1])) for x in np.split(at, cuts) if len(x)]
        return tuple(found)
