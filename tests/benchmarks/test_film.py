"""Kernels do what their twins in C do, which were written apart from numba."""

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
    build = partial(twins.compiled, compiler, str(tmp_path))
    for told, points in ((twins.film(build, ticks=100), 40), (twins.points(build, ticks=100), 24)):
        assert told["points"] == points
        # in 1000 steps of bouncing the rounding of another compiler may grow; a wrong table is off by the state's size
        assert told["largest_difference"] < 1e-9


def test_a_whole_run_in_open_loop_and_its_c_twin_agree(tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed")
    told = twins.run(partial(twins.compiled, compiler, str(tmp_path)), short=1, long=3, rounds=1)
    assert told["same_events"]
    largest = [told[f"largest_difference_of_{what}"] for what in ("outputs", "samples", "energy")]
    assert largest == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
