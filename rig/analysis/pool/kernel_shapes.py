"""Kernel shapes: the properties that the kernels of a scene are compiled for, and the shapes compiled so far.

A kernel depends on the number of states and on the method (laws over speed, fixed steps), never on values, so that many
scenes share one shape. Compiled shapes are noted beside the compiled kernels, in the directory of exactly these
sources, so that the notes disappear when the sources change.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import NamedTuple

import llvmlite.binding
import numpy as np

from rig.analysis.pool import Arrays, Work, carry_out, temporary
from rig.bench.run.runner import PlantRunner
from rig.compiled import kernel
from rig.compiled.kernel_store import INSTEAD
from rig.errors import NumericsError
from rig.machine.files import own_bytes, own_file
from rig.machine.process import Child
from rig.machine.scheduling import keep_to_one_core
from rig.model.assembly import Assembly
from rig.model.method import TIGHT, chosen
from rig.model.system import System
from rig.model.tables import UNROLLED
from rig.printable import counted
from rig.scenes import load
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene

FRAMES = 3  # of a brief run: they call every kernel that a run calls
TYPICAL = 9.0  # s for one shape on one core, measured; the first estimate only


class Shape(NamedTuple):
    """The properties that a compiled kernel depends on."""

    states: int  # 0: any number
    curved: bool
    fixed: bool
    products: bool
    kicks: bool = False
    implicit: bool = False
    long: bool = False


FILM = Shape(0, curved=False, fixed=True, products=False, kicks=True)
"""The kernels of a film, for any number of states."""


def _variants() -> Iterator[Shape]:
    for states in range(UNROLLED + 1):
        for flags in product((False, True), repeat=6):
            kind = Shape(states, *flags)
            if kind.products and not kind.curved:  # products of states are never linear
                continue
            if kind.kicks and kind != FILM:
                continue
            adaptive = kind.curved and not kind.fixed
            if kind.implicit and not adaptive:  # implicit steps are for what is not linear, and of any length
                continue
            if kind.long and (kind.implicit or not adaptive):  # so are the long steps of dop853
                continue
            yield kind


VARIANTS = tuple(_variants())
"""Every possible shape: the number of compiled kernels does not grow with the number of effects."""


def shape(scene: Scene) -> Shape:
    """Return the kernel shape of a scene."""
    return shape_of(scene.assemble().system(), scene.clock.method)


def shape_of(system: System, method: str, tolerance: float = math.inf) -> Shape:
    """Return the kernel shape of a system and an integration method, for an analysis with its own `tolerance`."""
    how = chosen(method, system, tolerance)
    if how == "kick":
        return FILM
    curved = not system.linear or how == "smooth"
    return Shape(
        states=system.n if system.n <= UNROLLED else 0,
        curved=curved,
        fixed=how == "rk4",
        products=bool(system.products) or system.remembers,
        implicit=how == "rosenbrock" and curved,
        long=how == "dop853" and curved,
    )


def prepare(
    wanted_scenes: Iterable[Scene],
    report: Callable[[str], object] | None = None,
    workers: int = 1,
    analysed: Iterable[Scene] = (),
) -> dict[Shape, float]:
    """Compile the missing kernels of these scenes in `workers` processes; `analysed`: those of maps and branches.

    Returns seconds for each compiled shape. `report` gets a line before and after each, with an estimate of the
    remaining time.
    """
    say = report or (lambda _: None)
    wanted: dict[Shape, list[Scene]] = {}
    for scene in wanted_scenes:
        wanted.setdefault(shape(scene), []).append(scene)
    for scene in analysed:
        wanted.setdefault(analysed_shape(scene), []).append(scene)
    done = ready()
    missing = {kind: wanted[kind][0] for kind in _one_of_each(wanted) if kind not in done}
    many = f"{len(wanted)} kernel shapes in {sum(map(len, wanted.values()))} scenes"
    say(f"{many}, {len(missing)} to prepare; there can be {len(VARIANTS)}")
    return compile_all(missing, min(workers, len(missing)), say)


def _one_of_each(kinds: Iterable[Shape]) -> list[Shape]:
    """One shape of each method, then a second one, and so on: two workers seldom need the same new kernels at a time.

    Those for any number of states, which take longest, come first; among them a film last: `warmup` begins with it.
    """
    earlier = Counter[Shape]()
    turns = []
    for kind in sorted(kinds):
        method = kind._replace(states=0, products=False)
        turns.append((earlier[method], kind.kicks, kind))
        earlier[method] += 1
    return [kind for *_, kind in sorted(turns, key=lambda turn: turn[:2])]


def compile_all(missing: Mapping[Shape, Scene], workers: int, say: Callable[[str], object]) -> dict[Shape, float]:
    """Compile for these scenes, in this process or in several; return seconds for each shape."""
    spent: dict[Shape, float] = {}
    shapes = list(missing.items())

    def left() -> str:
        each = max(spent.values(), default=TYPICAL)
        return f"at most {each * -(-(len(shapes) - len(spent)) // max(workers, 1)):.0f} s left"

    def ends(number: int, seconds: float) -> None:
        kind, scene = shapes[number]
        spent[kind] = seconds
        note(kind)
        say(f"{len(spent)} of {len(shapes)}: {scene.name} ready after {seconds:.1f} s; {left()}")

    def look(done: int, _: int) -> None:
        if done > len(spent):
            for number, arrays in store.load().items():
                if shapes[number][0] not in spent:
                    ends(number, float(arrays["seconds"]))

    if workers > 1:
        say(f"compiling {len(shapes)} kernel shapes in {workers} processes; {left()}")
        work = Work(_compile, shapes)
        with temporary(work) as store:
            carry_out(work, store, workers, look, apart=True)
        return spent
    for number, (kind, scene) in enumerate(shapes):
        states = counted(kind.states, "state") if kind.states else "many states"
        say(f"{number + 1} of {len(shapes)}: {scene.name}, {states}; {left()}")
        ends(number, float(_compile((kind, scene))["seconds"]))
    return spent


def _compile(wanted: tuple[Shape, Scene]) -> Arrays:
    """Compile a shape for a scene; return the time it took [s].

    Kernels that several workers need are compiled by each, unless another was faster; one at a time stores them.
    """
    begin = time.perf_counter()
    kind, scene = wanted
    (run_briefly if kind == shape(scene) else analyse_briefly)(scene)
    return {"seconds": np.array(time.perf_counter() - begin)}


def analyse_briefly(scene: Scene) -> None:
    """Call what maps and branches call."""
    from rig.bench.free_rig import FreeRig

    for assembly in (scene.assemble(), _analysed(scene)):  # at one value of the parameter, and over it
        rig = FreeRig(scene, assembly, tolerance=TIGHT, read=[next(iter(assembly.outputs))])
        for x in (rig.system.start, rig.settled):  # which may stick, and slips
            rig.carried(x, rig.step, keep=True)


def analysed_shape(scene: Scene) -> Shape:
    """Return the shape of a map or of branches over the speed of the drive, which is then a state; else of a run."""
    kind = shape_of(_analysed(scene).system(), scene.clock.method, TIGHT)
    return shape(scene) if kind.fixed else kind


def _analysed(scene: Scene) -> Assembly:
    held = dict.fromkeys({"drive.speed"} & scene.assemble().inputs.keys(), "held")
    return assembled(scene.parameters, scene.frame_ns, {**held, **scene.moved}, random=False, limits=scene.limits)


def run_briefly(scene: Scene) -> None:
    """Call what a run calls; a method that leaves the limits at this scene's step has been compiled all the same."""
    runner = PlantRunner(scene, measured={})
    with suppress(NumericsError):
        for _ in range(FRAMES):
            runner.frame()
    runner.output_values()
    runner.statistics()


def begun(name: str) -> Child:
    """Begin to compile the kernels of scene `name`, in another process on one core."""
    return Child("first compiler", ["rig.analysis.pool.kernel_shapes", name])


def ready() -> set[Shape]:
    """Return the shapes that have been compiled for these sources and this processor."""
    try:
        return {Shape(*fields) for fields in json.loads(own_bytes(notes(), INSTEAD))}
    except (OSError, ValueError, TypeError):  # not there, or damaged: what is compiled is found all the same
        return set()


def notes() -> Path:
    """The file with the shapes that have been compiled."""
    return kernel.FOLDER.path / f"warm-{llvmlite.binding.get_host_cpu_name()}.json"


def note(kind: Shape) -> None:
    """Note that the kernels of a shape have been compiled."""
    noted = sorted(ready() | {kind})
    place = notes()
    draft = place.with_suffix(f".{os.getpid()}")
    with suppress(OSError):  # a read-only cache: the next start compiles again
        draft.write_text(json.dumps(noted))
        own_file(draft)
        draft.replace(place)


def main() -> None:
    """Compile the kernels of a scene: `python -m rig.analysis.pool.kernel_shapes SCENE`."""
    keep_to_one_core()
    run_briefly(load(sys.argv[1]))


if __name__ == "__main__":
    main()
