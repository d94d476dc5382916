"""Products in blocks of columns: those of numpy, for any length and any number of blocks."""

import numpy as np
import pytest

from rig.compiled.kernel import kernel
from rig.solve.column_blocks import BLOCK, LANE, across, blend, gather, multiply


@kernel
def _product(table, x, first, count, out):
    multiply(table, x, first, count, out)


@kernel
def _sum(total, x, weight):
    gather(total, x, weight)


@kernel
def _interpolated(low, rise, share, x, now, out):
    blend(low, rise, share, x, now, out)


@kernel
def _back(table, weights, out):
    across(table, weights, out)


@pytest.mark.parametrize(("n", "first", "count"), [(1, 0, 1), (5, 1, 2), (41, 0, 5), (7, 2, 3), (3, 1, 0)])
def test_the_product_of_a_few_blocks(n, first, count):
    draw = np.random.default_rng(1)
    table, x, out = draw.normal(size=(5, n, BLOCK)), draw.normal(size=n), np.full(count * BLOCK + 3, 7.0)
    _product(table, x, first, count, out)
    expected = np.einsum("j,bjr->br", x, table[first : first + count]).ravel()
    assert out[: count * BLOCK] == pytest.approx(expected, rel=1e-13, abs=1e-13)
    assert (out[count * BLOCK :] == 7.0).all()


@pytest.mark.parametrize("n", [1, 16, 41])
def test_the_sum_of_outer_products(n):
    width = -(-n // BLOCK) * BLOCK
    total, x = np.ones((n, width)), np.zeros(width)
    x[:n] = np.random.default_rng(2).normal(size=n)
    _sum(total, x, 0.3)
    assert total == pytest.approx(1.0 + 0.3 * np.outer(x[:n], x), rel=1e-14)


@pytest.mark.parametrize("n", [1, 2, 21])
@pytest.mark.parametrize("width", [LANE, BLOCK + LANE, 3 * BLOCK])
def test_rows_between_two_places_and_their_products_both_ways(n, width):
    draw = np.random.default_rng(3)
    low, rise = draw.normal(size=(2, n, width))
    x, weights = draw.normal(size=n), draw.normal(size=width)
    now, out, back = np.zeros((n, width)), np.full(width + 3, 7.0), np.full(n + 1, 7.0)
    _interpolated(low, rise, 0.3, x, now, out)
    _back(now, weights, back)
    rows = low + 0.3 * rise
    assert now == pytest.approx(rows, rel=1e-14, abs=1e-15)
    assert out[:width] == pytest.approx(x @ rows, rel=1e-13, abs=1e-13)
    assert back[:n] == pytest.approx(rows @ weights, rel=1e-13, abs=1e-13)
    assert (out[width:] == 7.0).all()
    assert back[n] == 7.0
