"""A plate on foam under a rigid slider that travels over it on a thin film, detaches and attaches again.

    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = sum_p (-z_i(p) P_p + x_i(p) f_p)         modes i of mass one, points p

P, f: normal and friction force of point p of the film (rig.plants.structures.film_slider). The plate's modes are those
of finite elements (rig.plants.structures.plate_model). The scene gives the damping ratio of the highest mode; the
ratios of the others are proportional to their frequencies. Or it gives a table of ratios over frequency, and may then
add the flexibility that the modes lack, as further coordinates q at the band limit. A scene may have a plate without a
slider, on foam or free, for example to excite it by a knock.

Source: paper 002, "A new mechanism of friction-induced vibration: detachment and reattachment", section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from rig.about import About
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.errors import SceneError
from rig.laws.constant import Constant
from rig.model.assembly import Assembly
from rig.model.named_rows import Row
from rig.picture import Own
from rig.plants.belt import RAMPED
from rig.plants.structures import film_slider, plate_model
from rig.plants.structures.contact_map import Surface
from rig.plants.structures.film_slider import Film, Slider, SliderTables
from rig.plants.structures.plate_elements import Foam, Plate
from rig.plants.structures.plate_model import Grid, Reduced
from rig.plants.structures.same_modes import keyed, refuse_others
from rig.quantities import Hand, Metre, NonNegativeMetre, Section
from rig.structure import model_store

HANDS = {
    "friction.mu": Hand("coefficient of friction"),
    "drive.speed": Hand("speed of the slider"),
    "load.force": Hand("normal force"),
    "plate.damping_ratio": Hand("damping ratio"),
}
PICTURES = (Own("rig.view.plate:Plate", ("position", "normal_force", "surface_speed")),)
FIGURE = Own("rig.view.pressure_figure:compose", ("plate_acceleration",))

MOST_PLACES = 1000
"""Largest number of places at which rows are kept: 66 MB for 96 points. # chosen"""


class Probe(Section):
    """The point of the plate that is knocked and measured: x [m] from its rear edge, y [m] from its middle."""

    x: NonNegativeMetre
    y: Metre = 0.0


class Parameters(Noisy):
    """The tables of a plate scene. Slider, film, drive, load and friction are either all present or all absent."""

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
        given = [name for name in SliderTables._fields if getattr(self, name) is not None]
        missing = [f"[{name}]" for name in SliderTables._fields if name not in given]
        if given and missing:
            raise ValueError(
                f"[{given[0]}] also needs {', '.join(missing)}; a plate without a slider has none of these"
            )
        if given and self.foam is None:
            raise ValueError("[slider] needs [foam], which carries the load of the slider")
        faults = list(self._misplaced())
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def _misplaced(self) -> Iterator[str]:
        plate = self.plate
        slid = self.slid
        if self.probe.x > plate.length or abs(self.probe.y) > 0.5 * plate.width:
            yield (
                f"probe at x {self.probe.x:g} m, y {self.probe.y:g} m is beside the plate: x up to {plate.length:g} m, "
                f"y within {0.5 * plate.width:g} m"
            )
        if slid is None:
            return
        for name in ("length", "width"):
            size = getattr(slid.slider, name)
            most = getattr(plate, name)
            if size >= most:
                yield f"slider.{name} {size:g} m is not below plate.{name}, {most:g} m"
        place = slid.slider.position
        longest = plate.length - slid.slider.length
        if place > longest > 0.0:
            yield f"slider.position {place:g} m is beyond {longest:g} m, where it meets the plate's edge"
        most = MOST_PLACES * self.grid().pitch
        if longest > most:
            yield f"the slider's way of {longest:g} m is too long for points so close: at most {most:.3g} m"
        if not slid.film.opens and slid.slider.travels:
            yield "film.opens false (bonded) needs slider.travels false: only points that open can travel"
        if slid.film.completed and plate.damping is None:
            yield "film.completed needs plate.damping: its last frequency is the band limit of what the modes lack"
        if slid.film.lateral and not slid.film.opens:
            yield "film.lateral needs film.opens: bonded points slide along the travel alone"
        for name in ("drive", "load"):
            if getattr(slid, name).lag is not None:
                yield f"{name}.lag is not known to a slider on a film: leave it out"

    @property
    def slid(self) -> SliderTables | None:
        """The slider and what acts on it; None for a plate alone."""
        if self.slider and self.film and self.drive and self.load and self.friction:
            return SliderTables(self.slider, self.film, self.drive, self.load, self.friction)
        return None

    @property
    def film_points(self) -> Grid | None:
        """The points whose pressures are outputs; None without a slider, and where the film is bonded."""
        return self.grid() if self.slid is not None and self.slid.film.opens else None

    @property
    def contact_surfaces(self) -> tuple[Surface, ...]:
        """The contact on a map of pressures."""
        return (points.surface,) if (points := self.film_points) is not None else ()

    def grid(self) -> Grid:
        """The contact points; of a plate alone any will do."""
        if self.slid is None:
            return Grid(0.5 * self.plate.length, 0.5 * self.plate.width, 2, 2)
        block = self.slid.slider
        film = self.slid.film
        return Grid(block.length, block.width, film.along, film.across)

    def continuing(self, begun: Self) -> Self:
        """See `Section.continuing`: the modes of plate and foam stay."""
        refuse_others(self._of_modes, begun._of_modes)
        return self

    @property
    def _of_modes(self) -> dict[str, Any]:
        """The values that the shapes of the modes depend on."""
        grid = self.grid()
        plate = self.plate
        values = keyed("plate", plate, ("damping_ratio", "damping")) | keyed("foam", self.foam)
        values |= {"slider.length": grid.length, "slider.width": grid.width}
        if self.slid is None or not self.slid.film.completed or plate.damping is None:
            return values
        of_rest = {"film.along": grid.along, "film.across": grid.across, "film.completed": True}
        return values | of_rest | {"the last frequency of plate.damping": plate.damping[-1][0]}

    def reduced(self) -> Reduced:
        """The plate's modes. Raises SceneError where its elements cannot give them."""
        try:
            completed = self.slid is not None and self.slid.film.completed
            return reduced_model(self.plate, self.foam, self.grid(), (self.probe.x, self.probe.y), completed)
        except ValueError as fault:
            raise SceneError("the plate's elements", [str(fault)]) from None


reduced_model = model_store.cached(plate_model.build)  # a sweep uses one model hundreds of times


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    model = p.reduced()
    a = Assembly(title="plate")
    names = [f"q{i}" for i in range(1, len(model.frequencies) + 1)]
    seen: Row = dict(zip(names, model.probe[:, film_slider.Z].tolist()))
    frequencies = model.frequencies
    if model.rest is not None:
        names += [f"rest{i}" for i in range(1, len(model.rest.parity) + 1)]
        frequencies = np.append(frequencies, np.full(len(model.rest.parity), model.rest.frequency))
    for name, frequency, ratio in zip(names, frequencies.tolist(), p.plate.ratios(frequencies).tolist()):
        omega = 2.0 * math.pi * frequency
        a.coordinate(name, 1.0, 2.0 * ratio * omega, omega**2)
    a.struck = seen
    a.outputs |= film_slider.motion_of("plate", seen, "m", film_slider.TOGETHER)
    a.free = {f"plate, mode {i}": f for i, f in enumerate(model.frequencies.tolist(), 1) if f and i <= 12}
    if p.slid is not None:
        film_slider.add(a, p.slid, p.grid(), model, names, moved)
    return a
