"""Base parameters: the combinations of parameters that a log determines.

A regression ``τ = W θ`` rarely determines every entry of θ. Some columns of W are zero, and others are linear
combinations of one another in every motion. So the torque depends on only p = rank(W) combinations of θ. Two singular
value decompositions find these, from numbers alone:

1. ``W = U diag(σ) [V1 V2]ᵀ`` with the columns of W scaled to unit norm. The parameters θ_n, with a zero row in V1, are
   not identifiable. The parameters θ_a, with a zero row in V2, are identifiable alone. The rest, θ_l, are identifiable
   only in combination.
2. On the columns of θ_l alone, ``W_l V2 = 0``. Split the rows of V2 into V22, d rows that form a regular matrix, and
   V21, the others. Then the parameters θ_l2 of V22 are redundant: the torque depends only on

       θ_d = θ_l1 − V21 V22⁻¹ θ_l2.

   Any regular V22 is possible; the one taken minimises ``α1 cond(V22) + α2 / |det V22|``.

Before that choice V2 is scaled back to the parameters' own units. Then V2 and the choice depend on the robot's
structure and not on the motion: different logs of one robot give the same base parameters.

References: M. Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems
8(4), 1991; S. Massaroli et al., "Frisch Scheme Identification of Robots Dynamic Parameters", eqs. 11 to
15 and 17. Eq. (16), Theorem 3, is wrong as printed: the base columns are the independent ones, Γ_d = Γ_l1, as here
(`frischid/paper/planar_arm.py` has the proof and the size of the error).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from frischid.core.types import Array, Column, Sign
from frischid.errors import IdentifiabilityError, InputError

Indices = NDArray[np.intp]

_EXHAUSTIVE = 20_000  # up to so many subsets of rows, all are tried; beyond, rows are exchanged one by one
_TIE = 1e-6  # relative difference below which two costs or two coefficients count as equal
_ROUNDING = 1e-7  # relative singular value above all rounding, even that of moments
_PRECISE = 1e-13  # relative singular value that only a regression in full precision can have
_EXACT = 1e-9  # share of a joint's torque below which merging costs nothing but rounding
_MISALIGNED = 100.0  # × tol: error of an exact relation when an angle is written 1.5708 (off by 3.7e-6 rad)


@dataclass(frozen=True, eq=False)
class Reduction:
    """The parameters that are identifiable, alone or in combination, and the base parameters.

    Attributes
    ----------
    columns : tuple of Column
        The C columns of W.
    rank : int
        p, the number of base parameters.
    singular_values : ndarray
        Descending, of the columns at unit norm, without the null columns.
    gap : float
        ``σ_p / σ_{p+1}``, with σ_{p+1} at least ``tol / 10 σ_1``, the level of rounding. Below 1e2 the rank is not
        clear: the motion excites some combination so weakly that it could be rounding.
    absolute, none, linear : tuple of int
        Columns of θ_a (identifiable alone), θ_n (not identifiable) and θ_l (only in combination).
    independent, dependent : tuple of int
        Columns of θ_l1, which stay, and of θ_l2, which are regrouped into those of θ_l1.
    mapping : ndarray, shape (p, C)
        K in ``θ_base = K θ``, so that ``W θ = W[:, base] K θ``.
    cost : float
        Largest share of a joint's torque by which ``W[:, base] K θ`` differs from ``W θ``, as `structure` measures it.
    """

    columns: tuple[Column, ...]
    rank: int
    singular_values: Array
    gap: float
    absolute: tuple[int, ...]
    none: tuple[int, ...]
    linear: tuple[int, ...]
    independent: tuple[int, ...]
    dependent: tuple[int, ...]
    mapping: Array
    cost: float = 0.0

    @property
    def base(self) -> tuple[int, ...]:
        """Columns of W that remain: the leading parameter of every base parameter."""
        return tuple(sorted(self.absolute + self.independent))

    def described_cost(self) -> str:
        """The cost of merging, in words; empty where it costs nothing but rounding."""
        words = f"merging near-dependencies costs at most {self.cost:.1e} of a joint's torque"
        return words if self.cost > _EXACT else ""

    def base_columns(self) -> tuple[Column, ...]:
        """Describe the base parameters as columns.

        Returns
        -------
        tuple of Column, length p
            The leading columns. A column with regrouped terms is renamed (``mx1`` becomes ``mx1R``), and its sign is
            known only where all its terms have the same sign.
        """
        return tuple(self._regrouped(row, lead) for row, lead in zip(self.mapping, self.base, strict=True))

    def _regrouped(self, row: Array, lead: int) -> Column:
        column, terms = self.columns[lead], np.flatnonzero(row)
        if len(terms) == 1:
            return column
        signs = {self.columns[i].sign * np.sign(row[i]) for i in terms}
        sign: Sign = column.sign if signs == {column.sign} else 0
        return replace(column, name=f"{column.name}R", sign=sign)

    def expressions(self) -> list[str]:
        """Each base parameter as a sum of parameters: ``Izz1 + Ia1 + 0.25 m2``."""
        return [self._expression(row, lead) for row, lead in zip(self.mapping, self.base, strict=True)]

    def _expression(self, row: Array, lead: int) -> str:
        # Terms without a factor come first: Izz1 + Ia1 + 0.25 m2.
        # Rounded twice, so that the last bit of 0.012345 does not decide between 0.01234 and 0.01235.
        digits = {i: f"{float(f'{abs(row[i]):.9g}'):.4g}" for i in np.flatnonzero(row) if i != lead}
        text = self.columns[lead].name
        for scaled, i in sorted((x != "1", i) for i, x in digits.items()):
            factor = f"{digits[i]} " if scaled else ""
            text += f" {'-' if row[i] < 0 else '+'} {factor}{self.columns[i].name}"
        return text


def reduce(
    root: Array, columns: Sequence[Column], *, tol: float = 1e-7, alpha: tuple[float, float] = (1.0, 1.0)
) -> Reduction:
    """Find the base parameters of a regression.

    Parameters
    ----------
    root : ndarray, shape (r, C)
        Any R with ``RᵀR = WᵀW``: W itself, or a square root of its moments.
    columns : sequence of Column, length C
    tol : float
        Singular values below ``tol σ_1`` count as zero, unless the spectrum has a wider gap between ``tol σ_1 / 10``
        and ``100 tol σ_1``. The default suits a root of moments, whose singular values are accurate to about 1e-8 σ_1;
        a W in full precision allows 1e-9. A link's column counts as zero where its norm is below ``100 tol`` times the
        largest of the links' columns, an effect's column where it is below 1e-12 times the largest of all.
    alpha : (float, float)
        α1 and α2, the weights of conditioning and volume in the choice of the dependent parameters.

    Raises
    ------
    InputError
        The shapes disagree, or `root` holds NaN or infinity.
    IdentifiabilityError
        Every column is zero.
    """
    root, columns = _compact(root, len(columns), tol), tuple(columns)
    norms = np.linalg.norm(root, axis=0)
    # A column of unit norm has no zero row in V1, so θ_n are exactly the zero columns.
    # Units differ from one effect to the next, so only rigid columns are compared with one another.
    rigid = np.array([c.effect == "rigid" for c in columns], dtype=bool)
    largest = norms.max(initial=0.0)
    seen = norms > np.where(rigid, _MISALIGNED * tol * norms.max(initial=0.0, where=rigid), 1e-12 * largest)
    if not seen.any():
        raise IdentifiabilityError(
            f"none of the {len(columns)} parameters can be identified: every column of the regression is zero; use a "
            "log in which the robot moves"
        )
    kept = np.flatnonzero(seen)
    sigma, V = _right_svd(root[:, kept] / norms[kept])
    p, gap, blur = _rank(sigma, tol)
    coupled = np.linalg.norm(V[:, p:], axis=1) > blur
    absolute, linear = kept[~coupled], kept[coupled]
    rows, B = _regrouping(root[:, linear], norms[linear], len(kept) - p, alpha, blur)
    dependent, independent = linear[rows], np.delete(linear, rows)
    base = np.union1d(absolute, independent)
    mapping = np.zeros((p, len(columns)))
    mapping[np.arange(p), base] = 1.0
    mapping[np.ix_(np.searchsorted(base, independent), dependent)] = B
    return Reduction(
        columns=columns,
        rank=p,
        singular_values=sigma,
        gap=gap,
        absolute=tuple(absolute.tolist()),
        none=tuple(np.flatnonzero(~seen).tolist()),
        linear=tuple(linear.tolist()),
        independent=tuple(independent.tolist()),
        dependent=tuple(dependent.tolist()),
        mapping=mapping,
    )


def _compact(root: Array, count: int, tol: float) -> Array:
    """Check the arguments of `reduce`, and reduce a tall root to a square one, so that the SVDs are cheap."""
    root = np.asarray(root, dtype=float)
    if root.ndim != 2:
        raise InputError(f"the regression matrix has {root.ndim} dimensions; it must have 2")
    bad = np.flatnonzero(~np.isfinite(root).all(axis=0))
    if len(bad):
        raise InputError(f"the regression matrix has NaN or infinite values in column {bad[0]}; clean the log first")
    if root.shape[1] != count:
        raise InputError(f"the regression matrix has {root.shape[1]} columns but {count} are named")
    if not 0.0 < tol <= 1e-4:
        raise InputError(f"the rank tolerance is {tol:g}; it must lie above 0 and not above 1e-4")
    return root if len(root) <= count else np.asarray(np.linalg.qr(root, mode="r"))


def _right_svd(matrix: Array) -> tuple[Array, Array]:
    """Singular values, one per column, and all right singular vectors as columns.

    By the QR iteration (gesvd): divide and conquer (gesdd) does not converge for some matrices, as that of Baxter.
    """
    _, values, Vt = linalg.svd(matrix, lapack_driver="gesvd")
    return np.pad(values, (0, matrix.shape[1] - len(values))), Vt.T


def _rank(sigma: Array, tol: float) -> tuple[int, float, float]:
    """Put the rank at the widest gap near `tol`; return it, the gap, and the relative error left in V2."""
    relative = sigma / sigma[0]
    dust = tol / 10.0
    ahead = np.maximum(np.append(relative[1:], 0.0), dust)
    gaps = np.where((relative > dust) & (ahead <= _MISALIGNED * tol), relative / ahead, 0.0)
    p = int(np.argmax(gaps)) + 1
    # Rounding perturbs the moments, and so V2 to second order; a misaligned axis perturbs W, and so V2 to first order.
    after = float(np.append(relative, 0.0)[p])
    precise = after < _PRECISE and p < len(sigma)
    error = max(after, _PRECISE) / relative[p - 1] if after > _ROUNDING or precise else (tol / relative[p - 1]) ** 2
    return p, float(gaps[p - 1]), float(np.clip(10.0 * error, 1e-8, 1e-3))


def _regrouping(root: Array, norms: Array, d: int, alpha: tuple[float, float], blur: float) -> tuple[Indices, Array]:
    """Rows of θ_l2 in θ_l, and ``B = −V21 V22⁻¹``, from the columns of θ_l alone."""
    V2 = _right_svd(root / norms)[1][:, len(norms) - d :]
    null = np.linalg.qr(V2 / norms[:, None])[0]  # from columns at unit norm back to the parameters' units
    rows = _dependent_rows(null, alpha)
    B = -np.delete(null, rows, axis=0) @ np.linalg.inv(null[rows])
    # A coefficient that adds hardly anything to its base parameter's torque is rounding.
    B[np.abs(B) * np.delete(norms, rows)[:, None] < blur * norms[rows]] = 0.0
    return rows, _tidy(B)


def _dependent_rows(null: Array, alpha: tuple[float, float]) -> Indices:
    """Choose the d rows of `null` that form V22; among equally good choices, the last rows.

    So later parameters are regrouped into earlier ones: m2 into mx1, Ia1 into Izz1.
    """
    n, d = null.shape
    if comb(n, d) > _EXHAUSTIVE:
        return _exchanged(null, _pivots(null), alpha)
    if d == 0:
        return np.empty(0, dtype=np.intp)
    subsets = np.array(list(combinations(range(n), d)), dtype=np.intp)
    return np.asarray(subsets[_cheapest(null, subsets, np.abs(np.linalg.det(null[subsets])), alpha)])


def _cheapest(null: Array, subsets: Indices, volumes: Array, alpha: tuple[float, float]) -> int:
    """Last of the subsets of rows with the least ``α1 cond + α2 / |det|``; `volumes` are their |det|."""
    # cond ≥ 1 bounds each cost from below, and the largest volume bounds the least cost: few cond are needed.
    floor = alpha[0] + alpha[1] / np.maximum(volumes, 1e-300)
    mark = volumes.argmax()
    limit = floor[mark] + alpha[0] * (np.linalg.cond(null[subsets[mark]]) - 1.0)
    rivals = np.flatnonzero((floor <= limit * (1.0 + _TIE)) & (volumes > 1e-12 * volumes[mark]))
    costs = floor[rivals] + alpha[0] * (np.linalg.cond(null[subsets[rivals]]) - 1.0)
    return int(rivals[np.flatnonzero(costs <= costs.min() * (1.0 + _TIE))[-1]])


def _pivots(null: Array) -> Indices:
    """Rows that span the most volume one after another, as pivoted QR picks them; ties go to the last row."""
    # The projector does not depend on the basis that the decomposition returned.
    projector, rows = null @ null.T, np.empty(null.shape[1], dtype=np.intp)
    for k in range(len(rows)):
        left = projector.diagonal()
        rows[k] = pivot = np.flatnonzero(left >= left.max() * (1.0 - _TIE))[-1]
        projector = projector - np.outer(projector[:, pivot], projector[pivot]) / projector[pivot, pivot]
    return np.sort(rows)


def _exchanged(null: Array, rows: Indices, alpha: tuple[float, float]) -> Indices:
    """Exchange one row at a time while that lowers the cost."""
    n, d = null.shape
    for _ in range(10 * n):
        # Replacing the k-th chosen row by row i multiplies |det V22| by |B[i, k]|.
        V22 = null[rows]
        factors = np.abs(null @ np.linalg.inv(V22))
        outside = np.setdiff1d(np.arange(n), rows)
        arrive, leave = (index.ravel() for index in np.meshgrid(outside, np.arange(d), indexing="ij"))
        # Keeping the row is shift 0: among equal costs, only a move towards later rows is preferred.
        arrive, leave = np.append(arrive, rows[0]), np.append(leave, 0)
        order = np.argsort(arrive - rows[leave], kind="stable")
        arrive, leave = arrive[order], leave[order]
        subsets = np.repeat(rows[None], len(order), axis=0)
        subsets[np.arange(len(order)), leave] = arrive
        best = subsets[_cheapest(null, subsets, abs(np.linalg.det(V22)) * factors[arrive, leave], alpha)]
        if (best == rows).all():
            break
        rows = np.sort(best)
    return rows


def _tidy(B: Array) -> Array:
    """Round near-integers to integers and nearly equal magnitudes to one value, so that rounding hides no structure."""
    size, sign = np.abs(B), np.sign(B)
    whole = np.round(size)
    snapped = (whole > 0.0) & (np.abs(size - whole) < _TIE * whole)
    size = np.where(snapped, whole, size)
    distinct, inverse = np.unique(size, return_inverse=True)
    if len(distinct):
        # Runs of neighbours closer than the tie share their smallest member.
        starts = np.append(True, np.diff(distinct) > _TIE * distinct[1:])
        size = distinct[starts][np.cumsum(starts) - 1][inverse.reshape(B.shape)]
    return np.asarray(sign * size)
