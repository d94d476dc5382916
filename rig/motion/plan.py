"""How a motion is advanced: its method and options as the kernels take them, and the compiled parts that it needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from numba.core import types

from rig.lent_records import Lent, Loan, lent_type
from rig.model.system import System
from rig.model.tables import UNROLLED, empty
from rig.model.workspace import workspace
from rig.motion.compiled_parts import addresses
from rig.solve import dopri5, exact, expm, film_steps, kick, rk4, runge_kutta_stage
from rig.solve.advance import advance, advance_block, evaluate_outputs
from rig.solve.contact_state import make_consistent
from rig.solve.frames import advance_frames
from rig.solve.records import MotionPlan, MotionRecords, MotionState, empty_log
from rig.solve.segment_output import empty_segments
from rig.solve.specialised import ANY, KernelShape

_STATE = (np.int64, float, float, float, float, np.int64, np.int64, float)
"""Types of the arrays of MotionState."""


def plan(
    system: System,
    method: str,
    substeps: int,
    tolerance: float,
    with_energy: bool,
    emitting: bool,
    limit: float,
    loans: Sequence[Loan],
) -> MotionPlan:
    """The plan for a system as its method sees it. Parts that are not compiled yet are compiled.

    `loans`: sensors, compiled controllers and random numbers of the run, if any (rig.solve.frames.Surroundings).
    """
    many_states, fixed_steps, nonlinear = system.n > UNROLLED, method in ("rk4", "kick"), not system.linear
    made = MotionPlan(
        advance_block=0,
        make_consistent=0,
        linear_stretch=0,
        quiet_ticks=0,
        certified_cell=0,
        stretch=0,
        take_steps=0,
        whole_derivative=0,
        many_states=int(many_states),
        nonlinear=int(nonlinear),
        fixed_steps=int(fixed_steps),
        substeps=substeps,
        tolerance=float(tolerance),
        with_energy=int(with_energy),
        emitting=int(emitting),
        limit=float(limit),
    )
    wanted = {"advance_block": (advance_block, ANY), "make_consistent": (make_consistent, ANY)}
    if not fixed_steps:
        wanted["linear_stretch"] = exact.stretch, ANY
        shape = KernelShape(0 if many_states else system.n, products=False, nonlinear=False)
        wanted["certified_cell"] = exact.certified_cell, shape
        if not many_states:
            wanted["quiet_ticks"] = exact.quiet_ticks, shape
    if fixed_steps or nonlinear:
        code = {"kick": kick if system.film is None else film_steps, "rk4": rk4}.get(method, dopri5)
        if method != "kick":
            shape = KernelShape(0 if many_states else system.n, bool(system.products), nonlinear)
            wanted["take_steps"] = code.take_steps, shape
            if not fixed_steps:
                wanted["whole_derivative"] = runge_kutta_stage.whole_derivative, shape
        wanted["stretch"] = code.stretch, ANY

    def kinds() -> list[Any]:
        records = (
            empty(system, 1.0, 0, 0, 0),
            workspace(system, 0, 0),
            MotionState(*(np.zeros(0, dtype=kind) for kind in _STATE)),
            empty_log(0, 0),
            empty_segments(0, 0),
            made,
        )
        return [*map(lent_type, records), types.int64]

    def more(common: Sequence[Any]) -> list[tuple[Any, tuple[Any, ...]]]:
        tables, *carried, ticks = common
        loan = Lent(types.NamedTuple([one.content for one in carried], MotionRecords))
        matrix = types.Array(types.float64, 2, "C")
        block = tables, loan, types.boolean, ticks, ticks
        return [
            (advance_frames, (*block, ticks, *map(numba.typeof, loans))) if loans else (advance, block),
            (evaluate_outputs, (tables, loan, matrix, types.Array(types.int64, 1, "C"), matrix, ticks)),
            (expm.ladder, (matrix, types.float64)),
        ]

    return made._replace(**addresses(wanted, kinds, more))
