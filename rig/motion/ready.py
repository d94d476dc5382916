"""Prepares a system for a motion: mode sets, workspace, the plan of its kernels with the compiled parts it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache, partial
from itertools import islice
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import types
from numpy.typing import NDArray

from rig.compiled.records import Lent, Loan, lent_type
from rig.model.method import as_integrated
from rig.model.mode_sets import FAST, ModeSets
from rig.model.system import System
from rig.model.tables import UNROLLED, empty
from rig.model.workspace import workspace
from rig.motion.compiled_parts import addresses
from rig.solve import collocation, dop853, dopri5, exact, expm, film_steps, forces, rk4, rosenbrock, runge_kutta_stage
from rig.solve.advance import advance, advance_block, evaluate_outputs
from rig.solve.contact_state import make_consistent
from rig.solve.frames import advance_frames
from rig.solve.records import PROGRESS, MotionPlan, MotionRecords, MotionState, Workspace, empty_log
from rig.solve.segment_output import empty_segments
from rig.solve.specialised import ANY, KernelShape
from rig.stability.report import fastest_eigenvalue

Array = NDArray[np.float64]
_OF_LONG_STEPS = 0.2  # share of the tolerance for the step of dop853: the path inside, of order 7, is less accurate
_STATE = (PROGRESS, float, float, float, np.int64, np.int64, float)
"""Types of the arrays of MotionState."""


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


def plan(
    system: System,
    method: str,
    substeps: int,
    tolerance: float,
    with_energy: bool,
    emitting: bool,
    limit: float,
    loans: Sequence[Loan],
    step: float,
) -> MotionPlan:
    """The plan for a system as its method sees it, at ticks of `step` [s]. Missing parts are compiled.

    `loans`: sensors, compiled controllers and random numbers of the run, if any (rig.solve.frames.Surroundings).
    """
    many_states = system.n > UNROLLED
    fixed_steps = method in ("rk4", "kick")
    nonlinear = not system.linear
    made = MotionPlan(
        advance_block=0,
        make_consistent=0,
        linear_stretch=0,
        quiet_ticks=0,
        certified_cell=0,
        stretch=0,
        take_steps=0,
        whole_derivative=0,
        inputs_of_state=0,
        raise_to_rounding=0,
        input_slopes_of_state=0,
        memory_errors=0,
        take_cell=0,
        first_event_of_fits=0,
        emit_graded=0,
        degree=dop853.DEGREE if method == "dop853" else 4,
        many_states=int(many_states),
        nonlinear=int(nonlinear),
        fixed_steps=int(fixed_steps),
        substeps=substeps,
        tolerance=float(tolerance) * (_OF_LONG_STEPS if method == "dop853" else 1.0),
        with_energy=int(with_energy),
        emitting=int(emitting),
        limit=float(limit),
    )
    wanted: dict[str, tuple[Any, KernelShape]] = {}  # those that take longest to compile come first
    if fixed_steps or nonlinear:
        code = {"kick": film_steps, "rk4": rk4}.get(method, dopri5)
        wanted["stretch"] = code.stretch, ANY
    if not fixed_steps:
        wanted["linear_stretch"] = exact.stretch, ANY
    if (fixed_steps or nonlinear) and method != "kick":
        shape = KernelShape(0 if many_states else system.n, bool(system.products) or system.remembers, nonlinear)
        own = {"rosenbrock": rosenbrock.take_implicit_steps, "dop853": dop853.take_long_steps}
        wanted["take_steps"] = own.get(method, code.take_steps), shape
        if not fixed_steps:
            wanted["whole_derivative"] = runge_kutta_stage.whole_derivative, shape
            wanted["raise_to_rounding"] = dopri5.raise_to_rounding, ANY
        if method == "rosenbrock":
            wanted["input_slopes_of_state"] = rosenbrock.input_slopes_of_state, ANY
            wanted["memory_errors"] = rosenbrock.memory_errors, ANY
    if nonlinear:
        wanted["inputs_of_state"] = forces.inputs_of_state, ANY
    wanted |= {"advance_block": (advance_block, ANY), "make_consistent": (make_consistent, ANY)}
    if not fixed_steps:
        shape = KernelShape(0 if many_states else system.n, products=False, nonlinear=False)
        wanted["certified_cell"] = exact.certified_cell, shape
        if not many_states:
            wanted["quiet_ticks"] = exact.quiet_ticks, shape

    def more(common: Sequence[Any]) -> list[tuple[Any, tuple[Any, ...]]]:
        tables, *carried, ticks = common
        loan = Lent(types.NamedTuple([lent.content for lent in carried], MotionRecords))
        matrix = types.Array(types.float64, 2, "C")
        indices = types.Array(types.int64, 1, "C")
        block = tables, loan, types.boolean, ticks, ticks
        soon = _for_stiff(made).values() if fastest_eigenvalue(system) * step > FAST else ()
        functions: list[tuple[Any, tuple[Any, ...]]] = [(function, (shape, *common)) for function, shape in soon]
        if loans:
            functions.append((advance_frames, (*block, ticks, *map(numba.typeof, loans))))
        else:
            functions.append((advance, block))
        functions.append((evaluate_outputs, (tables, loan, matrix, indices, matrix, ticks)))
        functions.append((expm.ladder, (matrix, types.float64)))
        return functions

    return made._replace(**addresses(wanted, partial(_kinds, system, made), more))


def _for_stiff(plan: MotionPlan) -> dict[str, tuple[Any, KernelShape]]:
    """The parts that stiff mode sets need."""
    wanted = {}
    if not plan.fixed_steps:
        wanted["first_event_of_fits"] = exact.first_event_of_fits, ANY
        if plan.emitting:
            wanted["emit_graded"] = exact.emit_graded, ANY
        if plan.nonlinear:
            wanted["take_cell"] = collocation.take_cell, ANY
    return wanted


def _kinds(system: System, plan: MotionPlan) -> list[Any]:
    """The types of the arguments of the parts, behind the shape."""
    records = (
        empty(system, 1.0, 0, 0),
        workspace(system, 0, 0),
        MotionState(*(np.zeros(0, dtype=kind) for kind in _STATE)),
        empty_log(0, 0),
        empty_segments(0, 0),
        plan,
    )
    return [*map(lent_type, records), types.int64]


def completed(plan: MotionPlan, system: System) -> MotionPlan:
    """The plan with the parts that stiff mode sets need. Those that are not compiled yet are compiled."""
    if plan.fixed_steps or plan.first_event_of_fits:
        return plan
    return plan._replace(**addresses(_for_stiff(plan), partial(_kinds, system, plan), lambda _: ()))


def prepared(system: System, outputs: list[dict[str, float]], integration: Integration) -> Ready:
    """The system as the method sees it, without mode sets. Raises ValueError if the method does not support it."""
    system = as_integrated(system, integration.method, integration.smoothing)
    step = integration.step_ns * 1e-9
    implicit = integration.method == "rosenbrock"
    mode_sets = ModeSets(system, step, outputs, integration.read, integration.substeps, implicit)
    work = workspace(system, integration.read, mode_sets.tables.G.shape[1])
    plan_of_system = plan(
        system,
        integration.method,
        integration.substeps,
        integration.tolerance,
        integration.with_energy,
        integration.read > 0,
        integration.limit,
        integration.loans,
        step,
    )
    now = (np.zeros((1, system.n)), np.zeros(1, dtype=np.int64), np.zeros((len(outputs), 1)))
    return Ready(system, outputs, mode_sets, work, plan_of_system, cache(system.event_text), now, None)


def add(mode_sets: ModeSets, key: int) -> int:
    """The index of mode set `key`, which is built if it is missing."""
    if mode_sets.tables.mode_set_of[key] < 0:
        mode_sets.add(key)
    return int(mode_sets.tables.mode_set_of[key])


def build_ahead(mode_sets: ModeSets, now: int, keys: Iterable[int], most: int) -> bool:
    """Build the mode sets `keys` and those that events of the contacts lead to from `now`.

    The latter only if there are at most `most` of them. Returns whether a run may meet a stiff one.
    """
    near = list(islice(mode_sets.system.contact_keys(now), most + 1))
    for key in (*keys, *(near if len(near) <= most else ())):
        with suppress(ArithmeticError, np.linalg.LinAlgError):  # no such motion exists: a run will not meet it
            add(mode_sets, key)
    return mode_sets.stiff or len(near) > most


def parts(system: System) -> tuple[list[str], ...]:
    """What two systems must have in common for a motion to continue from one to the other."""
    film = [] if system.film is None else [f"{system.film.points} points in {system.film.directions} directions"]
    return [p.name for p in system.patches], [k.name for k in system.normals], [s.name for s in system.sectors], film


def carried_state(system: System, old: System, x: Array) -> Array:
    """The state [n] of `system` that follows state `x` of `old`.

    States of equal name keep their values, or the quantities that both systems conserve do.
    """
    values = dict(zip(old.names, x.tolist()))
    kept = np.array([values.get(name, start) for name, start in zip(system.names, system.start.tolist())])
    for name, row in system.kept.items():  # in their order: each starts from what those before it gave
        if name not in old.kept or name not in system.names:
            continue
        at = system.names.index(name)
        kept[at] += (old.kept[name] @ x - row @ kept) / row[at]
    return kept
