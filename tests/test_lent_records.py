"""Records that are lent to kernels by their address."""

from typing import NamedTuple

import numpy as np

from rig.compiled.kernel import kernel
from rig.compiled.records import Loan


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


def test_no_python_code_finds_the_type_of_a_record_while_a_kernel_is_called(monkeypatch):
    """Numba ignores what is raised there: a Ctrl-C would be lost."""
    record = Record(2.5, Inside(np.arange(3.0), -7), np.arange(6.0).reshape(2, 3), 11)
    loan = Loan(record)

    def interrupted(*_):
        raise AssertionError("the type of a record is found again")

    monkeypatch.setattr("rig.compiled.records.lent_type", interrupted)
    assert told(loan) == told(Loan(record, loan)) == (2.5, 3.0, -7.0, 9.0, 11)
