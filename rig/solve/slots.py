"""Mode sets as arrays: the tables a kernel needs for each mode set, built when a run first visits it.

Only a few of the possible mode sets are ever visited, so a kernel that meets an unknown one returns and asks for it.
A command, a slope or a speed target is a state, so no command ever rebuilds a table.

A guard g = G x is certified free of events over a cell of length h when it exceeds, at both ends, the bound
b = B.|x|, B_j = 1.25 h^2/8 max |(G A^2 exp(A t))_j|: the interpolation error of a chord cannot reach zero then.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import bundle
from rig.solve import expm, kick, laws, products, wide
from rig.solve.formulation import ModeSet, assemble
from rig.solve.kick import Flow
from rig.solve.ledger import (
    NODES,
    TERMS,
    at_nodes,
    damping,
    loss_rows,
    powers,
    store,
    supplied,
    work,
)
from rig.solve.products import Products
from rig.solve.roots import DEGREE
from rig.solve.system import HIGH, LOW, STICK, System
from rig.solve.wide import Wide

Array = NDArray[np.float64]
UNROLLED = 8
"""States up to which their number is a constant of the compiled code; above, one compiled code serves all rigs."""
_SAMPLES = 128
_MARGIN = 1.25


class Tables(NamedTuple):
    """All mode sets visited so far, stacked by slot; unknown ones have slot -1 in `slot_of`. I: number of inputs T."""

    slot_of: NDArray[np.int32]  # [mode sets]
    depth: NDArray[np.int64]  # [slot]
    order: NDArray[np.int64]  # [slot] terms of a finest cell's Taylor polynomial
    curved: NDArray[np.int64]  # [slot] 1: not linear: a slipping patch has a law over speed, or there are products
    stuck: NDArray[np.int64]  # [slot] 1: some patch sticks
    lands: NDArray[np.int64]  # [slot] 1: landing moves something
    E: Array  # [slot, level, n, n] propagators over step / 2^level less one, landing folded in
    A: Array  # [slot, n, n]
    b: Array  # [slot, n, I]
    landing: Array  # [slot, n, n]
    guards: NDArray[np.int64]  # [slot] number of guards
    kind: NDArray[np.int64]  # [slot, guard]
    owner: NDArray[np.int64]  # [slot, guard]
    G: Array  # [slot, guard, n]
    GT: Array  # [slot, guard, I]
    GA: Array  # [slot, guard, n]
    B: Array  # [slot, guard, n] bound of the chord over one step
    BA: Array  # [slot, guard, n] the same for the guard's slope
    normal: Array  # [slot, K, n]
    normal_t: Array  # [slot, K, I]
    friction: Array  # [slot, P, n]
    friction_t: Array  # [slot, P, I]
    load: Array  # [slot, P, n] sum of the closed normal forces of a patch
    load_t: Array  # [slot, P, I]
    sigma: Array  # [slot, P]
    signals: Array  # [slot, S, n] quantities the sensors read
    signals_t: Array  # [slot, S, I]
    coupled: NDArray[np.int64]  # [slot] 1: some load depends on the friction forces T
    needs: NDArray[np.int64]  # [slot, guard] 1: the guard depends on the inputs
    press: Array  # [slot, K, n] the normal forces that are closed, 0 for the others
    press_t: Array  # [slot, K, I]
    active: NDArray[np.int64]  # [slot, terms] 1: the power is not zero throughout
    powers: Array  # [slot, terms, n, n] quadratic forms of power
    work: Array  # [slot, level, terms, n, n] their integrals over step / 2^level
    slip: Array  # [P, n] slip speed rows
    surface: Array  # [P, n] slip speed and the speed of the body under the friction force: what the drive supplies
    lift: Array  # [K, n] rows of the speed along each normal force
    damping: Array  # [slot, nq, nq]
    force: Array  # [nq, n]
    force_t: Array  # [nq, products]
    static: Array  # [slot, P]
    code: NDArray[np.int64]  # [slot, P]
    numbers: Array  # [slot, P, widest]
    of_patch: NDArray[np.int64]  # [K]
    limiters: NDArray[np.int64]  # [1] number of limiters
    sectors: NDArray[np.int64]  # [sector row] number of sectors
    turn: NDArray[np.int64]  # [sector row] the state that is moved by a period
    commanded: NDArray[np.int64]  # [switch] the state that says its position
    positions: NDArray[np.int64]  # [switch] how many it has
    store: Array  # [slot, n, n] twice the energy in the network
    loss: Array  # [slot, resistor, n] their heat is the square of this, times the
    conductance: Array  # [resistor]
    path: Array  # [sector row, n] place
    edges: Array  # [sector row, widest + 1] the last is the period
    change: Array  # [sector row, widest, nq, nq] what a sector adds to the stiffness; no row where none does
    products: Products | None
    wide: Wide | None  # of rigs with many states
    flow: Flow | None  # of the method kick
    step: Array  # [1] s


class Slots:
    """The mode sets of one run: `tables` for the kernels, `add(key)` when one is met for the first time."""

    def __init__(
        self, system: System, step: float, signals: list[dict[str, float]], read: int = 0, kicks: int = 0
    ) -> None:
        """`signals`: extended rows (rig.solve.assembly) of the rig's outputs, sensors read the first; `step` in s.

        `kicks`: steps of the method kick in a `step`; 0 for other methods.
        """
        self.read, self._kicks = read, kicks
        self.system = system
        self.step = step
        self.rows = signals
        self.sets: list[ModeSet] = []
        self.tables = self._empty()
        self.handle = bundle(self.tables)

    def _empty(self) -> Tables:
        s = self.system
        n, nq, P, K, S = s.n, len(s.coordinates), len(s.patches), len(s.normals), len(self.rows)
        I = s.inputs
        g = 2 * P + K + 2 * len(s.limiters) + 2 * len(s.sectors)
        nodes = max((len(sector.edges) + 1 for sector in s.sectors), default=1)
        edges = np.zeros((len(s.sectors), nodes))
        for i, sector in enumerate(s.sectors):
            edges[i, : len(sector.edges) + 1] = (*sector.edges, sector.period)
        varies = any(sector.changes for sector in s.sectors)
        change = np.zeros((len(s.sectors), nodes - 1, nq, nq) if varies else (0, 1, 1, 1))
        for i, sector in enumerate(s.sectors):
            for at, one in enumerate(sector.changes):
                change[i, at] = one.stiffness
        z = np.zeros
        return Tables(
            slot_of=np.full(s.keys, -1, dtype=np.int32),
            depth=z(0, dtype=np.int64),
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
            signals=z((0, S, n)),
            signals_t=z((0, S, I)),
            coupled=z(0, dtype=np.int64),
            needs=z((0, g), dtype=np.int64),
            press=z((0, K, n)),
            press_t=z((0, K, I)),
            active=z((0, TERMS), dtype=np.int64),
            powers=z((0, TERMS, n, n)),
            work=z((0, 1, TERMS, n, n)),
            slip=s.slip_rows.copy(),
            surface=supplied(s),
            lift=np.array([k.direction for k in s.normals]).reshape(K, nq) @ np.eye(n)[nq : 2 * nq],
            damping=z((0, nq, nq)),
            force=s.force.copy(),
            force_t=s.force_t.copy(),
            static=z((0, P)),
            code=z((0, P), dtype=np.int64),
            numbers=z((0, P, laws.width(tuple(law for p in range(P) for law in s.laws(p))))),
            of_patch=np.array([k.patch for k in s.normals], dtype=np.int64),
            limiters=np.array([len(s.limiters)]),
            sectors=np.array([len(sector.edges) for sector in s.sectors], dtype=np.int64),
            turn=np.array([sector.turn for sector in s.sectors], dtype=np.int64),
            commanded=np.array([switch.state for switch in s.switches], dtype=np.int64),
            positions=np.array([len(switch.positions) for switch in s.switches], dtype=np.int64),
            store=z((0, n, n)),
            loss=z((0, len(s.losses), n)),
            conductance=np.array([loss.conductance for loss in s.losses]),
            path=np.array([sector.row for sector in s.sectors]).reshape(-1, n),
            edges=edges,
            change=change,
            products=products.pack(s.products, n, P, K),
            wide=wide.empty(n, g, self.read, S) if n > UNROLLED else None,
            flow=kick.empty(n) if self._kicks else None,
            step=np.array([self.step]),
        )

    def add(self, key: int) -> ModeSet:
        """Assemble mode set `key` and append its tables; returns the mode set."""
        system = self.system
        modes = assemble(system, key)
        t = self.tables
        g = t.G.shape[1]
        guards = _padded(modes.guards, g)
        E = expm.ladder(modes.A, self.step)
        if t.wide is None:
            order, nodes = (
                expm.order(modes.A, self.step),
                at_nodes(modes.A, modes.landing, self.step / 2.0 ** (len(E) - 1)),
            )
        else:
            E = E[: wide.depth(modes.A, self.step) + 1]
            terms = wide.series(modes.A, self.step / 2.0 ** (len(E) - 1))
            order, nodes = DEGREE, wide.at(NODES, terms) @ modes.landing
        E = (modes.landing - np.eye(system.n)) + modes.landing @ E @ modes.landing
        bounds, slopes = np.zeros((2, g, system.n))
        if t.wide is None or len(E) > 1:
            bounds, slopes = _bounds(modes.A, guards, self.step)
        forms = powers(system, modes)
        integrals = work(nodes, forms, self.step, E)
        patch_modes, normal_modes, _, sector_modes, _ = system.modes(key)
        met = tuple(system.law(p, sector_modes) for p in range(len(system.patches)))
        code, numbers = laws.pack(met, t.numbers.shape[2])
        closed = 1.0 - np.array(normal_modes, dtype=np.float64).reshape(-1, 1)
        load, load_t = np.zeros_like(modes.friction), np.zeros_like(modes.friction_t)
        for k, contact in enumerate(system.normals):
            if normal_modes[k] == 0:
                load[contact.patch] += modes.normal[k]
                load_t[contact.patch] += modes.normal_t[k]
        rows, rows_t = signal_rows(system, modes, self.rows)
        broad: dict[str, Array] = {}
        if t.wide is not None:
            broad = wide.tables(terms, E, modes.landing, guards, bounds, rows, self.read)
        slot_of = t.slot_of.copy()
        slot_of[key] = len(self.sets)
        new: dict[str, Any] = {
            "depth": len(E) - 1,
            "order": order,
            "curved": int(bool(modes.nonlinear.any()) or bool(system.products)),
            "stuck": int(STICK in patch_modes),
            "lands": int(not np.array_equal(modes.landing, np.eye(system.n))),
            "static": np.array([law.static for law in met]),
            "code": code,
            "numbers": numbers,
            "E": E,
            "A": modes.A,
            "b": modes.b,
            "landing": modes.landing,
            "guards": len(modes.guards),
            "kind": _padded(modes.kinds, g),
            "owner": _padded(modes.owners, g),
            "G": guards,
            "GT": _padded(modes.guards_t, g),
            "GA": guards @ modes.A,
            "B": bounds,
            "BA": slopes,
            "normal": modes.normal,
            "normal_t": modes.normal_t,
            "friction": modes.friction,
            "friction_t": modes.friction_t,
            "load": load,
            "load_t": load_t,
            "sigma": modes.sigma,
            "signals": rows,
            "signals_t": rows_t,
            "coupled": int(load_t[:, : len(system.patches)].any()),
            "needs": _padded(np.array(modes.guards_t.any(axis=1), dtype=np.int64), g),
            "store": store(system, key),
            "loss": loss_rows(system, modes),
            "press": modes.normal * closed,
            "press_t": modes.normal_t * closed,
            "damping": damping(system, key),
            "active": forms.any(axis=(1, 2)).astype(np.int64),
            "powers": forms,
            "work": integrals,
        }
        at = len(self.sets)
        stacked: dict[str, Any] = {name: _put(getattr(t, name), at, new[name]) for name in new}
        if t.products is not None:
            stacked["products"] = t.products._replace(
                press=stacked["press"],
                press_t=stacked["press_t"],
                rub=stacked["friction"],
                rub_t=stacked["friction_t"],
            )
        if t.wide is not None:
            stacked["wide"] = t.wide._replace(**{name: _put(getattr(t.wide, name), at, broad[name]) for name in broad})
        if t.flow is not None:
            E, integrals = kick.flow(modes, forms, self.step / self._kicks)
            stacked["flow"] = Flow(_put(t.flow.E, at, E), _put(t.flow.work, at, integrals))
        self.tables = t._replace(slot_of=slot_of, **stacked)
        self.handle = bundle(self.tables)
        self.sets.append(modes)
        return modes

    def booked(self) -> Array:
        """What the kernels have booked as sums over states, [term]; the rest of the ledger they have worked out."""
        t, count = self.tables, len(self.sets)
        return np.zeros(TERMS) if t.wide is None else wide.energy(t.wide, count, t.work[:, 0], t.powers)


def signal_rows(system: System, modes: ModeSet, rows: list[dict[str, float]]) -> tuple[Array, Array]:
    """Extended rows by name as rows over x [signal, n] and T [signal, inputs] of one mode set."""
    nq, inputs, states = len(system.coordinates), np.eye(system.inputs), np.eye(system.n)
    known: dict[str, tuple[Array, Array]] = {}
    for i, name in enumerate(system.names):
        known[name] = (states[i], np.zeros(system.inputs))
    for j, product in enumerate(system.products):
        known[product.name] = (np.zeros(system.n), inputs[len(system.patches) + j])
    for i, name in enumerate(system.names[2 * nq :], 2 * nq):
        known[f"{name}'"] = (modes.A[i], modes.b[i])
    for i, name in enumerate(system.coordinates):
        known[f"{name}''"] = (modes.A[nq + i], modes.b[nq + i])
    for p, patch in enumerate(system.patches):
        known[f"T:{patch.name}"] = (modes.friction[p], modes.friction_t[p])
        known[f"w:{patch.name}"] = (system.slip_rows[p], np.zeros(system.inputs))
    for k, normal in enumerate(system.normals):
        closed = system.modes(modes.key)[1][k] == 0
        known[f"N:{normal.name}"] = (modes.normal[k] * closed, modes.normal_t[k] * closed)
    clamped, thrown = system.modes(modes.key)[2], system.modes(modes.key)[4]
    gains = [position.gains for position in (s.positions[at] for s, at in zip(system.switches, thrown))]
    for i, (limiter, mode) in enumerate(zip(system.limiters, clamped)):
        held = {LOW: limiter.low, HIGH: limiter.high}.get(mode)
        idle = any(found.get(i) == 0.0 for found in gains)  # a switch has taken it out of the network
        within = held is None or idle
        known[f"c:{limiter.name}"] = (limiter.row if within else held * states[system.one], np.zeros(system.inputs))
    over_x, over_t = np.zeros((len(rows), system.n)), np.zeros((len(rows), system.inputs))
    for i, row in enumerate(rows):
        for name, value in row.items():
            over_x[i] += value * known[name][0]
            over_t[i] += value * known[name][1]
    return over_x, over_t


def _padded(array: NDArray[Any], count: int) -> NDArray[Any]:
    out = np.zeros((count, *array.shape[1:]), dtype=array.dtype)
    out[: len(array)] = array
    return out


def _put(old: NDArray[Any], slot: int, new: Any) -> NDArray[Any]:
    """The array with `new` in place of `slot`; with more room where it is full, or where a ladder is deeper."""
    entry = np.asarray(new, dtype=old.dtype)
    levels = entry.ndim > 2
    if slot >= len(old) or (levels and len(entry) > old.shape[1]):
        room = list(old.shape)
        room[0] = max(2 * slot, 4) if slot >= len(old) else len(old)
        if levels:
            room[1] = max(room[1], len(entry))
        more = np.zeros(room, dtype=old.dtype)
        more[tuple(map(slice, old.shape))] = old
        old = more
    if levels:
        old[slot, : len(entry)] = entry
    else:
        old[slot] = entry
    return old


def _bounds(A: Array, guards: Array, step: float) -> tuple[Array, Array]:
    """Chord bounds over one step for each guard and for its slope, [guard, n] each."""
    samples = int(min(_SAMPLES, 4 * 2 ** min(expm.depth(A, step), 10)))
    E = expm.ladder(A, step / samples)[0]
    second = guards @ A @ A
    third = second @ A
    worst2, worst3 = np.abs(second), np.abs(third)
    for _ in range(samples):
        second, third = second + second @ E, third + third @ E
        np.maximum(worst2, np.abs(second), out=worst2)
        np.maximum(worst3, np.abs(third), out=worst3)
    scale = _MARGIN * step * step / 8.0
    return scale * worst2, scale * worst3
