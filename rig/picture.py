"""What is to be drawn of a rig, in plain data. Its plant and its effects declare it, `rig.view` draws it.

An output names the plot in which it is drawn (rig.model.assembly.Output):

    a.outputs["band_speed"] = Output({"one": speed}, "m/s", Plot("speeds of the band"))

A plant's module lists its pictures; the first one whose outputs the rig has is drawn:

    PICTURES = (OnBelt(up="height", lifted=True),)

Without any, a viewer shows curves and the strip of contact states, and no picture. Every picture shows the friction and
the normal force as arrows, and the body in the colour of its contact state. Motions are magnified by a round number.

A plant with another figure of a run than the common one declares it as well:

    FIGURE = Own("rig.view.pressure_figure:compose", ("plate_acceleration",))
"""

from __future__ import annotations

from dataclasses import dataclass

IN_FIGURE = 3
"""Last place of a plot that the figure of a run shows even if it is not among the first two plots."""


@dataclass(frozen=True)
class Plot:
    """A plot over time of all outputs that name it and have one unit.

    `title`: by default the name of the output, so that it has a plot of its own. `place`: plots are ordered by it. The
    viewer shows the first plots large and the others as tabs. The figure of a run has panels for the first two plots,
    and for others up to place `IN_FIGURE`.
    """

    title: str = ""
    place: int = 100


_BY_UNIT = {
    "m/s": Plot("velocity", 1),
    "N": Plot("forces", 2),
    "m": Plot("displacement", 4),
    "m/s^2": Plot("acceleration", 5),
    "rad": Plot("angle", 6),
    "rad/s": Plot("angular speed", 7),
    "rad/s^2": Plot("angular acceleration", 8),
    "N*m": Plot("moments", 9),
    "V": Plot("voltage", 10),
    "A": Plot("current", 11),
    "Pa": Plot("pressure", 12),
}


def plot_of(unit: str) -> Plot:
    """The plot of an output in `unit` that names none: that of its quantity, or its own for another unit."""
    return _BY_UNIT.get(unit, Plot())


@dataclass(frozen=True)
class OnBelt:
    """A body on a running belt, a spring from it to a wall, seen from the side.

    `along`, `up` [m], `turn` [rad]: outputs that move the body along the belt, away from it, and about the axis across;
    "" where it does not move so. `lifted`: it stands on a contact spring, seen as a gap; across the belt, where the
    preload alone presses far in, a quarter of the magnification is drawn. `lean` [rad]: a rod that leans against the
    motion of the surface, in place of a block. `surface`: output, speed of the belt [m/s].
    """

    along: str = "displacement"
    up: str = ""
    turn: str = ""
    lifted: bool = False
    lean: float = 0.0
    surface: str = "surface_speed"
    friction: str = "friction_force"
    normal: str = "normal_force"

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that it is drawn from."""
        return tuple(filter(None, (self.along, self.up, self.turn, self.surface, self.friction, self.normal)))


@dataclass(frozen=True)
class OnDisc:
    """A body at the end of an arm over a rotating disc, a spring from the arm to a post.

    `angle` [rad], `surface` [rad/s]: outputs that turn the arm and the disc, about one axis.
    """

    angle: str = "angle"
    surface: str = "disc_speed"
    friction: str = "friction_force"
    normal: str = "normal_force"

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that it is drawn from."""
        return self.angle, self.surface, self.friction, self.normal


@dataclass(frozen=True)
class Own:
    """A picture or a figure of its own, drawn where the rig has `outputs`.

    `drawer`: "module:name" of a class derived from `rig.view.base.Picture`, or of a function that draws a run on an
    empty figure of matplotlib: `compose(figure, run)`. Without a module, ":name", it is in the plant's own file.
    """

    drawer: str
    outputs: tuple[str, ...]


Picture = OnBelt | OnDisc | Own
