"""Products in blocks of columns: those of numpy, for any length and any number of blocks."""

import numpy as np
import pytest

from rig.kernel import kernel
from rig.solve.lanes import BLOCK, gather, multiply


@kernel
def _product(table, x, first, count, out):
    multiply(table, x, first, count, out)


@kernel
def _sum(total, x, weight):
    gather(total, x, weight)


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
