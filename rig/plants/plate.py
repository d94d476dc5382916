"""A plate on foam under a rigid slider that travels over it on a thin film, detaches and attaches again.

    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = sum_p (-z_i(p) P_p + x_i(p) f_p)         modes i of mass one, points p
    m z'' = -F + sum P,   I_p theta'' = sum (-X P + h f),   I_r psi'' = sum (Y P)
    d = sum z_i q_i - (z - X theta + Y psi),   P = A (k d + c d') >= 0,   |f| <= mu P        rig.model.film

The slider's upper face is guided: it heaves (z), pitches (theta) and rolls (psi) about axes in that face, and the load
F presses on it. h: from there to the plate. It travels along the plate's x from `slider.position` on, at the speed of
the drive, and drags the plate along. Half of the film moves with the slider. The plate's modes are of finite elements
(rig.plants.structures.plate_model); the damping ratio of the highest is given, those of the others follow the
frequency. A plate without a slider, on foam or free, is a scene as well: to be knocked and listened to.

Source: paper 002, "A new mechanism of friction-induced vibration: detachment and reattachment", section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import model_validator

from rig.about import About
from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.friction import Constant
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.errors import SceneError
from rig.model import film
from rig.model.assembly import Assembly, Output
from rig.model.film import over
from rig.model.named_rows import Row
from rig.picture import Own
from rig.plants.belt import RAMPED
from rig.plants.structures import model_store, plate_model
from rig.plants.structures.film_points import FilmPoints
from rig.plants.structures.plate_elements import Foam, Plate
from rig.plants.structures.plate_model import Grid, Reduced
from rig.quantities import (
    KilogramPerCubicMetre,
    Metre,
    Pascal,
    PoissonRatio,
    PositiveMetre,
    Second,
    Section,
    SomeMetre,
)
from rig.solve import film_sums

PICTURES = (Own("rig.view.plate:Plate", ("position", "normal_force", "surface_speed")),)

Array = NDArray[np.float64]
Along = Annotated[int, Ge(1), Le(64)]
Across = Annotated[int, Ge(2), Le(64)]
X, Y, Z = range(3)
SLIDER = ("z", "theta", "psi")
MOST_PLACES = 1000
"""Places at which rows are kept: of 96 points 66 MB. # chosen"""


class Slider(Section):
    """A rigid block; `position`: of its rear edge from the plate's at the start. `travels`: false holds it there."""

    declares: ClassVar = About("a rigid block that the load presses on the film", hardware=True)

    length: PositiveMetre
    width: PositiveMetre
    thickness: PositiveMetre
    density: KilogramPerCubicMetre
    position: SomeMetre = 0.0
    travels: bool = True


class Film(Section):
    """Between slider and plate, a grid of points with equal areas; `across` is even: the rig is its own mirror image.

    It presses by its modulus with the sides held, and bears friction by its shear modulus, derived from the others
    where it is not given. `retardation`: its viscous stress is that times the rate of the elastic one. `opens`: false
    bonds it to the plate: then all points slide and pull as well. `lateral`: friction across the travel too.
    `completed`: what the plate's modes leave out of its deflection is in series with it.
    """

    declares: ClassVar = About("a film that presses and sticks point by point: its forces, those of each point")

    thickness: PositiveMetre
    young: Pascal
    density: KilogramPerCubicMetre
    poisson: PoissonRatio
    shear_modulus: Pascal | None = None
    retardation: Second = 0.0
    along: Along
    across: Across
    opens: bool = True
    lateral: bool = False
    completed: bool = False

    @model_validator(mode="after")
    def _mirrored(self) -> Self:
        if self.across % 2:
            raise ValueError(f"across {self.across} is odd: take {self.across + 1}, or {self.across - 1}")
        return self

    @property
    def normal(self) -> float:
        """Stiffness of a unit area against compression [Pa/m]."""
        modulus = self.young * (1.0 - self.poisson) / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))
        return float(modulus / self.thickness)

    @property
    def shear(self) -> float:
        """Stiffness of a unit area against shear [Pa/m]."""
        modulus = self.shear_modulus or self.young / (2.0 * (1.0 + self.poisson))
        return float(modulus / self.thickness)


class Probe(Section):
    """Where the plate is knocked and looked at: from its rear edge, and from its middle."""

    x: SomeMetre
    y: Metre = 0.0


class Slid(NamedTuple):
    """What a plate under a slider has beside the plate."""

    slider: Slider
    film: Film
    drive: BeltDrive
    load: Load
    friction: Constant

    @property
    def points(self) -> FilmPoints:
        """The points of the film."""
        return FilmPoints(self.slider.length, self.slider.width, self.film.along, self.film.across)


class Parameters(Noisy):
    """The tables of a plate scene. Slider, film, drive, load and friction are there together, or none of them."""

    plate: Plate
    foam: Annotated[Foam | None, About("holds the plate; without it the plate is free", hardware=True)] = None
    probe: Probe
    slider: Slider | None = None
    film: Film | None = None
    drive: BeltDrive | None = None
    load: Load | None = None
    friction: Constant | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        there = [name for name in Slid._fields if getattr(self, name) is not None]
        missing = [f"[{name}]" for name in Slid._fields if name not in there]
        if there and missing:
            raise ValueError(f"[{there[0]}] needs {', '.join(missing)} beside it; a plate alone has none of these")
        if there and self.foam is None:
            raise ValueError("[slider] needs [foam]: nothing else holds the plate against its load")
        faults = list(self._misplaced())
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def _misplaced(self) -> Iterator[str]:
        plate, slid = self.plate, self.slid
        if self.probe.x > plate.length or abs(self.probe.y) > 0.5 * plate.width:
            yield (
                f"probe at x {self.probe.x:g} m, y {self.probe.y:g} m is beside the plate: x up to {plate.length:g} m, "
                f"y within {0.5 * plate.width:g} m"
            )
        if slid is None:
            return
        for name in ("length", "width"):
            size, most = getattr(slid.slider, name), getattr(plate, name)
            if size >= most:
                yield f"slider.{name} {size:g} m is not below plate.{name}, {most:g} m"
        place, longest = slid.slider.position, plate.length - slid.slider.length
        if place > longest > 0.0:
            yield f"slider.position {place:g} m is beyond {longest:g} m, where it meets the plate's edge"
        most = MOST_PLACES * self.grid().pitch
        if longest > most:
            yield f"the slider's way of {longest:g} m is too long for points so close: at most {most:.3g} m"
        if not slid.film.opens and slid.slider.travels:
            yield "film.opens false (bonded) needs slider.travels false: only points that open can travel"
        if slid.film.lateral and not slid.film.opens:
            yield "film.lateral needs film.opens: bonded points slide along the travel alone"
        for name in ("drive", "load"):
            if getattr(slid, name).lag is not None:
                yield f"{name}.lag is not known to a slider on a film: leave it out"

    @property
    def slid(self) -> Slid | None:
        """What goes with a slider; None for a plate alone."""
        if self.slider and self.film and self.drive and self.load and self.friction:
            return Slid(self.slider, self.film, self.drive, self.load, self.friction)
        return None

    @property
    def film_points(self) -> FilmPoints | None:
        """The points whose pressures are outputs; None without a slider, and where the film is bonded."""
        return self.slid.points if self.slid is not None and self.slid.film.opens else None

    def grid(self) -> Grid:
        """The contact points; of a plate alone any will do."""
        if self.slid is None:
            return Grid(0.5 * self.plate.length, 0.5 * self.plate.width, 2, 2)
        block, film = self.slid.slider, self.slid.film
        return Grid(block.length, block.width, film.along, film.across)

    def reduced(self) -> Reduced:
        """The plate's modes. Raises SceneError where its elements cannot give them."""
        try:
            return _reduced(self.plate, self.foam, self.grid(), (self.probe.x, self.probe.y))
        except ValueError as fault:
            raise SceneError("the plate's elements", [str(fault)]) from None


_reduced = model_store.remembered(plate_model.build)  # a sweep asks for one model hundreds of times


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """The rig's rows. `moved`: actuators that the scene commands ("held") or ramps ("ramped"); others are constant."""
    model = p.reduced()
    a = Assembly(title="plate")
    names = [f"q{i}" for i in range(1, len(model.frequencies) + 1)]
    for name, frequency in zip(names, model.frequencies.tolist()):
        omega = 2.0 * math.pi * frequency
        ratio = p.plate.damping_ratio * frequency / float(model.frequencies[-1])
        a.coordinate(name, 1.0, 2.0 * ratio * omega, omega**2)
    seen: Row = dict(zip(names, model.probe[:, Z].tolist()))
    a.struck = seen
    a.outputs |= _motion("plate", seen, "m")
    a.free = {f"plate, mode {i}": f for i, f in enumerate(model.frequencies.tolist(), 1) if f and i <= 12}
    if p.slid is not None:
        _slide(a, p.slid, p.grid(), model, names, moved)
    return a


def _motion(what: str, row: Row, unit: str) -> dict[str, Output]:
    """Place, speed and acceleration of something."""
    parts = (("displacement", "", unit), ("velocity", "'", f"{unit}/s"), ("acceleration", "''", f"{unit}/s^2"))
    return {f"{what}_{name}": Output({f"{c}{mark}": f for c, f in row.items()}, u) for name, mark, u in parts}


def _slide(a: Assembly, p: Slid, grid: Grid, model: Reduced, names: list[str], moved: Mapping[str, str]) -> None:
    """Add slider, film, drive and load."""
    block = p.slider
    area = block.length * block.width
    mass = area * (block.density * block.thickness + 0.5 * p.film.density * p.film.thickness)
    for name, side in zip(SLIDER, (None, block.length, block.width)):
        a.coordinate(name, mass if side is None else mass * (side**2 / 12.0 + block.thickness**2 / 3.0))
    speed = drive.add(a, p.drive, "m/s", moved)
    pressed = load.add(a, p.load, moved)
    a.push("z", {state: -value for state, value in pressed.items()})
    a.signal("position", speed if block.travels else {}, block.position, "drive")
    if not block.travels:
        a.signal("slid", speed, 0.0, "drive")
    own = _film(p, grid, model)
    here = own.everywhere(block.position)
    every = [*names, *SLIDER]
    mu = math.copysign(p.friction.mu, p.drive.speed)
    normal, push = here[0], mu * here[1] - here[0]
    if p.film.opens:  # as the points are at the start: what is known before a run
        a.patch("film", {}, speed, p.friction.friction(), {})
        for point in range(own.points):
            row = _pressed(p, every, own.stiffness * normal[:, point])
            a.normal(f"point {point + 1}", "film", row, dict(zip(every, push[:, point].tolist())))
        a.film = own
        creep = own.creep(p.load.force / own.points)
        told = f": a point is held by the shear of the film, {creep * 1e9:.2g} nm at the most before it slips"
        a.about["friction at film"] = told
    else:
        for name, rows in zip(every, own.stiffness * (push @ normal.T)):
            a.push(name, _pressed(p, every, rows))
        total = _pressed(p, every, own.stiffness * normal.sum(axis=1))
        a.outputs |= {
            "normal_force": Output(total, "N"),
            "friction_force": Output({name: mu * value for name, value in total.items()}, "N"),
        }
    for name, coordinate, unit in (("slider", "z", "m"), ("pitch", "theta", "rad"), ("roll", "psi", "rad")):
        a.outputs |= _motion(name, {coordinate: 1.0}, unit)
    a.outputs |= {"position": Output({"position": 1.0}, "m"), "surface_speed": Output(dict(speed), "m/s")}
    if p.film.opens:
        _contact(a, p, own)


def _pressed(p: Slid, names: list[str], values: Array) -> Row:
    """A row over the coordinates that the film makes, with what its viscosity adds."""
    row: Row = dict(zip(names, values.tolist()))
    if p.film.retardation:
        row |= {f"{name}'": p.film.retardation * value for name, value in zip(names, values.tolist())}
    return row


def _film(p: Slid, grid: Grid, model: Reduced) -> film.Film:
    """The points, those of the left half first."""
    lines = np.flatnonzero(grid.lines > 0.0)
    count = model.shapes.shape[3] - (grid.along - 1) * grid.stride
    components = (Z, X, Y)[: 3 if p.film.lateral else 2]
    h = p.slider.thickness + p.film.thickness
    x = ((np.arange(grid.along) + 0.5) / grid.along - 0.5) * grid.length
    pairs_x, pairs_y = np.repeat(x, len(lines)), np.tile(grid.lines[lines], grid.along)
    modes = len(model.frequencies)
    rows = np.zeros((count, len(components), modes + len(SLIDER), len(pairs_x)))
    at = np.arange(count)[:, None] + np.arange(grid.along) * grid.stride
    for direction, component in enumerate(components):
        shapes = model.shapes[:, component][:, lines][:, :, at]  # mode, line, place, point along
        rows[:, direction, :modes] = shapes.transpose(2, 0, 3, 1).reshape(count, modes, -1)
    rows[:, 0, modes:] = -np.ones_like(pairs_x), pairs_x, -pairs_y
    rows[:, 1, modes + SLIDER.index("theta")] = h
    if p.film.lateral:
        rows[:, 2, modes + SLIDER.index("psi")] = -h
    area = p.slider.length * p.slider.width / (2 * len(pairs_x))
    stiffness = p.film.normal
    if p.film.completed:
        stiffness = 1.0 / (1.0 / stiffness + model.residual)
    return film.Film(
        rows=rows,
        parity=np.array([*_parity(model), 1.0, 1.0, -1.0]),
        pitch=model.pitch,
        travel="position",
        slid="position" if p.slider.travels else "slid",
        longest=float(model.surface.x[-1] - model.surface.x[0]) - grid.length,
        stiffness=stiffness * area,
        damping=stiffness * p.film.retardation * area,
        shear=p.film.shear * area,
        mu=p.friction.mu,
        x=np.tile(pairs_x, 2),
        y=np.concatenate([pairs_y, -pairs_y]),
    )


def _parity(model: Reduced) -> Array:
    """Of each mode: 1 where it lifts both sides of the plate alike, -1 where against each other."""
    signs = np.array([1.0, -1.0, 1.0])[:, None, None]
    both = np.einsum("mclp,mclp->m", model.shapes, signs * model.shapes[:, :, ::-1])
    return np.asarray(np.sign(both), dtype=np.float64)


def _contact(a: Assembly, p: Slid, own: film.Film) -> None:
    """Outputs of the points, together and one by one."""
    a.outputs |= {
        "normal_force": Output({over("normal"): 1.0}, "N"),
        "friction_force": Output({over("friction"): 1.0}, "N"),
        "contact_fraction": Output({over("fraction"): 1.0}, "1"),
        "pressure_centre_x": Output({over("centre_x"): 1.0}, "m"),
        "pressure_centre_y": Output({over("centre_y"): 1.0}, "m"),
        "openings": Output({over("openings"): 1.0 / film_sums.COUNTED}, "1"),
    }
    area = p.slider.length * p.slider.width / own.points
    for name, point in places(p.points, own).items():
        a.outputs[name] = Output({film.at("P", point): 1.0 / area}, "Pa")


def places(points: FilmPoints, own: film.Film) -> dict[str, int]:
    """The output of the pressure at each point, rows along from the rear, across from the right: its number."""
    return dict(zip(points.names, np.lexsort((own.y, own.x)).tolist(), strict=True))
