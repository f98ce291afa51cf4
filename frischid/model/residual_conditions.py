"""Where a model fails: its error under each condition of the motion, against its average, joint by joint.

A condition is a set of samples (near a reversal, fast, high load, ...). Its ratio is rms(residual inside) /
rms(residual everywhere). Residuals are correlated, so the significance comes from blocks of about a second: Welch's
one-sided t test compares the mean squared residuals of blocks inside and outside. Chatterjee's ξ (2021, JASA 116(536))
tests whether the residual depends on a variable at all, on samples one correlation time apart. A residual counts as
white if its correlation time is that of filtered white noise.

Where a model fails is judged on samples in bounded memory: stretches that are spread evenly over all logs. The errors
themselves are sums over all samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.estimators.autocorrelation import correlation_time
from frischid.estimators.p_values import depends, mean_above
from frischid.model.comparison_criteria import COMPARISON_CRITERIA as CRITERIA
from frischid.model.model import Model
from frischid.regression.block import COLUMNS_BESIDE_Y, Block

Flags = NDArray[np.bool_]

CONDITION_ORDER = (
    "near reversal", "slow", "fast", "forwards", "backwards", "low angles", "middle angles", "high angles",
    "high load", "high acceleration", "beginning", "end",
)  # fmt: skip
"""Conditions in the order in which pages and figures show them."""


@dataclass(frozen=True)
class Condition:
    """Error of a joint under one condition."""

    joint: str
    condition: str
    ratio: float
    """Rms residual inside over the joint's rms residual."""
    rmse: float
    """Rms residual inside, N·m (N)."""
    samples: int
    p_value: float
    """Probability of so large a ratio by chance."""


@dataclass(frozen=True)
class Structure:
    """Structure of a joint's residual error."""

    correlation_time: float
    """Correlation time of the residual, s."""
    white_time: float
    """Correlation time of white noise after the filter, s."""
    depends_on: Mapping[str, float]
    """Variable -> p value of independence (Chatterjee's ξ)."""

    @property
    def white(self) -> bool:
        """Whether the residual is hardly more correlated than filtered white noise."""
        return self.correlation_time < CRITERIA.white_ratio * self.white_time


class Residuals:
    """Residuals of a model over some logs, with the motion of their samples.

    Parameters
    ----------
    blocks : sequence of (Block, ndarray)
        Filtered samples and the torque the model fits to them, as `Model.blocks` gives.
    """

    def __init__(self, model: Model, blocks: Sequence[tuple[Block, Array]]) -> None:
        index = model.torque_index
        self.joints = model.joints
        self.t = np.concatenate([b.t for b, _ in blocks])
        self.q, self.v, self.a = (
            np.concatenate([getattr(b, name)[:, index] for b, _ in blocks]) for name in ("q", "v", "a")
        )
        self.used = np.concatenate([b.used[:, index] for b, _ in blocks])
        self.fitted = np.concatenate([f[:, index] for _, f in blocks])
        self.residual = np.concatenate([b.tau[:, index] for b, _ in blocks]) - self.fitted
        numbers = {name: k for k, name in enumerate(sorted({b.source for b, _ in blocks}))}
        self.source = np.repeat([numbers[b.source] for b, _ in blocks], [len(b.t) for b, _ in blocks])
        steps = np.diff(self.t)
        steps = steps[steps > 0]  # a log may begin before the one before it ended
        self.step = float(np.median(steps)) if len(steps) else 1.0
        self.white_time = _filter_time(model, self.step)

    def conditions(self) -> list[Condition]:
        """Every joint under every condition, worst first."""
        found = [c for j in range(len(self.joints)) for c in self._joint(j)]
        return sorted(found, key=lambda c: -c.ratio)

    def _joint(self, j: int) -> Iterator[Condition]:
        used = self.used[:, j]
        rms = float(np.sqrt(np.mean(self.residual[used, j] ** 2)))
        block = self._blocks()
        for name, inside in self._masks(j).items():
            inside = inside & used
            outside = used & ~inside
            if min(inside.sum(), outside.sum()) < CRITERIA.condition_samples or rms == 0:
                continue
            squared = self.residual[:, j] ** 2
            p = _welch(*(_means(squared[m], block[m]) for m in (inside, outside)))
            local = float(np.sqrt(squared[inside].mean()))
            yield Condition(self.joints[j], name, local / rms, local, int(inside.sum()), p)

    def _blocks(self) -> NDArray[np.intp]:
        seconds = np.floor((self.t - self.t.min()) / max(1.0, 5 * self.white_time)).astype(int)
        return np.asarray(seconds + self.source * (int(seconds.max()) + 1))

    def _masks(self, j: int) -> dict[str, Flags]:
        q, v, a, load = self.q[:, j], self.v[:, j], self.a[:, j], np.abs(self.fitted[:, j])
        used = self.used[:, j]
        low, high = np.quantile(np.abs(v[used]), [CRITERIA.quarter, 1 - CRITERIA.quarter]) if used.any() else (0.0, 0.0)
        thirds = np.quantile(q[used], [1 / 3, 2 / 3]) if used.any() else (0.0, 0.0)
        start = np.array([self.t[self.source == s].min() for s in range(self.source.max() + 1)])[self.source]
        length = np.array([np.ptp(self.t[self.source == s]) for s in range(self.source.max() + 1)])[self.source]
        share = (self.t - start) / np.maximum(length, 1e-9)
        strong = np.quantile(load[used], 1 - CRITERIA.quarter) if used.any() else 0.0
        brisk = np.quantile(np.abs(a[used]), 1 - CRITERIA.quarter) if used.any() else 0.0
        return {
            "near reversal": self._near_reversal(v),
            "slow": np.abs(v) <= low,
            "fast": np.abs(v) >= high,
            "forwards": v > 0,
            "backwards": v < 0,
            "low angles": q <= thirds[0],
            "middle angles": (q > thirds[0]) & (q < thirds[1]),
            "high angles": q >= thirds[1],
            "high load": load >= strong,
            "high acceleration": np.abs(a) >= brisk,
            "beginning": share < CRITERIA.beginning,
            "end": share > 1 - CRITERIA.beginning,
        }

    def _near_reversal(self, v: Array) -> Flags:
        """Samples near a reversal, by time: logs may have other rates, and one ends where no other begins."""
        near = np.zeros(len(v), bool)
        for part in (np.flatnonzero(self.source == number) for number in np.unique(self.source)):
            t, changes = self.t[part], np.flatnonzero(np.diff(np.sign(v[part])) != 0)
            middle, reach = (t[changes] + t[changes + 1]) / 2, np.maximum(CRITERIA.reversal_seconds, self.step)
            for first, last in zip(np.searchsorted(t, middle - reach), np.searchsorted(t, middle + reach), strict=True):
                near[part[first:last]] = True
        return near

    def structure(self) -> dict[str, Structure]:
        """Correlation and dependence of every joint's residual."""
        return {name: self._structure(j) for j, name in enumerate(self.joints)}

    def _structure(self, j: int) -> Structure:
        used = self.used[:, j]
        r = self.residual[used, j]
        time = correlation_time(r) * self.step
        thin = slice(None, None, max(1, round(time / self.step)))
        variables = {"q": self.q, "v": self.v, "a": self.a, "load": self.fitted}
        p = {}
        for name, x in variables.items():
            x_thin, r_thin = x[used, j][thin], r[thin]
            enough = len(r_thin) >= CRITERIA.dependence_samples and np.ptp(x_thin) > 0 and np.ptp(r_thin) > 0
            p[name] = depends(x_thin, r_thin) if enough else 1.0
        return Structure(time, self.white_time, p)

    def to_dict(self) -> list[dict[str, Any]]:
        """Conditions as plain JSON values."""
        return [vars(c) for c in self.conditions()]


def _filter_time(model: Model, step: float) -> float:
    """Correlation time of white noise after the filter and decimation, s."""
    if model.lowpass.cutoff is None:
        return step
    fine = step / 8
    taps = model.lowpass.taps(fine)
    rho = np.correlate(taps, taps, "full")[len(taps) - 1 :][::8]
    rho = rho / rho[0]
    below = np.flatnonzero(rho <= 0.05)
    stop = int(below[0]) if len(below) else len(rho)
    return float(step * max(1.0, 1 + 2 * rho[1:stop].sum()))


def _means(x: Array, block: NDArray[np.intp]) -> Array:
    _, where = np.unique(block, return_inverse=True)
    return np.asarray(np.bincount(where, x) / np.bincount(where))


def _welch(inside: Array, outside: Array) -> float:
    if min(len(inside), len(outside)) < 3 or not (inside.std() > 0 and outside.std() > 0):
        return 1.0
    return mean_above(inside, outside)


CONSECUTIVE_SAMPLES = 1000  # filtered samples kept or left out together, so that residuals stay consecutive
SAMPLES_KEPT = 60_000  # filtered samples in memory: an hour of motion at usual cut-offs, 20 MB for a six-joint arm


class SampledBlocks:
    """Blocks in memory, in stretches spread evenly over the logs: all of them, or every second, fourth, ... stretch.

    Where a model fails is judged on at most `SAMPLES_KEPT` samples; the errors themselves are sums over all.

    Parameters
    ----------
    limit : int
        Samples in memory at most, but never less than one stretch.
    """

    def __init__(self, limit: int = SAMPLES_KEPT) -> None:
        self.limit = limit
        self.stretches: list[list[tuple[Block, Array]]] = []
        self.every, self.number, self.samples, self.length = 1, -1, 0, CONSECUTIVE_SAMPLES

    @property
    def blocks(self) -> list[tuple[Block, Array]]:
        """The blocks in memory, in order."""
        return [pair for stretch in self.stretches for pair in stretch]

    def add(self, block: Block, fitted: Array) -> None:
        """Keep the next block, or leave it out."""
        if self.length >= CONSECUTIVE_SAMPLES:
            self.number, self.length = self.number + 1, 0
            if self.number % self.every == 0:
                self.stretches.append([])
        self.length += len(block.t)
        if self.number % self.every:
            return
        # Only the parts that residuals need, as copies: columns are most of a block, and views keep whole motions.
        self.stretches[-1].append((replace(block, t=block.t.copy(), Z=block.Z[:, -COLUMNS_BESIDE_Y:].copy()), fitted))
        self.samples += len(block.t)
        if self.samples > self.limit:
            self.stretches, self.every = self.stretches[::2], 2 * self.every
            self.samples = sum(len(b.t) for b, _ in self.blocks)
