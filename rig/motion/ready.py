"""Prepares a system for a motion: mode sets, workspace, plan of its kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.lent_records import Loan
from rig.model.method import as_integrated
from rig.model.mode_sets import ModeSets
from rig.model.system import System
from rig.model.workspace import workspace
from rig.motion.plan import plan
from rig.solve.records import MotionPlan, Workspace

Array = NDArray[np.float64]


class Integration(NamedTuple):
    """How a motion is integrated: see `rig.motion.motion.Motion`. `loans`: what surrounds the plant, if anything."""

    step_ns: int
    method: str
    tolerance: float
    substeps: int
    smoothing: float
    limit: float
    with_energy: bool
    read: int
    loans: Sequence[Loan] = ()


class Ready(NamedTuple):
    """A system prepared for a motion to continue with, including mode sets and compiled code (`Motion.ready`)."""

    system: System
    outputs: list[dict[str, float]]
    mode_sets: ModeSets
    work: Workspace
    plan: MotionPlan
    event_text: Callable[[int, int], str]
    now: tuple[Array, NDArray[np.int64], Array]
    carry: Callable[..., int] | None


def prepared(system: System, outputs: list[dict[str, float]], integration: Integration) -> Ready:
    """The system as the method sees it, without mode sets. Raises ValueError if the method does not support it."""
    system = as_integrated(system, integration.method, integration.smoothing)
    mode_sets = ModeSets(
        system,
        integration.step_ns * 1e-9,
        outputs,
        integration.read,
        integration.substeps if integration.method == "kick" else 0,
    )
    return Ready(
        system,
        outputs,
        mode_sets,
        workspace(system, integration.read, mode_sets.tables.G.shape[1]),
        plan(
            system,
            integration.method,
            integration.substeps,
            integration.tolerance,
            integration.with_energy,
            integration.read > 0,
            integration.limit,
            integration.loans,
        ),
        cache(system.event_text),
        (np.zeros((1, system.n)), np.zeros(1, dtype=np.int64), np.zeros((len(outputs), 1))),
        None,
    )


def add(mode_sets: ModeSets, key: int) -> int:
    """The index of mode set `key`, which is built if it is missing."""
    if mode_sets.tables.mode_set_of[key] < 0:
        mode_sets.add(key)
    return int(mode_sets.tables.mode_set_of[key])


def build_ahead(mode_sets: ModeSets, now: int, keys: Iterable[int], most: int) -> None:
    """Build the mode sets `keys` and those that events of the contacts lead to from `now`.

    The latter only if there are at most `most` of them.
    """
    near = list(islice(mode_sets.system.contact_keys(now), most + 1))
    for key in (*keys, *(near if len(near) <= most else ())):
        with suppress(ArithmeticError, np.linalg.LinAlgError):  # no such motion exists: a run will not meet it
            add(mode_sets, key)


def parts(system: System) -> tuple[list[str], ...]:
    """What two systems must have in common for a motion to continue from one to the other."""
    return [p.name for p in system.patches], [k.name for k in system.normals], [s.name for s in system.sectors]


def carried_state(system: System, old: System, x: Array) -> Array:
    """The state [n] of `system` that follows state `x` of `old`.

    States of equal name keep their values, or the quantities that both systems conserve do.
    """
    values = dict(zip(old.names, x.tolist()))
    kept = np.array([values.get(name, start) for name, start in zip(system.names, system.start.tolist())])
    for name in (name for name in system.kept.keys() & old.kept.keys() if name in system.names):
        row, at = system.kept[name], system.names.index(name)
        kept[at] += (old.kept[name] @ x - row @ kept) / row[at]
    return kept
