"""The entities of a run in rerun: descriptions once, then blocks of rows with their simulated times.

plant/<output>  sensor/<sensor>  command/<controller>    curves
strip/contact   strip/protocol   strip/<controller>      strips: a state over time
rig/...         portrait/...                             the moving picture, the phase portrait
health/...      event/<process>                          timing and energy of the run, its events
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.bus import topics
from rig.view import contact, curves
from rig.view.base import Columns, Shape
from rig.view.channels import Channels
from rig.view.picture import picture_of
from rig.view.portrait import Portrait

if TYPE_CHECKING:
    import rerun as rr

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

TIMELINE = "sim_time"
FRAME_NS = 20_000_000
"""Interval between two frames of the picture: 50 per second of simulated time."""
HEALTH = {
    "rate": "rate",
    "lateness_us": "lateness p99 [us]",
    "worst_us": "worst lateness [us]",
    "late": "late frames",
    "overruns": "overruns",
    "drops": "commands lost",
    "held": "commands held",
    "stick_share": "stick share",
    "energy_error": "log10 |energy error|",
}
"""Fields of Health messages and the names of their curves."""
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
        self.plant = str(described.get("plant", "rig"))
        """Name of the plant, or "rig" if the scene is not readable."""
        self.controllers = list(described.get("controllers", {}))
        """Names of the controllers in the scene."""
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
        self._apart = apart
        self._hidden = hidden
        self.pair = None if self.points or apart else self.channels.portrait
        """Outputs of the phase portrait, of which a film of points and outputs apart from one another have none."""
        self._portrait: Portrait | None = None
        if self.pair:
            displacement, velocity = self.pair
            self._portrait = Portrait((outputs[displacement], outputs[velocity]))

    def static(self, rec: rr.RecordingStream) -> None:
        """Send names and colours of all curves and strips, and the geometry of the picture."""
        import rerun as rr

        for name in self.curves:
            rec.log(f"plant/{name}", self._line(name), static=True)
        for name in self.channels.sensors:
            red, green, blue = contact.rgb(self.channels.colour_of(name))
            pale = (min(red + 60, 255), min(green + 60, 255), min(blue + 60, 255), _FAINT)
            label = f"{_plain(name)} (measured)"
            line = rr.SeriesLines(names=label, colors=[pale], widths=1.0, aggregation_policy=_BAND)
            rec.log(f"sensor/{name}", line, static=True)
        for name, label in HEALTH.items():
            rec.log(f"health/{name}", rr.SeriesLines(names=label, widths=1.6), static=True)
        rec.log("health/dropped", rr.SeriesLines(names="dropped by this viewer", widths=1.6), static=True)
        if self.worded:
            combinations = range(1, 1 << len(contact.COLOURS))
            words = [_states(bits) for bits in combinations]
            mixed = [_mixed(bits) for bits in combinations]
            lanes = rr.StateConfiguration(values=words, labels=words, colors=mixed)
            rec.log("strip/contact", lanes, static=True)
        for name in self.controllers:
            states = rr.StateConfiguration(values=list(_SWITCH), labels=list(_SWITCH), colors=list(_SWITCH.values()))
            rec.log(f"strip/{name}", states, static=True)
        if self.picture is not None:
            rec.log("rig", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            self.picture.static(lambda path, shape: rec.log(path, _archetype(shape), static=True))

    def _line(self, output: str) -> Any:
        """How an output is drawn: as a line, or as points if it was recorded too seldom."""
        import rerun as rr

        colour = contact.rgb(self.channels.colours[output])
        if not self._apart:
            return rr.SeriesLines(names=_plain(output), colors=[colour], widths=1.6, aggregation_policy=_BAND)
        label = f"{_plain(output)} ({self._apart})"
        return rr.SeriesPoints(names=label, colors=[colour], marker_sizes=1.5, visible_series=[not self._hidden])

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
        words = [_states(int(state_bits)) for state_bits in bits[changed]]
        return [self._strip("contact", t_ns[changed], words)]

    def picture_of(
        self, t_ns: Integers, signals: Mapping[str, Reals], keys: Integers, frames: int = 1 << 30
    ) -> list[Columns]:
        """At most `frames` frames of the picture."""
        if self.picture is None:
            return []
        lost = dict.fromkeys(self._lost, np.full(t_ns.size, np.nan))
        known = {**lost, **signals}
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
            if name == "energy_error":
                v = np.log10(np.abs(v) + 1e-18)
            curves.append(_curve(f"health/{name}", t_ns, v))
        return curves

    def events(self, events: Iterable[Mapping[str, Any]]) -> list[Columns]:
        """Events as lines of the log; protocol steps and switched controllers also as strips."""
        drawn = []
        for event in events:
            now = np.array([event["t_ns"]], np.int64)
            kind = event["kind"]
            text = f"{kind}: {event['text']}"
            level = "DEBUG" if kind == "contact" else topics.LEVELS.get(kind, "info").upper()
            entry = Shape("TextLog", text=[text], level=[level])
            drawn.append(Columns(f"event/{event['source']}", now, entry))
            if event["source"] != "plant":  # the strips show what happened in the run
                continue
            if kind == "step":
                drawn.append(self._strip("protocol", now, [event["text"]]))
            elif kind in ("connected", "disconnected"):
                controller = str(event["data"].get("controller", "controller"))
                drawn.append(self._strip(controller, now, [kind]))
        return drawn

    def _strip(self, lane: str, t_ns: Integers, words: list[str]) -> Columns:
        return Columns(f"strip/{lane}", t_ns, Shape("StateChange", state=words))


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _states(bits: int) -> str:
    """The words of contact states, a bit for each."""
    return ", ".join(name for i, name in enumerate(contact.NAMES) if 1 << i & bits)


def _mixed(bits: int) -> list[int]:
    """The mean of the colours of contact states, a bit for each."""
    colours = [contact.rgb(colour) for i, colour in enumerate(contact.COLOURS) if 1 << i & bits]
    return [round(sum(parts) / len(parts)) for parts in zip(*colours)]


def _curve(path: str, t_ns: Integers, v: Reals) -> Columns:
    return Columns(path, t_ns, Shape("Scalars", scalars=v))


def send(rec: rr.RecordingStream, batch: Iterable[Columns]) -> None:
    """Send rows to rerun."""
    import rerun as rr

    for path, t_ns, shape in batch:
        count = len(t_ns)
        if not count:
            continue
        time = rr.TimeColumn(TIMELINE, duration=np.asarray(t_ns).astype("timedelta64[ns]"))
        rows = getattr(rr, shape.kind).columns(**shape.fields)
        each = len(next(iter(shape.fields.values()))) // count
        columns = rows if each == 1 else rows.partition([each] * count)
        rec.send_columns(path, indexes=[time], columns=columns)


def _archetype(shape: Shape) -> Any:
    """A shape that never changes as rerun's archetype; an arrow without a vector gets it frame by frame."""
    import rerun as rr

    kind = getattr(rr, shape.kind)
    fields = shape.fields
    if shape.kind in ("Boxes3D", "Cylinders3D"):
        fields = {"fill_mode": "solid", **fields}
    partial = shape.kind == "Arrows3D" and "vectors" not in fields
    return (kind.from_fields if partial else kind)(**fields)
