"""Kroeger, Neubauer, Popp (2008), figure 17: 225 brakings, and which of them squeal.

Pressure and temperature are drawn from the ranges of the paper's tests. The paper does not state the friction
coefficient of a braking; ours scatters, and rises a little with the temperature of the disc [calibrated]. Each braking
is classified by eigenvalues; every fifteenth is also simulated and classified by its sound, as in the tests.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rig.papers.common import load, quiet, run
from rig.papers.entry import Comparison, Entry
from rig.view.palette import BLUE, GREY, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COUNT, _EVERY, _SEED = 225, 15, 17
_SPEED = 40.0 * 2.0 * math.pi / 60.0  # rad/s
_LONGEST, _FOLDS = 2.0, 8.0
"""A simulated braking lasts for a growth or decay by e^8, at most 2 s."""
_SOUND = 11.0  # Pa for 1 m/s of the pad, at 0.5 m [calibrated]
_LOUD = 60.0  # dB
_CRITICAL = {5: (1.16673313, 2118.17724), 8: (0.908164652, 2126.11917), 10: (0.800988812, 2130.59114),
             12: (0.722627539, 2134.61188), 15: (0.639993894, 2140.00096), 18: (0.585154497, 2144.79477),
             20: (0.559415334, 2147.72595), 25: (0.521396430, 2154.31959), 30: (0.509365552, 2160.08765)}  # fmt: skip
"""Pressure [bar]: critical friction coefficient and frequency [Hz]."""


class Braking(NamedTuple):
    """Pressure [bar], temperature [C], friction; growth [1/s] and frequency [Hz] of the least stable mode."""

    pressure: float
    temperature: float
    mu: float
    growth: float
    frequency: float


def brakings() -> list[Braking]:
    """Return all brakings, classified by eigenvalues."""
    from rig.analysis.regions import sliding

    scene = load("brake", drive__speed=_SPEED)
    draw = np.random.default_rng(_SEED)
    found = []
    for _ in range(_COUNT):
        pressure, temperature = draw.uniform(2.0, 30.0), draw.uniform(30.0, 310.0)
        mu = 0.62 + 0.03 * draw.standard_normal() + 0.02 * (temperature - 170.0) / 140.0
        rate = sliding(scene, {"load.pressure": 1e5 * pressure, "friction.mu": mu}).eigenvalues()[0]
        found.append(Braking(pressure, temperature, mu, rate.real, abs(rate.imag) / (2.0 * math.pi)))
    return found


def level(one: Braking) -> float:
    """Return the sound pressure level [dB] at the end of a simulated braking."""
    changes: dict[str, Any] = {"drive__speed": _SPEED, "load__pressure": 1e5 * one.pressure, "friction__mu": one.mu}
    scene = replace(quiet(load("brake", **changes)), sensors={})
    ran = run(scene, min(_FOLDS / abs(one.growth), _LONGEST))
    last = _SOUND * ran.signals["velocity"][ran.time > ran.time[-1] - 0.04]
    return 20.0 * math.log10(float(np.sqrt(np.mean(last**2))) / 20e-6)


def classified(figure: Figure) -> Iterator[Comparison]:
    """Pressure and temperature of the brakings; friction over pressure with the critical coefficient."""
    import rig

    found = brakings()
    heard = {number: level(found[number]) for number in range(0, _COUNT, _EVERY)}
    tests, border = figure.subplots(1, 2)
    for squeals, mark, colour, label in ((False, ".", GREY, "quiet"), (True, "+", VERMILION, "squeals")):
        chosen = [one for one in found if (one.growth > 0.0) == squeals]
        p = [one.pressure for one in chosen]
        tests.plot(p, [one.temperature for one in chosen], mark, color=colour, label=label)
        border.plot(p, [one.mu for one in chosen], mark, color=colour)
        sampled = [found[number] for number, loud in heard.items() if (loud > _LOUD) == squeals]
        p = [one.pressure for one in sampled]
        look: dict[str, Any] = {"color": colour, "mfc": "none", "markersize": 9}
        tests.plot(p, [one.temperature for one in sampled], "o", **look, label=f"simulated: {label}")
        border.plot(p, [one.mu for one in sampled], "o", **look)
    tests.annotate("", (30.5, 322.0), (15.0, 322.0), arrowprops={"arrowstyle": "-|>", "color": BLUE})
    tests.text(22.5, 326.0, "predicted in the paper", color=BLUE, ha="center")
    tests.set(xlabel="pressure [bar]", ylabel="temperature of the disc [C]", xlim=(0.0, 31.0), ylim=(20.0, 345.0))
    tests.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    scene, critical = load("brake"), {}
    for bar in _CRITICAL:
        at = replace(scene, parameters=load("brake", load__pressure=1e5 * bar).parameters)
        critical[bar] = rig.sweep(at, "friction.mu", np.linspace(0.45, 1.25, 9)).critical[0]
    border.plot(list(critical), [one.value for one in critical.values()], color=BLUE, label="critical")
    border.set(xlabel="pressure [bar]", ylabel="friction coefficient", xlim=(0.0, 31.0), ylim=(0.48, 0.8))
    border.legend()
    loud = [one for one in found if one.growth > 0.0]
    lowest = min(one.pressure for one in loud)
    yield Comparison(
        "lowest pressure with squeal (predicted 15, measured 12)", "bar", lowest, 15.0, "paper", absolute=3.0
    )
    for which, frequency in (("lowest", min), ("highest", max)):
        hertz = frequency(one.frequency for one in loud)
        yield Comparison(f"{which} frequency of squeal, predicted", "Hz", hertz, 2140.0, "paper", relative=0.015)
    differ = sum(bool(loud > _LOUD) != bool(found[number].growth > 0.0) for number, loud in heard.items())
    yield Comparison(f"of {len(heard)} simulated: differ from the eigenvalues", "", differ, 0.0, "theory")
    for bar, (mu, hertz) in _CRITICAL.items():
        yield Comparison(f"{bar} bar: critical friction", "", critical[bar].value, mu, "reference", absolute=1e-6)
        yield Comparison(f"{bar} bar: frequency", "Hz", critical[bar].frequency, hertz, "reference", absolute=1e-3)


ENTRIES = (
    Entry("kroeger-17", "kroeger", "Figure 17", "225 brakings and which of them squeal", ("brake",), classified,
          "Classified by eigenvalues; every fifteenth one also by the sound of its simulation (above 60 dB). The "
          "paper states no friction of these tests. Here it is drawn for each braking, with a mean of 0.62, a "
          "standard deviation of 0.03 and a slope of 0.02 in 140 degrees of the disc (calibrated); the mean decides "
          "the lowest pressure. The tests measured 2350 Hz, the paper's model predicts 2140 Hz. The paper draws "
          "frequency over pressure; its temperatures are not printed."),
)  # fmt: skip
