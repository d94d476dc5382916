"""Mode shapes of a structure: panels of a figure, a moving picture (GIF), and a recording for rerun.

They are drawn on the outer faces of the mesh where these are known, otherwise on its nodes.

A complex mode shape moves as Re(shape exp(i phase)): nodes do not reach their largest displacement at the same time.
Panels show the phase with the largest displacement. Colours are the displacement along the axis that moves most.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import OutputError, UsageError
from rig.machine.files import draft_of, write_file
from rig.printable import counted
from rig.view.palette import drawn, headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

    from rig.analysis.linear.modes_report import Mode, Modes

Array = NDArray[np.float64]
SUFFIXES = (".gif", ".rrd")
SHOWN = 4
"""Mode shapes in a moving picture, the least stable first."""
MOST = 8
"""Mode shapes in a recording for rerun, the least stable first."""
_FRAMES = 24  # of a period of the moving picture
_FRAME_S = 0.06  # each
_PERIODS = 2  # in a recording for rerun
_MOVED = 0.12  # largest displacement in the picture, of the largest extent
_FLAT = 0.25  # least side of the box around a structure, over its largest
_OPAQUE = 0.8  # of a surface in a figure
_GREY = (176, 182, 192)


class Shape(NamedTuple):
    """A mode on the nodes: `moved` [node, 3], complex, the largest component of size one; `axis` that moves most.

    `place`: the body or node set that moves most.
    """

    title: str
    moved: NDArray[np.complex128]
    axis: int
    place: str = ""

    def at(self, phase: float) -> Array:
        """The displacement [node, 3] at a phase."""
        return np.asarray((self.moved * np.exp(1j * phase)).real)


def shapes(modes: Modes, most: int) -> list[Shape]:
    """The least stable oscillating modes on the nodes. Raises UsageError for a rig without nodes."""
    if modes.nodes is None:
        raise UsageError(f"{modes.scene} has no nodes: mode shapes move on the mesh of a plant structure")
    vibrating = [mode for mode in modes.sliding.modes if mode.frequency]
    return [_shape(modes, mode) for mode in vibrating[:most]]


def _shape(modes: Modes, mode: Mode) -> Shape:
    assert modes.nodes is not None
    amplitudes = np.array([mode.shape.get(name, 0.0) for name in modes.nodes.coordinates])
    moved = modes.nodes.rows @ amplitudes
    largest = np.unravel_index(int(np.abs(moved).argmax()), moved.shape)
    moved = moved / (moved[largest] or 1.0)
    axis = int((np.abs(moved) ** 2).sum(axis=0).argmax())
    title = f"{mode.frequency:.5g} Hz, growth {mode.growth:.4g} 1/s"
    region = next(iter(mode.regions), "")
    place = f"{region} {100.0 * mode.regions[region]:.2g} % of the energy" if region else ""
    return Shape(title, moved, axis, place)


def panels(figure: Figure | SubFigure, modes: Modes, most: int) -> Callable[[float], None]:
    """Draw the least stable modes, one in each panel; returns a function that moves them to a phase."""
    assert modes.nodes is not None
    xyz = modes.nodes.xyz
    faces = modes.nodes.faces
    extent = float(np.ptp(xyz, axis=0).max()) or 1.0
    movers: list[tuple[Shape, Callable[[Array, Array], None]]] = []
    shown = shapes(modes, most)
    columns = math.ceil(len(shown) / 2) if len(shown) > 2 else 1
    for i, shape in enumerate(shown):
        axes: Any = figure.add_subplot(math.ceil(len(shown) / columns), columns, i + 1, projection="3d")
        movers.append((shape, _surface(axes, xyz, faces) if len(faces) else _cloud(axes, xyz)))
        middle = 0.5 * (xyz.min(axis=0) + xyz.max(axis=0))
        sides = np.maximum(np.ptp(xyz, axis=0), _FLAT * extent)  # a flat structure fills its panel
        for set_limits, centre, side in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, sides):
            set_limits(centre - 0.55 * side, centre + 0.55 * side)
        x, y, z = sides / np.linalg.norm(sides)
        axes.set_box_aspect(sides, zoom=min(1.0 / (0.25 * x + 0.43 * y + 1.1 * z), 1.6 / (0.87 * x + 0.5 * y)))
        for drawing in axes.collections:
            drawing.set_clip_on(False)
        axes.set_axis_off()
        axes.set_title(f"{shape.title}\n{shape.place}".rstrip(), fontsize=10, y=0.98)

    def move(phase: float) -> None:
        for shape, draw in movers:
            displaced = shape.at(phase)
            draw(xyz + _MOVED * extent * displaced, displaced[:, shape.axis])

    figure.text(0.5, 0.01, "red and blue: to and fro along the axis that moves most", ha="center", fontsize=9)
    move(0.0)
    return move


def _cloud(axes: Any, xyz: Array) -> Callable[[Array, Array], None]:
    """Draw the nodes at rest; returns a function that moves them to places, coloured by values from -1 to 1."""
    axes.scatter(*xyz.T, s=1.0, color="0.8", depthshade=False)
    points = axes.scatter(*xyz.T, s=5.0, color=[(0.9, 0.9, 0.9)] * len(xyz), depthshade=False)

    def draw(places: Array, values: Array) -> None:
        points._offsets3d = tuple(places.T)  # noqa: SLF001 (there is no other way)
        points.set_color(_colours(values) / 255.0)

    return draw


def _surface(axes: Any, xyz: Array, faces: NDArray[np.int32]) -> Callable[[Array, Array], None]:
    """The same as `_cloud` for the outer faces; at rest their edges."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    axes.add_collection3d(Line3DCollection(xyz[_edges(faces)], colors="0.6", linewidths=0.3, alpha=0.4))
    surface = Poly3DCollection(xyz[faces], linewidths=0.15)
    axes.add_collection3d(surface)

    def draw(places: Array, values: Array) -> None:
        colours = _colours(values[faces].mean(axis=1)) / 255.0
        surface.set_verts(places[faces])
        surface.set_facecolor(np.column_stack([colours, np.full(len(colours), _OPAQUE)]))
        surface.set_edgecolor(np.column_stack([0.6 * colours, np.full(len(colours), _OPAQUE)]))

    return draw


def _edges(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """The edges [edge, 2] of faces, each once."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(edges[edges[:, 0] < edges[:, 1]], axis=0)


def write(modes: Modes, path: Path) -> None:
    """Write the moving mode shapes to a file: GIF, or RRD for rerun. Raises UsageError, OutputError."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: expected a file {' or '.join(SUFFIXES)}")
    if not shapes(modes, 1):
        raise UsageError("no mode oscillates in the range of the reduction")
    if path.suffix.lower() == ".gif":
        write_file(path, _gif(modes))
    else:
        with draft_of(path) as draft:
            _rerun(modes, draft)


def _gif(modes: Modes) -> bytes:
    import io

    from PIL import Image

    movers: list[Callable[[float], None]] = []

    @drawn(9.6, 7.2)
    def page(figure: Figure) -> None:
        what = counted(len(shapes(modes, SHOWN)), "least stable mode")
        headline(figure, f"{modes.scene}: {what}")
        movers.append(panels(figure, modes, SHOWN))
        figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=0.88, wspace=0.0, hspace=0.08)

    figure = page()
    frames = []
    for frame in range(_FRAMES):
        movers[0](2.0 * math.pi * frame / _FRAMES)
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=80)
        frames.append(Image.open(content).convert("P", palette=Image.Palette.ADAPTIVE))
    moving = io.BytesIO()
    frames[0].save(moving, format="GIF", save_all=True, append_images=frames[1:], duration=int(1e3 * _FRAME_S), loop=0)
    return moving.getvalue()


def _rerun(modes: Modes, path: Path) -> None:
    """One view for each mode; the time line `phase` repeats a period."""
    import rerun as rr
    import rerun.blueprint as rrb

    assert modes.nodes is not None
    extent = float(np.ptp(modes.nodes.xyz, axis=0).max()) or 1.0
    xyz = modes.nodes.xyz / extent
    faces = modes.nodes.faces
    triangles = np.vstack([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    triangles = triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)]
    shown = shapes(modes, MOST)
    names = [f"mode_{i}" for i in range(1, len(shown) + 1)]
    views = [
        rrb.Spatial3DView(origin=name, name=f"{shape.title}, {shape.place}".rstrip(", "))
        for name, shape in zip(names, shown)
    ]
    stream = rr.RecordingStream(f"friction-rig mode shapes of {modes.scene}", recording_id=f"shapes {modes.scene}")
    try:
        stream.save(path, default_blueprint=rrb.Blueprint(rrb.Tabs(*views), collapse_panels=True))
    except Exception as fault:  # rerun raises its own kinds
        raise OutputError(f"{path} cannot be written: {fault}") from None
    lines = rr.LineStrips3D(np.asarray(xyz[_edges(faces)], dtype=np.float32), colors=[(*_GREY, 90)], radii=[0.0005])
    rest = lines if len(faces) else rr.Points3D(xyz, colors=[_GREY], radii=[0.002])
    for name in names:
        stream.log(f"{name}/rest", rest, static=True)
        if len(faces):
            stream.log(f"{name}/moved", rr.Mesh3D.from_fields(triangle_indices=triangles), static=True)
    for frame in range(_FRAMES * _PERIODS):
        stream.set_time("phase", duration=frame * _FRAME_S)
        for name, shape in zip(names, shown):
            displaced = shape.at(2.0 * math.pi * frame / _FRAMES)
            colours = _colours(displaced[:, shape.axis])
            places = xyz + _MOVED * displaced
            surface = rr.Mesh3D.from_fields(vertex_positions=places, vertex_colors=colours)
            moved = surface if len(faces) else rr.Points3D(places, colors=colours, radii=[0.004])
            stream.log(f"{name}/moved", moved)
    stream.flush()
    stream.disconnect()


def _colours(values: Array) -> NDArray[np.uint8]:
    """Blue to white to red for values from -1 to 1 [node, 3]."""
    size = np.clip(np.abs(values), 0.0, 1.0)[:, None]
    ends: Sequence[tuple[int, int, int]] = ((33, 102, 172), (178, 24, 43))
    far = np.where(values[:, None] < 0.0, *(np.array(end, dtype=float)[None] for end in ends))
    return np.asarray((1.0 - size) * 245.0 + size * far, dtype=np.uint8)
