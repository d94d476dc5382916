"""A structure of the user's own: matrices of a finite element program, or typed in; contacts, loads, a piezo stack.

    M q'' + D q' + K q = sum_c (n_c N_c + t_c T_c) + p F        N_c = -k_c n_c q,  w_c = r_c W - t_c q'
    M, D, K: sums of parts; a part may be multiplied by a number of the scene: KEY, KEY^2 or 1/KEY

n_c, t_c: rows of contact point c, gap and motion along the sliding relative to the master. k_c is the stiffness per
area times the area of the point, in series with the flexibility that a reduction leaves out. p F: the load. The
coordinates q are those of the matrices, or of a reduced model (rig.structure), which is kept on disk and in recordings.

Steady sliding is the equilibrium with every point closed; a run starts there.
"""

from __future__ import annotations

import hashlib
import logging
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from difflib import get_close_matches
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
import scipy.sparse as sp
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema

from rig.effects import drive, load, piezo
from rig.effects.drive import BeltDrive, DiscDrive, actuator
from rig.effects.load import Load
from rig.effects.piezo import Piezo, WithStack
from rig.errors import SceneError, UsageError
from rig.laws import Friction
from rig.model import film
from rig.model.assembly import Accuracy, Assembly, Input, Nodes, Output
from rig.model.film import Film
from rig.model.friction_law import Law
from rig.model.method import MANY
from rig.model.named_rows import Row
from rig.model.system import Finding, System
from rig.picture import Plot
from rig.plants.belt import RAMPED
from rig.quantities import (
    Hertz,
    MetrePerSecond,
    Newton,
    NewtonPerMetre,
    Number,
    PositiveMetre,
    PositiveNewton,
    PositiveNumber,
    Ratio,
    Section,
    Unit,
    quantity,
    refused,
    unit_of,
)
from rig.solve.film_steps import COUNTED
from rig.stability.linearisation import sliding_key, steady
from rig.structure import basis, estimate, model_store, read
from rig.structure.contacts import Contact as MeshContact
from rig.structure.contacts import contact_points, contact_rows, node_vector
from rig.structure.full import FRICTION, Full, Part, Points
from rig.structure.mesh import Mesh, Selection
from rig.structure.read import Source
from rig.structure.reduced import Reduced
from rig.units import si

Array = NDArray[np.float64]
Line = dict[str, float]
"""A row over typed coordinates."""
PerArea: Any = quantity("N/m^3", Ge(1e-3), Le(1e18))
PerSecond: Any = quantity("1/s", Ge(0.0))
Seconds: Any = quantity("s", Ge(0.0))
_TIMES = re.compile(r"(?P<one>1\s*/\s*)?(?P<key>[A-Za-z]\w*(\.\w+)+)(\s*\^\s*(?P<power>[1-9]))?")
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_SAME = 1e-9  # of the largest entry: rows of the sliding that are equal belong to one contact
_log = logging.getLogger("rig")
_DRAWN = 4000  # nodes that mode shapes are drawn on, at most
_ROUNDING = 1e-9  # of the largest entry
_SILENT = 5.0  # s before a reduction says what it computes, and between two lines
_UP_TO, _VECTORS = 1e4, 120  # highest frequency [Hz] and number of vectors that a scene does not state
ALPHA, BETA = "damping.alpha", "damping.beta"
T = TypeVar("T")


def _direction(value: Any) -> Any:
    """A direction as a text ("z", "-x") or three numbers, as a unit vector."""
    if isinstance(value, str):
        name = value.removeprefix("-")
        if name not in _AXES:
            raise ValueError("expected x, y, z, -x, -y, -z or three numbers, such as [0, 0.6, 0.8]")
        return tuple(-v if value.startswith("-") else v for v in _AXES[name])
    given = np.asarray(value, dtype=float) if isinstance(value, list | tuple) and len(value) == 3 else np.zeros(3)
    size = float(np.linalg.norm(given))
    if not 0.0 < size < math.inf:
        raise ValueError("expected x, y, z or three numbers that are not all zero")
    return tuple((given / size).tolist())


Direction = Annotated[tuple[float, float, float], BeforeValidator(_direction)]


class MatrixPart(Section):
    """One matrix: from a file, or `values` typed in row by row; the number of the scene that multiplies it.

    `name`: of the variable in a file with several. `times`: KEY, KEY^2 or 1/KEY of a number of this scene, in SI.
    `stored`: "full", or the triangle that the file contains.
    """

    of: Literal["mass", "damping", "stiffness"]
    file: str | None = None
    name: str | None = None
    values: tuple[tuple[float, ...], ...] | None = None
    times: str | None = None
    factor: Number = 1.0
    stored: Literal["full", "lower", "upper"] = "full"

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        wrong = []
        if (self.file is None) == (self.values is None):
            wrong.append(("values", 'give either file = "./NAME" or values = [[...], ...], row by row'))
        if self.values is not None:
            count = len(self.values)
            for i, row in enumerate(self.values, 1):
                if len(row) != count:
                    wrong.append(("values", f"row {i} has {len(row)} numbers; a matrix of {count} rows needs {count}"))
        if self.times is not None and not _TIMES.fullmatch(self.times):
            wrong.append(("times", "expected KEY, KEY^2 or 1/KEY, where KEY is a number of this scene: drive.speed"))
        if wrong:
            raise refused(wrong)
        return self

    @property
    def scaling(self) -> tuple[str, int]:
        """The key that multiplies the matrix, and its power; "" for none."""
        if self.times is None or (match := _TIMES.fullmatch(self.times)) is None:
            return "", 1
        power = int(match["power"] or 1)
        return match["key"], -power if match["one"] else power


class Structure(Section):
    """The matrices: `parts` by name, or a job of a finite element program; the unit system of all its numbers.

    `coordinates`: names of typed rows. `rows`: file with node and direction of each row. `nodes`: mesh of the job.
    `film`: in runs the contacts are points of a film, each of which opens, sticks by its shear stiffness and slips on
    its own; by default where their mode sets are too many.
    """

    units: Literal["m-kg-s", "mm-t-s"]
    format: Literal["calculix"] | None = None
    job: str | None = None
    nodes: str | None = None
    rows: str | None = None
    coordinates: tuple[str, ...] | None = None
    parts: dict[str, MatrixPart] = Field(default_factory=dict)
    film: bool | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        wrong = []
        if (self.format is None) != (self.job is None):
            wrong.append(("job", 'format = "calculix" needs job = "./NAME" of the files NAME.sti, NAME.mas, NAME.dof'))
        if not self.parts and self.job is None:
            wrong.append(("parts", 'there is no matrix: give [structure.parts.NAME] of = "mass", ... , or a job'))
        for key, path in self.paths:
            if not path.startswith("/"):
                wrong.append((key, f'begin the path with "./": it is relative to the file of the scene ("./{path}")'))
        if self.coordinates is not None:
            for name in self.coordinates:
                if not name.isidentifier():
                    wrong.append(("coordinates", f"{name!r} is no name: letters, digits and _"))
                elif self.coordinates.count(name) > 1:
                    wrong.append(("coordinates", f"{name!r} is there twice"))
        if wrong:
            raise refused(dict.fromkeys(wrong))
        return self

    @property
    def paths(self) -> Iterator[tuple[str, str]]:
        """Key and path of every file."""
        yield from ((key, path) for key in ("job", "nodes", "rows") if (path := getattr(self, key)) is not None)
        yield from ((f"parts.{name}.file", part.file) for name, part in self.parts.items() if part.file is not None)

    @property
    def typed(self) -> bool:
        """Whether the scene contains every number itself."""
        return not any(True for _ in self.paths)


class Place(Section):
    """Nodes and a direction: one node, a list, a set or a box of the mesh (their mean); or a `row` over coordinates."""

    node: int | None = None
    nodes: tuple[int, ...] | None = None
    set: str | None = None
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    direction: Direction | None = None
    row: Line | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [key for key in ("node", "nodes", "set", "box", "row") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of node, nodes, set, box or row; there is {' and '.join(given) or 'none'}")
        if (self.row is None) == (self.direction is None):
            raise refused([("direction", 'is needed beside nodes, such as direction = "z"')] if self.row is None else
                          [("direction", "a row has its direction already; leave it out")])  # fmt: skip
        return self


class Surface(Section):
    """The nodes of one side of a contact: a set, a list or a box of the mesh."""

    set: str | None = None
    nodes: tuple[int, ...] | None = None
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(getattr(self, key) is not None for key in ("set", "nodes", "box")) != 1:
            raise ValueError("give one of set, nodes or box")
        return self


class Contact(Section):
    """A contact between two surfaces of the mesh, grouped into `points`; or of rows: a file, or `gap` and `along`.

    `stiffness`, `shear`: normal and along, per area. `gap`, `along`: rows over typed coordinates, with
    the `spring` of the contact [N/m] and the `radius` at which it slides on a turning surface. `opens`: it lifts off.
    """

    slave: Surface | None = None
    master: Surface | None = None
    normal: Direction | Literal["face"] = "face"
    sliding: Direction | None = None
    points: tuple[Annotated[int, Ge(1), Le(64)], Annotated[int, Ge(1), Le(64)]] = (1, 1)
    search: PositiveMetre = 1e-3
    stiffness: Annotated[PerArea | None, Unit("N/m^3")] = None
    shear: Annotated[PerArea | None, Unit("N/m^3")] = None
    rows: str | None = None
    gap: Line | None = None
    along: Line | None = None
    spring: NewtonPerMetre | None = None
    radius: PositiveMetre | None = None
    opens: bool = True

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = {
            "slave and master": self.slave is not None or self.master is not None,
            "rows": self.rows is not None,
            "gap and along": self.gap is not None or self.along is not None,
        }
        given = [kind for kind, there in kinds.items() if there]
        wrong = []
        if len(given) != 1:
            wrong.append(("slave", f"give one of {', '.join(kinds)}; there is {' and '.join(given) or 'none'}"))
        for key, other in (("slave", "master"), ("master", "slave"), ("gap", "along"), ("along", "gap")):
            if getattr(self, key) is None and getattr(self, other) is not None and len(given) == 1:
                wrong.append((key, f"is missing beside {other}"))
        needed, beside = ("spring", "stiffness") if self.gap is not None else ("stiffness", "spring")
        if getattr(self, needed) is None:
            unit = "N/m" if needed == "spring" else "N/m^3, per area"
            wrong.append((needed, f"is missing; expected the stiffness of the contact [{unit}]"))
        if getattr(self, beside) is not None:
            wrong.append((beside, f"does not belong to {given[0] if given else 'it'}: give {needed}"))
        if wrong:
            raise refused(wrong)
        return self


class Reduction(Section):
    """How many coordinates are left of the matrices, and which error of the eigenvalues is allowed.

    kind  "modes" (vibration modes with attachment vectors), "snapshots" (eigenvectors over the ranges `over`), "none"
    """

    kind: Literal["modes", "snapshots", "none"] | None = None
    modes_up_to: Hertz | None = None
    modes: Annotated[int, Ge(1), Le(1000)] | None = None
    contact: Literal["closed", "open"] = "closed"
    residual: Literal["spring", "attachment", "none"] = "attachment"
    error: PositiveNumber = 1e-4
    over: dict[str, tuple[float | str, float | str]] = Field(default_factory=dict)
    up_to: Hertz | None = None
    vectors: Annotated[int, Ge(2), Le(2000)] | None = None


class Damping(Section):
    """Damping beside the damping matrices: a `ratio` at a frequency (proportional to it), Rayleigh's, or a `table`.

    `table`: damping ratios of the vibration modes over frequency, [[Hz, ratio], ...], linear in between.
    """

    ratio: Ratio | None = None
    at: Hertz | None = None
    alpha: PerSecond = 0.0
    beta: Seconds = 0.0
    table: tuple[tuple[float, float], ...] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.ratio is None) != (self.at is None):
            raise ValueError('ratio and at belong together: ratio = 0.002, at = "3 kHz"')
        kinds = (self.ratio is not None, self.alpha > 0.0 or self.beta > 0.0, self.table is not None)
        if sum(kinds) > 1:
            raise ValueError("give one of ratio with at, alpha with beta, or table")
        if self.table is not None:
            hertz = [row[0] for row in self.table]
            if not hertz or sorted(set(hertz)) != hertz or min(min(row) for row in self.table) < 0.0:
                raise refused([("table", "expected rows [Hz, ratio] with rising frequencies and ratios from 0 on")])
        return self

    @property
    def rayleigh(self) -> tuple[float, float]:
        """Damping per mass [1/s] and per stiffness [s]."""
        if self.ratio is not None and self.at is not None:
            return 0.0, self.ratio / (math.pi * self.at)
        return self.alpha, self.beta


class Drive(BeltDrive):
    """The type of a field for a surface that slides along a line (BeltDrive) or, with `axis`, turns (Turning)."""

    axis: Direction | None = None
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        as_it_is: Callable[..., Any] = lambda section, serialise: serialise(section)  # noqa: E731
        written = core_schema.wrap_serializer_function_ser_schema(as_it_is, schema=core_schema.any_schema())
        return core_schema.no_info_plain_validator_function(_by_axis, serialization=written)


class Turning(DiscDrive):
    """A surface that turns about `axis` through `centre`; speeds in rad/s."""

    axis: Direction
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _by_axis(value: Any) -> BeltDrive | Turning:
    turns = isinstance(value, Turning) or (isinstance(value, Mapping) and "axis" in value)
    return (Turning if turns else BeltDrive).model_validate(value)


class Press(Load):
    """The load: its force acts at each place of `at`, shared equally by the nodes of the place."""

    at: dict[str, Place] = Field(min_length=1)


class Force(Section):
    """An actuator: a force on nodes, at the start and at most, of either sign."""

    at: Place
    force: Newton = 0.0
    limit: PositiveNewton

    @model_validator(mode="after")
    def _within(self) -> Self:
        if abs(self.force) > self.limit:
            raise ValueError(f"force {self.force:g} N is beyond the limit of {self.limit:g} N")
        return self


class Between(Piezo):
    """The stack between two places; its extension is the displacement of `first` minus that of `second`."""

    first: Place
    second: Place | None = None


class Knock(Section):
    """Where a knock acts: the name of an output; by default the first one, or the first contact."""

    at: str | None = None


class Start(Section):
    """Steady sliding or the unloaded structure, and a velocity of the point of the knock, as after a blow."""

    at: Literal["sliding", "rest"] = "sliding"
    velocity: MetrePerSecond = 0.0


class Parameters(WithStack):
    """The tables of a structure scene. `factors`: numbers of the user's own that parts may be multiplied by."""

    structure: Structure
    factors: dict[str, Number] = Field(default_factory=dict)
    reduction: Reduction = Reduction()
    damping: Damping = Damping()
    contacts: dict[str, Contact] = Field(default_factory=dict)
    drive: Drive | None = None
    load: Press | None = None
    friction: Friction | None = None
    actuators: dict[str, Force] = Field(default_factory=dict)
    outputs: dict[str, Place] = Field(default_factory=dict)
    knock: Knock = Knock()
    piezo: Between | None = None
    start: Start = Start()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if wrong := [*self._numbers(), *self._tables(), *self._rows()]:
            raise refused(wrong)
        return self

    def _tables(self) -> Iterator[tuple[str, str]]:
        for table in ("drive", "friction"):
            if self.contacts and getattr(self, table) is None:
                yield table, "is missing; a structure with [contacts] needs [drive] and [friction]"
        if self.friction is not None and not self.contacts:
            yield "friction", "needs a contact: give [contacts.NAME]"
        for name, path in ((name, contact.rows) for name, contact in self.contacts.items()):
            if path is not None and not path.startswith("/"):
                yield f"contacts.{name}.rows", f'begin the path with "./": it is relative to the scene ("./{path}")'
        for name, contact in self.contacts.items():
            if contact.gap is not None and (contact.radius is None) == isinstance(self.drive, Turning):
                what = "is missing: drive.axis" if contact.radius is None else "needs drive.axis: without it nothing"
                yield f"contacts.{name}.radius", f"{what} turns"
            if contact.slave is not None and contact.sliding is None and not isinstance(self.drive, Turning):
                yield (
                    f"contacts.{name}.sliding",
                    "give the direction of the sliding, or drive.axis for a turning surface",
                )
        if self.knock.at is not None and self.knock.at not in self.outputs:
            yield "knock.at", f"no output has this name; known: {', '.join(self.outputs) or 'none'}"
        if self.reduction.kind == "snapshots" and not self.reduction.over:
            yield (
                "reduction.over",
                'is missing: the ranges to train, such as { "drive.speed" = ["6 rad/s", "25 rad/s"] }',
            )

    def _numbers(self) -> Iterator[tuple[str, str]]:
        of_scene = numbers(self)
        known = {key: value for key, (value, _) in of_scene.items() if not key.startswith("structure.")}
        for name, part in self.structure.parts.items():
            key, power = part.scaling
            where = f"structure.parts.{name}.times"
            if key and key not in known:
                near = get_close_matches(key, known, 1)
                hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
                yield where, f"{key} is no number of this scene; {hint}"
            elif power < 0 and known.get(key) == 0.0:
                yield key, f"{where} divides by it; it must not be zero"
        for key, ends in self.reduction.over.items():
            if key not in known:
                near = get_close_matches(key, known, 1)
                yield "reduction.over", f"{key} is no number of this scene" + f"; did you mean {near[0]}?" * bool(near)
                continue
            try:
                low, high = (si(end, of_scene[key][1]) for end in ends)
                if not low < high:
                    yield (
                        "reduction.over",
                        f"{key}: the range begins with {low:g} and ends with {high:g}; expected it to rise",
                    )
            except ValueError as fault:
                yield "reduction.over", f"{key}: {fault}"

    def _rows(self) -> Iterator[tuple[str, str]]:
        """Faults of typed matrices and of rows over typed coordinates."""
        sizes = {name: len(part.values) for name, part in self.structure.parts.items() if part.values is not None}
        names = self.structure.coordinates
        if self.structure.typed and names is None:
            yield "structure.coordinates", 'is missing: names of the rows of typed matrices, such as ["x", "y"]'
        if names is None:
            return
        for name, size in sizes.items():
            if size != len(names):
                yield f"structure.parts.{name}.values", f"has {size} rows; there are {len(names)} coordinates"
        for where, row in self._typed_rows():
            for name in row:
                if name not in names:
                    yield where, f"names the coordinate {name!r}; known: {', '.join(names)}"
            if not any(row.values()):
                yield where, "moves nothing: every number is zero"

    def _typed_rows(self) -> Iterator[tuple[str, Line]]:
        for name, contact in self.contacts.items():
            for key in ("gap", "along"):
                if (row := getattr(contact, key)) is not None:
                    yield f"contacts.{name}.{key}", row
        yield from ((f"{where}.row", place.row) for where, place in self.places() if place.row is not None)

    def places(self) -> Iterator[tuple[str, Place]]:
        """Key and place of every load, actuator and output, and of the ends of the stack."""
        if self.load is not None:
            yield from ((f"load.at.{name}", place) for name, place in self.load.at.items())
        yield from ((f"actuators.{name}.at", force.at) for name, force in self.actuators.items())
        yield from ((f"outputs.{name}", place) for name, place in self.outputs.items())
        if self.piezo is not None:
            yield "piezo.first", self.piezo.first
            if self.piezo.second is not None:
                yield "piezo.second", self.piezo.second


def numbers(section: BaseModel, prefix: str = "") -> dict[str, tuple[float, str]]:
    """Value and SI unit of every quantity of a section, by dotted key."""
    out: dict[str, tuple[float, str]] = {}
    for name in type(section).model_fields:
        value, key = getattr(section, name), f"{prefix}{name}"
        unit = "1" if name == "factors" else unit_of(type(section), name)
        for entry, part in value.items() if isinstance(value, dict) else [("", value)]:
            here = f"{key}.{entry}" if entry else key
            if isinstance(part, BaseModel):
                out |= numbers(part, f"{here}.")
            elif unit and isinstance(part, float | int) and not isinstance(part, bool):
                out[here] = float(part), unit
            elif not unit:
                break
    return out


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant.

    Raises SceneError with every fault of the files.
    """
    whole = reduced(p)
    model, of_scene, given = whole.model, numbers(p), values_of(p)
    typed = p.structure.coordinates if whole.kind == "none" else None
    names = typed or tuple(f"q{i}" for i in range(1, model.rows + 1))
    scaling = {part.scaling[0] for part in p.structure.parts.values()} - {""}
    moved = {name: how for name, how in moved.items() if name not in scaling}
    mass, damping, stiffness = (model.matrix(of, given) for of in ("mass", "damping", "stiffness"))
    if p.damping.table is not None:
        damping = damping + _modal(p.damping.table, mass, stiffness)
    a = Assembly(title="structure")
    a.block(names, mass, damping, stiffness)

    def row(vector: Array, rate: str = "", factor: float = 1.0) -> Row:
        return {f"{name}{rate}": factor * value for name, value in zip(names, vector.tolist()) if value}

    speed: Row = {}
    if p.drive is not None:
        unit = "rad/s" if isinstance(p.drive, Turning) else "m/s"
        speed = drive.add(a, p.drive, unit, moved)
        a.outputs["drive_speed"] = Output(dict(speed), unit, role="drive")
    pressing = np.zeros(len(names))
    if p.load is not None:
        force = load.add(a, p.load, moved)
        pressing = sum((model.vectors[f"load.at.{name}"] for name in p.load.at), pressing)
        for name, share in row(pressing).items():
            a.push(name, {state: share * value for state, value in force.items()})
    for name, shaker in p.actuators.items():
        key, bounds = f"actuators.{name}.force", (-shaker.limit, shaker.limit)
        pushed = actuator(a, key, "N", shaker.force, 0.0, bounds, shaker.limit, None, f"actuators.{name}", moved)
        for coordinate, share in row(model.vectors[f"actuators.{name}.at"]).items():
            a.push(coordinate, {state: share * value for state, value in pushed.items()})
    springs = [points.springs(given) for points in model.contacts]
    if p.friction is not None:
        _add_contacts(a, p, model, springs, speed, row)
    if p.piezo is not None:
        ends = [model.vectors[f"piezo.{end}"] for end in ("first", "second") if f"piezo.{end}" in model.vectors]
        piezo.add(a, p, row(ends[0] - ends[1] if len(ends) > 1 else ends[0]), moved)
    for name in p.outputs:
        seen = model.vectors[f"outputs.{name}"]
        first = name == next(iter(p.outputs))
        a.outputs |= {
            f"{name}_displacement": Output(row(seen), "m", role="displacement" if first else ""),
            f"{name}_velocity": Output(row(seen, "'"), "m/s", role="velocity" if first else ""),
            f"{name}_acceleration": Output(row(seen, "''"), "m/s^2"),
        }
    struck = p.knock.at or next(iter(p.outputs if not p.contacts else ()), None)
    if struck is not None:
        a.struck = row(model.vectors[f"outputs.{struck}"])
    for key in scaling:
        value, unit = of_scene[key]
        a.inputs[key] = Input(unit, *_range(key, value, model.parts), value, value, ramped="keep it constant")
    _begin(a, p, mass, stiffness, springs, model, pressing)
    if len(whole.model.ids):
        a.nodes = partial(_nodes, whole, names)
    if whole.kind != "none":
        a.accuracy, a.outside = partial(_accuracy, p, whole), tuple(whole.outside(given))
        a.up_to = whole.up_to / (2.0 * math.pi)
    return a


def _nodes(whole: Reduced, names: tuple[str, ...]) -> Nodes:
    """The nodes of the mesh that have rows, at most `_DRAWN` of them."""
    model = whole.model
    free = np.flatnonzero(np.isin(model.node, model.ids) & (model.direction >= 0) & (model.direction < 3))
    places, of = np.unique(np.searchsorted(model.ids, model.node[free]), return_inverse=True)
    rows = np.zeros((len(places), 3, len(names)))
    rows[of, model.direction[free]] = whole.basis[free]
    step = -(-len(places) // _DRAWN)
    return Nodes(model.xyz[places[::step]], rows[::step], names)


def _accuracy(p: Parameters, whole: Reduced, jacobian: Array) -> Accuracy:
    """The estimated errors of the eigenvalues of a reduced structure, and what they do not tell."""
    given, count = values_of(p), whole.coordinates
    mass, damping, stiffness = whole.pencil(given)
    own = -mass @ jacobian[count : 2 * count, count : 2 * count] - damping  # of a table, of a law that falls
    added = own if np.abs(own).max() > _ROUNDING * np.abs(damping).max(initial=1e-300) else None
    notes = [*whole.outside(given), *estimate.weaker_modes(whole, given, added)]
    notes += estimate.growing_without_friction(whole, given, added)
    held = np.abs(mass @ jacobian[count : 2 * count, :count] + stiffness).max() <= 1e-6 * np.abs(stiffness).max()
    if not held or p.piezo is not None:
        notes.append(
            "errors of the eigenvalues are not estimated beside a piezo stack, or where friction depends on more"
        )
        return Accuracy(np.zeros(0, np.complex128), np.zeros(0), tuple(notes))
    try:
        found = _estimator(_Given(p), whole.up_to).at(whole, given, added)
    except (SceneError, OSError):
        notes.append("errors of the eigenvalues are not estimated: the files of the matrices are not there")
        return Accuracy(np.zeros(0, np.complex128), np.zeros(0), tuple(notes))
    if (worst := found.relative.max(initial=0.0)) > p.reduction.error:
        hertz = found.values[int(found.relative.argmax())].imag / (2.0 * math.pi)
        notes.append(
            f"the estimated error at {hertz:.4g} Hz is {worst:.1e}, above reduction.error {p.reduction.error:g}; "
            "use more modes or vectors, or a lower reduction.up_to"
        )
    return Accuracy(found.values, found.relative, tuple(notes))


@lru_cache(maxsize=1)
def _estimator(given: _Given, up_to: float) -> estimate.Estimator:
    return estimate.Estimator(full(given.parameters)[0], up_to, values_of(given.parameters))


def _modal(table: tuple[tuple[float, float], ...], mass: Array, stiffness: Array) -> Array:
    """The damping matrix of ratios over frequency [Hz], for the vibration modes without contacts."""
    from scipy.linalg import eigh

    squares, shapes = eigh(0.5 * (stiffness + stiffness.T), mass)
    omega = np.sqrt(np.maximum(squares, 0.0))
    hertz, ratio = np.array(table).T
    weighed = mass @ shapes
    return np.asarray((weighed * (2.0 * omega * np.interp(omega / (2.0 * math.pi), hertz, ratio))) @ weighed.T)


def _add_contacts(
    a: Assembly, p: Parameters, model: Full, springs: list[Array], speed: Row, row: Callable[..., Row]
) -> None:
    """Add friction patches and normal forces; points with the same slip speed belong to one patch."""
    assert p.friction is not None
    law = p.friction.friction()
    patches: list[tuple[str, Array, float]] = []
    for points, stiffness in zip(model.contacts, springs):
        contact, single = p.contacts[points.name], len(points.area) == 1
        for i, (normal, along) in enumerate(zip(points.normal, points.along)):
            name = points.name if single else f"{points.name}_{i + 1}"
            radius = float(points.radius[i])
            same = (
                patch
                for patch, other, at in patches
                if at == radius and np.abs(along - other).max() <= _SAME * np.abs(other).max()
            )
            if (patch := next(same, "")) == "":
                patch = name
                patches.append((patch, along, radius))
                a.patch(patch, row(along), {state: radius * value for state, value in speed.items()}, law)
            a.normal(name, patch, row(normal, factor=-float(stiffness[i])), row(normal), opens=contact.opens)
        of_contact = [entry[0] for entry in a.normals[-len(points.area) :]]
        a.outputs[f"normal_force_{points.name}"] = Output({f"N:{name}": 1.0 for name in of_contact}, "N", Plot())
    if _as_film(a, p):
        _add_film(a, p, model, springs, law, speed)
        return
    first = patches[0][0]
    a.outputs |= {
        "normal_force": Output({f"N:{name}": 1.0 for name, *_ in a.normals}, "N"),
        "friction_force": Output({f"T:{name}": 1.0 for name, *_ in a.patches}, "N"),
        "slip_speed": Output({f"w:{first}": 1.0}, "m/s", Plot()),
        "surface_speed": Output(dict(a.surface(first)), "m/s", role="drive"),
    }
    a.judges.append(tension)


def _as_film(a: Assembly, p: Parameters) -> bool:
    """Whether the contacts run as points of a film. Raises SceneError if they are to, but cannot."""
    law, asked = p.friction.friction() if p.friction else None, p.structure.film
    wrong = [
        f"contacts.{name}.opens: points of a film open; leave it out" for name, c in p.contacts.items() if not c.opens
    ]
    if law is not None and (law.states or law.backward is not None):
        wrong.append("friction.law: points of a film support no law with memory or with a direction")
    if p.piezo is not None and a.switches:
        wrong.append("piezo: a shunt with a switch needs contacts with mode sets")
    if asked and wrong:
        raise SceneError("structure.film", wrong)
    return not wrong and (6 ** len(a.patches) > MANY if asked is None else asked)


def _add_film(a: Assembly, p: Parameters, model: Full, springs: list[Array], law: Law, speed: Row) -> None:
    """Make the contacts points of a film, with outputs of each point.

    Without `shear` a point is as stiff along the sliding as across it.
    """
    a.signal("slid", dict(speed), 0.0, "drive")
    names = [name for name, *_ in a.normals]
    of_points = list(zip(model.contacts, springs, strict=True))
    shears = [
        stiffness if (shear := p.contacts[points.name].shear) is None else shear * points.area
        for points, stiffness in of_points
    ]
    a.film = own = Film(
        rows=np.stack([np.concatenate([-points.normal for points, _ in of_points]).T,
                       np.concatenate([points.along for points, _ in of_points]).T])[None],
        slid="slid",
        stiffness=np.concatenate(springs),
        shear=np.concatenate(shears),
        mu=np.array(law.static),
        reach=np.concatenate([points.radius for points, _ in of_points]),
        x=np.concatenate([points.position[:, 0] for points, _ in of_points]),
        y=np.concatenate([points.position[:, 1] for points, _ in of_points]),
        law=law,
        tells=True,
    )  # fmt: skip
    load = p.load.force if p.load is not None else 0.0
    creep = (
        f"; it is held by its shear stiffness, {own.creep(load / own.points) * 1e9:.2g} nm at the most before it slips"
    )
    a.about |= {f"friction at {patch}": creep for patch, *_ in a.patches}
    first = 0
    for points, _ in of_points:
        each = range(first, first + len(points.area))
        a.outputs[f"normal_force_{points.name}"] = Output({film.at("P", i): 1.0 for i in each}, "N", Plot())
        first += len(points.area)
    for i, name in enumerate(names):
        a.outputs[f"normal_force_of_{name}"] = Output({film.at("P", i): 1.0}, "N", Plot("normal force of points"))
        a.outputs[f"slip_speed_of_{name}"] = Output({film.at("w", i): 1.0}, "m/s", Plot("slip speed of points"))
        a.outputs[f"state_of_{name}"] = Output({film.at("s", i): 1.0}, "1", Plot("0 open, 1 stick, 2 slip"))
    a.outputs |= {
        "normal_force": Output({film.over("normal"): 1.0}, "N"),
        "friction_force": Output({film.over("friction"): 1.0}, "N"),
        "contact_fraction": Output({film.over("fraction"): 1.0}, "1", Plot(place=2)),
        "openings": Output({film.over("openings"): 1.0 / COUNTED}, "1", Plot()),
        "slip_speed": Output({film.at("w", 0): 1.0}, "m/s", Plot()),
        "surface_speed": Output(
            {state: float(own.reach[0]) * value for state, value in speed.items()}, "m/s", role="drive"
        ),
    }
    a.judges.append(tension)


def tension(system: System, step: float) -> Iterator[Finding]:
    """Points that would have to pull at steady sliding with every contact closed."""
    if system.film is not None:  # its forces are those of the contacts already
        start = system.start.copy()
        start[[system.names.index(film.on(name)) for name in system.coordinates]] = 0.0
        system = replace(system, start=start)
    at = steady(system, sliding_key(system))
    if not at.balanced:
        return
    forces = (at.modes.normal @ at.x + at.modes.normal_t @ at.T).tolist()
    pulls = sorted((force, normal.name) for force, normal in zip(forces, system.normals) if force <= 0.0)
    if pulls:
        shown = ", ".join(f"{name} ({force:.3g} N)" for force, name in pulls[:4])
        more = f" and {len(pulls) - 4} more" if len(pulls) > 4 else ""
        what = f"{len(pulls)} of {len(forces)} contact points do not press at steady sliding: {shown}{more}"
        remedy = "more load, or a load nearer to these points; eigenvalues with every point closed do not hold there"
        yield Finding("warning", what, pulls[0][0], remedy)


def _range(key: str, value: float, parts: Iterable[Part]) -> tuple[float, float]:
    """The range of a number that multiplies parts: of one sign where a part is divided by it."""
    most = max(1e4, abs(value))
    if any(part.key == key and part.power < 0 for part in parts):
        return (1e-9, most) if value > 0.0 else (-most, -1e-9)
    return (0.0 if key == "load.force" else -most), most


def _begin(
    a: Assembly, p: Parameters, mass: Array, stiffness: Array, springs: list[Array], model: Full, pressing: Array
) -> None:
    """Write the start: steady sliding with every point closed, and the velocity of a blow on the point of the knock."""
    q = np.zeros(len(a.coordinates))
    if p.start.at == "sliding" and p.load is not None:
        held = stiffness.copy()
        speed, law = (p.drive.speed if p.drive else 0.0), p.friction.friction() if p.friction else None
        for points, own in zip(model.contacts, springs):
            for k, normal, along, radius in zip(own, points.normal, points.along, points.radius.tolist()):
                slip = radius * speed
                mu = math.copysign(law.mu(abs(slip)), slip) if law is not None else 0.0
                held += k * np.outer(normal + mu * along, normal)
        q = np.linalg.lstsq(held, pressing * p.load.force, rcond=None)[0]
    struck = np.array([a.strike.get(name, 0.0) for name in a.coordinates])
    blow = np.linalg.solve(mass, struck) if p.start.velocity else struck
    v = blow * (p.start.velocity / float(struck @ blow) if p.start.velocity else 0.0)
    a.start |= {name: value for name, value in zip(a.coordinates, q.tolist()) if value}
    a.start |= {f"{name}'": value for name, value in zip(a.coordinates, v.tolist()) if value}


def values_of(p: Parameters) -> dict[str, float]:
    """Every number that multiplies matrices or springs, by key: those of the scene, and what follows from them.

    "friction.mu" is the coefficient in steady sliding, below zero for sliding backwards.
    """
    values = {key: value for key, (value, _) in numbers(p).items()}
    values[ALPHA], values[BETA] = p.damping.rayleigh
    for name, contact in p.contacts.items():
        values[f"contacts.{name}.stiffness"] = contact.stiffness or contact.spring or 0.0
    if p.friction is not None and p.drive is not None:
        radius = max((contact.radius or 0.0 for contact in p.contacts.values()), default=0.0) or 1.0
        speed = p.drive.speed * (radius if isinstance(p.drive, Turning) else 1.0)
        values[FRICTION] = math.copysign(p.friction.friction().mu(abs(speed)), speed)
    return values


def reduced(p: Parameters) -> Reduced:
    """The reduced structure: from the recording, the store, or built. Raises SceneError with every fault."""
    try:
        return _reduced(_Given(p))
    except UsageError as fault:
        raise SceneError("reduction", [f"reduction: {line}" for line in str(fault).splitlines()]) from None


class _Given:
    """What a reduced structure depends on, as a key: tables and files, without the values that are swept."""

    def __init__(self, p: Parameters) -> None:
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
        self._key = self.tables, repr(self.reduction), self.files

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Given) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


_SWEPT = ("film", "stiffness", "shear", "spring", "opens", "speed", "speed_min", "speed_max", "lag")


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
def _reduced(given: _Given) -> Reduced:
    p = given.parameters
    contents = [_hash(*file) for file in given.files]
    tables = hashlib.sha256(repr((given.tables, given.reduction)).encode()).hexdigest()[:32]
    key = f"{tables} {' '.join(contents)}"
    return basis.stored(key, lambda: full(p)[0], given.reduction, f"structure {tables}", _Told())


class _Told:
    """Says in the log what takes long: what is computed, every few seconds."""

    def __init__(self) -> None:
        self._next = time.monotonic() + _SILENT

    def __call__(self, what: str, share: float) -> None:
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _SILENT
            _log.warning("reducing the structure: %s (%.0f %%); the result is kept", what, 100.0 * share)


def _reduction(p: Parameters) -> basis.Reduction:
    """The reduction of a scene; by default typed matrices stay as they are, and files are reduced to modes."""
    given, values = p.reduction, values_of(p)
    kind = given.kind or ("none" if p.structure.typed else "modes")
    keys = {part.scaling[0] for part in p.structure.parts.values() if part.of != "damping"} - {""}
    if kind == "snapshots":
        keys |= {part.scaling[0] for part in p.structure.parts.values()} - {""} | {ALPHA, BETA, FRICTION}
    keys |= {f"contacts.{name}.stiffness" for name in p.contacts}
    units = {key: unit for key, (_, unit) in numbers(p).items()}
    over = {key: tuple(si(end, units[key]) for end in ends) for key, ends in given.over.items()}
    return basis.Reduction(
        kind=kind,
        up_to=2.0 * math.pi * (given.up_to or given.modes_up_to or _UP_TO),
        modes=given.modes or 0,
        contact=given.contact,
        residual=given.residual,
        at={key: values[key] for key in sorted(keys) if key in values},
        over=over,  # type: ignore[arg-type]
        vectors=given.vectors or _VECTORS,
        error=given.error,
    ).rounded()


def _sources(p: Parameters) -> list[Source]:
    return [
        Source(
            name, part.of, Path(part.file) if part.file else None, part.values, part.name or "", part.stored, *scaled
        )
        for name, part in p.structure.parts.items()
        for scaled in [(*part.scaling, part.factor)]
    ]


def _beside(p: Parameters) -> dict[str, Any]:
    """The files of a structure that are no parts: job, mesh, node and direction of each row."""
    given = p.structure
    return {key: Path(path) if (path := getattr(given, key)) else None for key in ("job", "nodes", "rows")}


def _files(p: Parameters) -> tuple[Path, ...]:
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


def full(p: Parameters) -> tuple[Full, Mesh]:
    """The full matrices of a structure with the rows of its contacts and places, in SI, and the mesh.

    Raises SceneError with every fault, each with its key or its file and row.
    """
    whole, mesh = read.structure(_sources(p), p.structure.units, **_beside(p))
    names = p.structure.coordinates or tuple(map(str, range(1, whole.rows + 1)))
    over = {name: i for i, name in enumerate(names)}
    faults: list[str] = []
    if len(names) != whole.rows:
        faults.append(f"structure.coordinates: there are {len(names)} names for matrices of {whole.rows} rows")

    def tried(where: str, make: Callable[[], T], otherwise: T) -> T:
        try:
            return make()
        except SceneError as fault:
            faults.extend(f"{where}: {line}" for line in fault.faults)
            return otherwise

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
        return node_vector(whole, nodes, place.direction or ())

    def points(name: str, contact: Contact, finer: int) -> Points:
        if contact.rows is not None:
            return contact_rows(name, Path(contact.rows), whole)
        if contact.gap is not None and contact.along is not None:
            gap, along = (sp.csr_array(vector(row)[None]) for row in (contact.gap, contact.along))
            radius = np.array([contact.radius or 1.0])
            return Points(name, gap, along, np.ones(1), radius, np.zeros((1, 3)), np.zeros((1, 3)))
        assert contact.slave is not None
        assert contact.master is not None
        slave, master = (Selection(s.set or "", s.nodes or (), s.box) for s in (contact.slave, contact.master))
        turning = p.drive if isinstance(p.drive, Turning) and contact.sliding is None else None
        turns: dict[str, Any] = {"axis": turning.axis, "centre": turning.centre} if turning else {}
        cells = contact.points and (finer * contact.points[0], finer * contact.points[1])
        described = MeshContact(
            name, slave, master, contact.normal, contact.sliding, points=cells, search=contact.search, **turns
        )
        return contact_points(described, whole, mesh)

    none = Points("", *[sp.csr_array((0, whole.rows))] * 2, *[np.zeros(0)] * 2, *[np.zeros((0, 3))] * 2)
    contacts, finer = (
        tuple(tried(f"contacts.{name}", partial(points, name, contact, by), none) for name, contact in chosen.items())
        for by, chosen in ((1, p.contacts), (2, {n: c for n, c in p.contacts.items() if c.slave and c.points}))
    )
    vectors = {where: tried(where, partial(of_place, place), np.zeros(whole.rows)) for where, place in p.places()}
    if faults:
        raise SceneError("structure", dict.fromkeys(faults))
    parts = list(whole.parts)
    if p.damping.table is None:
        own = [replace(part, of="damping", name=f"Rayleigh {part.name}") for part in parts if not part.key]
        parts += [replace(part, key=ALPHA) for part, of in zip(own, (q.of for q in parts if not q.key)) if of == "mass"]
        parts += [
            replace(part, key=BETA)
            for part, of in zip(own, (q.of for q in whole.parts if not q.key))
            if of == "stiffness" and part.symmetric
        ]
    if len(finer) < len(contacts):
        finer = ()
    return replace(whole, parts=tuple(parts), contacts=contacts, vectors=vectors, finer=finer), mesh
