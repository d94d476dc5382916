"""The report of `rig loop`: delay budget, margins, and decay over delay, jitter and loss with one point simulated.

The delay budget of a control loop: what delays it at the frequency of its least stable mode, and who states that. A
filter delays by phase / frequency; a lag of first order by atan(w T) / w; a value held over a period by half of it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np

from rig.analysis.linear.control_loop import Loop, ends, loop
from rig.analysis.linear.jump_linear import Growth, fits, jump_growth, mean_age, worst_case
from rig.analysis.linear.loop_check import Checked, simulated
from rig.errors import SceneError
from rig.printable import counted
from rig.results import Column, Result, Table
from rig.scenes.explain import explain
from rig.scenes.network import Link, Network, described
from rig.scenes.scene import Scene
from rig.scenes.sections import dump

POINTS = 9
"""Values of each curve. # chosen"""
_ROUNDED = 1e-12  # rad: a smaller phase is rounding error
_MOST_LOSS = 0.9  # the end of the curve over loss: a loop without messages is none
_FREE = 20  # frames of delay that the curve covers if the loop has no delay margin. [chosen]


@dataclass(frozen=True)
class Item:
    """One delay of a loop [s], and its `origin`: a key of the scene with its origin, computed, or measured."""

    part: str
    seconds: float
    origin: str


def links(scene: Scene, name: str) -> tuple[Link, Link]:
    """The links of the loop of controller `name`: of its sensor, and of its commands."""
    network = scene.network
    return network.meas.get(ends(scene, name)[0], Link()), network.act.get(name, Link())


def budget(scene: Scene, closed: Loop, bus: float | None = None) -> Iterator[Item]:
    """The delays of the loop `closed` of `scene` in the order of the signal.

    `bus`: measured time [s] from a step to its answer over the bus; None: it was not measured.
    """
    name = closed.controller
    section = scene.controllers[name]
    omega = abs(closed.spectrum.rates[0].imag)
    sensor, drive = ends(scene, name)
    meas, act = links(scene, name)
    frame = scene.frame_ns
    origins = {value.key: f"{value.key} ({value.origin.origin})" for value in explain(scene).values}
    end = scene.sensors[sensor].front_end()

    def of_link(side: str, part: str, link: Link) -> Item:
        known = part in getattr(scene.network, side)
        origin = f"network.{side}.{part}: mean age of what arrives" if known else "a perfect link"
        return Item(f"link {side}/{part}", mean_age(link, frame) * frame * 1e-9, origin)

    if omega:
        late = 1e-9 * end.delay_ns
        turn = -cmath.phase(end.response(1j * omega) / end.response(1e-9j * omega) * cmath.exp(1j * omega * late))
        turn = turn if abs(turn) > _ROUNDED else 0.0
        yield Item(f"filter of {sensor}", turn / omega, "computed from its transfer function")
    yield Item(f"delay of {sensor}", 1e-9 * end.delay_ns, origins.get(f"sensors.{sensor}.delay", "its instrument"))
    yield of_link("meas", sensor, meas)
    yield Item(f"computation of {name}", 1e-9 * section.delay, origins.get(f"controllers.{name}.delay", "default"))
    yield of_link("act", name, act)
    yield Item("sample and hold", 0.5 * closed.model.period, "half a period, computed")
    key = f"{drive.partition('.')[0]}.lag"
    lag: Any = scene.values().get(key, (0.0, ""))[0]
    if scene.assemble().inputs[drive].lagging and isinstance(lag, float | int) and lag:
        yield Item(f"lag of {drive}", math.atan(omega * lag) / omega if omega else lag, origins.get(key, key))
    else:
        yield Item(f"lag of {drive}", 0.0, "none in the scene")
    if section.where == "process":
        origin = "rig run --pace: not measured (--measure does)" if bus is None else f"{1e3 * bus:.2g} ms, measured"
        frames = 1 if bus is None else max(math.ceil(bus * 1e9 / frame), 1)
        yield Item("bus of a paced run", frames * frame * 1e-9, f"{origin}: {counted(frames, 'frame')}")


@dataclass(frozen=True)
class Curve:
    """Growth rates [1/s] over one property of the link of the sensor: `values` in seconds, or a probability."""

    key: str
    values: Sequence[float]
    growth: Sequence[float]


@dataclass
class LoopReport(Result):
    """What delays a loop, what it can still bear, and how its decay depends on the links.

    `loop`: the loop with the mean age of its links as a constant delay. `point`: links of the simulated point.
    """

    FIGURE: ClassVar = "rig.analysis.linear.figures:loop_report_figure"

    scene: str
    loop: Loop
    items: list[Item]
    growth: float
    curves: list[Curve]
    point: str
    computed: float
    checked: Checked | None = None
    of_mean: bool = False
    """Whether `computed` is the rate of the mean, because that of the mean square, which runs show, was not found."""
    notes: list[str] = field(default_factory=list)

    @property
    def error(self) -> float | None:
        """Relative error of the computed growth rate against the simulated one; None if they cannot be compared."""
        if self.checked is None or self.of_mean:
            return None
        return abs(self.computed - self.checked.growth) / abs(self.checked.growth)

    def facts(self) -> dict[str, Any]:
        """Return the loop, the curves and the check."""
        return {
            "scene": self.scene,
            "controller": self.loop.controller,
            "budget": [asdict(record) for record in self.items],
            "growth": self.growth,
            "loop": self.loop.to_json(),
            "curves": [asdict(record) for record in self.curves],
            "check": {
                "links": self.point,
                "computed": self.computed,
                "simulated": None if self.checked is None else asdict(self.checked),
                "relative_error": self.error,
            },
            "notes": self.notes,
        }

    def shown(self) -> Iterator[str | Table]:
        """Yield the delay budget, the margins, the decay rates over the links, and the check."""
        hertz = abs(self.loop.spectrum.rates[0].imag) / (2.0 * math.pi)
        total = sum(item.seconds for item in self.items)
        yield f"{self.scene}: loop of {self.loop.controller} ({self.loop.through})"
        for remark in (self.loop.left_out, *self.loop.belief):
            if remark:
                yield f"  {remark}"
        yield f"\n  delay budget: {1e3 * total:.4g} ms, {360 * total * hertz:.3g} deg at {hertz:.4g} Hz"
        delay = Column("delay", "s", ".4g", "ms", 1e-3)
        columns = (Column("part"), delay, Column("phase", "deg", ".3g"), Column("origin"))
        rows = [(item.part, item.seconds, 360 * item.seconds * hertz, item.origin) for item in self.items]
        yield Table("budget", columns, rows)
        yield ""
        yield from self._margins()
        yield from self._curves()
        yield ""
        yield from self._check()

    def _margins(self) -> Iterator[str]:
        yield f"  decay rate at steady sliding {-self.growth:.6g} 1/s, with its links in the mean square"
        yield from self.loop.margin_lines("ms more than the budget without the bus")
        ends = self.loop.gain_range
        if ends is not None and self.loop.gain:
            least, most = sorted(end / self.loop.gain for end in ends)
            low = f"from {least:.4g}" if math.isfinite(least) else "from any negative multiple"
            high = f"to {most:.4g} times" if math.isfinite(most) else "to any multiple of"
            yield f"  gain margin: stable {low} {high} its gain of {self.loop.gain:g}"

    def _curves(self) -> Iterator[str | Table]:
        for curve in self.curves:
            units = ("1", ".3g", "%", 0.01) if curve.key == "loss" else ("s", ".3g", "ms", 1e-3)
            columns = (Column(f"{curve.key} of the sensor's link", *units), Column("growth", "1/s", ".4g"))
            yield ""
            yield Table(f"growth over {curve.key}", columns, [*zip(curve.values, curve.growth)])
        yield "  rates of the mean square (jump linear system), with independent ages of messages (docs/worse_loops.md)"

    def _check(self) -> Iterator[str]:
        yield f"  one point checked by simulation: {self.point}"
        if (checked := self.checked) is not None:
            rates = f"decay rate computed {-self.computed:.6g}, simulated {-checked.growth:.6g} 1/s"
            comparison = "that of the mean against that of the mean square, which grows at least as fast"
            if self.error is not None:
                comparison = f"relative error {self.error:.2g}"
            yield f"  {rates} ({counted(checked.runs, 'run')} of {checked.seconds:.3g} s); {comparison}"
        yield from (f"  {note}" for note in self.notes)


def report(
    scene: Scene, name: str, bus: float | None = None, progress: Callable[[int, int], object] = lambda done, of: None
) -> LoopReport:
    """The report on the loop of controller `name`. `bus`: see `budget`. Raises SceneError where there is no loop."""
    margin = loop(scene, name).margins
    meas, act = links(scene, name)
    frame = scene.frame_ns
    late = (mean_age(meas, frame), mean_age(act, frame))
    if not all(map(math.isfinite, late)):
        raise SceneError(scene.name, ["network: a link of this loop loses every message, so there is no loop"])
    delayed = loop(scene, name, sum(map(round, late)) * frame)
    rates = _Rates(scene, name)
    growth, _ = rates.of(meas, act)
    frames = _FREE
    if margin is not None and not math.isinf(margin["delay"]):
        frames = max(math.ceil(1.3e9 * margin["delay"] / frame), 4)
    half = max(frames // 3, 1) * frame
    varied = list(_varied(meas, frames, half, frame, rates.jumps))
    points: dict[str, list[tuple[float, float]]] = {}
    for done, (key, value, link) in enumerate(varied):
        progress(done, len(varied))
        rate, _ = rates.of(link, act)
        points.setdefault(key, []).append((value, rate))
    curves = []
    for key, pairs in points.items():
        values, growths = zip(*pairs)
        curves.append(Curve(key, [*values], [*growths]))
    point = (meas, act)
    sensor, _ = ends(scene, name)
    if not scene.network.links.keys() & {f"meas/{sensor}", f"act/{name}"}:
        impaired = {"delay": half, "jitter": half // 2, "loss": 0.2} if rates.jumps else {"delay": half}
        point = (Link().model_copy(update=impaired), Link())
    result = LoopReport(scene.name, delayed, [*budget(scene, delayed, bus)], growth, curves, "", math.nan)
    _simulate(result, scene, rates, *point)
    result.notes += rates.notes
    progress(len(varied), len(varied))
    return result


def _varied(meas: Link, frames: int, half: int, frame: int, jumps: bool) -> Iterator[tuple[str, float, Link]]:
    """The links of the curves: property, its value, and the link of the sensor `meas` with it.

    Delay goes up to `frames`; jitter is about the delay of the link, or about `half` [ns]; loss only if the loop
    `jumps`.
    """
    steps = np.linspace(0.0, 1.0, POINTS)
    for delay in sorted({round(frames * share) * frame for share in steps}):
        yield "delay", delay * 1e-9, Link().model_copy(update={"delay": delay})
    about = meas if meas.delay else meas.model_copy(update={"delay": half})
    for jitter in sorted({round(about.delay * share) for share in steps}):
        yield "jitter", jitter * 1e-9, about.model_copy(update={"jitter": jitter, "loss": 0.0})
    if jumps:
        for loss in np.round(steps * _MOST_LOSS, 4).tolist():
            yield "loss", loss, meas.model_copy(update={"loss": loss})


class _Rates:
    """Growth rates of the loop of a controller over links. `notes`: how they were found, where it is not as usual."""

    def __init__(self, scene: Scene, name: str) -> None:
        self.scene = scene
        self.name = name
        self.jumps = fits(scene, name)
        self.notes: list[str] = []
        if not self.jumps:
            why = "the loop does not work once in every frame"
            self.notes.append(f"{why}: rates are those of the longest constant delay, and losses are left out")

    def of(self, meas: Link, act: Link) -> tuple[float, Growth]:
        """Growth rate [1/s] over a link of the sensor and one of the commands, and what it is of."""
        decay = (jump_growth if self.jumps else worst_case)(self.scene, self.name, meas, act)
        if math.isfinite(decay.mean_square):
            return decay.mean_square, decay
        note = "some rates are those of the mean: the mean square of a loop of many modes was not found"
        if note not in self.notes:
            self.notes.append(note)
        return decay.mean, decay


def _simulate(result: LoopReport, scene: Scene, rates: _Rates, meas: Link, act: Link) -> None:
    """Add the simulation of one point to the report."""
    name = rates.name
    sensor, _ = ends(scene, name)
    named = {f"meas/{sensor}": meas, f"act/{name}": act}
    result.point = "; ".join(f"{topic}: {described(dump(link))}" for topic, link in named.items())
    result.computed, of = rates.of(meas, act)
    result.of_mean = not math.isfinite(of.mean_square)
    network = Network(meas={sensor: meas}, act={name: act})
    if not of.hertz:
        result.notes.append("not checked: the least stable mode does not vibrate")
        return
    try:
        result.checked = simulated(scene, name, network, result.computed, of)
    except SceneError as fault:
        result.notes += [f"not checked: {text}" for text in fault.faults]
