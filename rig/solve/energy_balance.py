"""The energy balance of structure and network. Each term is integrated on its own.

    stored'  = v.M a + q.K v + (x.H x / 2)' = drive - friction - damper + forces + normal - resistor - switch + edges
    drive    = sum_p T_p V_p      supplied by the belt or disc; V_p = w_p + t_p.v
    friction = sum_p T_p w_p      dissipated at the contacts, never negative
    damper   = v.D v              dissipated in the dampers
    forces   = v.(F x + F_t T)    supplied by external forces and products
    normal   = sum_k N_k n_k.v    supplied through normal forces
    resistor = sum i^2 R          dissipated in the resistors of the network
    edges    = q.dK q / 2         supplied when the stiffness changes at the edge of a sector
    switch                        lost from the network when a switch interrupts a current

Every power is a quadratic form x.Q x of the mode set. Its integral over a cell is x.W x. The matrices W come from the
same sequence of halved cells as the propagators: W(2h) = W(h) + Phi(h)^T W(h) Phi(h). No term is computed as the
difference of the others, so their sum is a check. With speed-dependent friction the forms hold the part that is linear
in x; the rest is integrated along the dense output.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import inner

Array = NDArray[np.float64]
NAMES = ("drive", "friction", "damper", "forces", "normal", "resistor", "switch")
SIGNS = np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
TERMS = len(NAMES)
RESISTOR = TERMS - 2
SWITCH = TERMS - 1
NODES, WEIGHTS = (0.5 * (a + o) for a, o in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0)))


@inner
def network_energy(H, x):
    """The energy stored in the network; H is twice its quadratic form."""
    s = 0.0
    for i in range(x.shape[0]):
        for j in range(x.shape[0]):
            s += x[i] * H[i, j] * x[j]
    return 0.5 * s


@inner
def add_energy(W, active, x, energy):
    """Add x.W[term] x to energy[term] for every active term."""
    n = x.shape[0]
    for term in range(energy.shape[0]):
        if active[term]:
            s = 0.0
            for i in range(n):
                r = 0.0
                for j in range(n):
                    r += W[term, i, j] * x[j]
                s += x[i] * r
            energy[term] += s
