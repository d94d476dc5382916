"""Allocates the scratch memory that the kernels need for a system."""

from __future__ import annotations

import numpy as np

from rig.model.system import System
from rig.solve import energy_balance
from rig.solve.records import Work
from rig.solve.roots import DEGREE, WORK_COLUMNS, WORK_ROWS


def workspace(system: System, read: int, guards: int) -> Work:
    """Scratch for a system with `read` outputs for sensors and at most `guards` guards in a mode set."""
    n, P = system.n, len(system.patches)
    both = np.zeros(n + system.inputs)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    return Work(
        k=np.zeros((7, n)),
        y=np.zeros(n),
        y2=np.zeros(n),
        x0=np.zeros(n),
        copy=np.zeros(n),
        size=np.zeros(n),
        ended=np.zeros(n),
        ask=np.zeros(n),
        ask_x=np.zeros(n),
        bear=np.zeros(n),
        bear_x=np.zeros(n),
        both=both,
        at=both[:n],
        rates=np.zeros(n),
        T=both[n:],
        scratch=np.zeros((P, P)),
        swung=np.zeros((len(system.generators), 2)),
        derivatives=np.zeros((DEGREE + 1, n)),
        spare=np.zeros((DEGREE + 1, n)),
        poly=np.zeros(DEGREE + 1),
        roots=np.zeros((WORK_ROWS, WORK_COLUMNS)),
        g=np.zeros(guards),
        fits=np.zeros((guards, 7)),
        values=np.zeros((5, read)),
        nodes=energy_balance.NODES,
        weights=energy_balance.WEIGHTS,
        nodes3=0.5 * (nodes + 1.0),
        weights3=0.5 * weights,
    )
