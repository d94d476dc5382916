"""The entities of a run in rerun: descriptions once, then blocks of rows with their simulated times.

plant/<output>  sensor/<sensor>  command/<controller>    curves
strip/contact   strip/protocol   strip/<controller>      strips: a state over time
rig/...         portrait/...                             the moving picture, the phase portrait
health/...      event/<process>                          timing and energy of the run, its events

The phase portrait of the viewer: velocity over displacement at the latest steps, coloured by contact state.

Its points are one stretch of steps, none left out, and at most 2 s of them: points farther apart than a fast vibration
would be joined to a shape that there was not.

rerun's 2D view has no axes with numbers. So the curve is divided by a round scale, which grows when needed, and drawn
in a frame whose edges are labelled with the scale.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.bus import topics
from rig.view import contact, curves
from rig.view.base import Columns, Shape
from rig.view.channels import Channels
from rig.view.picture import picture_of

if TYPE_CHECKING:
    import rerun as rr


SHOWN_NS = 2_000_000_000
POINTS = 2000
_FRAME = [[(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], [(-1, 0), (1, 0)], [(0, -1), (0, 1)]]
_GREY = (110, 116, 128)


class Portrait:
    """Collects states and draws the latest of them; `units` of displacement and velocity."""

    def __init__(self, units: tuple[str, str]) -> None:
        self._units = units
        self._points: deque[tuple[int, float, float, int]] = deque(maxlen=POINTS)
        self._scale = (0.0, 0.0)

    def add(self, t_ns: NDArray[np.int64], x: Any, v: Any, modes: Any, step_ns: int) -> None:
        """Add steps, one every `step_ns`. If they do not follow the last one, they begin a new stretch."""
        if self._points and not 0 < t_ns[0] - self._points[-1][0] <= 1.5 * step_ns:
            self._points.clear()
        for point in zip(*(a[-POINTS:].tolist() for a in (t_ns, x, v, modes))):
            if math.isfinite(point[1]) and math.isfinite(point[2]):
                self._points.append(point)

    def draw(self) -> list[Columns]:
        """The curve up to the last state, and the frame if its scale has changed."""
        if not self._points:
            return []
        last = self._points[-1][0]
        while self._points[0][0] < last - SHOWN_NS:
            self._points.popleft()
        table = np.array([(x, v) for _, x, v, _ in self._points])
        now = np.array([last])
        frame = self._frame(now, np.abs(table).max(axis=0))
        table = table / self._scale * (1.0, -1.0)
        modes = np.array([mode for *_, mode in self._points])
        cuts = [0, *(np.flatnonzero(np.diff(modes)) + 1).tolist(), len(modes)]
        strips = [table[begin : end + 1] for begin, end in pairwise(cuts)]
        colours = [contact.rgb(contact.COLOURS[modes[begin]]) for begin in cuts[:-1]]
        curve = Shape("LineStrips2D", strips=strips, colors=colours, radii=[0.012] * len(strips))
        dot = Shape("Points2D", positions=table[-1:], colors=colours[-1:], radii=[0.035])
        return [*frame, Columns("portrait/curve", now, curve), Columns("portrait/now", now, dot)]

    def _frame(self, now: NDArray[np.int64], largest: Any) -> list[Columns]:
        scale = tuple(max(_round_up(float(size)), had) for size, had in zip(largest, self._scale))
        if scale == self._scale:
            return []
        self._scale = (scale[0], scale[1])
        words = [_with_unit(scale[0], self._units[0]), _with_unit(scale[1], self._units[1])]
        frame = Shape("LineStrips2D", strips=_FRAME, colors=[_GREY] * 3, radii=[0.004] * 3)
        labels = Shape(
            "Points2D", positions=[(1.0, 0.0), (0.0, -1.0)], labels=words, colors=[_GREY] * 2, radii=[0.0] * 2
        )
        return [Columns("portrait/frame", now, frame), Columns("portrait/edges", now, labels)]


def _with_unit(value: float, unit: str) -> str:
    """A value with its unit; small lengths and angles in mm, um, mrad or urad."""
    if unit not in ("m", "rad") or value >= 1.0:
        return f"{value:g} {unit}"
    return f"{1e3 * value:g} m{unit}" if value >= 1e-4 else f"{1e6 * value:g} u{unit}"


def _round_up(value: float) -> float:
    """Round up to a number with one or two digits, at least 1e-7."""
    value = max(value, 1e-7)
    base = 10.0 ** math.floor(math.log10(value))
    return next(
        step * base for step in (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0) if value <= step * base * (1.0 + 1e-9)
    )


Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

TIMELINE = "sim_time"
FRAME_NS = 20_000_000
"""Interval between two frames of the picture: 50 per second of simulated time."""
HEALTH = {
    "rate": "rate", "lateness_us": "lateness p99 [us]", "worst_us": "worst lateness [us]", "late": "late frames",
    "overruns": "overruns", "drops": "commands lost", "held": "commands held", "stick_share": "stick share",
    "energy_error": "log10 |energy error|",
}  # fmt: skip
_FAINT = 150
_BAND: Final = "MinMax"
"""How a curve shows several samples in one pixel. rerun's default, their mean, would hide a squeal."""
_SWITCH = {"connected": (58, 140, 96), "disconnected": (70, 74, 82)}


class Drawing:
    """The entities of a scene (JSON text) with these outputs and sensors (name -> unit).

    `apart`: rate of outputs that were recorded too seldom to be joined, in words; `hidden`: they show a motion that
    there was not, so that they are hidden until one clicks on their names.
    """

    def __init__(
        self, scene: str, outputs: Mapping[str, str], sensors: Mapping[str, str], apart: str = "", hidden: bool = False
    ) -> None:
        scene_and_rig = contact.read(scene)
        system = scene_and_rig[1].system() if scene_and_rig else None
        described = curves.described(scene)
        self.plant, self.controllers = str(described.get("plant", "rig")), list(described.get("controllers", {}))
        """Name of the plant, or "rig" if the scene is not readable; names of the controllers in the scene."""
        self.channels = Channels(scene_and_rig, outputs, sensors)
        self.curves = [name for name in outputs if name not in self.channels.at_points]
        """Outputs that are drawn as curves. A quantity at many points is drawn as a map instead."""
        self.points = bool(self.channels.at_points) and (system is None or system.film is not None)
        """Whether the contact is a film of points."""
        self.worded = bool(outputs) and not self.points and (system is None or bool(system.patches))
        """Whether there is a strip of the contact state: not for a film of points, nor for a bonded contact."""
        self.picture = picture_of(*scene_and_rig, system) if scene_and_rig and system else None
        self._lost = scene_and_rig[1].outputs.keys() - outputs.keys() if scene_and_rig else set()
        """Outputs of the rig that a damaged recording has lost. The picture is drawn without them."""
        if self.picture is not None:
            self.picture.paint(self.channels.colours)
        self._modes = contact.Modes(system)
        self._bits = 0
        self._frame_ns = -FRAME_NS
        self._apart, self._hidden = apart, hidden
        self.pair = None if self.points or apart else self.channels.portrait
        """Outputs of the phase portrait, of which a film of points and outputs apart from one another have none."""
        self._portrait = Portrait((outputs[self.pair[0]], outputs[self.pair[1]])) if self.pair else None

    def static(self, rec: rr.RecordingStream) -> None:
        """Send names and colours of all curves and strips, and the geometry of the picture."""
        import rerun as rr

        for name in self.curves:
            colour = contact.rgb(self.channels.colours[name])
            line: Any = rr.SeriesLines(names=_plain(name), colors=[colour], widths=1.6, aggregation_policy=_BAND)
            if self._apart:
                label, shown = f"{_plain(name)} ({self._apart})", [not self._hidden]
                line = rr.SeriesPoints(names=label, colors=[colour], marker_sizes=1.5, visible_series=shown)
            rec.log(f"plant/{name}", line, static=True)
        for name in self.channels.sensors:
            red, green, blue = contact.rgb(self.channels.colour_of(name))
            pale = (min(red + 60, 255), min(green + 60, 255), min(blue + 60, 255), _FAINT)
            label = f"{_plain(name)} (measured)"
            line = rr.SeriesLines(names=label, colors=[pale], widths=1.0, aggregation_policy=_BAND)
            rec.log(f"sensor/{name}", line, static=True)
        for name, label in HEALTH.items():
            rec.log(f"health/{name}", rr.SeriesLines(names=label, widths=1.6), static=True)
        rec.log("health/dropped", rr.SeriesLines(names="dropped by this viewer", widths=1.6), static=True)
        colours = [contact.rgb(colour) for colour in contact.COLOURS]
        if self.worded:
            words = [_states(bits) for bits in range(1, 1 << len(colours))]
            shares = [[c for i, c in enumerate(colours) if 1 << i & bits] for bits in range(1, 1 << len(colours))]
            mixed = [[round(sum(parts) / len(parts)) for parts in zip(*share)] for share in shares]
            lanes = rr.StateConfiguration(values=words, labels=words, colors=mixed)
            rec.log("strip/contact", lanes, static=True)
        for name in self.controllers:
            states = rr.StateConfiguration(values=list(_SWITCH), labels=list(_SWITCH), colors=list(_SWITCH.values()))
            rec.log(f"strip/{name}", states, static=True)
        if self.picture is not None:
            rec.log("rig", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            self.picture.static(lambda path, shape: rec.log(path, _archetype(shape), static=True))

    def measured(self, sensor: str, t_ns: Integers, v: Reals) -> list[Columns]:
        """Measurements of a sensor, converted to the output that it reads."""
        channel = self.channels.measured.get(sensor)
        return [_curve(f"sensor/{sensor}", t_ns, v * channel.factor if channel else v)]

    def modes(self, keys: Integers) -> Integers:
        """Contact state of mode sets, as an index of `rig.view.contact.NAMES`."""
        return self._modes.indices(keys)

    def states(self, t_ns: Integers, signals: Mapping[str, Reals], keys: Integers) -> list[Columns]:
        """All steps of a run: curves, contact states and picture. `keys`: number of the mode set at each row."""
        columns = [self.curve(name, t_ns, signals[name]) for name in self.curves]
        return columns + self.contacts(t_ns, 1 << self.modes(keys)) + self.picture_of(t_ns, signals, keys)

    def curve(self, output: str, t_ns: Integers, v: Reals) -> Columns:
        """Values of an output."""
        return _curve(f"plant/{output}", t_ns, v)

    def contacts(self, t_ns: Integers, bits: Integers) -> list[Columns]:
        """The strip of contact states; from each time on the states, a bit for each, follow one another."""
        changed = np.flatnonzero(np.diff(bits, prepend=self._bits))
        if not changed.size or not self.worded:
            return []
        self._bits = int(bits[-1])
        return [self._strip("contact", t_ns[changed], [_states(int(state_bits)) for state_bits in bits[changed]])]

    def picture_of(
        self, t_ns: Integers, signals: Mapping[str, Reals], keys: Integers, frames: int = 1 << 30
    ) -> list[Columns]:
        """At most `frames` frames of the picture."""
        if self.picture is None:
            return []
        known = {**dict.fromkeys(self._lost, np.full(t_ns.size, np.nan)), **signals}
        return self.picture.frames(t_ns, known, self.modes(keys), self._frames(t_ns, frames))

    def portrait(self, t_ns: Integers, x: Reals, v: Reals, keys: Integers, step_ns: int) -> list[Columns]:
        """The phase portrait of the latest steps, of which these are the last."""
        if self._portrait is None:
            return []
        self._portrait.add(t_ns, x, v, self.modes(keys), step_ns)
        return self._portrait.draw()

    def _frames(self, t_ns: Integers, most: int) -> Integers:
        """Rows for the picture: one for each interval of `FRAME_NS`, at most `most`."""
        rows = np.flatnonzero(np.diff(t_ns // FRAME_NS, prepend=self._frame_ns // FRAME_NS))
        if rows.size:
            self._frame_ns = int(t_ns[rows[-1]])
        return rows if rows.size <= most else rows[np.linspace(0, rows.size - 1, most).astype(np.int64)]

    def commands(self, controller: str, t_ns: Integers, values: Reals) -> list[Columns]:
        """Commands [row, drive] as they took effect."""
        return [_curve(f"command/{controller}", t_ns, values.ravel())]

    def health(self, t_ns: Integers, health: Mapping[str, Sequence[float]]) -> list[Columns]:
        """Curves of the fields of Health messages: name -> values at `t_ns`."""
        curves = []
        for name, values in health.items():
            v = np.asarray(values, np.float64)
            curves.append(_curve(f"health/{name}", t_ns, np.log10(np.abs(v) + 1e-18) if name == "energy_error" else v))
        return curves

    def events(self, events: Iterable[Mapping[str, Any]]) -> list[Columns]:
        """Events as lines of the log; protocol steps and switched controllers also as strips."""
        drawn = []
        for event in events:
            now, kind = np.array([event["t_ns"]], np.int64), event["kind"]
            text = f"{kind}: {event['text']}"
            level = "DEBUG" if kind == "contact" else topics.LEVELS.get(kind, "info").upper()
            drawn.append(Columns(f"event/{event['source']}", now, Shape("TextLog", text=[text], level=[level])))
            if event["source"] != "plant":  # the strips show what happened in the run
                continue
            if kind == "step":
                drawn.append(self._strip("protocol", now, [event["text"]]))
            elif kind in ("connected", "disconnected"):
                drawn.append(self._strip(str(event["data"].get("controller", "controller")), now, [kind]))
        return drawn

    def _strip(self, lane: str, t_ns: Integers, words: list[str]) -> Columns:
        return Columns(f"strip/{lane}", t_ns, Shape("StateChange", state=words))


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _states(bits: int) -> str:
    """The words of contact states, a bit for each."""
    return ", ".join(name for i, name in enumerate(contact.NAMES) if 1 << i & bits)


def _curve(path: str, t_ns: Integers, v: Reals) -> Columns:
    return Columns(path, t_ns, Shape("Scalars", scalars=v))


def send(rec: rr.RecordingStream, batch: Iterable[Columns]) -> None:
    """Send rows to rerun."""
    import rerun as rr

    for path, t_ns, shape in batch:
        if len(t_ns):
            time = rr.TimeColumn(TIMELINE, duration=np.asarray(t_ns).astype("timedelta64[ns]"))
            rows = getattr(rr, shape.kind).columns(**shape.fields)
            each = len(next(iter(shape.fields.values()))) // len(t_ns)
            columns = rows if each == 1 else rows.partition([each] * len(t_ns))
            rec.send_columns(path, indexes=[time], columns=columns)


def _archetype(shape: Shape) -> Any:
    """A shape that never changes as rerun's archetype; an arrow without a vector gets it frame by frame."""
    import rerun as rr

    kind, fields = getattr(rr, shape.kind), shape.fields
    if shape.kind in ("Boxes3D", "Cylinders3D"):
        fields = {"fill_mode": "solid", **fields}
    partial = shape.kind == "Arrows3D" and "vectors" not in fields
    return (kind.from_fields if partial else kind)(**fields)
