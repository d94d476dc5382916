"""The kernel of a film of points does what its twin in C does, which was written apart from numba and its vectors."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import pytest

from benchmarks import twins


def test_kernel_and_c_twin_carry_the_same_state(tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed")
    told = twins.film(partial(twins.compiled, compiler, str(tmp_path)), ticks=100)
    assert told["points"] == 40
    # in 1000 steps of bouncing the rounding of another compiler may grow; a wrong table is off by the size of the state
    assert told["largest_difference"] < 1e-9
