"""The report of `rig loop`: delay budget, margins, and decay over delay, jitter and loss with one point simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np

from rig.analysis.control_loop import Loop, ends, loop
from rig.analysis.jump_loop import fits, jump_growth, mean_age, worst_case
from rig.analysis.loop_budget import Item, budget, links
from rig.analysis.loop_check import Checked, simulated
from rig.analysis.text_table import columns
from rig.errors import SceneError
from rig.results import Result
from rig.scenes.network import Link, Network
from rig.scenes.network_text import described
from rig.scenes.scene import Scene
from rig.scenes.sections import dump

POINTS = 9
"""Values of each curve. # chosen"""
_MOST_LOSS = 0.9
_FREE = 20
"""Frames of delay that the curve covers if the loop has no delay margin. # chosen"""


@dataclass(frozen=True)
class Curve:
    """Growth rates [1/s] over one property of the link of the sensor: `values` in seconds, or a probability."""

    key: str
    values: Sequence[float]
    growth: Sequence[float]


@dataclass
class LoopReport(Result):
    """What delays a loop, what it can still bear, and how its decay depends on the links.

    `found`: the loop with the mean age of its links as a constant delay. `point`: links of the simulated point.
    """

    FIGURE: ClassVar = "rig.analysis.loop_figure:figure"

    scene: str
    found: Loop
    items: list[Item]
    growth: float
    curves: list[Curve]
    point: str
    computed: float
    checked: Checked | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def error(self) -> float | None:
        """Relative error of the computed growth rate against the simulated one; None without a simulation."""
        return None if self.checked is None else abs(self.computed - self.checked.growth) / abs(self.checked.growth)

    def to_json(self) -> dict[str, Any]:
        """The report as JSON values."""
        return {
            "scene": self.scene,
            "controller": self.found.controller,
            "budget": [asdict(one) for one in self.items],
            "growth": self.growth,
            "loop": self.found.to_json(),
            "curves": [asdict(one) for one in self.curves],
            "check": {
                "links": self.point,
                "computed": self.computed,
                "simulated": None if self.checked is None else asdict(self.checked),
                "relative_error": self.error,
            },
            "notes": self.notes,
        }

    def text(self) -> str:
        """The report as text."""
        hertz = abs(self.found.spectrum.rates[0].imag) / (2.0 * math.pi)
        total = sum(one.seconds for one in self.items)
        rows = [("delay budget", f"ms at {hertz:.4g} Hz", "deg", "origin")]
        rows += [(o.part, f"{1e3 * o.seconds:.4g}", f"{360 * o.seconds * hertz:.3g}", o.origin) for o in self.items]
        rows += [("sum", f"{1e3 * total:.4g}", f"{360 * total * hertz:.3g}", "")]
        lines = [f"{self.scene}: loop of {self.found.controller} ({self.found.through})", "", *columns(rows, "<>><")]
        return "\n".join([*lines, "", *self._margins(), "", *self._curves(), "", *self._check()])

    def _margins(self) -> Iterator[str]:
        yield f"  decay rate at steady sliding {-self.growth:.6g} 1/s, with its links in the mean square"
        if (m := self.found.margins) is None:
            yield "  no margins: the loop is unstable with the mean delay of its links"
        elif math.isinf(m["delay"]):
            yield "  no phase margin and no delay margin: the loop gain never reaches 1"
        else:
            yield f"  phase margin {math.degrees(m['phase']):.4g} deg at {m['phase_hertz']:.5g} Hz"
            yield f"  delay margin {1e3 * m['delay']:.5g} ms more than the budget without the bus"
        if (ends := self.found.gain_range) is not None and self.found.gain:
            least, most = sorted(end / self.found.gain for end in ends)
            yield f"  gain margin: stable from {least:.4g} to {most:.4g} times its gain of {self.found.gain:g}"

    def _curves(self) -> Iterator[str]:
        for curve in self.curves:
            unit, scale = ("%", 1e2) if curve.key == "loss" else ("ms", 1e3)
            rows = [(f"{curve.key} of the sensor's link, {unit}", *(f"{scale * v:.3g}" for v in curve.values))]
            rows += [("decay rate 1/s", *(f"{-g:.4g}" for g in curve.growth))]
            yield from columns(rows, "<" + ">" * len(curve.values))
        yield "  rates of the mean square (jump linear system), with independent ages of messages (docs/worse_loops.md)"

    def _check(self) -> Iterator[str]:
        yield f"  one point checked by simulation: {self.point}"
        if self.checked is not None and self.error is not None:
            one = self.checked
            found = f"decay rate computed {-self.computed:.6g}, simulated {-one.growth:.6g} 1/s"
            yield f"  {found} ({one.runs} runs of {one.seconds:.3g} s); relative error {self.error:.2g}"
        yield from (f"  {one}" for one in self.notes)


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
    found = loop(scene, name, sum(map(round, late)) * frame)
    rates = _Rates(scene, name)
    growth, _ = rates.of(meas, act)
    frames = (
        _FREE if margin is None or math.isinf(margin["delay"]) else max(math.ceil(1.3e9 * margin["delay"] / frame), 4)
    )
    half = max(frames // 3, 1) * frame
    steps = np.linspace(0.0, 1.0, POINTS)
    delays = sorted({round(frames * share) * frame for share in steps})
    about = meas if meas.delay else meas.model_copy(update={"delay": half})
    jitters = sorted({round(about.delay * share) for share in steps})
    asked: list[tuple[str, float, Link]] = [("delay", d * 1e-9, Link().model_copy(update={"delay": d})) for d in delays]
    asked += [("jitter", j * 1e-9, about.model_copy(update={"jitter": j, "loss": 0.0})) for j in jitters]
    losses = np.round(steps * _MOST_LOSS, 4).tolist() if rates.jumps else []
    asked += [("loss", p, meas.model_copy(update={"loss": p})) for p in losses]
    found_rates = []
    for done, (_, _, link) in enumerate(asked):
        progress(done, len(asked))
        found_rates.append(rates.of(link, act)[0])
    curves = [
        Curve(key, [v for k, v, _ in asked if k == key], [r for r, (k, _, _) in zip(found_rates, asked) if k == key])
        for key in ("delay", "jitter", *(("loss",) if rates.jumps else ()))
    ]
    point, own = (meas, act), scene.network.links.keys() & {f"meas/{ends(scene, name)[0]}", f"act/{name}"}
    if not own:
        chosen = {"delay": half, "jitter": half // 2, "loss": 0.2} if rates.jumps else {"delay": half}
        point = Link().model_copy(update=chosen), Link()
    result = LoopReport(scene.name, found, budget(scene, found, bus), growth, curves, "", math.nan)
    _simulate(result, scene, rates, *point)
    result.notes += rates.notes
    progress(len(asked), len(asked))
    return result


class _Rates:
    """Growth rates of the loop of a controller over links. `notes`: how they were found, where it is not as usual."""

    def __init__(self, scene: Scene, name: str) -> None:
        self.scene, self.name = scene, name
        self.jumps = fits(scene, name)
        self.notes: list[str] = []
        if not self.jumps:
            self._note("the loop does not work once in every frame: rates are those of the longest constant delay, "
                       "and losses are left out")  # fmt: skip

    def of(self, meas: Link, act: Link) -> tuple[float, float]:
        """Growth rate [1/s] and frequency [Hz] over a link of the sensor and one of the commands."""
        found = (jump_growth if self.jumps else worst_case)(self.scene, self.name, meas, act)
        if math.isfinite(found.mean_square):
            return found.mean_square, found.hertz
        self._note("some rates are those of the mean: the mean square of a loop of many modes was not found")
        return found.mean, found.hertz

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _simulate(result: LoopReport, scene: Scene, rates: _Rates, meas: Link, act: Link) -> None:
    """Add the simulation of one point to the report."""
    name = rates.name
    sensor, _ = ends(scene, name)
    named = {f"meas/{sensor}": meas, f"act/{name}": act}
    result.point = "; ".join(f"{topic}: {described(dump(link))}" for topic, link in named.items())
    result.computed, hertz = rates.of(meas, act)
    network = Network(meas={sensor: meas}, act={name: act})
    if not hertz:
        result.notes.append("not checked: the least stable mode does not vibrate")
        return
    try:
        result.checked = simulated(scene, name, network, result.computed, hertz)
    except SceneError as fault:
        result.notes += [f"not checked: {one}" for one in fault.faults]
