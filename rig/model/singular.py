"""Why the equations of motion of a mode set have no unique solution: jamming, no inertia, no holding force."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import Singular
from rig.model.formulation import ModeSet, assemble, bearing_mass
from rig.model.system import System
from rig.solve.records import CLOSED, STICK

Array = NDArray[np.float64]
JAMS = "jams: friction takes up all of the inertia at these parameter values"
_ROUNDING = 1e-12  # share of the largest singular value


def assembled(system: System, key: int) -> ModeSet:
    """The matrices of mode set `key`. Raises rig.errors.Singular if they are not defined."""
    try:
        return assemble(system, key)
    except np.linalg.LinAlgError:
        raise singular(system, key) from None


def singular(system: System, key: int) -> Singular:
    """The error with the reason why `assemble` cannot solve mode set `key`."""
    nq = len(system.coordinates)
    mode = system.describe(key)
    patch_modes, normal_modes, *_ = system.modes(key)
    if not _regular(system.mass):
        return Singular("the mass matrix is singular: some motion has no inertia", mode)
    laws = [system.law(p, key) for p in range(len(system.patches))]
    mass = bearing_mass(system, key, [law.numbers[0] if law.constant else 0.0 for law in laws])
    if not _regular(np.linalg.solve(system.mass, mass)):
        return Singular(JAMS, mode, jams=True)
    loaded = {k.patch for k, where in zip(system.normals, normal_modes) if where == CLOSED}
    stuck = [p for p, where in enumerate(patch_modes) if where == STICK and p in loaded]
    free = [p for p in stuck if not np.any(system.slip_rows[p, nq : 2 * nq])]
    names = ", ".join(system.patches[p].name for p in free or stuck)
    if free:
        return Singular(f"no coordinate moves along {names}: no friction force can stop the slip there", mode)
    return Singular(f"no friction forces can hold {names}: their effect on the slip speeds cancels", mode)


def _regular(matrix: NDArray[Any]) -> bool:
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return bool(sizes[-1] > _ROUNDING * sizes[0])
