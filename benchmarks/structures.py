"""A structure of 100,000 degrees of freedom that a script makes: how long its reduction takes, and how much memory.

A plate of triquadratic hexahedra that is held at one edge, with contact points on its upper face. A process of its own
measures it: the peak of its memory is that of the reduction, and of making the matrices, which is less.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eig

from rig.analysis.linear.modes import at_rest
from rig.analysis.linear.sweep import sweep
from rig.errors import RigError
from rig.plants.structures import hexahedra
from rig.scenes.axis import Axis
from rig.scenes.loader import load
from rig.structure.basis import Reduction, build
from rig.structure.eigenvalues import complex_eigenvalues
from rig.structure.estimate import Estimator
from rig.structure.full import FRICTION, Full, Part, Points

ELEMENTS, QUICK = (64, 25, 2), (16, 8, 2)
"""Along x, y and z: 97,920 degrees of freedom, and 5,280 for a quick look."""
SIZE = (0.3, 0.12, 0.012)
"""Of the plate [m]."""
CAST_IRON = hexahedra.Material(1.1e11, 0.26, 7100.0)
POINTS = (6, 4)
DAMPING = 2e-7  # over stiffness [s]
_VALUES = {"contacts.pad.stiffness": 1e11, FRICTION: 0.4}


CHAIN = """
format = 1
title = "A chain of masses"
plant = "structure"
structure.units = "m-kg-s"
structure.coordinates = {names}
structure.parts.M = {{ of = "mass", values = {mass} }}
structure.parts.K = {{ of = "stiffness", values = {stiffness} }}
damping = {{ ratio = 0.002, at = "1 kHz" }}
contacts.pad = {{ gap = {{ x2 = 1.0 }}, along = {{ x1 = 1.0 }}, spring = "1e8 N/m" }}
drive = {{ speed = "1 m/s" }}
load = {{ force = "1000 N", at = {{ back = {{ row = {{ x3 = -1.0 }} }} }} }}
friction = {{ law = "constant", mu = 0.3 }}
outputs.pad = {{ row = {{ x1 = 1.0 }} }}
"""
"""A scene of typed matrices."""


def plate(elements: tuple[int, int, int]) -> Full:
    """The plate and its contact with the ground, which slides along x."""
    across, deep, thick = (np.linspace(0.0, size, n + 1) for size, n in zip(SIZE, elements, strict=True))
    made = hexahedra.assemble(
        across, deep, thick, [hexahedra.Part(CAST_IRON, np.ones(elements, dtype=np.bool_))], held=False
    )
    nodes, place = len(made.lattice), made.lattice
    free = np.flatnonzero(np.tile(place[:, 0] > 0, 3))
    row = np.full(3 * nodes, -1)
    row[free] = np.arange(free.size)
    x, y = (
        2 * np.round(np.linspace(0.3, 0.7, count) * number).astype(int)
        for count, number in zip(POINTS, elements, strict=False)
    )
    touched = np.flatnonzero(np.isin(place[:, 0], x) & np.isin(place[:, 1], y) & (place[:, 2] == 2 * elements[2]))
    count = touched.size
    normal, along = (
        sp.csr_array((np.full(count, sign), (np.arange(count), row[direction * nodes + touched])), (count, free.size))
        for sign, direction in ((-1.0, 2), (1.0, 0))
    )
    zero = np.zeros((count, 3))
    pad = Points("pad", normal, along, np.full(count, 1e-4), np.ones(count), zero, zero)
    mass, stiffness = (sp.csr_array(matrix)[free][:, free] for matrix in (made.mass, made.stiffness))
    parts = (
        Part("M", "mass", mass),
        Part("D", "damping", stiffness, factor=DAMPING),
        Part("K", "stiffness", stiffness),
    )
    return Full(parts, free % nodes, free // nodes, contacts=(pad,))


def measured(elements: tuple[int, int, int]) -> dict[str, Any]:
    """Seconds and MB of this process, and the errors of the reduction; `measure` calls it in one of its own."""
    seconds: dict[str, float] = {}
    started = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal started
        seconds[name] = time.perf_counter() - started
        started = time.perf_counter()

    full = plate(elements)
    lap("matrices_s")
    reduced = build(full, Reduction(modes=72, at=_VALUES))
    lap("basis_s")
    points, alone = [], []
    mass, damping, stiffness = reduced.pencil(_VALUES)
    fast = float(np.sqrt(np.abs(np.linalg.solve(mass, stiffness)).max()))
    first_order = np.block(
        [
            [np.zeros(mass.shape), np.eye(len(mass))],
            [-np.linalg.solve(mass, stiffness) / fast**2, -np.linalg.solve(mass, damping) / fast],
        ]
    )
    for _ in range(30):
        before = time.process_time()
        reduced.eigenvalues(_VALUES, vectors="none")
        between = time.process_time()
        np.linalg.eig(first_order)
        points.append(between - before)
        alone.append(time.process_time() - between)
    lap("points_s")
    estimates = Estimator(full, reduced.up_to, _VALUES).at(reduced, _VALUES)
    lap("estimate_s")
    first = float(estimates.values[0].imag)
    exact = complex_eigenvalues(*full.pencil(_VALUES), 1.01 * first, low=0.99 * first).values
    lap("one_full_circle_s")
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    near = estimates.values[np.argmin(np.abs(estimates.values[:, None] - exact[None, :]), axis=0)]
    return {
        "rows": full.rows,
        "coordinates": reduced.coordinates,
        "MB": megabytes,
        "estimated_error": float(estimates.relative.max()),
        "point_ms": 1e3 * min(points),
        "point_ratio": min(points) / min(alone),
        "true_error": float(np.max(np.abs(near - exact) / np.abs(exact))),
    } | seconds


def swept(coordinates: int = 85, values: int = 100) -> dict[str, float]:
    """A sweep over friction of a chain of typed masses on a belt, its critical values among them; processor time.

    `sweep_ratio`: over the eigenvalues and both vectors of `values` matrices of its size, by scipy alone.
    """
    stiffness = 1e8 * (2.0 * np.eye(coordinates) - np.eye(coordinates, k=1) - np.eye(coordinates, k=-1))
    stiffness += np.diag(np.linspace(0.0, 2e8, coordinates))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.toml"
        path.write_text(
            CHAIN.format(
                names=json.dumps([f"x{i}" for i in range(1, coordinates + 1)]),
                mass=np.eye(coordinates).tolist(),
                stiffness=stiffness.tolist(),
            )
        )
        scene = load(path)
    axis = Axis.parse(f"friction.mu=0:0.6:{values}", scene)
    sweep(scene, axis)
    started = time.process_time()
    sweep(scene, axis)
    seconds = time.process_time() - started
    system = at_rest(scene)[1]
    matrix = system.A[np.ix_(system.moving, system.moving)]
    started = time.process_time()
    for _ in range(values):
        eig(matrix, left=True, right=True)
    alone = time.process_time() - started
    return {"sweep_s": seconds, "sweep_ratio": seconds / alone}


def measure(quick: bool) -> dict[str, Any]:
    """As `measured`, in a process of its own. Raises RigError if it ends without a result."""
    elements = QUICK if quick else ELEMENTS
    call = f"import json; from benchmarks import structures; print(json.dumps(structures.measured({elements})))"
    ended = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RigError(f"the reduction ended with code {ended.returncode}: {ended.stderr.strip()[-500:]}")
    result: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return result | swept()
