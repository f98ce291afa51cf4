"""The bounding-box recursion (BBRF): every stretch of the log bounds the parameters; the bounds intersect.

A window of w rows of the stacked matrix E = [Y τ] has its own moments Σ_k = EᵀE / w and, by the Frisch
scheme (`frischid.estimators.frisch`), its own p + 1 vertices. The true parameters do not change from window to window,
so they lie in all of the boxes around those vertices (Massaroli et al., *Frisch Scheme Identification of
Robots Dynamic Parameters*, Algorithm 1):

    l ← max(l, min_j θ_ij(Σ_k)),     u ← min(u, max_j θ_ij(Σ_k)),     k = 0, 1, …

This holds for exact moments. A window is a finite sample, so its vertices have errors of O(1/√w), and the maximum over
thousands of windows collects the worst of these errors. On long logs the bounds cross, or shrink to a wrong value. So
there are three variants.

``strict``
    Algorithm 1 as published. It stops at the first window that empties the box.
``undo``
    A window that would empty the box is left out altogether and the recursion goes on, as in the authors'
    code.
``calibrated``
    Each vertex is first widened by its sampling error, so that *all* windows' boxes contain their
    population's box at once with the stated confidence. With K = Σ⁻¹ and y = K x, row x moves vertex j by
    its influence function

        IF_ij(x) = y_j (y_i + θ_ij y_L) / K_Lj,      var θ_ij ≈ E[IF_ij²] / w_effective.

    Neighbouring rows are correlated, so w rows count as fewer than w. The variance is computed from the sums of IF
    over blocks of `correlation` rows (batch means), which are ``K G_b K`` of the blocks' moments G_b. The
    bounds move by t_{B−1}(1 − α / (2 p n)) standard errors, Bonferroni over n windows, p parameters and two
    sides, for B blocks per window. No correction for the p + 1 vertices is needed: the bound can fail only where the
    population's extreme vertex does. If the denominator K_Lj of a vertex is zero within its error, the vertex may lie
    anywhere, and its window gives no bound.

One limitation holds for every variant: the boxes bound the truth only when the vertices share an orthant (Theorem 1).
`Recursion.same_orthant` counts the windows whose vertices do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import special

from frischid.core.types import Array, Sign
from frischid.errors import EmptyBoxError, IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.bbrf_windows import Extents, calibrated_extents, correlation_length, sample_extents
from frischid.estimators.frisch import Box

Variant = Literal["strict", "undo", "calibrated"]

HISTORY = 2000
"""Most rows kept of the bounds' history; longer recursions keep every second, third, … window."""


@dataclass(frozen=True)
class Calibration:
    """How far the calibrated variant widens the vertices.

    Raises
    ------
    InputError
        The confidence is not between 0 and 1.
    """

    confidence: float = 0.95
    """Joint confidence of all the bounds."""
    correlation: int | None = None
    """Length in rows of the blocks that count as independent. By default twice the lag at which the autocorrelation of
    the slowest regression residual vanishes, but between 1/64 and 1/8 of a window, so that 8 to 64 blocks show their
    scatter."""

    def __post_init__(self) -> None:
        if not 0 < self.confidence < 1:
            raise InputError(f"the confidence must lie strictly between 0 and 1, not {self.confidence}")


CALIBRATION = Calibration()


class Emptied(NamedTuple):
    """The window whose bounds contradicted the earlier ones, and the first parameter in which they did."""

    parameter: str
    lower: float
    upper: float
    window: int


@dataclass(frozen=True, eq=False)
class Recursion:
    """Result of the recursion."""

    names: tuple[str, ...]
    """The p parameters."""
    variant: Variant
    """Variant of the recursion."""
    box: Box | None
    """The last box; None when a window emptied it."""
    steps: NDArray[np.int64]
    """Windows of the histories' rows, (n_steps,): all, or evenly spaced ones (and the last) of more than `HISTORY`."""
    lower: Array
    upper: Array
    """`lower`, `upper`: Histories of the bounds, (n_steps, p); they never widen, and end before the window that emptied
    the box."""
    windows: int
    """Number of windows."""
    skipped: int
    """Windows with singular moments: no motion, or no noise at all. They do not change the bounds."""
    undone: int
    """Windows left out because they would have emptied the box (``"undo"`` only)."""
    same_orthant: int
    """Windows whose vertices (widened ones if calibrated) share an orthant, so that Theorem 1 applies."""
    emptied: Emptied | None
    """Parameter and window at which the bounds crossed, if they did."""
    correlation: int
    """Rows that count as correlated; 1 unless calibrated."""

    def require_box(self) -> Box:
        """Return the last box, or raise the EmptyBoxError that says which window emptied it."""
        if self.emptied is not None:
            raise EmptyBoxError(*self.emptied)
        return self.box if self.box is not None else Box.unbounded(self.names)


def bbrf(
    rows: Array,
    names: Sequence[str],
    *,
    window: int,
    stride: int | None = None,
    signs: Sequence[Sign] | None = None,
    variant: Variant = "strict",
    calibration: Calibration = CALIBRATION,
) -> Recursion:
    """Intersect the Frisch boxes of a window that slides over the rows.

    Parameters
    ----------
    rows : ndarray, shape (M, p + 1)
        E = [Y τ], torque last, rows in the order of time.
    names : sequence of str
        The p parameters.
    window : int
        Rows per window, from p + 2 to M.
    stride : int, optional
        Rows from one window to the next. By default 1, and half a window when calibrated: windows that
        overlap more say little new, and each one counted widens all bounds.
    signs : sequence of {-1, 0, 1}, optional
        Known signs; the bounds start at zero on the known side.
    variant : {"strict", "undo", "calibrated"}
        See the module's docstring.
    calibration : Calibration
        For the calibrated variant; the others widen nothing.

    Returns
    -------
    Recursion
        An emptied box is a result and not an error: see `Recursion.emptied` and `Recursion.require_box`.

    Raises
    ------
    InputError
        An option or the shape of `rows` is not usable.
    IdentifiabilityError
        A column of `rows`, or the torque, is zero throughout.
    """
    p = len(names)
    if variant not in get_args(Variant):
        raise UnknownNameError("variant", variant, get_args(Variant))
    calibrated = variant == "calibrated"
    stride = stride if stride is not None else max(1, window // 2 if calibrated else 1)
    _check(rows, p, window, stride)
    rms = np.sqrt(np.einsum("ki,ki->i", rows, rows) / len(rows))
    if not (rms > 0).all():
        what = [*names, "torque"][int((rms == 0).argmax())]
        raise IdentifiabilityError(f"{what} is zero in all {len(rows)} rows; leave it out or record a richer motion")
    scaled = np.ascontiguousarray(rows / rms)
    count = (len(rows) - window) // stride + 1
    if calibrated:
        block = calibration.correlation
        block = correlation_length(scaled, window) if block is None else block
        if not 1 <= block <= window // 4:
            raise InputError(
                f"the correlation length is {block} rows; a window of {window} rows needs four blocks, so give 1 to "
                f"{window // 4} rows, or a larger window"
            )
        quantile = -float(special.stdtrit(-(-window // block) - 1, (1 - calibration.confidence) / (2 * p * count)))
        extents = calibrated_extents(scaled, window, stride, block, quantile)
    else:
        block = 1
        extents = sample_extents(scaled, window, stride)
    start = Box.unbounded(names).with_signs(signs if signs is not None else [0] * p)
    return _intersect(start, extents, rms[p] / rms[:p], variant, count, block)


def _intersect(
    start: Box, extents: Iterator[Extents], unit: Array, variant: Variant, count: int, block: int
) -> Recursion:
    """Run the recursion itself over the windows' boxes, which come in units of `unit`."""
    lower, upper = start.lower, start.upper
    every = -(-count // HISTORY)
    history: list[tuple[int, Array, Array]] = []
    skipped, undone, same_orthant = 0, 0, 0
    emptied: Emptied | None = None
    for window, (low, high, usable, backed) in enumerate(_each(extents, unit)):
        same_orthant += backed
        if not usable:
            skipped += 1
        else:
            new_lower, new_upper = np.maximum(lower, low), np.minimum(upper, high)
            crossed = new_lower > new_upper
            if not crossed.any():
                lower, upper = new_lower, new_upper
            elif variant == "undo":
                undone += 1
            else:
                i = int(crossed.argmax())
                emptied = Emptied(start.names[i], float(new_lower[i]), float(new_upper[i]), window)
                break
        if window % every == 0 or window == count - 1:
            history.append((window, lower, upper))
    return Recursion(
        names=start.names,
        variant=variant,
        box=None if emptied is not None else Box(start.names, lower, upper),
        steps=np.array([step for step, _, _ in history], dtype=np.int64),
        lower=np.array([low for _, low, _ in history]).reshape(-1, len(start.names)),
        upper=np.array([high for _, _, high in history]).reshape(-1, len(start.names)),
        windows=count if emptied is None else emptied.window + 1,
        skipped=skipped,
        undone=undone,
        same_orthant=same_orthant,
        emptied=emptied,
        correlation=block,
    )


def _each(extents: Iterator[Extents], unit: Array) -> Iterator[tuple[Array, Array, bool, bool]]:
    """Bounds of each window in the parameters' units, whether usable, and whether in one orthant."""
    for lower, upper, usable in extents:
        backed = ((lower > 0) | (upper < 0)).all(axis=1) & usable
        yield from zip(lower * unit, upper * unit, usable.tolist(), backed.tolist(), strict=True)


def _check(rows: Array, p: int, window: int, stride: int) -> None:
    """Raise the InputError that says which option does not fit the rows."""
    if rows.ndim != 2 or rows.shape[1] != p + 1 or p == 0:
        raise InputError(f"{p} parameters need rows [Y τ] of shape (M, {p + 1}) and p ≥ 1, not {rows.shape}")
    if not np.isfinite(rows).all():
        k = int((~np.isfinite(rows)).any(axis=1).argmax())
        raise InputError(f"row {k} of [Y τ] holds NaN or infinity; drop the rows with missing samples")
    if not p + 2 <= window <= len(rows):
        raise InputError(
            f"a window of {window} rows cannot be used: {p} parameters need at least {p + 2}, "
            f"and there are {len(rows)} rows"
        )
    if stride < 1:
        raise InputError(f"the stride must be at least 1 row, not {stride}")
