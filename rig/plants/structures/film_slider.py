"""A rigid slider on a film over a plate: its tables in a scene, the rows that it adds to the plate, its outputs.

    m z'' = -F + sum P,   I_p theta'' = sum (-X P + h f),   I_r psi'' = sum (Y P)
    d = sum z_i q_i - (z - X theta + Y psi),   P = A (k d + c d') >= 0,   |f| <= mu P        rig.model.film

The slider's upper face is guided: the slider heaves (z), pitches (theta) and rolls (psi) about axes in that face. The
load F presses on this face. h: distance from this face to the plate. The slider starts at `slider.position` and moves
along the plate's x at the speed of the drive; friction acts on the plate in this direction. Half of the film's
mass moves with the slider.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import model_validator

from rig.about import About
from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.laws.constant import Constant
from rig.model import film
from rig.model.assembly import Assembly, Output
from rig.model.film import over
from rig.model.named_rows import Row
from rig.picture import Plot
from rig.plants.structures.plate_model import Grid, Reduced
from rig.quantities import KilogramPerCubicMetre, NonNegativeMetre, Pascal, PoissonRatio, PositiveMetre, Second, Section
from rig.solve import film_steps

Array = NDArray[np.float64]


Along = Annotated[int, Ge(1), Le(64)]
Across = Annotated[int, Ge(2), Le(64)]
X, Y, Z = range(3)
SLIDER = ("z", "theta", "psi")
TOGETHER = Plot("displacement of slider and plate"), Plot("velocity of slider and plate"), Plot("acceleration", 1)
TURNS = Plot("pitch and roll"), Plot("pitch and roll velocity"), Plot("pitch and roll acceleration")
CENTRE = Plot("pressure centre", 3)
FORCES = Plot("forces", 4)


class Slider(Section):
    """A rigid block. `position`: from the rear edge of the plate to its own at the start; `travels`: false fixes it."""

    declares: ClassVar = About("a rigid block that the load presses on the film", hardware=True)

    length: PositiveMetre
    width: PositiveMetre
    thickness: PositiveMetre
    density: KilogramPerCubicMetre
    position: NonNegativeMetre = 0.0
    travels: bool = True


class Film(Section):
    """The film between slider and plate: a grid of points with equal areas; `across` is even because of symmetry.

    Its normal stiffness follows from the modulus at zero lateral strain, its shear stiffness from the shear modulus, by
    default that of an isotropic material. `retardation`: viscous stress over the rate of the elastic stress [s].
    `opens`: false bonds the film to the plate; then all points slide and also carry tension. `lateral`: friction also
    across the travel. `completed`: with the flexibility of the plate that its modes lack, up to the band limit, the
    last frequency of `plate.damping`.
    """

    declares: ClassVar = About(
        "a film of points, each of which opens, sticks and slips: forces of the film and of each point"
    )

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
        """Stiffness per area in compression [Pa/m]."""
        modulus = self.young * (1.0 - self.poisson) / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))
        return float(modulus / self.thickness)

    @property
    def shear(self) -> float:
        """Stiffness per area in shear [Pa/m]."""
        modulus = self.shear_modulus or self.young / (2.0 * (1.0 + self.poisson))
        return float(modulus / self.thickness)


class SliderTables(NamedTuple):
    """The tables of a slider on a plate: slider, film, drive, load and friction."""

    slider: Slider
    film: Film
    drive: BeltDrive
    load: Load
    friction: Constant


def motion_of(what: str, row: Row, unit: str, plots: tuple[Plot, Plot, Plot]) -> dict[str, Output]:
    """The outputs displacement, velocity and acceleration of `what`, in these plots; `row`: its displacement [unit]."""
    parts = (("displacement", "", unit), ("velocity", "'", f"{unit}/s"), ("acceleration", "''", f"{unit}/s^2"))
    outputs = {}
    for (name, mark, unit_of_part), plot in zip(parts, plots):
        rates = {f"{coordinate}{mark}": factor for coordinate, factor in row.items()}
        outputs[f"{what}_{name}"] = Output(rates, unit_of_part, plot)
    return outputs


def add(a: Assembly, p: SliderTables, grid: Grid, model: Reduced, names: list[str], moved: Mapping[str, str]) -> None:
    """Add slider, film, drive and load to a plate with the modes `names`. `moved`: see the plant's `assemble`."""
    block = p.slider
    area = block.length * block.width
    mass = area * (block.density * block.thickness + 0.5 * p.film.density * p.film.thickness)
    a.coordinate("z", mass)
    for name, side in (("theta", block.length), ("psi", block.width)):
        a.coordinate(name, mass * (side**2 / 12.0 + block.thickness**2 / 3.0))
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
    normal = here[0]
    push = mu * here[1] - here[0]
    if p.film.opens:  # the points at the start, for the text before a run
        a.patch("film", {}, speed, p.friction.friction(), {})
        for point in range(own.points):
            row = _pressed(p, every, own.stiffness[point] * normal[:, point])
            direction = dict(zip(every, push[:, point].tolist()))
            a.normal(f"point {point + 1}", "film", row, direction)
        a.film = own
        creep = own.creep(p.load.force / own.points)
        note = f": a point is held by the shear of the film, {creep * 1e9:.2g} nm at the most before it slips"
        a.about["friction at film"] = note
    else:
        pushes = own.stiffness[0] * (push @ normal.T)
        for name, rows in zip(every, pushes):
            a.push(name, _pressed(p, every, rows))
        total = _pressed(p, every, own.stiffness[0] * normal.sum(axis=1))
        a.outputs |= {
            "normal_force": Output(total, "N", FORCES),
            "friction_force": Output({name: mu * value for name, value in total.items()}, "N", FORCES),
        }
    a.outputs |= motion_of("slider", {"z": 1.0}, "m", TOGETHER)
    a.outputs |= motion_of("pitch", {"theta": 1.0}, "rad", TURNS) | motion_of("roll", {"psi": 1.0}, "rad", TURNS)
    a.outputs |= {
        "position": Output({"position": 1.0}, "m", Plot()),
        "surface_speed": Output(dict(speed), "m/s", Plot(), "drive"),
    }
    if p.film.opens:
        _contact(a, grid, own)


def _pressed(p: SliderTables, names: list[str], values: Array) -> Row:
    """The force of the film as a row: `values` over the coordinates, and its viscous part over their rates."""
    row: Row = dict(zip(names, values.tolist()))
    if p.film.retardation:
        row |= {f"{name}'": p.film.retardation * value for name, value in zip(names, values.tolist())}
    return row


def _film(p: SliderTables, grid: Grid, model: Reduced) -> film.Film:
    """The film with its points, those of the left half first, then their images."""
    lines = np.flatnonzero(grid.y > 0.0)
    count = model.shapes.shape[3] - (grid.along - 1) * grid.stride
    components = (Z, X, Y)[: 3 if p.film.lateral else 2]
    h = p.slider.thickness + p.film.thickness
    pairs_x = np.repeat(grid.x, len(lines))
    pairs_y = np.tile(grid.y[lines], grid.along)
    own = len(model.frequencies)
    half = len(pairs_x)
    modes = own + (0 if model.rest is None else len(model.rest.parity))
    rows = np.zeros((count, len(components), modes + len(SLIDER), 2 * half))
    at = np.arange(count)[:, None] + np.arange(grid.along) * grid.stride
    for direction, component in enumerate(components):
        shapes = model.shapes[:, component][:, lines][:, :, at]  # mode, line, place, point along
        rows[:, direction, :own, :half] = shapes.transpose(2, 0, 3, 1).reshape(count, own, -1)
    longest = float(model.surface.x[-1] - model.surface.x[0]) - grid.length
    parity = _parity(model)
    if model.rest is not None:
        rest = model.rest.at(grid.pitch * np.arange(count) / longest)
        rows[:, :2, own:modes, :half] = rest.swapaxes(1, 2)
        parity = np.concatenate([parity, model.rest.parity])
    rows[:, 0, modes:, :half] = -np.ones_like(pairs_x), pairs_x, -pairs_y
    rows[:, 1, modes + SLIDER.index("theta"), :half] = h
    if p.film.lateral:
        rows[:, 2, modes + SLIDER.index("psi"), :half] = -h
    signs = np.append(parity, [1.0, 1.0, -1.0])
    rows[..., half:] = rows[..., :half] * signs[:, None]
    rows[:, 2:, :, half:] *= -1.0
    area = p.slider.length * p.slider.width / (2 * half)
    stiffness = p.film.normal
    return film.Film(
        rows=rows,
        pitch=grid.pitch,
        travel="position",
        slid="position" if p.slider.travels else "slid",
        longest=longest,
        stiffness=np.array(stiffness * area),
        damping=np.array(stiffness * p.film.retardation * area),
        shear=np.array(p.film.shear * area),
        mu=np.array(p.friction.mu),
        x=np.tile(pairs_x, 2),
        y=np.concatenate([pairs_y, -pairs_y]),
    )


def _parity(model: Reduced) -> Array:
    """The parity of each mode: 1 if both sides of the plate move alike, -1 if they move against each other."""
    signs = np.array([1.0, -1.0, 1.0])[:, None, None]
    both = np.einsum("mclp,mclp->m", model.shapes, signs * model.shapes[:, :, ::-1])
    return np.asarray(np.sign(both), dtype=np.float64)


def _contact(a: Assembly, grid: Grid, own: film.Film) -> None:
    """Add the outputs of all points together and of each point."""
    a.outputs |= {
        "normal_force": Output({over("normal"): 1.0}, "N", FORCES),
        "friction_force": Output({over("friction"): 1.0}, "N", FORCES),
        "contact_fraction": Output({over("fraction"): 1.0}, "1", Plot(place=2)),
        "pressure_centre_x": Output({over("centre_x"): 1.0}, "m", CENTRE),
        "pressure_centre_y": Output({over("centre_y"): 1.0}, "m", CENTRE),
        "openings": Output({over("openings"): 1.0 / film_steps.COUNTED}, "1", Plot()),
    }
    area = grid.length * grid.width / own.points
    for name, point in places(grid, own).items():
        a.outputs[name] = Output({film.at("P", point): 1.0 / area}, "Pa")


def places(points: Grid, own: film.Film) -> dict[str, int]:
    """Pressure output -> number of the point; in order from the rear, then from the right."""
    return dict(zip(points.names, np.lexsort((own.y, own.x)).tolist(), strict=True))
