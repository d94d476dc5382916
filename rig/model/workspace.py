"""Allocates the scratch memory that the kernels need for a system."""

from __future__ import annotations

import numpy as np

from rig.model.system import System
from rig.solve import energy_balance, segments
from rig.solve.column_blocks import zeros
from rig.solve.dense_output import PROBE
from rig.solve.lanes import LANE
from rig.solve.places import PART
from rig.solve.records import Workspace
from rig.solve.roots import DEGREE, WORK_COLUMNS, WORK_ROWS
from rig.solve.stiff_cells import PLACES


def workspace(system: System, read: int, guards: int) -> Workspace:
    """Scratch for a system with `read` outputs for sensors and at most `guards` guards in a mode set."""
    n, P = system.n, len(system.patches)
    both = np.zeros(n + system.inputs)
    nodes, weights = np.polynomial.legendre.leggauss(LANE - PART)
    return Workspace(
        k=np.zeros((7, n)),
        y=np.zeros(n),
        y2=np.zeros(n),
        x0=np.zeros(n),
        copy=np.zeros(n),
        size=np.zeros(n),
        x_at_end=np.zeros(n),
        law_argument=np.zeros(n),
        law_argument_x=np.zeros(n),
        law_load=np.zeros(n),
        law_load_x=np.zeros(n),
        state_and_inputs=both,
        at=both[:n],
        rates=np.zeros(n),
        T=both[n:],
        scratch=np.zeros((P, P)),
        generators_at_begin=np.zeros((len(system.generators), 2)),
        derivatives=np.zeros((DEGREE + 1, n)),
        spare=np.zeros((DEGREE + 1, n)),
        poly=np.zeros(DEGREE + 1),
        roots=np.zeros((WORK_ROWS, WORK_COLUMNS)),
        g=np.zeros(guards),
        guard_samples=np.zeros((guards, 7)),
        values=np.zeros((2, read)),
        nodes=energy_balance.NODES,
        weights=energy_balance.WEIGHTS,
        x_at=zeros((n, LANE)),
        T_at=zeros((system.inputs, LANE)),
        in_part=np.repeat([1.0, 0.0], [PART, LANE - PART]),
        quarters=np.pad(np.linspace(0.0, 1.0, PART), (0, LANE - PART)),
        simpson=np.pad(np.array([1.0, 0.0, 4.0, 0.0, 1.0]) / 6.0, (0, LANE - PART)),
        probes=np.pad([0.0, 0.25, 0.5, 0.75, 1.0, PROBE], (0, LANE - 6)),
        cell_changes=np.zeros((len(PLACES), n)),
        cell_inputs=np.zeros((len(PLACES), system.inputs)),
        cell_size=np.zeros(n),
        node_inputs=np.zeros(system.inputs * (segments.DEGREE + 1)),
        input_powers=np.zeros((segments.DEGREE + 1, system.inputs)),
        nodes3=np.pad(0.5 * (nodes + 1.0), (PART, 0)),
        weights3=np.pad(0.5 * weights, (PART, 0)),
    )
