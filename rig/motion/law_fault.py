"""Why a motion cannot go on: a friction law from elsewhere that is not finite at the state, or just ahead of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rig.errors import PartError, Singular
from rig.model.formulation import ModeSet
from rig.model.singular import assembled
from rig.model.system import System
from rig.solve.records import STICK
from rig.stability.linearisation import inputs, own_law

Array = NDArray[np.float64]
_AHEAD = np.geomspace(1e-12, 1e-2, 61)  # s: shorter and longer than the last steps that were tried
_SPEEDS = np.linspace(0.0, 2.0, 200_001)  # m/s, where the state itself is lost


def law_fault(system: System, key: int, x: Array) -> str:
    """What of a friction law is not finite, in words, near state `x` [n] in mode set `key`; "" if all laws are."""
    patches = [p for p in range(len(system.patches)) if system.law(p, key).origin is not None]
    if not patches:
        return ""
    try:
        if not np.isfinite(x).all():
            for p in patches:
                if not system.patches[p].memory:
                    system.law(p, key).over(_SPEEDS)
            return ""
        modes = assembled(system, key)
        places = ((p, place) for place in _ahead(system, modes, x) for p in patches)
        return next((fault for p, place in places if (fault := _fault_at(system, modes, p, place))), "")
    except PartError as fault:
        return str(fault)
    except Singular:
        return ""


def _ahead(system: System, modes: ModeSet, x: Array) -> Iterator[Array]:
    """The state, and states ahead of it along its rate."""
    yield x
    rate = modes.A @ x + modes.b @ inputs(system, modes, x, own_law(system, modes))[0]
    yield from (x + step * rate for step in _AHEAD.tolist())


def _fault_at(system: System, modes: ModeSet, p: int, x: Array) -> str:
    """What of the law of patch p is not finite at the state x."""
    law = system.law(p, modes.key)
    patch = system.patches[p]
    sigma = float(modes.sigma[p])
    slip = 0.0 if system.modes(modes.key)[0][p] == STICK else float(system.slip_rows[p] @ x)
    sign = sigma or (-1.0 if slip < 0.0 else 1.0)
    turned = np.array([sign if state.along else 1.0 for state in law.states])
    load = float(modes.load[p] @ x)
    return law.fault(max(sign * slip, 0.0), load, turned * x[list(patch.memory)])
