"""Bases of a structure, and the reduced model of a scene: from the store, or built.

"modes"      modes with the contacts closed and without friction, and the static deflections of the structure under a
             pair of forces at each contact point, along its normal and along the sliding, and under each load
             (attachment vectors). The basis holds for every coefficient of friction and contact stiffness.
             Or modes with the contacts open; the flexibility that they lack acts in series with each contact spring.
"snapshots"  complex eigenvectors at points of a range, see `snapshots`
"whole"      the matrices as they are

A basis must not depend on numbers that a study varies: modes use the power of ten next to each.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from rig.errors import UsageError
from rig.structure import eigenvalues, model_store, snapshots
from rig.structure.eigenvalues import Modes
from rig.structure.full import Array, Full, Points
from rig.structure.reduced import Kind, Reduced, as_they_are, orthonormal, projected

Told = Callable[[str, float], object]
"""Is told what is being computed, and the share of the whole that is done."""
DENSE = 300
"""Most rows of kind "whole" [chosen]: their matrices are dense, and a propagator of as many states takes minutes."""
_SOURCES = (
    *("matrix_files.py", "mesh.py", "read.py", "faces.py", "contacts.py", "rows.py", "plausible.py"),
    *("full.py", "eigenvalues.py", "reduced.py", "basis.py", "snapshots.py", "estimate.py"),
)
_WIDER = 1.5  # the highest mode of a basis over the highest frequency that is wanted
_REFINED = 3  # each reduces the error of the flexibility left out by shift / (lowest w^2 left out)


@dataclass(frozen=True)
class Reduction:
    """What a basis depends on beside the full structure.

    `modes`: their number; 0: all up to 1.5 times `up_to` [rad/s], the highest frequency that is wanted. `at`: numbers
    of the scene that multiply parts, and contact stiffnesses; modes use their powers of ten. `over`: the range of each
    number that snapshots are trained for, with at most `vectors` vectors, until the estimated relative error of each
    eigenvalue is at most `error`. `residual`: where the flexibility that the modes lack goes.
    """

    kind: Kind = "modes"
    up_to: float = 0.0
    modes: int = 0
    contact: Literal["closed", "open"] = "closed"
    residual: Literal["attachment", "spring", "omitted"] = "attachment"
    at: Mapping[str, float] = field(default_factory=dict)
    over: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    vectors: int = 120
    error: float = 1e-4

    def rounded(self) -> Reduction:
        """The same without what cannot change the basis; modes: with each number of `at` as its power of ten."""
        if self.kind == "modes":
            at = {key: power_of_ten(value) for key, value in self.at.items()}
            return replace(self, at=at, over={}, vectors=0, error=0.0)
        if self.kind == "whole":
            return Reduction("whole")
        return replace(self, at={key: value for key, value in self.at.items() if key not in self.over})


class Deflections:
    """Static deflections under forces, without the part that the modes describe.

    The stiffness may be singular (rigid modes), if they are among the modes: (K + s M)^-1 is used, and what s changes
    is removed by a series in s / w^2 of the modes left out.
    """

    def __init__(self, stiffness: Any, mass: Any, modes: Modes) -> None:
        self._mass = mass
        self._modes = modes
        self._shift = 1e-2 * modes.square[-1] if modes.rigid else 0.0
        self._inverse = eigenvalues.factor(stiffness + self._shift * mass)

    def under(self, forces: Array) -> Array:
        """Deflections [row, force] under `forces` [row, force], free of the modes."""
        free = self._free(self._inverse.solve(forces))
        total = free
        for _ in range(_REFINED if self._modes.rigid else 0):
            free = self._free(self._shift * self._inverse.solve(self._mass @ free))
            total = total + free
        return total

    def _free(self, vectors: Array) -> Array:
        shapes = self._modes.shapes
        for _ in range(2):
            vectors = vectors - shapes @ (shapes.T @ (self._mass @ vectors))
        return vectors

    def flexibility(self, points: Points) -> Array:
        """The flexibility of each point, n (K^-1 - V w^-2 V^T) n^T [m/N]."""
        normal = points.normal.toarray().T
        return np.asarray(np.maximum(np.einsum("ij,ij->j", normal, self.under(normal)), 0.0))


def power_of_ten(value: float) -> float:
    """The power of ten next to a number, by ratio; 0 for 0."""
    return math.copysign(10.0 ** round(math.log10(abs(value))), value) if value else 0.0


def stored(key: str, full: Callable[[], Full], reduction: Reduction, of: str, told: Told | None = None) -> Reduced:
    """The reduced structure of a scene, from the recording or the store, or built.

    `key`: hash of all that `full` depends on. `of`: its subject in a recording. `full` is called only to build.
    Raises UsageError as `build`.
    """
    reduction = reduction.rounded()
    given = {"structure": key, "reduction": asdict(reduction)} | model_store.built_by(Path(__file__).parent, _SOURCES)
    name = sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:32]
    return model_store.stored_or_built(
        f"{name}.structure",
        build=lambda: build(full(), reduction, told),
        write=Reduced.to_bytes,
        read=Reduced.from_bytes,
        of=of,
    )


def build(full: Full, reduction: Reduction, told: Told | None = None) -> Reduced:
    """Reduce a full structure. Raises UsageError for one that cannot be reduced in this way, with what to do."""
    tell: Told = told or (lambda what, share: None)
    if reduction.kind == "whole":
        if full.rows > DENSE:
            raise UsageError(
                f"reduction.kind is 'whole' and the matrices have {full.rows} rows; at most {DENSE} are allowed: "
                f"use 'modes' or 'snapshots'"
            )
        return as_they_are(full)
    if reduction.kind == "snapshots":
        return snapshots.trained(
            full, reduction.over, reduction.at, reduction.up_to, reduction.vectors, reduction.error, tell
        )
    return _of_modes(full, reduction.rounded(), tell)


def _of_modes(full: Full, reduction: Reduction, tell: Told) -> Reduced:
    """Kind "modes"."""
    if reduction.modes > full.rows:
        raise UsageError(
            f"reduction.modes is {reduction.modes} and the matrices have {full.rows} rows, which have no more modes: "
            "ask for fewer"
        )
    closed = reduction.contact == "closed" and bool(full.contacts)
    if closed and reduction.residual == "spring":
        raise UsageError(
            "reduction.residual is 'spring' and reduction.contact is 'closed': modes with closed contacts contain the "
            "springs already; use contact = 'open', or residual = 'attachment'"
        )
    tell("modes", 0.0)
    mass = full.matrix("mass", reduction.at)
    stiffness = full.symmetric_stiffness(reduction.at, closed)
    modes = eigenvalues.modes(stiffness, mass, reduction.modes, 0.0 if reduction.modes else _WIDER * reduction.up_to)
    held = modes if closed or not full.contacts else _held(full, reduction, mass)
    if held.rigid:
        raise UsageError(
            f"the stiffness leaves {held.rigid} rigid mode{'s' * (held.rigid > 1)} that no contact and no support "
            f"holds: hold nodes in the mesh, or add the stiffness that holds them"
        )
    tell("attachment vectors", 0.6)
    left_out = Deflections(stiffness, mass, modes)
    added = np.zeros((full.rows, 0))
    contacts = full.contacts
    if reduction.residual == "attachment" and modes.square.size < full.rows:
        rows = [matrix for points in contacts for matrix in (points.normal, points.along)]
        loads = np.array(list(full.vectors.values())).reshape(-1, full.rows)
        forces = sp.vstack([*rows, sp.csr_array(loads)]).toarray().T if rows or loads.size else added
        added = left_out.under(forces[:, np.any(forces != 0, axis=0)])
    elif reduction.residual == "spring" and not closed:
        contacts = tuple(replace(points, flexibility=left_out.flexibility(points)) for points in contacts)
    basis = orthonormal(np.hstack([modes.shapes, added]), mass, modes.square.size)
    tell("projection", 0.9)
    up_to = reduction.up_to or math.sqrt(modes.square[-1]) / _WIDER
    reduced = projected(
        replace(full, contacts=contacts), basis, stiffness, kind="modes", up_to=up_to, rigid=modes.rigid
    )
    tell("projection", 1.0)
    return reduced


def _held(full: Full, reduction: Reduction, mass: Any) -> Modes:
    """The lowest modes with the contacts closed: rigid ones are held by nothing."""
    return eigenvalues.modes(full.symmetric_stiffness(reduction.at, closed=True), mass, min(8, full.rows - 8))
