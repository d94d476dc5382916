"""Scratch memory of the kernels for a system, and the scales of errors of its states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.model.system import System
from rig.solve import energy_balance, segment_output
from rig.solve.column_blocks import LANE, zeros
from rig.solve.dopri5 import PROBE
from rig.solve.exact import PLACES
from rig.solve.forces import MemoryTables
from rig.solve.places import PART
from rig.solve.records import Workspace
from rig.solve.roots import DEGREE as ROOT_DEGREE
from rig.solve.roots import WORK_COLUMNS, WORK_ROWS

Array = NDArray[np.float64]
_SLOW = 1e-3  # m/s: least speed of steady slip, for scales of errors
_SHARE = 1e-3  # of the states in steady slip, for scales of errors
_BEHIND = (0, LANE - PART)
_IN_PART = np.repeat([1.0, 0.0], [PART, LANE - PART])
_QUARTERS = np.pad(np.linspace(0.0, 1.0, PART), _BEHIND)
_SIMPSON = np.pad(np.array([1.0, 0.0, 4.0, 0.0, 1.0]) / 6.0, _BEHIND)
_PROBES = np.pad([0.0, 0.25, 0.5, 0.75, 1.0, PROBE], (0, LANE - 6))
_NODES, _WEIGHTS = (
    np.pad(0.5 * (a + o), (PART, 0)) for a, o in zip(np.polynomial.legendre.leggauss(LANE - PART), (1.0, 0.0))
)


def workspace(system: System, read: int, guards: int) -> Workspace:
    """Scratch for a system with `read` outputs for sensors and at most `guards` guards in a mode set."""
    n = system.n
    P = len(system.patches)
    width = -(-n // LANE) * LANE
    return Workspace(
        k=zeros((7, width)),
        k16=zeros((16, width)),
        bends=zeros((4, width)),
        y=zeros(width)[:n],
        y2=zeros(width)[:n],
        x0=np.zeros(n),
        copy=np.zeros(n),
        size=scales_of_memory(system),
        x_at_end=np.zeros(n),
        law_argument=np.zeros(n),
        law_argument_x=np.zeros(n),
        law_load=np.zeros(n),
        law_load_x=np.zeros(n),
        law_argument_p=np.zeros(system.inputs),
        law_load_p=np.zeros(system.inputs),
        at=zeros(width)[:n],
        rates=zeros(width)[:n],
        T=np.zeros(system.inputs),
        scratch=np.zeros((P, P)),
        generators_at_begin=np.zeros((len(system.generators), 2)),
        derivatives=np.zeros((ROOT_DEGREE + 1, n)),
        spare=np.zeros((ROOT_DEGREE + 1, n)),
        poly=np.zeros(ROOT_DEGREE + 1),
        roots=np.zeros((WORK_ROWS, WORK_COLUMNS)),
        g=np.zeros(guards),
        guard_samples=np.zeros((guards, 7)),
        values=np.zeros((2, read)),
        nodes=energy_balance.NODES,
        weights=energy_balance.WEIGHTS,
        x_at=zeros((n, LANE)),
        T_at=zeros((system.inputs, LANE)),
        in_part=_IN_PART,
        quarters=_QUARTERS,
        simpson=_SIMPSON,
        probes=_PROBES,
        cell_changes=np.zeros((len(PLACES), n)),
        cell_inputs=np.zeros((len(PLACES), system.inputs)),
        cell_size=np.zeros(n),
        node_inputs=np.zeros(system.inputs * (segment_output.DEGREE + 1)),
        input_powers=np.zeros((segment_output.DEGREE + 1, system.inputs)),
        stages=np.zeros((8, n)),
        matrix=np.zeros((n, n)),
        row_order=np.zeros(n, dtype=np.int64),
        right=np.zeros(n),
        slopes=np.zeros((system.inputs, n)),
        nodes3=_NODES,
        weights3=_WEIGHTS,
    )


def scales_of_memory(s: System) -> Array:
    """The least scale of the error of each state: a share of steady slip for internal states of laws, else 0.

    Steps are then not limited by a deflection that begins at zero.
    """
    size = np.zeros(s.n)
    for p, patch in enumerate(s.patches):
        if not patch.memory:
            continue
        speed = max(abs(float(s.slip_rows[p] @ s.start)), _SLOW)
        load = sum(abs(float(normal.row @ s.start)) for normal in s.normals if normal.patch == p)
        for law in s.laws(p):
            if law.formula is not None:
                steady = law.formula.steady(law.numbers, speed, load)
                size[list(patch.memory)] = _SHARE * np.abs(steady)
    return size


def scratch_for_memory(s: System) -> MemoryTables:
    """Scratch for the laws with memory of a system."""
    most = max((len(patch.memory) for patch in s.patches), default=0)
    return MemoryTables(
        inputs=np.array([s.rates_from]),
        mu=np.zeros(len(s.patches) if most else 0),
        states=np.zeros(most),
        values=np.zeros(most + 2 if most else 0),
        slopes=np.zeros((most + 1) * (most + 2) if most else 0),
    )
