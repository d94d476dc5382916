"""Compiling ahead: every kernel shape of the shipped scenes, once for these sources.

A kernel is compiled for the number of states and for what a method brings (laws over speed, fixed steps), never for a
value: many scenes share one shape. What is done is noted beside the compiled kernels, in the directory that belongs to
exactly these sources, so that it goes when they change.
"""

from __future__ import annotations

import compileall
import json
import os
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import NamedTuple

import llvmlite.binding

import controllers
import rig
import sensors
from rig import kernel, scenes
from rig.bench.stand import Stand
from rig.errors import NumericsError
from rig.scenes.scene import Scene
from rig.solve.method import chosen, crowded
from rig.solve.system import System
from rig.solve.tables import UNROLLED

FRAMES = 3
TYPICAL = 25.0  # s for one shape on one core, measured; only the first estimate


class Shape(NamedTuple):
    """What a compiled kernel depends on."""

    states: int  # 0: any number
    curved: bool
    fixed: bool
    products: bool
    kicks: bool = False


VARIANTS = tuple(
    Shape(*one)
    for one in product(range(UNROLLED + 1), (False, True), (False, True), (False, True), (False, True))
    if one[1] or not one[3]  # a product of states is no linear motion
    if not one[4] or (one[1] and one[2] and one[3])  # kicks come from products, in fixed steps
)
"""Every shape that there can be: what is compiled does not grow with the number of effects."""


def shape(scene: Scene) -> Shape:
    """The kernel shape of a scene."""
    return shape_of(scene.assemble().system(), scene.clock.method)


def shape_of(system: System, method: str) -> Shape:
    """The kernel shape of a system and a method of integration."""
    how, states = chosen(method, system), system.n if system.n <= UNROLLED else 0
    pressed = how == "kick" or (how in ("dopri5", "rk4") and crowded(system))
    curved = not system.linear or pressed or how == "smooth"
    return Shape(states, curved, how in ("rk4", "kick"), bool(system.products) or pressed, how == "kick")


def warmup(report: Callable[[str], object] | None = None, names: Iterable[str] | None = None) -> dict[Shape, float]:
    """Compile the kernels of the scenes `names`; by default of all shipped ones, and of the torture test.

    Seconds for each shape compiled. `report` gets a line before and after each shape, with an estimate of what is left.
    """
    for package in (rig, controllers, sensors):  # some systems are told to keep no bytecode: 0.2 s of each start
        compileall.compile_dir(Path(package.__path__[0]), quiet=2)
    if names is not None:
        return prepare([scenes.load(name) for name in names], report)
    from rig.study.torture.cells import needed  # it asks this module for shapes

    return prepare([*(scenes.load(name) for name in scenes.names()), *needed()], report)


def prepare(wanted_scenes: Iterable[Scene], report: Callable[[str], object] | None = None) -> dict[Shape, float]:
    """Compile what these scenes need and is not there yet; as `warmup`."""
    say = report or (lambda _: None)
    wanted: dict[Shape, list[Scene]] = {}
    for scene in wanted_scenes:
        wanted.setdefault(shape(scene), []).append(scene)
    done = ready()
    missing = [one for one in wanted if one not in done]
    many = f"{len(wanted)} kernel shapes in {sum(map(len, wanted.values()))} scenes"
    say(f"{many}, {len(missing)} to prepare; there can be {len(VARIANTS)}")
    spent: dict[Shape, float] = {}
    for number, one in enumerate(missing, 1):
        scene = wanted[one][0]
        each = max(spent.values(), default=TYPICAL)
        left = len(missing) - len(spent)
        say(
            f"{number} of {len(missing)}: {scene.name}, {one.states or 'many'} states; at most {each * left:.0f} s left"
        )
        begin = time.perf_counter()
        _run(scene)
        spent[one] = time.perf_counter() - begin
        note(one)
        say(f"{number} of {len(missing)}: ready after {spent[one]:.1f} s")
    return spent


def _run(scene: Scene) -> None:
    """Call what a run calls; a method that leaves the limits at this scene's step has been compiled all the same."""
    stand = Stand(scene)
    with suppress(NumericsError):
        for _ in range(FRAMES):
            stand.frame()
    stand.output_values()
    stand.statistics()


def ready() -> set[Shape]:
    """Shapes that have been compiled for these sources and this processor."""
    try:
        return {Shape(*one) for one in json.loads(_notes().read_text())}
    except (OSError, ValueError, TypeError):  # not there, or damaged: what is compiled is found all the same
        return set()


def _notes() -> Path:
    return kernel.FOLDER.path / f"warm-{llvmlite.binding.get_host_cpu_name()}.json"


def note(one: Shape) -> None:
    """Remember that the kernels of a shape have been compiled."""
    noted, place = sorted(ready() | {one}), _notes()
    draft = place.with_suffix(f".{os.getpid()}")
    try:
        draft.write_text(json.dumps(noted))
        draft.replace(place)
    except OSError:  # a read-only cache: the next start compiles again
        return
