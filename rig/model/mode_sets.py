"""The mode sets of a run as arrays: tables for the kernels, built for each mode set at its first visit.

A run visits only a few of the possible mode sets. A kernel that meets an unknown one returns and asks for it. Commands,
slopes and speed targets are states, so no command ever rebuilds a table. Many contacts visit thousands of mode sets.
Beyond `MOST_BYTES` the least recently used ones are forgotten; at the next visit they are built again, with the same
bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.records import Loan
from rig.model import film_tables, friction_law, many_states_tables
from rig.model.energy_forms import at_nodes, at_nodes_extended, damping, loss_rows, powers, store, work
from rig.model.formulation import ModeSet, assemble, changes, reach, signal_rows
from rig.model.system import System
from rig.model.tables import UNROLLED, empty, sparse
from rig.solve import expm, segment_output
from rig.solve.advance import TALLIED
from rig.solve.column_blocks import entries_of, zeros
from rig.solve.energy_balance import NODES, TERMS
from rig.solve.records import STICK
from rig.solve.roots import DEGREE

Array = NDArray[np.float64]
_SAMPLES = 128  # most samples in a step of the second derivative of a guard [chosen]
STIFF = 7
"""Deepest tick of a mode set whose cells are single segments: at most 64 a tick."""
WIDE_STIFF = 3
"""The same of a mode set with many states."""
FAST = 50.0
"""|lambda| step beyond which dopri5 leaves explicit steps, of which stability alone would take more than 15 a tick."""
_MARGIN = 1.25  # safety factor on the largest sample, for what lies between samples
MOST_BYTES = 1 << 30
"""Memory of the tables beyond which mode sets are forgotten."""
KEPT = 320
"""Least number of mode sets that are kept whatever their size; the first 256 are counted one by one (advance.TALLIED)
and never forgotten."""


class _Cells(NamedTuple):
    """How a mode set propagates: `E` [level, n, n] over step / 2^level minus one, with the landing.

    `nodes` [node, n, n]: to the quadrature nodes of the finest cell; `order`: number of Taylor terms there; `series`:
    of rigs with many states (`many_states_tables.series`).
    """

    E: Array
    nodes: NDArray[Any]
    order: int
    series: Array


class ModeSets:
    """The mode sets of one run. `tables`: for the kernels; `add(key)`: builds a mode set at its first visit."""

    def __init__(
        self,
        system: System,
        step: float,
        signals: list[dict[str, float]],
        read: int = 0,
        substeps: int = 1,
        implicit: bool = False,
    ) -> None:
        """Start without mode sets.

        `step` in s; `signals`: extended rows (rig.model.assembly) of the rig's outputs, of which sensors read the first
        `read`; `substeps`: steps of a film in a `step`. `implicit`: the method is rosenbrock, whose steps no eigenvalue
        limits.
        """
        self.read = read
        self._substeps = substeps
        self._implicit = implicit
        self._wide = system.n > UNROLLED
        self.system = system
        self.step = step
        self.rows = signals
        self.sets: list[ModeSet] = []
        self.sticks: list[bool] = []
        """For each mode set, whether every patch sticks."""
        self.stiff = False
        """Whether a mode set is stiff: some states change within a tiny part of a tick."""
        self.forgotten = 0
        """How many times a mode set was forgotten."""
        self._free: list[int] = []
        self._size = 0  # bytes of the largest mode set
        self.tables = empty(system, step, len(signals), read)
        self._handle: Loan | None = None

    @property
    def handle(self) -> Loan:
        """The tables, lent to kernels."""
        if self._handle is None or self._handle.content is not self.tables:
            self._handle = Loan(self.tables, self._handle)
        return self._handle

    @property
    def keys(self) -> tuple[int, ...]:
        """The keys of the mode sets built so far, in the order of the tables."""
        return tuple(modes.key for modes in self.sets)

    def add(self, key: int) -> ModeSet:
        """Assemble mode set `key`, append its tables and return it."""
        system = self.system
        modes = assemble(system, key)
        if system.film is not None:
            return self._add_with_film(modes)
        t = self.tables
        g = t.G.shape[1]
        guards = _padded(modes.guards, g)
        cells = self._cells(modes)
        E = cells.E
        depth = len(E) - 1
        bounds, slopes = np.zeros((2, g, system.n))
        if not self._wide or depth > 0:
            bounds, slopes = guard_bounds(modes.A, guards, self.step)
        forms = powers(system, modes)
        integrals = work(cells.nodes, forms, self.step, E)
        patch_modes, normal_modes, *_ = system.modes(key)
        met = tuple(system.law(p, key) for p in range(len(system.patches)))
        places = [system.places(p) for p in range(len(met))]
        code, numbers = friction_law.pack(met, places, t.numbers.shape[2])
        closed = 1.0 - np.array(normal_modes, dtype=np.float64).reshape(-1, 1)
        rows, rows_t = signal_rows(system, modes, self.rows)
        stiff = depth > (WIDE_STIFF if self._wide else STIFF)
        read = np.vstack([guards, rows[: self.read]])
        broad: dict[str, Array] = {}
        if self._wide:
            field = np.hstack([modes.A, modes.b])
            broad = many_states_tables.tables(cells.series, E, modes.landing, guards, bounds, field, rows, self.read)
        curved = bool(modes.nonlinear.any()) or bool(system.products) or system.remembers
        explicit = curved and not self._implicit
        fast = explicit and np.abs(np.linalg.eigvals(modes.A)).max() * self.step > FAST
        levels = (expm.depth(modes.A, self.step) + 1) * fast
        self.stiff = self.stiff or stiff or levels > 0
        response = reach(modes.A, modes.b, self.step, levels)
        constant = response[..., system.n :: segment_output.DEGREE + 1]
        at = self._free.pop() if self._free else len(self.sets)
        mode_set_of = t.mode_set_of.copy()
        mode_set_of[key] = at
        new: dict[str, Any] = {
            "used": t.used.max(initial=0),
            "depth": depth,
            "room": 0 if stiff else 2**depth,
            "along": changes(modes, read, self.step, depth * stiff),
            "order": cells.order,
            "curved": int(curved),
            "graded": levels,
            "reach": response,
            "gain": np.abs(constant).max(axis=1),
            "stuck": int(STICK in patch_modes),
            "lands": int(not np.array_equal(modes.landing, np.eye(system.n))),
            "static": np.array([law.static for law in met]),
            "static_back": np.array([law.towards(-1.0).static for law in met]),
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
            "load": modes.load,
            "load_t": modes.load_t,
            "sigma": modes.sigma,
            "law_speed": modes.sigma[:, None] * system.slip_rows,
            "law_load": modes.sigma[:, None] * modes.load,
            "law_load_t": modes.sigma[:, None] * modes.load_t,
            "signals": rows,
            "signals_t": rows_t,
            "output_needs_inputs": rows_t.any(axis=1).astype(np.int64),
            "coupled": int(modes.load_t[:, : len(system.patches)].any()),
            "guard_needs_inputs": _padded(np.array(modes.guards_t.any(axis=1), dtype=np.int64), g),
            "store": store(system, key),
            "loss": loss_rows(system, modes),
            "press": modes.normal * closed,
            "press_t": modes.normal_t * closed,
            "damping": damping(system, key),
            "active": forms.any(axis=(1, 2)).astype(np.int64),
            "powers": forms,
            "work": integrals,
        }
        new |= {f"{name}_entries": entries_of(new[name][:rows]) for name, (rows, _) in sparse(system).items()}
        stacked: dict[str, Any] = {name: _put(getattr(t, name), at, new[name]) for name in new}
        if self._wide:
            stacked["many_states"] = t.many_states._replace(
                **{name: _put(getattr(t.many_states, name), at, broad[name]) for name in broad}
            )
        arrays = (*new.values(), *broad.values())
        self._size = max(self._size, sum(np.asarray(array).nbytes for array in arrays))
        self.tables = t._replace(mode_set_of=mode_set_of, **stacked)
        self.sets[at : at + 1] = [modes]
        self.sticks[at : at + 1] = [all(mode == STICK for mode in patch_modes)]
        return modes

    def _cells(self, modes: ModeSet) -> _Cells:
        """The propagators of a mode set."""
        E = expm.ladder(modes.A, self.step)
        if self._wide:
            E = E[: many_states_tables.depth(modes.A, self.step) + 1]
        depth = len(E) - 1
        finest = self.step / 2.0**depth
        if not self._wide:
            series = np.zeros((0, 0, 0))
            nodes_of = at_nodes_extended if depth > STIFF else at_nodes
            nodes = nodes_of(modes.A, modes.landing, finest)
            order = expm.order(modes.A, self.step)
        else:
            series = many_states_tables.series(modes.A, finest)
            nodes = many_states_tables.at(NODES, series) @ modes.landing
            order = DEGREE
        landed = modes.landing @ E @ modes.landing
        return _Cells((modes.landing - np.eye(len(modes.A))) + landed, nodes, order, series)

    @property
    def full(self) -> bool:
        """Whether the tables have no room for another mode set."""
        count = len(self.sets)
        return not self._free and count >= KEPT and count * self._size > MOST_BYTES

    @property
    def states_at_once(self) -> int:
        """How many states a motion may keep: the mode sets of kept states cannot be forgotten."""
        if len(self.tables.mode_set_of) <= KEPT:
            return 1 << 30  # there is room for all
        return (max(MOST_BYTES // max(self._size, 1), KEPT) - TALLIED) // 2

    def forget(self, needed: NDArray[np.int64]) -> bool:
        """Forget the least recently used quarter of the mode sets, but not the indices `needed`.

        Sums that kernels have collected must be taken before (`collected_energy`). Returns False if all are needed.
        """
        count = len(self.sets)
        tables = self.tables
        order = np.argsort(tables.used[:count], kind="stable")
        order = order[(order >= TALLIED) & ~np.isin(order, needed)][: max(count // 4, 1)]
        for at in order.tolist():
            tables.mode_set_of[self.sets[at].key] = -1
        self._free = order.tolist()
        self.forgotten += len(order)
        return len(order) > 0

    def _add_with_film(self, modes: ModeSet) -> ModeSet:
        """Append the tables of the only mode set of a rig with a film.

        Tables that neither rig.solve.film_steps nor the search for the contact state reads keep length zero.
        """
        t = self.tables
        rows = signal_rows(self.system, modes, self.rows)[0]
        new: dict[str, Any] = {"signals": rows, "output_needs_inputs": np.zeros(len(rows)), "room": 1}
        new |= dict.fromkeys(("used", "depth", "guards", "stuck", "lands", "curved"), 0)
        stacked: dict[str, Any] = {name: _put(getattr(t, name), 0, new[name]) for name in new}
        stacked["mode_set_of"] = np.zeros_like(t.mode_set_of)
        stacked["film"] = film_tables.tables(self.system, modes, self.step / self._substeps, rows, self.read)
        self.tables = t._replace(**stacked)
        self.sets.append(modes)
        self.sticks.append(False)
        return modes

    def collected_energy(self) -> Array:
        """The energy terms, [term], of the sums over states that kernels have collected since the last call.

        Terms that kernels compute themselves are not included.
        """
        if not self._wide:
            return np.zeros(TERMS)
        t = self.tables
        return many_states_tables.collected_energy(t.many_states, len(self.sets), t.work[:, 0], t.powers)

    def sums(self) -> dict[str, NDArray[Any]]:
        """Copy the sums that kernels have collected since the last call of `collected_energy`.

        `visited`: the mode sets to which they belong; `whole`, `part`: their sums.
        """
        tables = self.tables.many_states
        count = len(self.sets) if self._wide else 0
        in_whole = tables.whole[:count].any(axis=(1, 2))
        in_part = tables.part[:count].any(axis=(1, 2))
        visited = np.flatnonzero(in_whole | in_part)
        return {"visited": visited, "whole": tables.whole[visited], "part": tables.part[visited]}

    def put_sums(self, kept: Mapping[str, NDArray[Any]]) -> None:
        """Replace the collected sums by those of `sums`."""
        tables = self.tables.many_states
        visited = kept["visited"]
        tables.whole[:] = 0.0
        tables.part[:] = 0.0
        tables.whole[visited] = kept["whole"]
        tables.part[visited] = kept["part"]


def _padded(array: NDArray[Any], count: int) -> NDArray[Any]:
    out = np.zeros((count, *array.shape[1:]), dtype=array.dtype)
    out[: len(array)] = array
    return out


def _put(old: NDArray[Any], mode_set: int, new: Any) -> NDArray[Any]:
    """The array with entry `mode_set` set to `new`; enlarged if it is full or if `new` has more levels."""
    entry = np.asarray(new, dtype=old.dtype)
    levels = entry.ndim > 2
    full = mode_set >= len(old)
    if full or (levels and len(entry) > old.shape[1]):
        room = list(old.shape)
        if full:
            room[0] = max(2 * mode_set, 4)
        if levels:
            room[1] = max(room[1], len(entry))
        more = zeros(tuple(room)) if old.dtype == np.float64 else np.zeros(room, dtype=old.dtype)
        if old.size:
            more[tuple(map(slice, old.shape))] = old
        old = more
    if levels:
        old[mode_set, : len(entry)] = entry
    else:
        old[mode_set] = entry
    return old


def guard_bounds(A: Array, guards: Array, step: float) -> tuple[Array, Array]:
    """Chord bounds over one step for each guard and for its slope, [guard, n] each."""
    depth = min(expm.depth(A, step), 10)
    samples = int(min(_SAMPLES, 4 * 2**depth))
    E, *shorter = expm.ladder(A, step / samples)
    second = guards @ A @ A
    third = second @ A
    worst2 = np.abs(second)
    worst3 = np.abs(third)
    for early in shorter:  # what rises and decays before the first sample
        np.maximum(worst2, np.abs(second + second @ early), out=worst2)
        np.maximum(worst3, np.abs(third + third @ early), out=worst3)
    for _ in range(samples):
        second = second + second @ E
        third = third + third @ E
        np.maximum(worst2, np.abs(second), out=worst2)
        np.maximum(worst3, np.abs(third), out=worst3)
    scale = _MARGIN * step * step / 8.0
    return scale * worst2, scale * worst3
