"""Compilation ahead of time: every kernel shape of the shipped scenes and of the torture test."""

from __future__ import annotations

import compileall
from collections.abc import Callable, Iterable
from pathlib import Path

import rig
from rig import controllers, scenes, sensors
from rig.analysis.kernel_shapes import Shape, prepare
from rig.qualify.torture.cells import needed


def warmup(
    report: Callable[[str], object] | None = None, names: Iterable[str] | None = None, workers: int = 1
) -> dict[Shape, float]:
    """Compile the kernels of the scenes `names`; by default of all shipped ones, and of the torture test.

    Returns seconds for each compiled shape. `report` gets a line before and after each shape, with an estimate of the
    remaining time.
    """
    for package in (rig, controllers, sensors):  # some systems do not store bytecode: that costs 0.2 s at each start
        compileall.compile_dir(Path(package.__path__[0]), quiet=2)
    if names is not None:
        return prepare([scenes.load(name) for name in names], report, workers)
    return prepare([*(scenes.load(name) for name in scenes.names()), *needed()], report, workers)
