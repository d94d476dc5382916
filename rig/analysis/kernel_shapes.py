"""Kernel shapes: the properties that the kernels of a scene are compiled for, and the shapes compiled so far.

A kernel depends on the number of states and on the method (laws over speed, fixed steps), never on values, so that many
scenes share one shape. Compiled shapes are noted beside the compiled kernels, in the directory of exactly these
sources, so that the notes disappear when the sources change.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import NamedTuple

import llvmlite.binding

from rig import kernel
from rig.bench.runner import PlantRunner
from rig.child_process import Child, end
from rig.errors import NumericsError, WorkerError
from rig.model.method import chosen, crowded
from rig.model.system import System
from rig.model.tables import UNROLLED
from rig.process import as_process
from rig.scenes.scene import Scene

FRAMES = 3
TYPICAL = 9.0  # s for one shape on one core, measured; the first estimate only


class Shape(NamedTuple):
    """The properties that a compiled kernel depends on."""

    states: int  # 0: any number
    curved: bool
    fixed: bool
    products: bool
    kicks: bool = False


VARIANTS = tuple(
    Shape(*one)
    for one in product(range(UNROLLED + 1), (False, True), (False, True), (False, True), (False, True))
    if one[1] or not one[3]  # products of states are never linear
    if not one[4] or (one[1] and one[2] and one[3])  # kicks need products and fixed steps
)
"""Every possible shape: the number of compiled kernels does not grow with the number of effects."""


def shape(scene: Scene) -> Shape:
    """Return the kernel shape of a scene."""
    return shape_of(scene.assemble().system(), scene.clock.method)


def shape_of(system: System, method: str) -> Shape:
    """Return the kernel shape of a system and an integration method."""
    how, states = chosen(method, system), system.n if system.n <= UNROLLED else 0
    pressed = how == "kick" or (how in ("dopri5", "rk4") and crowded(system))
    curved = not system.linear or pressed or how == "smooth"
    return Shape(states, curved, how in ("rk4", "kick"), bool(system.products) or pressed, how == "kick")


def prepare(
    wanted_scenes: Iterable[Scene], report: Callable[[str], object] | None = None, workers: int = 1
) -> dict[Shape, float]:
    """Compile the missing kernels of these scenes in `workers` processes.

    Returns seconds for each compiled shape. `report` gets a line before and after each, with an estimate of the
    remaining time.
    """
    say = report or (lambda _: None)
    wanted: dict[Shape, list[Scene]] = {}
    for scene in wanted_scenes:
        wanted.setdefault(shape(scene), []).append(scene)
    done = ready()
    missing = {one: found[0] for one, found in wanted.items() if one not in done}
    many = f"{len(wanted)} kernel shapes in {sum(map(len, wanted.values()))} scenes"
    say(f"{many}, {len(missing)} to prepare; there can be {len(VARIANTS)}")
    workers = min(workers, len(missing))
    progress = Progress(missing, max(workers, 1), say)
    if workers > 1:
        together(list(missing.values()), workers, progress)
    else:
        for number, scene in enumerate(missing.values()):
            progress.begins(number)
            begin = time.perf_counter()
            _run(scene)
            progress.ends(number, time.perf_counter() - begin)
    return progress.spent


class Progress:
    """Messages on shapes that are compiled, by number."""

    def __init__(self, missing: Mapping[Shape, Scene], workers: int, say: Callable[[str], object]) -> None:
        self.spent: dict[Shape, float] = {}
        self._missing, self._workers, self._say = list(missing.items()), workers, say

    def begins(self, number: int) -> None:
        """Report that a shape is being compiled."""
        (one, scene), count = self._missing[number], len(self._missing)
        each = max(self.spent.values(), default=TYPICAL)
        left = each * -(-(count - len(self.spent)) // self._workers)
        states = "1 state" if one.states == 1 else f"{one.states or 'many'} states"
        self._say(f"{number + 1} of {count}: {scene.name}, {states}; at most {left:.0f} s left")

    def ends(self, number: int, seconds: float) -> None:
        """Report that a shape is ready."""
        one, _ = self._missing[number]
        self.spent[one] = seconds
        note(one)
        self._say(f"{number + 1} of {len(self._missing)}: ready after {seconds:.1f} s")


def together(scenes_: list[Scene], workers: int, progress: Progress) -> None:
    """Compile for these scenes in several processes, each of which takes the next scene.

    Kernels that several of them need are compiled by each, unless another was faster; one at a time stores them.
    """
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
        for number, scene in enumerate(scenes_):
            (Path(folder) / f"{number}.json").write_text(scene.to_json())
        crew = [Child(f"compiler {k + 1}", ["rig.analysis.kernel_shapes", folder]) for k in range(workers)]
        try:
            going = True
            while going:
                going = any(child.code is None for child in crew)
                for words in [line.split() for child in crew for line in child.new_lines() if line[:1] == ">"]:
                    if words[0] == ">begins":
                        progress.begins(int(words[1]))
                    else:
                        progress.ends(int(words[1]), float(words[2]))
                if lost := [child.ending for child in crew if child.code]:
                    raise WorkerError(f"{'; '.join(lost)}. Finished kernels are kept")
                time.sleep(0.05)
        finally:
            end(crew, 0.0)


def main() -> None:
    """A compiler: `python -m rig.analysis.kernel_shapes FOLDER`."""
    for path in sorted(Path(sys.argv[1]).glob("*.json"), key=lambda path: int(path.stem)):
        try:
            os.close(os.open(path.with_suffix(".claim"), os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            continue
        sys.stdout.write(f">begins {path.stem}\n")
        sys.stdout.flush()
        begin = time.perf_counter()
        _run(Scene.from_json(path.read_text()))
        sys.stdout.write(f">ends {path.stem} {time.perf_counter() - begin:.3f}\n")
        sys.stdout.flush()


def _run(scene: Scene) -> None:
    """Call what a run calls; a method that leaves the limits at this scene's step has been compiled all the same."""
    runner = PlantRunner(scene)
    with suppress(NumericsError):
        for _ in range(FRAMES):
            runner.frame()
    runner.output_values()
    runner.statistics()


def ready() -> set[Shape]:
    """Return the shapes that have been compiled for these sources and this processor."""
    try:
        return {Shape(*one) for one in json.loads(notes().read_text())}
    except (OSError, ValueError, TypeError):  # not there, or damaged: what is compiled is found all the same
        return set()


def notes() -> Path:
    """The file that tells which shapes have been compiled."""
    return kernel.FOLDER.path / f"warm-{llvmlite.binding.get_host_cpu_name()}.json"


def note(one: Shape) -> None:
    """Note that the kernels of a shape have been compiled."""
    noted, place = sorted(ready() | {one}), notes()
    draft = place.with_suffix(f".{os.getpid()}")
    try:
        draft.write_text(json.dumps(noted))
        draft.replace(place)
    except OSError:  # a read-only cache: the next start compiles again
        return


if __name__ == "__main__":
    as_process(main)
