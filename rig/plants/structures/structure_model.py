"""From the tables of a structure scene to its full matrices and its reduced model, kept by content.

A reduced model does not depend on values that are swept: friction, speed, contact stiffness, load, factors.
"""

from __future__ import annotations

import hashlib
import logging
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pydantic import BaseModel

from rig.errors import SceneError, UsageError
from rig.plants.structures.structure_tables import Contact, Line, Place, Tables, Turning
from rig.structure import basis, model_store, plausible, read
from rig.structure.contacts import Contact as MeshContact
from rig.structure.contacts import contact_points
from rig.structure.eigenvalues import Incomplete
from rig.structure.full import FRICTION, Full, Points
from rig.structure.mesh import Mesh, Selection, tried
from rig.structure.read import Source
from rig.structure.reduced import Reduced
from rig.structure.rows import contact_rows, node_vector
from rig.units import si

Array = NDArray[np.float64]
_log = logging.getLogger("rig")
_SILENT = 5.0  # s before a reduction says what it computes, and between two lines
_UP_TO = 1e4  # Hz: highest frequency that a scene does not state
_VECTORS = 120  # number of vectors that a scene does not state
ALPHA = "damping.alpha"
BETA = "damping.beta"
_SWEPT = (
    "film",
    "stiffness",
    "damping",
    "stiffness_of",
    "shear",
    "spring",
    "damper",
    "opens",
    "friction",
    "speed",
    "speed_min",
    "speed_max",
    "lag",
)


class Given:
    """What a reduced structure depends on, as a key: tables and files, without the values that are swept."""

    def __init__(self, p: Tables) -> None:
        self.parameters = p
        self.reduction = _reduction(p)
        contacts = tuple((name, _plain(contact)) for name, contact in p.contacts.items())
        places = tuple((where, _plain(place)) for where, place in p.places())
        turning = _plain(p.drive) if isinstance(p.drive, Turning) else ()
        self.tables = _plain(p.structure), contacts, places, turning, p.damping.table is None
        try:
            self.files = tuple((str(path), *_stamp(path)) for path in _files(p))
        except (SceneError, OSError):  # a recording that is simulated again needs no files
            self.files = ()
        self._beside = self.tables, self.files
        self._key = *self._beside, repr(self.reduction)

    def alike(self, other: Given) -> bool:
        """Whether the basis is that of `other` but for the numbers that it is made for."""
        reduction = replace(self.reduction, at={})
        of_other = replace(other.reduction, at={})
        return reduction == of_other and self._beside == other._beside

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Given) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


class _Told:
    """Says in the log what takes long: what is computed, every few seconds, and for which values alone it holds."""

    def __init__(self, reduction: basis.Reduction) -> None:
        self._next = time.monotonic() + _SILENT
        fixed = ", ".join(f"{key} = {value:g}" for key, value in reduction.at.items() if value)
        self._holds = ""
        if fixed and reduction.kind == "snapshots":
            advice = "what you vary belongs into reduction.over, or every value is trained anew"
            self._holds = f", for {fixed} alone: {advice}"

    def __call__(self, what: str, share: float) -> None:
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _SILENT
            _log.warning("reducing the structure: %s (%.0f %%); the result is kept%s", what, 100.0 * share, self._holds)


def values_of(p: Tables) -> dict[str, float]:
    """Every number that multiplies matrices or springs, by key: those of the scene, and what follows from them.

    "friction.mu" and "contacts.NAME.friction.mu" are coefficients in steady sliding, below zero for sliding backwards.
    Of a law with memory it is that under an equal share of the load for each contact: the true one follows from the
    model, for which these values are.
    """
    values = {key: value for key, (value, _) in p.numbers.items()}
    values[ALPHA], values[BETA] = p.damping.rayleigh
    for name in p.contacts:
        contact = p.of_stiffness(name)
        values[f"contacts.{name}.stiffness"] = contact.stiffness or contact.spring or 0.0
        if damping := contact.damping or contact.damper:
            values[f"contacts.{name}.damping"] = damping
    if p.friction is not None and p.drive is not None:
        radius = max((contact.radius or 0.0 for contact in p.contacts.values()), default=0.0) or 1.0
        speed = p.drive.speed * (radius if isinstance(p.drive, Turning) else 1.0)
        of_contacts = {f"contacts.{name}.": contact.friction for name, contact in p.contacts.items()}
        share = p.load.force / max(len(p.contacts), 1) if p.load is not None else 0.0
        for where, law in {"": p.friction, **of_contacts}.items():
            if law is not None:
                mu = law.friction().mu(abs(speed), share)
                values[f"{where}{FRICTION}"] = math.copysign(mu, speed)
    return values


def reduced(p: Tables) -> Reduced:
    """The reduced structure: from the recording, the store, or built. Raises SceneError with every fault."""
    return _reduced(Given(p))


def basis_in_run(p: Tables, begun: Tables) -> Mapping[str, float] | None:
    """The numbers for which the basis of `p` is made in a run that began with `begun`; None: there is no basis.

    Raises ValueError if the basis with which the run began cannot describe `p`.

    Displacements stay what they are only on one basis. Modes with attachment vectors hold for other stiffnesses too;
    snapshots were taken for the numbers of their ranges, and for one value of every other number.
    """
    now = Given(p)
    first = Given(begun)
    if now.reduction.kind == first.reduction.kind == "whole":
        return None
    if not now.alike(first):
        raise ValueError(
            "the basis of the reduced structure, whose coordinates are the state of the run, depends on it: with "
            "another one the displacements would jump; make a new run with this value"
        )
    at = now.reduction.at
    before = first.reduction.at
    other = sorted(key for key in at.keys() | before.keys() if at.get(key) != before.get(key))
    if other and now.reduction.kind == "snapshots":
        raise ValueError(
            f"the snapshots of the reduced structure were taken for one value of {', '.join(other)}: make a new run "
            "with this value, or put the range into reduction.over"
        )
    return before


def _plain(value: Any) -> Any:
    """A section as nested tuples, without values that can be swept."""
    if isinstance(value, BaseModel):
        return tuple(_plain(getattr(value, name)) for name in type(value).model_fields if name not in _SWEPT)
    if isinstance(value, dict):
        return tuple((key, _plain(entry)) for key, entry in value.items())
    return value


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


@lru_cache(maxsize=64)
def _hash(path: str, *stamp: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@model_store.cached
def _reduced(given: Given) -> Reduced:
    p = given.parameters
    contents = [_hash(*file) for file in given.files]
    tables = hashlib.sha256(repr((given.tables, given.reduction)).encode()).hexdigest()[:32]
    key = f"{tables} {' '.join(contents)}"
    read: list[Full] = []

    def whole() -> Full:
        read.append(full(p)[0])
        return read[0]

    try:
        return basis.stored(key, whole, given.reduction, f"structure {tables}", _Told(given.reduction))
    except (UsageError, Incomplete) as fault:
        doubts = [f"{what}; {remedy}" for of in read for what, remedy in of.all_doubts]
        raise SceneError("reduction", [*str(fault).splitlines(), *doubts]) from None


def _reduction(p: Tables) -> basis.Reduction:
    """The reduction of a scene; by default typed matrices stay as they are, and files are reduced to modes."""
    given = p.reduction
    values = values_of(p)
    kind = given.kind or ("whole" if p.structure.typed else "modes")
    keys = {part.scaling[0] for part in p.structure.parts.values() if part.of != "damping"}
    if kind == "snapshots":
        keys |= {part.scaling[0] for part in p.structure.parts.values()} | {ALPHA, BETA, FRICTION}
        keys |= {f"contacts.{name}.{number}" for name in p.contacts for number in (FRICTION, "damping")}
    keys -= {""}  # of parts without a factor
    keys |= {f"contacts.{name}.stiffness" for name in p.contacts}
    units = {key: unit for key, (_, unit) in p.numbers.items()}
    over = {}
    for key, ends in given.over.items():
        over[key] = tuple(si(end, units[key]) for end in ends)
    at = p.reduced_at
    if at is None:
        at = {key: values[key] for key in sorted(keys) if key in values}
    return basis.Reduction(
        kind=kind,
        up_to=2.0 * math.pi * (given.up_to or given.modes_up_to or _UP_TO),
        modes=given.modes or 0,
        contact=given.contact,
        residual=given.residual,
        at=at,
        over=over,  # type: ignore[arg-type]
        vectors=given.vectors or _VECTORS,
        error=given.error,
    ).rounded()


def _sources(p: Tables) -> list[Source]:
    sources = []
    for name, part in p.structure.parts.items():
        file = Path(part.file) if part.file else None
        scaled = (*part.scaling, part.factor)
        sources.append(Source(name, part.of, file, part.values, part.name or "", part.stored, *scaled))
    return sources


def _beside(p: Tables) -> dict[str, Any]:
    """The files of a structure that are no parts: job, mesh, node and direction of each row."""
    paths = {key: getattr(p.structure, key) for key in ("job", "nodes", "rows")}
    return {key: Path(path) if path else None for key, path in paths.items()}


def _files(p: Tables) -> tuple[Path, ...]:
    """Every file of the structure and of its contacts. Raises SceneError for one that cannot be read."""
    own = tuple(Path(contact.rows) for contact in p.contacts.values() if contact.rows is not None)
    nodes = p.structure.nodes
    stamp = _stamp(Path(nodes)) if nodes and Path(nodes).exists() else ()
    return (*_listed(tuple(p.structure.paths), *stamp), *own)


@lru_cache(maxsize=8)
def _listed(paths: tuple[tuple[str, str], ...], *stamp: int) -> tuple[Path, ...]:
    """The files that a structure reads, those that its mesh includes too. `stamp`: of the mesh."""
    beside = {key: Path(path) for key, path in paths if not key.startswith("parts.")}
    parts = [Source(key, "mass", Path(path)) for key, path in paths if key.startswith("parts.")]
    return read.files_read(parts, **beside) if paths else ()


def full(p: Tables) -> tuple[Full, Mesh]:
    """The full matrices of a structure with the rows of its contacts and places, in SI, and the mesh.

    Raises SceneError with every fault, each with its key or its file and row.
    """
    faults: list[str] = []
    whole, mesh = read.structure(_sources(p), p.structure.units, **_beside(p), flaws=faults)
    names = p.structure.coordinates or tuple(map(str, range(1, whole.rows + 1)))
    over = {name: i for i, name in enumerate(names)}
    if len(names) != whole.rows:
        faults.append(f"structure.coordinates: there are {len(names)} names for matrices of {whole.rows} rows")

    def vector(row: Line) -> Array:
        out = np.zeros(whole.rows)
        for name, value in row.items():
            if name not in over:
                raise SceneError("", [f"names the row {name!r}; known: {names[0]} to {names[-1]}"])
            out[over[name]] += value
        return out

    def of_place(place: Place) -> Array:
        if place.row is not None:
            return vector(place.row)
        nodes = (place.node,) if place.node is not None else place.nodes or ()
        if len(mesh.ids) or not nodes:
            nodes = tuple(Selection(place.set or "", nodes, place.box).of(mesh).tolist())
        return node_vector(whole, nodes, place.direction or (), mesh)

    def points(name: str, contact: Contact, finer: int) -> Points:
        if contact.rows is not None:
            return contact_rows(name, Path(contact.rows), whole, read.UNITS[p.structure.units])
        if contact.gap is not None and contact.along is not None:
            gap = sp.csr_array(vector(contact.gap)[None])
            along = sp.csr_array(vector(contact.along)[None])
            radius = np.array([contact.radius or 1.0])
            return Points(name, gap, along, np.ones(1), radius, np.zeros((1, 3)), np.zeros((1, 3)))
        assert contact.slave is not None
        assert contact.master is not None
        slave = Selection(contact.slave.set or "", contact.slave.nodes or (), contact.slave.box)
        master = Selection(contact.master.set or "", contact.master.nodes or (), contact.master.box)
        turning = p.drive if isinstance(p.drive, Turning) and contact.sliding is None else None
        turns: dict[str, Any] = {"axis": turning.axis, "centre": turning.centre} if turning else {}
        cells = (finer * contact.points[0], finer * contact.points[1])
        described = MeshContact(
            name, slave, master, contact.normal, contact.sliding, points=cells, search=contact.search, **turns
        )
        return contact_points(described, whole, mesh)

    no_rows = sp.csr_array((0, whole.rows))
    none = Points("", no_rows, no_rows, np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))

    def points_of(chosen: Mapping[str, Contact], finer: int) -> tuple[Points, ...]:
        contacts = []
        for name, contact in chosen.items():
            contacts.append(tried(partial(points, name, contact, finer), none, faults, f"contacts.{name}: "))
        return tuple(contacts)

    on_mesh = {name: contact for name, contact in p.contacts.items() if contact.slave}
    contacts = points_of(p.contacts, 1)
    finer = points_of(on_mesh, 2)
    vectors = {
        where: tried(partial(of_place, place), np.zeros(whole.rows), faults, f"{where}: ")
        for where, place in p.places()
    }
    if faults:
        raise SceneError("structure", dict.fromkeys(faults))
    parts = list(whole.parts)
    if p.damping.table is None:
        constant = [part for part in whole.parts if not part.key]
        masses = [part for part in constant if part.of == "mass"]
        springs = [part for part in constant if part.of == "stiffness" and part.symmetric]
        for key, proportional in ((ALPHA, masses), (BETA, springs)):
            parts += [replace(part, of="damping", name=f"Rayleigh {part.name}", key=key) for part in proportional]
    if len(finer) < len(contacts):
        finer = ()
    whole = replace(whole, parts=tuple(parts), contacts=contacts, vectors=vectors, finer=finer)
    total = None if p.structure.typed else plausible.total_mass(whole)
    regions = plausible.regions(whole, mesh)
    return replace(whole, total=total, regions=regions, doubts=plausible.doubts(whole)), mesh
