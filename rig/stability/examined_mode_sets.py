"""The mode sets that the stability report examines: all of them for few contacts, a selection for many."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from rig.model.system import System
from rig.model.system_parts import Sector
from rig.solve.state_codes import CLOSED, LINEAR, OPEN, SLIP_MINUS, SLIP_PLUS, STICK

MOST = 27
"""Up to this number every mode set is examined; beyond it only those with all contacts alike or one contact stuck."""
_KINDS = (SLIP_PLUS, SLIP_MINUS, STICK)


def mode_sets(system: System) -> Iterator[int]:
    """The mode sets to examine: contacts closed, in slip and stick and in every sector; contacts open; limiters linear.

    Of the positions of a switch: the first two, the last and the one at the start.
    """
    P, K, free = len(system.patches), len(system.normals), [LINEAR] * len(system.limiters)
    ways = [_ways(system, p) for p in range(P)]
    few = math.prod(map(len, ways)) <= MOST
    patches: list[tuple[int, ...]] = list(product(*ways)) if few else [(k,) * P for k in _KINDS]
    if not few:
        patches += [(SLIP_PLUS,) * p + (STICK,) + (SLIP_PLUS,) * (P - p - 1) for p in range(P)]
    places = list(product(*(_places(sector) for sector in system.sectors)))
    ends = [{0, 1, len(s.positions) - 1, s.at(system.start)} for s in system.switches]
    for thrown in product(*(sorted(positions) for positions in ends)):
        for modes, where in product(patches, places):
            yield system.key(modes, [CLOSED] * K, free, where, thrown)
        if any(k.opens for k in system.normals):
            lifted = [OPEN if k.opens else CLOSED for k in system.normals]
            yield system.key([SLIP_PLUS] * P, lifted, free, switches=thrown)


def _ways(system: System, p: int) -> tuple[int, ...]:
    """The modes of patch p to examine: all; or, if no coordinate moves along it, only slip as it is driven."""
    nq = len(system.coordinates)
    row = system.slip_rows[p]
    if np.any(row[nq : 2 * nq]):
        return _KINDS
    return (SLIP_PLUS if row @ system.start >= 0.0 else SLIP_MINUS,)


def _places(sector: Sector) -> Sequence[int]:
    """The sectors to examine: all sectors of a friction law; of a structure the first and the one at half a turn."""
    return (0, len(sector.edges) // 2) if sector.changes else range(len(sector.edges))
