"""What the kernels read for a system: tables stacked by mode set.

A guard g = G x is certified free of events over a cell of length h if it exceeds, at both ends, the bound b = B.|x|,
B_j = 1.25 h^2/8 max |(G A^2 exp(A t))_j|. This bounds the interpolation error of the chord, so g cannot reach zero.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model import film_tables, friction_law, many_states_tables, products
from rig.model.energy_forms import supplied
from rig.model.system import System
from rig.model.workspace import scratch_for_memory
from rig.solve.energy_balance import TERMS
from rig.solve.exact import PLACES
from rig.solve.film_steps import FilmTables
from rig.solve.forces import MemoryTables, ProductTables
from rig.solve.many_states import ManyStatesTables
from rig.solve.segment_output import DEGREE

Array = NDArray[np.float64]
UNROLLED = 8
"""Up to this number of states, compiled code has it as a constant; above, the same code serves all rigs."""


class Tables(NamedTuple):
    """Tables of all mode sets visited so far, stacked by mode set. I: number of inputs T.

    Unknown mode sets have the entry -1 in `mode_set_of`. Arrays that a rig does not need have length zero, so that all
    tables have one type and kernels compile once.
    """

    mode_set_of: NDArray[np.int32]  # [mode sets]
    used: NDArray[np.int64]  # [mode set] number of events before its last use
    depth: NDArray[np.int64]  # [mode set]
    room: NDArray[np.int64]  # [mode set] most segments of a tick; 0: stiff, they are graded
    order: NDArray[np.int64]  # [mode set] number of Taylor terms of the finest cell
    curved: NDArray[np.int64]  # [mode set] 1: not linear: a slipping patch has speed-dependent friction, or products
    stuck: NDArray[np.int64]  # [mode set] 1: at least one patch sticks
    lands: NDArray[np.int64]  # [mode set] 1: the landing projection is not the identity
    E: Array  # [mode set, level, n, n] propagators over step / 2^level minus one, landing included
    A: Array  # [mode set, n, n]
    b: Array  # [mode set, n, I]
    landing: Array  # [mode set, n, n]
    guards: NDArray[np.int64]  # [mode set] number of guards
    kind: NDArray[np.int64]  # [mode set, guard]
    owner: NDArray[np.int64]  # [mode set, guard]
    G: Array  # [mode set, guard, n]
    GT: Array  # [mode set, guard, I]
    GA: Array  # [mode set, guard, n]
    B: Array  # [mode set, guard, n] chord bound over one step
    BA: Array  # [mode set, guard, n] the same for the guard's slope
    normal: Array  # [mode set, K, n]
    normal_t: Array  # [mode set, K, I]
    friction: Array  # [mode set, P, n]
    friction_t: Array  # [mode set, P, I]
    load: Array  # [mode set, P, n] sum of the closed normal forces of a patch
    load_t: Array  # [mode set, P, I]
    sigma: Array  # [mode set, P]
    law_speed: Array  # [mode set, P, n] sigma times the slip speed
    law_load: Array  # [mode set, P, n] sigma times the load
    law_load_t: Array  # [mode set, P, I]
    signals: Array  # [mode set, S, n] outputs that sensors read
    signals_t: Array  # [mode set, S, I]
    along: Array  # [mode set, level, guard and output, place, n] their changes in a cell, for stiff mode sets
    graded: NDArray[np.int64]  # [mode set] levels of `reach`; 0: dopri5 takes explicit steps
    reach: Array  # [mode set, level, place, n, n + inputs x nodes] change in a cell (rig.solve.collocation)
    gain: Array  # [mode set, level, n, inputs] largest change of a state in a cell by an input of 1
    output_needs_inputs: NDArray[np.int64]  # [mode set, S] 1: the output depends on the inputs
    coupled: NDArray[np.int64]  # [mode set] 1: a load depends on the friction forces T
    guard_needs_inputs: NDArray[np.int64]  # [mode set, guard] 1: the guard depends on the inputs
    press: Array  # [mode set, K, n] closed normal forces, 0 for open ones
    press_t: Array  # [mode set, K, I]
    press_entries: NDArray[np.int64]  # rig.solve.column_blocks.sparse_dot: of the rows of this name
    press_t_entries: NDArray[np.int64]
    friction_entries: NDArray[np.int64]
    friction_t_entries: NDArray[np.int64]
    law_speed_entries: NDArray[np.int64]
    law_load_entries: NDArray[np.int64]
    law_load_t_entries: NDArray[np.int64]
    A_entries: NDArray[np.int64]  # without rows if friction forces are the only inputs
    b_entries: NDArray[np.int64]
    active: NDArray[np.int64]  # [mode set, terms] 1: the power is not identically zero
    powers: Array  # [mode set, terms, n, n] quadratic forms of power
    work: Array  # [mode set, level, terms, n, n] their integrals over step / 2^level
    slip: Array  # [P, n] slip speed rows
    surface: Array  # [P, n] surface speed: slip speed plus speed of the body along the friction force
    lift: Array  # [K, n] rows of the speed along each normal force
    damping: Array  # [mode set, nq, nq]
    force: Array  # [nq, n]
    force_t: Array  # [nq, products]
    static: Array  # [mode set, P]
    static_back: Array  # [mode set, P] against a friction force in negative direction
    code: NDArray[np.int64]  # [mode set, P]
    numbers: Array  # [mode set, P, widest]
    patch_of_normal: NDArray[np.int64]  # [K]
    sticks: NDArray[np.int64]  # [P] 0: its law has presliding instead of stick
    opens: NDArray[np.int64]  # [K] 1: the contact opens at N = 0; 0: it transmits tension too
    limiters: NDArray[np.int64]  # [1] number of limiters
    sectors: NDArray[np.int64]  # [sector row] number of sectors
    turn: NDArray[np.int64]  # [sector row] the state that is shifted by a period
    commanded: NDArray[np.int64]  # [switch] the state that commands its position
    positions: NDArray[np.int64]  # [switch] number of positions
    generators: NDArray[np.int64]  # [generator, 2] states a, b with a' = rate b, b' = -rate a
    generator_rate: Array  # [generator]
    store: Array  # [mode set, n, n] twice the energy in the network
    loss: Array  # [mode set, resistor, n] power: the square of this row times x, times the
    conductance: Array  # [resistor]
    path: Array  # [sector row, n] position along the path
    edges: Array  # [sector row, widest + 1] the last is the period
    change: Array  # [sector row, widest, nq, nq] stiffness that a sector adds; no rows if none does
    products: ProductTables
    memory: MemoryTables
    many_states: ManyStatesTables  # of rigs with many states
    film: FilmTables  # of rigs with a film
    step: Array  # [1] s


_FEW_STATES = many_states_tables.empty(0, 0, 0, 0, 0)
"""What all rigs without many states have in place of their tables."""


@cache
def _no_rows(shape: int | tuple[int, ...], dtype: type = np.float64) -> NDArray[Any]:
    """An array without numbers, the same for all tables."""
    none: NDArray[Any] = np.zeros(shape, dtype)
    assert not none.size
    return none


def sparse(s: System) -> dict[str, tuple[int, int]]:
    """Rows whose entries that are not zero are listed in the tables, by name, and the shape of each."""
    n = s.n
    P = len(s.patches)
    K = len(s.normals)
    I = s.inputs
    whole = n if P < I else 0  # each product and each rate of a law is an input: most entries are zero
    return {
        "press": (K, n),
        "press_t": (K, I),
        "friction": (P, n),
        "friction_t": (P, I),
        "law_speed": (P, n),
        "law_load": (P, n),
        "law_load_t": (P, I),
        "A": (whole, n),
        "b": (whole, I),
    }


def empty(s: System, step: float, signals: int, read: int) -> Tables:
    """Tables without a mode set. `signals`: number of outputs; the other arguments as in ModeSets."""
    n = s.n
    nq = len(s.coordinates)
    P = len(s.patches)
    K = len(s.normals)
    S = signals
    I = s.inputs
    g = 2 * P + K + 2 * len(s.limiters) + 2 * len(s.sectors)
    nodes = max((len(sector.edges) + 1 for sector in s.sectors), default=1)
    edges = np.zeros((len(s.sectors), nodes))
    for i, sector in enumerate(s.sectors):
        edges[i, : len(sector.edges) + 1] = (*sector.edges, sector.period)
    varies = any(sector.changes for sector in s.sectors)
    change = np.zeros((len(s.sectors), nodes - 1, nq, nq) if varies else (0, 1, 1, 1))
    for i, sector in enumerate(s.sectors):
        for at, addition in enumerate(sector.changes):
            change[i, at] = addition.stiffness
    widest = friction_law.width(law for p in range(P) for law in s.laws(p))
    directions = np.array([k.direction for k in s.normals]).reshape(K, nq)
    z = _no_rows
    return Tables(
        mode_set_of=np.full(s.keys, -1, dtype=np.int32),
        used=z(0, dtype=np.int64),
        depth=z(0, dtype=np.int64),
        room=z(0, dtype=np.int64),
        order=z(0, dtype=np.int64),
        curved=z(0, dtype=np.int64),
        stuck=z(0, dtype=np.int64),
        lands=z(0, dtype=np.int64),
        E=z((0, 1, n, n)),
        A=z((0, n, n)),
        b=z((0, n, I)),
        landing=z((0, n, n)),
        guards=z(0, dtype=np.int64),
        kind=z((0, g), dtype=np.int64),
        owner=z((0, g), dtype=np.int64),
        G=z((0, g, n)),
        GT=z((0, g, I)),
        GA=z((0, g, n)),
        B=z((0, g, n)),
        BA=z((0, g, n)),
        normal=z((0, K, n)),
        normal_t=z((0, K, I)),
        friction=z((0, P, n)),
        friction_t=z((0, P, I)),
        load=z((0, P, n)),
        load_t=z((0, P, I)),
        sigma=z((0, P)),
        law_speed=z((0, P, n)),
        law_load=z((0, P, n)),
        law_load_t=z((0, P, I)),
        signals=z((0, S, n)),
        signals_t=z((0, S, I)),
        along=z((0, 0, g + read, len(PLACES), n)),
        graded=z(0, dtype=np.int64),
        reach=z((0, 0, len(PLACES), n, n + I * (DEGREE + 1))),
        gain=z((0, 0, n, I)),
        output_needs_inputs=z((0, S), dtype=np.int64),
        coupled=z(0, dtype=np.int64),
        guard_needs_inputs=z((0, g), dtype=np.int64),
        press=z((0, K, n)),
        press_t=z((0, K, I)),
        **{f"{name}_entries": z((0, rows, 1 + columns), dtype=np.int64) for name, (rows, columns) in sparse(s).items()},
        active=z((0, TERMS), dtype=np.int64),
        powers=z((0, TERMS, n, n)),
        work=z((0, 1, TERMS, n, n)),
        slip=s.slip_rows.copy(),
        surface=supplied(s),
        lift=directions @ np.eye(n)[nq : 2 * nq],
        damping=z((0, nq, nq)),
        force=s.force.copy(),
        force_t=s.force_t.copy(),
        static=z((0, P)),
        static_back=z((0, P)),
        code=z((0, P), dtype=np.int64),
        numbers=z((0, P, widest)),
        patch_of_normal=np.array([k.patch for k in s.normals], dtype=np.int64),
        sticks=np.array([not patch.law.presliding for patch in s.patches], dtype=np.int64),
        opens=np.array([k.opens for k in s.normals], dtype=np.int64),
        limiters=np.array([len(s.limiters)]),
        sectors=np.array([len(sector.edges) for sector in s.sectors], dtype=np.int64),
        turn=np.array([sector.turn for sector in s.sectors], dtype=np.int64),
        commanded=np.array([switch.state for switch in s.switches], dtype=np.int64),
        positions=np.array([len(switch.positions) for switch in s.switches], dtype=np.int64),
        generators=np.array([pair for *pair, _ in s.generators], dtype=np.int64).reshape(-1, 2),
        generator_rate=np.array([rate for *_, rate in s.generators], dtype=np.float64),
        store=z((0, n, n)),
        loss=z((0, len(s.losses), n)),
        conductance=np.array([loss.conductance for loss in s.losses]),
        path=np.array([sector.row for sector in s.sectors]).reshape(-1, n),
        edges=edges,
        change=change,
        products=products.pack(s.products, n, P, K),
        memory=scratch_for_memory(s),
        many_states=many_states_tables.empty(n, I, g, read, S) if n > UNROLLED else _FEW_STATES,
        film=film_tables.no_film(),
        step=np.array([step]),
    )
