"""Records that are lent to kernels by their address."""

from typing import NamedTuple

import numpy as np

from rig.kernel import kernel
from rig.lent_records import Loan


class Inside(NamedTuple):
    row: np.ndarray
    whole: int


class Record(NamedTuple):
    number: float
    inside: Inside
    table: np.ndarray
    last: int


@kernel
def told(record):
    inside = record.inside
    total = 0.0
    for i in range(inside.row.shape[0]):
        total += inside.row[i]
    return record.number, total, float(inside.whole), record.table[1, 2] + record.table[1, 1], record.last


def test_a_loan_is_read_as_it_was_laid_down():
    """Whole numbers, numbers, arrays of any order and records within records, at their places in memory."""
    inside = Inside(np.arange(3.0), -7)
    record = Record(2.5, inside, np.arange(6.0).reshape(2, 3), 11)
    loan = Loan(record)
    assert told(loan) == (2.5, 3.0, -7.0, 9.0, 11)
    inside.row[:] = 2.0  # shared, not copied
    assert told(loan)[1] == 6.0
