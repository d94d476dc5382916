"""Bases for parameter studies: complex eigenvectors of the full matrices at a few points of a range.

A basis contains the real and imaginary parts of right and left eigenvectors, compressed by singular values. Both sides
of the projection use it. (Left vectors on the other side alone create eigenvalues that the structure does not have.)
Training starts in the middle of the range, with the derivatives of the vectors with respect to each number. Then it
adds the point where the estimated error is largest, until this is small enough.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.structure import eigenvalues
from rig.structure.eigenvalues import Complex, Eigenpairs
from rig.structure.estimate import Estimator
from rig.structure.full import Array, Full
from rig.structure.reduced import Reduced, orthonormal, projected

MOST = 24
"""Most points of a training [chosen]: the eigenvalues of a point take seconds."""
_CANDIDATES = {1: 9, 2: 5, 3: 3, 4: 3}  # of each number, by how many numbers are trained
_ROUNDED = 1e-14  # singular values below this share of the largest are rounding


def trained(
    full: Full,
    over: Mapping[str, tuple[float, float]],
    at: Mapping[str, float],
    up_to: float,
    vectors: int,
    error: float,
    tell: Callable[[str, float], object],
) -> Reduced:
    """The reduced structure for all eigenvalues up to `up_to` [rad/s] over the ranges `over`; `at`: the other numbers.

    It has at most `vectors` coordinates. Training ends when the largest relative error that is estimated is at most
    `error`, or when more points do not help. Raises UsageError for ranges that cannot be trained.
    """
    _check(full, over, at)
    middle = dict(at) | {key: 0.5 * (low + high) for key, (low, high) in over.items()}
    mass = full.matrix("mass", middle)
    stiffness = full.symmetric_stiffness(middle, closed=True)
    tell("eigenvalues in the middle of the range", 0.0)
    estimator = Estimator(full, up_to, middle)
    pairs = eigenvalues.complex_eigenvalues(*full.pencil(middle), up_to, left=True)
    derivatives = _derivatives(full, over, middle, pairs, estimator)
    columns = np.hstack([_columns(pairs, mass), derivatives])
    ranges = {key: over.get(key, (middle[key], middle[key])) for key in (*full.numbers, *over)}
    points = [middle]
    candidates = [dict(at) | point for point in _grid(over)]
    largest = [math.inf] * len(candidates)
    first = 0.0
    while True:
        basis = _compressed(columns, mass, vectors)
        reduced = projected(full, basis, stiffness, kind="snapshots", up_to=up_to, trained=ranges, points=tuple(points))
        fresh: set[int] = set()
        while (worst := int(np.argmax(largest))) not in fresh:  # a basis with more points has smaller errors
            relative = estimator.at(reduced, candidates[worst]).relative
            largest[worst] = float(relative.max(initial=0.0))
            fresh.add(worst)
        present = largest[worst]
        first = first or max(present, error)
        decades = math.log(first / max(present, error))
        share = decades / math.log(max(first / error, math.e))
        text = f"{counted(len(points), 'point')}: relative error {present:.1e}, wanted {error:g}"
        tell(text, min(max(share, 0.0), 1.0))
        if present <= error or candidates[worst] in points or len(points) == MOST:
            return replace(reduced, error=present)
        points.append(candidates[worst])
        pairs = eigenvalues.complex_eigenvalues(*full.pencil(candidates[worst]), up_to, left=True)
        columns = np.hstack([columns, _columns(pairs, mass)])


def _check(full: Full, over: Mapping[str, tuple[float, float]], at: Mapping[str, float]) -> None:
    """Refuse ranges that cannot be trained, all faults at once."""
    faults = []
    known = {*full.numbers, *(points.damping_key for points in full.contacts)}
    numbers = ", ".join(full.numbers) or "no numbers"
    for key in over:
        if key not in known:
            faults.append(f"reduction.over: {key} multiplies nothing of this structure; it has {numbers}")
    for key, (low, high) in over.items():
        if not low < high:
            faults.append(
                f"reduction.over: {key} is trained from {low:g} to {high:g}; the second number must be larger"
            )
    for part in full.parts:
        low, high = over.get(part.key, (1.0, 1.0))
        if part.power < 0 and low <= 0.0 <= high:
            span = f"from {low:g} to {high:g}"
            faults.append(f"reduction.over: {part.name} is divided by {part.key}, whose range {span} contains zero")
    faults += [f"{key} has no value" for key in full.numbers if key not in over and key not in at]
    if len(over) > max(_CANDIDATES):
        faults.append(f"reduction.over has {len(over)} numbers; at most {max(_CANDIDATES)} can be trained together")
    if faults:
        raise UsageError("\n".join(faults))


def _grid(over: Mapping[str, tuple[float, float]]) -> list[dict[str, float]]:
    """The points of the range that can be trained, its corners among them."""
    count = _CANDIDATES.get(len(over), 1)
    axes = [np.linspace(low, high, count).tolist() for low, high in over.values()]
    return [dict(zip(over, point, strict=True)) for point in itertools.product(*axes)]


def _columns(pairs: Eigenpairs, mass: Any) -> Array:
    """Real and imaginary parts [row, column] of right and left vectors of mass one."""
    vectors = _of_mass_one(np.hstack([pairs.right, pairs.left]), mass)
    return np.hstack([vectors.real, vectors.imag])


def _of_mass_one(vectors: Complex, mass: Any) -> Complex:
    """The columns, each scaled to mass one."""
    masses = np.einsum("ij,ij->j", vectors.conj(), mass @ vectors).real
    return np.asarray(vectors / np.sqrt(masses))


def _derivatives(
    full: Full,
    over: Mapping[str, tuple[float, float]],
    middle: Mapping[str, float],
    pairs: Eigenpairs,
    estimator: Estimator,
) -> Array:
    """For each number the change of right and left vectors over half of its range, to first order [row, column]."""
    columns = [np.zeros((full.rows, 0))]
    mass = full.matrix("mass", middle)
    sides = ((pairs.right, pairs.values, "N"), (pairs.left, pairs.values.conj(), "H"))
    for key, (least, most) in over.items():
        at_least = full.pencil({**middle, key: least})
        at_most = full.pencil({**middle, key: most})
        differences = [high - low for low, high in zip(at_least, at_most, strict=True)]
        for vectors, values, trans in sides:
            vectors = _of_mass_one(vectors, mass)
            m, d, k = differences if trans == "N" else [matrix.T for matrix in differences]
            change = values**2 * (m @ vectors) + values * (d @ vectors) + k @ vectors
            change = 0.5 * estimator.solved(change, pairs.values, trans)
            columns += [change.real, change.imag]
    return np.hstack(columns)


def _compressed(columns: Array, mass: Any, vectors: int) -> Array:
    """The directions [row, vector] of mass one that matter most for the columns, at most `vectors`."""
    weight = np.sqrt(np.abs(mass.diagonal()))[:, None]
    _, size, combined = np.linalg.svd(weight * columns, full_matrices=False)
    independent = int(np.sum(size > _ROUNDED * size[0]))
    kept = min(vectors, independent)
    directions = (columns @ combined[:kept].T) / size[:kept]
    return orthonormal(directions, mass)
