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
from rig.solve.advance import advance, carry, evaluate
from rig.solve.frames import frames
from rig.solve.records import Carried, Log, Plan, State
from rig.solve.segment_output import empty_segments
from rig.solve.specialised import ANY, Shape

_STATE = (np.int64, float, float, float, float, np.int64, np.int64, float)
"""Types of the arrays of State."""
_WHOLE = np.zeros((0, 4), dtype=np.int64)


def plan(
    system: System,
    method: str,
    substeps: int,
    tolerance: float,
    with_energy: bool,
    emitting: bool,
    limit: float,
    loans: Sequence[Loan],
) -> Plan:
    """The plan for a system as its method sees it. Parts that are not compiled yet are compiled.

    `loans`: sensors, compiled controllers and random numbers of the run, if any (rig.solve.frames.Surroundings).
    """
    wide, fixed, bends = system.n > UNROLLED, method in ("rk4", "kick"), not system.linear
    made = Plan(
        carry=0,
        linear=0,
        quiet=0,
        stretch=0,
        steps=0,
        whole=0,
        wide=int(wide),
        bends=int(bends),
        fixed=int(fixed),
        substeps=substeps,
        tolerance=float(tolerance),
        with_energy=int(with_energy),
        emitting=int(emitting),
        limit=float(limit),
    )
    wanted = {"carry": (carry, ANY)}
    if not fixed:
        wanted["linear"] = exact.stretch, ANY
        if not wide:
            wanted["quiet"] = exact.quiet, Shape(system.n, products=False, bends=False)
    if fixed or bends:
        code = {"kick": kick if system.film is None else film_steps, "rk4": rk4}.get(method, dopri5)
        if method != "kick":
            shape = Shape(0 if wide else system.n, bool(system.products), bends)
            wanted["steps"] = code.steps, shape
            if not fixed:
                wanted["whole"] = runge_kutta_stage.whole, shape
        wanted["stretch"] = code.stretch, ANY

    def kinds() -> list[Any]:
        records = (
            empty(system, 1.0, 0, 0, 0),
            workspace(system, 0, 0),
            State(*(np.zeros(0, dtype=kind) for kind in _STATE)),
            Log(np.zeros((0, 0)), np.zeros(0, dtype=np.int64), _WHOLE, np.zeros(0)),
            empty_segments(0, 0),
            made,
        )
        return [*map(lent_type, records), types.int64]

    def more(common: Sequence[Any]) -> list[tuple[Any, tuple[Any, ...]]]:
        tables, *carried, ticks = common
        loan = Lent(types.NamedTuple([one.content for one in carried], Carried))
        matrix = types.Array(types.float64, 2, "C")
        block = tables, loan, types.boolean, ticks, ticks
        return [
            (frames, (*block, ticks, *map(numba.typeof, loans))) if loans else (advance, block),
            (evaluate, (tables, loan, matrix, types.Array(types.int64, 1, "C"), matrix)),
            (expm.ladder, (matrix, types.float64)),
        ]

    return made._replace(**addresses(wanted, kinds, more))
