"""Benchmark of a film of points under a moving slider: the kernel's step (rig.solve.film_steps) beside its C twin
(film.c).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from rig.motion.motion import Motion
from rig.qualify.benchmarks.kernels import interleaved
from rig.scenes.loader import load
from rig.solve.film_records import FIRST, FRICTIONAL, PITCH, POINTS, SHEAR, STIFFNESS, TRAVEL
from rig.solve.film_sums import SUMS

SCENE = "plate"
SLIDING = {"drive.speed": 0.01, "load.force": 108.79}
"""The slider starts at full load and speed, so that its points open and close from the start."""
TICKS = 2000
_TABLES = ("alike", "against", "which_alike", "which_against", "kick", "turn", "loss", "column", "push", "signal",
           "riders", "advance")  # fmt: skip


class _Film(ctypes.Structure):
    """The tables in the layout of the twin."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in _TABLES),
        *((name, ctypes.c_double) for name in ("pitch", "stiffness", "shear", "mu")),
        *((name, ctypes.c_int64) for name in ("places", "pushed", "travel")),
    ]


def ratio(compiled: Callable[[str, dict[str, int]], Any], ticks: int = TICKS) -> dict[str, Any]:
    """Return the time of the kernel over that of the twin, with energy balance, and the final differences of the
    states.

    `compiled`: a function that returns the library of a C file of this folder, with constants by name.
    """
    scene = load(SCENE, SLIDING)
    substeps = scene.clock.substeps(scene.step_ns)
    motion = Motion(scene.assemble().system(), scene.step_ns, "kick", substeps=substeps, longest=ticks)
    motion.advance(1)
    own = motion.mode_sets.tables.film
    numbers, where, signals = own.numbers, own.where, own.moved.shape[0]
    even, odd = own.symmetric, own.antisymmetric
    tables = (even.rows, odd.rows, even.which, odd.which, own.kick, own.turn, own.loss, own.column[0], own.push[0],
              own.signal, own.slider_rows, own.advance)  # fmt: skip
    film = _Film(
        *(table.ctypes.data for table in tables),
        *(numbers[k] for k in (PITCH, STIFFNESS, SHEAR, FRICTIONAL)),
        own.symmetric.rows.shape[0],
        int(own.pushed[0]),
        int(where[TRAVEL] - where[FIRST]) + signals,
    )
    constants = {
        "NQ": own.kick.shape[0],
        "NA": own.symmetric.which.shape[0],
        "NO": own.antisymmetric.which.shape[0],
        "M": signals,
        "R": own.slider_rows.shape[0],
        "PAIRS": int(where[POINTS]) // 2,
        "WIDTH": own.symmetric.rows.shape[2],
        "ROOM": own.slider_rows.shape[1],
    }
    c = compiled("film.c", constants)
    begun, x0 = motion.save(), motion.state.x.copy()
    x, energy, steps = x0.copy(), np.zeros(4), ticks * substeps

    def numba_run() -> None:
        motion.go_back(begun)
        motion.advance(ticks)

    def c_run() -> None:
        x[:] = x0
        written = (ctypes.c_void_p(a.ctypes.data) for a in (x, energy))
        counts = (ctypes.c_int64(n) for n in (ticks, substeps, len(SUMS)))
        c.film_run(ctypes.byref(film), *counts, *written)

    best = interleaved({"numba": numba_run, "c": c_run})
    states = 2 * own.kick.shape[0]
    ours = motion.state.x[:states]
    return {
        "coordinates": states // 2,
        "points": int(where[POINTS]),
        "ns_per_step": best["numba"] / steps * 1e9,
        "ns_per_step_c": best["c"] / steps * 1e9,
        "ratio": best["numba"] / best["c"],
        "largest_difference": float(np.abs(ours - x[:states]).max() / np.abs(ours).max()),
    }
