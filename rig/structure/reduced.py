"""A reduced structure: full matrices projected on a basis, x = V q, with all that a rig and its reports need of it.

    V^T M V q'' + V^T D V q' + V^T K V q = V^T loads           V real, of mass one; the same V on both sides (Galerkin)

The parts stay apart, so that numbers of the scene that multiply them can change without another basis. It is stored as
bytes (`to_bytes`) on disk and in recordings: a recording needs no files of the user.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from rig.structure import eigenvalues
from rig.structure.eigenvalues import Complex
from rig.structure.full import Array, Doubt, Full, Met, Part, Points

Kind = Literal["modes", "snapshots", "whole"]
_FORMAT = 1  # version of the bytes
_DROPPED = 1e-10  # of the squared length that a vector adds to a basis: less is rounding
_POINTS = ("normal", "along", "area", "radius", "position", "sliding", "flexibility")


@dataclass(frozen=True)
class Reduced:
    """A reduced structure.

    `model`: parts [coordinate, coordinate], contact rows [point, coordinate] and vectors [coordinate] are dense arrays
    in it; its `node`, `direction`, `ids`, `xyz` and `faces` are those of the full structure. `basis` [row, coordinate]
    in single precision gives shapes on the nodes, x = basis q. `up_to` [rad/s]: highest frequency that the basis is
    made for, 0 for all. `trained`: the range of each number of the scene that the basis is made for, empty for kinds
    that hold for every number; `points`: where snapshots were taken; `error`: the largest relative error that was
    estimated over the range. `rigid`: the number of modes at frequency zero. `masses` [coordinate, coordinate]: of each
    region of the structure, by name.
    """

    kind: Kind
    model: Full
    basis: NDArray[np.float32]
    up_to: float = 0.0
    trained: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    points: tuple[Mapping[str, float], ...] = ()
    error: float = 0.0
    rigid: int = 0
    masses: Mapping[str, Array] = field(default_factory=dict)

    @property
    def coordinates(self) -> int:
        """The number of coordinates q."""
        return self.model.rows

    def eigenvalues(
        self,
        values: Mapping[str, float],
        damping: Array | None = None,
        vectors: Literal["none", "right", "both"] = "right",
    ) -> tuple[Complex, Complex, Complex]:
        """All eigenvalues [2 n] in rad/s, right and left vectors [n, 2 n], for these `values` by key.

        `damping` [n, n] is added: modal damping. Without `vectors` a point takes three quarters of the time.
        """
        mass, own, stiffness = self.pencil(values)
        return eigenvalues.dense(mass, own if damping is None else own + damping, stiffness, vectors)

    def pencil(self, values: Mapping[str, float]) -> tuple[Array, Array, Array]:
        """Dense M, D and K with the springs of all points, for these `values` by key."""
        return self.model.pencil(values)  # type: ignore[return-value]

    def outside(self, values: Mapping[str, float]) -> list[str]:
        """For each number that lies outside of the trained range: a sentence about it."""
        return [
            f"{key} = {values[key]:g} lies outside of the range that the basis was trained for, {low:g} to {high:g}"
            for key, (low, high) in self.trained.items()
            if not low * (1 - 1e-9) - 1e-12 * abs(high) <= values[key] <= high * (1 + 1e-9)
        ]

    def to_bytes(self) -> bytes:
        """The model as bytes of an NPZ file; equal models give equal bytes."""
        arrays: dict[str, Any] = {"basis": self.basis}
        arrays |= {name: getattr(self.model, name) for name in ("node", "direction", "ids", "xyz", "faces")}
        arrays |= {f"part{i}": part.matrix for i, part in enumerate(self.model.parts)}
        arrays |= {f"vector{i}": vector for i, vector in enumerate(self.model.vectors.values())}
        arrays |= {f"mass{i}": mass for i, mass in enumerate(self.masses.values())}
        for title, contacts in (("contact", self.model.contacts), ("finer", self.model.finer)):
            for i, points in enumerate(contacts):
                arrays |= {f"{title}{i}.{name}": getattr(points, name) for name in _POINTS}
        head = {
            "format": _FORMAT,
            "kind": self.kind,
            "up_to": self.up_to,
            "rigid": self.rigid,
            "trained": self.trained,
            "points": self.points,
            "error": self.error,
            "parts": [[part.name, part.of, part.key, part.power, part.factor] for part in self.model.parts],
            "vectors": list(self.model.vectors),
            "contact": [points.name for points in self.model.contacts],
            "finer": [points.name for points in self.model.finer],
            "met": [_plain(points.met) for points in self.model.contacts],
            "total": self.model.total,
            "doubts": self.model.doubts,
            "masses": list(self.masses),
        }
        file = io.BytesIO()
        text = json.dumps(head).encode()
        np.savez(file, head=np.frombuffer(text, dtype=np.uint8), **arrays)
        return file.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """Read what `to_bytes` wrote. Raises ValueError for other content."""
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            head = json.loads(arrays["head"].tobytes())
            if head["format"] != _FORMAT:
                raise ValueError
            parts = tuple(
                Part(name, of, arrays[f"part{i}"], key, power, factor)
                for i, (name, of, key, power, factor) in enumerate(head["parts"])
            )
            met = [_met(stored) for stored in head.get("met", [None] * len(head["contact"]))]  # as faces
            contacts = _stored_points(arrays, "contact", head["contact"])
            contacts = tuple(replace(points, met=of) for points, of in zip(contacts, met, strict=True))
            finer = _stored_points(arrays, "finer", head["finer"])
            vectors = {name: arrays[f"vector{i}"] for i, name in enumerate(head["vectors"])}
            node = arrays["node"]
            direction = arrays["direction"]
            ids = arrays["ids"]
            xyz = arrays["xyz"]
            faces = arrays.get("faces", np.zeros((0, 4), dtype=np.int32))  # earlier models have none
            if faces.dtype != np.int32 or faces.shape[1:] != (4,):
                raise ValueError
            if not np.isin(faces, np.arange(len(ids))).all():
                raise ValueError
            model = Full(parts, node, direction, ids, xyz, contacts, vectors, finer, faces, head.get("total"))
            model = replace(model, doubts=_doubts(head.get("doubts", ())))
            masses = {name: arrays[f"mass{i}"] for i, name in enumerate(head.get("masses", ()))}
            trained = {key: (float(low), float(high)) for key, (low, high) in head["trained"].items()}
            points = tuple(head["points"])
            error = head["error"]
            rigid = head["rigid"]
            reduced = cls(head["kind"], model, arrays["basis"], head["up_to"], trained, points, error, rigid, masses)
            if not parts:
                raise ValueError
            size = reduced.basis.shape[1]
            if any(part.matrix.shape != (size, size) for part in parts):
                raise ValueError
        except (KeyError, TypeError, ValueError, AttributeError, OSError, EOFError, zipfile.BadZipFile):
            raise ValueError("is not a reduced structure of this version") from None
        return reduced


def _stored_points(arrays: Mapping[str, Any], title: str, names: Sequence[str]) -> tuple[Points, ...]:
    """The contacts that `to_bytes` stored below `title`."""
    contacts = []
    for i, name in enumerate(names):
        members = [arrays[f"{title}{i}.{member}"] for member in _POINTS]
        contacts.append(Points(name, *members))
    return tuple(contacts)


def _plain(met: Met | None) -> dict[str, Any] | None:
    """What is stored of the meeting of a contact."""
    if met is None:
        return None
    return {of.name: getattr(met, of.name) for of in fields(met) if of.compare}


def _met(stored: Mapping[str, Any] | None) -> Met | None:
    return None if stored is None else Met(**{**stored, "doubts": _doubts(stored["doubts"])})


def _doubts(stored: Sequence[Sequence[str]]) -> tuple[Doubt, ...]:
    return tuple((what, remedy) for what, remedy in stored)


def orthonormal(vectors: Array, mass: Any, modes: int = 0) -> Array:
    """A basis [row, coordinate] of mass one of the columns; the first `modes` of them stay as they are.

    The other columns lose their part in the modes before they are scaled, twice. Otherwise a soft support drowns the
    flexibility near a contact, and no number of modes brings it back. What is linearly dependent is left out.
    """
    kept, added = vectors[:, :modes], vectors[:, modes:]
    if modes:
        kept = _independent(kept, mass)
    for _ in range(2):
        added = added - kept @ (kept.T @ (mass @ added))
        length = np.sqrt(np.einsum("ij,ij->j", added, mass @ added))
        added = added[:, length > 0] / length[length > 0]
    if not added.shape[1]:
        return kept
    added = _independent(added, mass)
    added = _independent(added - kept @ (kept.T @ (mass @ added)), mass)
    return np.hstack([kept, added])


def _independent(vectors: Array, mass: Any) -> Array:
    """Combinations of the columns of mass one, without the directions that are rounding."""
    size, directions = np.linalg.eigh(vectors.T @ (mass @ vectors))
    kept = size > _DROPPED * size[-1]
    return np.asarray(vectors @ (directions[:, kept] / np.sqrt(size[kept])))


def projected(full: Full, basis: Array, stiffness: Any, **described: Any) -> Reduced:
    """The full structure on the basis, of mass one, in coordinates in which the symmetric `stiffness` is diagonal.

    `described`: the other members of `Reduced`.
    """
    small = basis.T @ (stiffness @ basis)
    _, turn = np.linalg.eigh(0.5 * (small + small.T))
    basis = eigenvalues.signed(basis @ turn)
    masses = _masses(full, basis)
    return Reduced(model=_on(full, basis), basis=basis.astype(np.float32), masses=masses, **described)


def as_they_are(full: Full) -> Reduced:
    """The full structure as dense matrices, without a basis: kind "whole"."""
    basis = np.eye(full.rows)
    return Reduced("whole", _on(full, basis), basis.astype(np.float32), masses=_masses(full, basis))


def _masses(full: Full, basis: Array) -> dict[str, Array]:
    """The mass of each region in the coordinates of the basis."""
    mass: Any = full.matrix("mass", dict.fromkeys(full.keys, 1.0))
    masses = {}
    for name, rows in full.regions.items():
        of_rows = basis[rows]
        masses[name] = np.asarray(of_rows.T @ (mass[rows][:, rows] @ of_rows))
    return masses


def _on(full: Full, basis: Array) -> Full:
    """All of a full structure in the coordinates of the basis."""
    masses = sum(part.of == "mass" for part in full.parts)
    parts = []
    for part in full.parts:
        matrix = basis.T @ (part.matrix @ basis)
        if part.symmetric:
            matrix = 0.5 * (matrix + matrix.T)
        parts.append(replace(part, matrix=matrix))
    if masses == 1:
        parts = [_unit(part) if part.of == "mass" else part for part in parts]
    vectors = {name: vector @ basis for name, vector in full.vectors.items()}
    contacts = _rows(full.contacts, basis)
    finer = _rows(full.finer, basis)
    return replace(full, parts=tuple(parts), contacts=contacts, vectors=vectors, finer=finer, regions={})


def _unit(part: Part) -> Part:
    """A mass part that is the identity but for rounding: the identity."""
    if part.key:
        return part
    unit = np.eye(part.matrix.shape[0]) / part.factor
    return replace(part, matrix=unit) if abs(unit - part.matrix).max() < 1e-9 / part.factor else part


def _rows(contacts: Sequence[Points], basis: Array) -> tuple[Points, ...]:
    """The rows of contacts in the coordinates of the basis."""
    projected_contacts = []
    for points in contacts:
        flexibility = np.asarray(points.flexibility, dtype=float)
        of_points = np.broadcast_to(flexibility, points.area.shape).copy()
        normal = points.normal @ basis
        along = points.along @ basis
        projected_contacts.append(replace(points, normal=normal, along=along, flexibility=of_points))
    return tuple(projected_contacts)
