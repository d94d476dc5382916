"""The tables of a scene with the plant `structure`: matrices, contacts, reduction, damping, and what acts on it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from annotated_types import Ge, Le
from pydantic import BaseModel, BeforeValidator, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema

from rig.effects.drive import BeltDrive, DiscDrive
from rig.effects.load import Load
from rig.effects.piezo import Piezo, WithStack
from rig.laws import Friction
from rig.model.friction_law import Law
from rig.quantities import (
    Hertz,
    MetrePerSecond,
    Newton,
    NewtonPerMetre,
    NewtonSecondPerMetre,
    Number,
    PositiveMetre,
    PositiveNewton,
    PositiveNumber,
    Ratio,
    Ratios,
    Section,
    Unit,
    quantity,
    refused,
    unit_of,
)
from rig.units import si

Line = dict[str, float]
"""A row over typed coordinates."""
PerArea: Any = quantity("N/m^3", Ge(1e-3), Le(1e18))
DampingPerArea: Any = quantity("N*s/m^3", Ge(0.0), Le(1e18))
PerSecond: Any = quantity("1/s", Ge(0.0))
Seconds: Any = quantity("s", Ge(0.0))
_TIMES = re.compile(r"(?P<one>1\s*/\s*)?(?P<key>[A-Za-z]\w*(\.\w+)+)(\s*\^\s*(?P<power>[1-9]))?")
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


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
Normal = Annotated[
    tuple[float, float, float] | Literal["face"],
    BeforeValidator(lambda value: value if value == "face" else _direction(value)),
]


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
        match = _TIMES.fullmatch(self.times or "")
        if match is None:
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


class Nodes(Section):
    """Nodes of the mesh: a set, a list, or a box of two corners."""

    set: str | None = None
    nodes: tuple[int, ...] | None = None
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None


class Place(Nodes):
    """Nodes and a direction: one node, a list, a set or a box of the mesh (their mean); or a `row` over coordinates."""

    node: int | None = None
    direction: Direction | None = None
    row: Line | None = None

    @model_validator(mode="after")
    def _one_choice(self) -> Self:
        given = [key for key in ("node", "nodes", "set", "box", "row") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of node, nodes, set, box or row; there is {' and '.join(given) or 'none'}")
        if (self.row is None) == (self.direction is None):
            fault = "a row has its direction already; leave it out"
            if self.row is None:
                fault = 'is needed beside nodes, such as direction = "z"'
            raise refused([("direction", fault)])
        return self


class Surface(Nodes):
    """The nodes of one side of a contact: a set, a list or a box of the mesh."""

    @model_validator(mode="after")
    def _one_choice(self) -> Self:
        if sum(getattr(self, key) is not None for key in ("set", "nodes", "box")) != 1:
            raise ValueError("give one of set, nodes or box")
        return self


class Contact(Section):
    """A contact between two surfaces of the mesh, grouped into `points`; or of rows: a file, or `gap` and `along`.

    `stiffness`, `shear`: normal and along, per area, and `damping` of the normal motion; with `stiffness_of` those of
    another contact. `gap`, `along`: rows over typed coordinates, with the `spring` and the `damper` of the contact and
    the `radius` at which it slides on a turning surface. `friction`: a law of its own, instead of [friction]. `opens`:
    it lifts off.
    """

    slave: Surface | None = None
    master: Surface | None = None
    normal: Normal = "face"
    sliding: Direction | None = None
    points: tuple[Annotated[int, Ge(1), Le(64)], Annotated[int, Ge(1), Le(64)]] = (1, 1)
    search: PositiveMetre = 1e-3
    stiffness: Annotated[PerArea | None, Unit("N/m^3")] = None
    shear: Annotated[PerArea | None, Unit("N/m^3")] = None
    damping: Annotated[DampingPerArea | None, Unit("N*s/m^3")] = None
    stiffness_of: str | None = None
    rows: str | None = None
    gap: Line | None = None
    along: Line | None = None
    spring: NewtonPerMetre | None = None
    damper: NewtonSecondPerMetre | None = None
    radius: PositiveMetre | None = None
    friction: Friction | None = None
    opens: bool = True

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = {
            "slave and master": self.slave is not None or self.master is not None,
            "rows": self.rows is not None,
            "gap and along": self.gap is not None or self.along is not None,
        }
        given = [kind for kind, stated in kinds.items() if stated]
        wrong = []
        if len(given) != 1:
            wrong.append(("slave", f"give one of {', '.join(kinds)}; there is {' and '.join(given) or 'none'}"))
        for key, other in (("slave", "master"), ("master", "slave"), ("gap", "along"), ("along", "gap")):
            if getattr(self, key) is None and getattr(self, other) is not None and len(given) == 1:
                wrong.append((key, f"is missing beside {other}"))
        needed, beside = ("spring", "stiffness") if self.gap is not None else ("stiffness", "spring")
        if self.stiffness_of is not None:
            numbers = ("stiffness", "shear", "damping", "spring", "damper")
            of_own = [key for key in numbers if getattr(self, key) is not None]
            wrong += [
                (key, f"does not belong beside stiffness_of: it is that of {self.stiffness_of}") for key in of_own
            ]
        elif getattr(self, needed) is None:
            unit = "N/m" if needed == "spring" else "N/m^3, per area"
            wrong.append((needed, f"is missing; expected the stiffness of the contact [{unit}]"))
        pairs = {"stiffness": "damping", "spring": "damper"}
        for key, instead in ((beside, needed), (pairs[beside], pairs[needed])):
            if getattr(self, key) is not None and self.stiffness_of is None:
                wrong.append((key, f"does not belong to {given[0] if given else 'it'}: give {instead}"))
        if wrong:
            raise refused(wrong)
        return self


class Reduction(Section):
    """How many coordinates are left of the matrices, and which error of the eigenvalues is allowed.

    kind  "modes" (vibration modes with attachment vectors), "snapshots" (eigenvectors over the ranges `over`), "whole"
    """

    kind: Literal["modes", "snapshots", "whole"] | None = None
    modes_up_to: Hertz | None = None
    modes: Annotated[int, Ge(1), Le(1000)] | None = None
    contact: Literal["closed", "open"] = "closed"
    residual: Literal["spring", "attachment", "omitted"] = "attachment"
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
    table: Ratios | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.ratio is None) != (self.at is None):
            raise ValueError('ratio and at belong together: ratio = 0.002, at = "3 kHz"')
        kinds = (self.ratio is not None, self.alpha > 0.0 or self.beta > 0.0, self.table is not None)
        if sum(kinds) > 1:
            raise ValueError("give one of ratio with at, alpha with beta, or table")
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


class Tables(WithStack):
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
    _reduced_at: Mapping[str, float] | None = None

    @property
    def reduced_at(self) -> Mapping[str, float] | None:
        """In a run, the numbers of the rig with which it began: its basis is made for these. None: for its own."""
        return self._reduced_at

    def on_basis(self, at: Mapping[str, float] | None) -> Self:
        """The same tables on a basis that is made for these numbers of a scene; None: for its own."""
        kept = self.model_copy()
        kept._reduced_at = at  # noqa: SLF001
        return kept

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
            if contact.stiffness_of is not None:
                alike = [
                    n
                    for n, c in self.contacts.items()
                    if not c.stiffness_of and (c.gap is None) == (contact.gap is None)
                ]
                if contact.stiffness_of not in alike:
                    known = ", ".join(alike) or "none"
                    yield f"contacts.{name}.stiffness_of", f"no such contact has a stiffness of its own; known: {known}"
                elif f"contacts.{contact.stiffness_of}.stiffness" in self.reduction.over:
                    yield (
                        f"contacts.{name}.stiffness_of",
                        "a range of reduction.over is that of one contact; leave it out",
                    )
        if self.knock.at is not None and self.knock.at not in self.outputs:
            yield "knock.at", f"no output has this name; known: {', '.join(self.outputs) or 'none'}"
        if self.reduction.kind == "snapshots" and not self.reduction.over:
            yield (
                "reduction.over",
                'is missing: the ranges to train, such as { "drive.speed" = ["6 rad/s", "25 rad/s"] }',
            )

    def _numbers(self) -> Iterator[tuple[str, str]]:
        of_scene = self.numbers
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
                _ = [si(end, of_scene[key][1]) for end in ends]
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

    def of_stiffness(self, name: str) -> Contact:
        """The contact whose stiffness and shear the contact `name` has: its own, or that of `stiffness_of`."""
        return self.contacts[self.contacts[name].stiffness_of or name]

    def law_of(self, name: str) -> Law:
        """The friction law of a contact: its own, or that of [friction]. A contact needs one of them."""
        law = self.contacts[name].friction or self.friction
        assert law is not None
        return law.friction()

    @cached_property
    def numbers(self) -> dict[str, tuple[float, str]]:
        """Value and SI unit of every quantity of the scene, by dotted key."""
        return _numbers(self)

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


def _numbers(section: BaseModel, prefix: str = "") -> dict[str, tuple[float, str]]:
    """Value and SI unit of every quantity of a section, by dotted key."""
    out: dict[str, tuple[float, str]] = {}
    for name in type(section).model_fields:
        value = getattr(section, name)
        key = f"{prefix}{name}"
        unit = "1" if name == "factors" else unit_of(type(section), name)
        for entry, part in value.items() if isinstance(value, dict) else [("", value)]:
            here = f"{key}.{entry}" if entry else key
            if isinstance(part, BaseModel):
                out |= _numbers(part, f"{here}.")
            elif unit and isinstance(part, float | int) and not isinstance(part, bool):
                out[here] = float(part), unit
            elif not unit:
                break
    return out
