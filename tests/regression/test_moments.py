"""Moments say about rows what the rows themselves say, however the moments were added and kept."""

import numpy as np
import pytest

from frischid.core.types import Column
from frischid.errors import InputError
from frischid.regression.moment_blocks import Blocks, total
from frischid.regression.moments import Gram

JOINTS = ("a", "b")


def columns(count):
    return tuple(Column(f"x{k}", "kg", "a", "rigid") for k in range(count))


def rows_of(seed, count=(30, 50), width=4):
    """Rows [Y τ] of two joints; the torque has a mean."""
    rng = np.random.default_rng(seed)
    return [rng.normal(size=(n, width + 1)) + np.append(np.zeros(width), 3.0) for n in count]


def gram(rows):
    width = rows[0].shape[1] - 1
    moments, sums = np.stack([Z.T @ Z for Z in rows]), np.stack([Z.sum(axis=0) for Z in rows])
    return Gram(columns(width), JOINTS, moments, sums, np.array([float(len(Z)) for Z in rows]))


def same(one, other):
    for part in ("moments", "sums", "counts"):
        np.testing.assert_allclose(getattr(one, part), getattr(other, part), rtol=1e-12, atol=1e-10)


def test_sums_add_and_subtract():
    first, second = rows_of(0), rows_of(1, (7, 90))
    both = gram([np.concatenate(pair) for pair in zip(first, second, strict=True)])
    same(gram(first) + gram(second), both)
    same(both - gram(second), gram(first))
    assert both.rows == 30 + 50 + 7 + 90
    with pytest.raises(InputError, match="different columns"):
        gram(first) - gram(rows_of(0, width=3))


def test_residuals_and_spread_are_those_of_the_rows():
    rows, theta = rows_of(2), np.array([1.0, -2.0, 0.5, 3.0])
    found = gram(rows)
    np.testing.assert_allclose(found.residual_ss(theta), [((Z[:, -1] - Z[:, :-1] @ theta) ** 2).sum() for Z in rows])
    np.testing.assert_allclose(found.torque_ss(), [((Z[:, -1] - Z[:, -1].mean()) ** 2).sum() for Z in rows])


def test_weights_are_of_squared_residuals():
    rows = rows_of(3)
    by_rows = sum(w * Z.T @ Z for w, Z in zip((2.0, 0.3), rows, strict=True))
    np.testing.assert_allclose(gram(rows).weighted(np.array([2.0, 0.3])), by_rows)
    np.testing.assert_allclose(gram(rows).weighted(), sum(Z.T @ Z for Z in rows))


def test_chosen_columns_keep_the_torque():
    rows = rows_of(4)
    found = gram(rows).select([2, 0])
    same(found, gram([Z[:, [2, 0, 4]] for Z in rows]))
    assert [c.name for c in found.columns] == ["x2", "x0"]


@pytest.mark.parametrize("width", [5, 300])  # moments of 300 columns are kept as triangles
def test_blocks_keep_what_they_are_given(width):
    parts = [rows_of(seed, (9, 12), width) for seed in range(6)]
    for rows in parts:
        rows[0][:, : width // 2] = 0.0  # a joint does not feel every column
    grams = [gram(rows) for rows in parts]
    blocks = Blocks(grams)
    for k, part in enumerate(grams):
        same(blocks[k], part)
    same(total(blocks), total(iter(grams)))
    blocks.merge(grams[0])
    same(blocks[5], grams[5] + grams[0])
    blocks.halve()
    assert len(blocks) == 3
    same(blocks[1], grams[2] + grams[3])
    same(blocks[1:][0], grams[2] + grams[3])
    assert (blocks.nbytes < 0.7 * sum(g.moments.nbytes for g in grams[:3])) == (width == 300)
