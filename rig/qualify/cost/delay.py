"""The error that a control loop causes: the change of its decay rate over delay and sample period, beside solver
errors.

The decay rate of a closed loop comes from rig.analysis.control_loop, exact for the loop as it runs: sampled, held,
delayed. It is compared with an ideal loop without delay that samples every microsecond. Solver errors are those of the
table, drawn over the step, so that one diagram shows where a shorter time helps most.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rig.analysis.control_loop import loop
from rig.errors import SceneError
from rig.qualify.cost.report import COLOURS, LEAST, MARKS, sheet
from rig.qualify.cost.table import WORST, Table, step
from rig.scenes.scene import Scene
from rig.view.palette import AMBER, PURPLE, put

IDEAL = 1_000  # ns, the sample period of the ideal loop
FINE = 20  # samples in a delay: so many pending commands are states of the loop
TIMES = tuple(round(m * 10.0**k) for k in range(4, 8) for m in (1, 2, 5))  # ns: 10 us to 50 ms


@dataclass(frozen=True)
class Delayed:
    """One loop. `ideal`: its growth rate [1/s] without delay; (time [s], relative error of the rate) over both.

    An error is infinite if the loop cannot exist. `own`: delay and sample period [s] of the scene, and the error that
    they cause.
    """

    controller: str
    ideal: float
    delays: tuple[tuple[float, float], ...]
    periods: tuple[tuple[float, float], ...]
    own: tuple[float, float, float]

    def text(self) -> str:
        """Return the report as text."""
        delay, period, error = self.own
        text = (
            f"loop {self.controller}: a delay of {1e3 * delay:g} ms and samples every {1e3 * period:g} ms change its "
            f"decay rate of {-self.ideal:.4g} 1/s by {error:.1%}"
        )
        for what, points in (("delays", self.delays), ("sample periods", self.periods)):
            without = [f"{1e3 * time:g}" for time, away in points if math.isinf(away)]
            text += f"; it cannot be designed for {what} of {', '.join(without)} ms" if without else ""
        return text


def delayed(scene: Scene) -> list[Delayed]:
    """Return every loop of the scene that is a linear feedback; others have no decay rate of their own."""
    loops = []
    for name, section in scene.controllers.items():
        try:
            ideal = loop(with_delay(scene, name, IDEAL, 0), name).growth
            own = abs(loop(scene, name).growth / ideal - 1.0)
        except SceneError:
            continue
        own_times = (int(section.delay) * 1e-9, int(section.period) * 1e-9)
        delays = tuple((ns * 1e-9, _of_delay(scene, name, ns)) for ns in TIMES)
        periods = tuple((ns * 1e-9, abs(_growth(scene, name, ns, 0) / ideal - 1.0)) for ns in TIMES)
        loops.append(Delayed(name, ideal, delays, periods, (*own_times, own)))
    return loops


def _of_delay(scene: Scene, name: str, delay: int) -> float:
    """Relative change by a delay [ns]: with and without it, in a loop that samples `FINE` times as fast."""
    period = delay // FINE
    late, prompt = (_growth(scene, name, period, dead_time) for dead_time in (delay, 0))
    return abs(late / prompt - 1.0) if math.isfinite(prompt) else math.inf


def _growth(scene: Scene, name: str, period: int, delay: int) -> float:
    """The growth rate [1/s] of a loop; infinite if its controller cannot be designed."""
    try:
        return loop(with_delay(scene, name, period, delay), name).growth
    except SceneError:
        return math.inf


def with_delay(scene: Scene, name: str, period: int, delay: int) -> Scene:
    """The scene with another sample period and delay [ns] of one loop and of its sensor."""
    section = scene.controllers[name].model_copy(update={"period": period, "delay": delay})
    clock = scene.clock.model_copy(update={"frame": min(period, scene.frame_ns)})
    sensors = {key: sensor.model_copy(update={"rate": 1e9 / period}) for key, sensor in scene.sensors.items()}
    return replace(scene, clock=clock, sensors=sensors, controllers={**scene.controllers, name: section})


def draw(loops: Sequence[Delayed], table: Table, path: Path) -> None:
    """Draw errors over time: delay, sample period, and integration step."""
    with sheet(f"{table.title}: where accuracy is lost", table.machine) as figure:
        axes = figure.add_subplot()
        styles = (("delay of the loop", AMBER, "-"), ("sample period of the loop", PURPLE, "--"))
        for delayed_loop in loops:
            for (label, colour, line), points in zip(styles, (delayed_loop.delays, delayed_loop.periods)):
                times, away = zip(*points)
                name = f"{label}, {delayed_loop.controller}" if len(loops) > 1 else label
                axes.plot(times, [max(v, LEAST) for v in away], line, color=colour, marker=".", label=name)
            delay, period, error = delayed_loop.own
            axes.plot(
                max(delay, period),
                error,
                "*",
                ms=14,
                color="black",
                label=f"{delayed_loop.controller} as the scene has it",
            )
        for method in dict.fromkeys(row.setting.method for row in table.rows):
            rows = [r for r in table.rows if r.setting.method == method and math.isfinite(r.error(WORST))]
            if not rows:
                continue
            x = [step(row, table.seconds) if row.steps or row.setting.step_ns else table.step for row in rows]
            y = [max(row.error(WORST), LEAST) for row in rows]
            label = f"{method}: largest error of all measures, over its step"
            axes.plot(x, y, color=COLOURS.get(method, "black"), marker=MARKS.get(method, "o"), ms=5, label=label)
        axes.set(xscale="log", yscale="log", xlabel="time [s]: delay, sample period, integration step")
        axes.set_ylabel("relative error: of the loop's decay rate; of the plant's measures")
        figure.legend(loc="outside lower left", ncols=2)
    put(figure, path)
