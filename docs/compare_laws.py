"""The figure of the page laws.md: `python docs/compare_laws.py` writes laws.png beside this file.

The experiments prescribe a slip or a force and integrate the laws' own formulas with scipy, without a rig around them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rig.laws import LAWS, FrictionLaw
from rig.view.palette import AMBER, BLUE, GREEN, GREY, PURPLE, SKY, VERMILION, page

Array = NDArray[np.float64]
LOAD, MASS = 20.0, 1.0
STRIBECK = {"mu_static": 0.5, "mu_kinetic": 0.3, "speed_scale": 2e-3}
BRISTLES = STRIBECK | {"sigma0": 1e5, "sigma1": 100.0}
STATE = {"mu_reference": 0.3, "speed": 1e-4, "a": 0.01, "b": 0.02, "distance": 2e-6}
VALUES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "LuGre": ("lugre", BLUE, BRISTLES),
    "elasto-plastic": ("elasto_plastic", VERMILION, BRISTLES),
    "Dahl": ("dahl", GREEN, {"mu_kinetic": 0.3, "sigma0": 1e5}),
    "Maxwell slip": (
        "maxwell_slip",
        PURPLE,
        STRIBECK | {"stiffness": [6e4, 3e4, 1e4], "shares": [0.4, 0.35, 0.25]},
    ),
    "rate and state, ageing": ("rate_state", AMBER, STATE),
    "rate and state, slip": ("rate_state", SKY, STATE | {"evolution": "slip"}),
    "time of stick": ("stick_time", GREY, {"mu_kinetic": 0.3, "rise": 0.2, "time": 0.3, "distance": 1e-5}),
    "temperature": (
        "contact_temperature",
        "black",
        {
            "mu_cold": 0.3,
            "mu_hot": 0.2,
            "temperature_scale": 20.0,
            "static_ratio": 1.3,
            "speed_scale": 2e-3,
            "capacity": 0.01,
            "cooling": 0.02,
        },
    ),
}
"""Label of a curve -> name of the law, colour, values."""


def laws(*labels: str) -> Iterator[tuple[str, str, FrictionLaw]]:
    """Label, colour and law of each of `labels`."""
    for label in labels:
        name, colour, values = VALUES[label]
        yield label, colour, LAWS[name].model_validate({"law": name, **values})


def moved(law: Any, speed: Callable[[float], float], times: Array, z: Array) -> tuple[Array, Array]:
    """The coefficient at `times` under the slip `speed`(t) >= 0, from the states z, and the states at the end."""
    p = law.numbers()

    def rates(t: float, y: Array) -> Array:
        dz = np.zeros(len(y))
        law.rates(p, speed(t), LOAD, y, dz)
        return dz

    y = solve_ivp(rates, (times[0], times[-1]), z, "Radau", times, rtol=1e-8, atol=1e-14, max_step=np.ptp(times) / 50).y
    return np.array([law.mu(p, speed(t), LOAD, y[:, i]) for i, t in enumerate(times)]), y[:, -1]


def breakaway(axes: Axes) -> None:
    """The largest friction force while a force on a resting mass rises linearly."""
    rates = np.geomspace(1.0, 1000.0, 13)
    for label, colour, law in laws("LuGre", "elasto-plastic", "time of stick", "temperature"):
        forces = [_breakaway(law, rate) for rate in rates]
        axes.semilogx(rates, forces, color=colour, label=label)
    axes.set(xlabel="rate of the force [N/s]", ylabel="breakaway force [N]", title="breakaway")


def _breakaway(law: Any, rate: float) -> float:
    p, count = law.numbers(), len(law.states)
    begin, start = 0.0, np.zeros(2 + count)
    if law.sticks:  # until the force reaches the limit

        def surplus(t: float, y: Array) -> float:
            return float(law.mu(p, 0.0, LOAD, y) * LOAD - rate * t)

        surplus.terminal = True  # type: ignore[attr-defined]

        def rest(t: float, y: Array) -> Array:
            dz = np.zeros(count)
            law.rates(p, 0.0, LOAD, y, dz)
            return dz

        stuck = solve_ivp(rest, (0.0, 20.0 / rate + 1.0), start[2:], events=surplus, rtol=1e-8)
        return float(rate * stuck.t[-1])

    def field(t: float, y: Array) -> Array:
        dy = np.zeros(2 + count)
        dy[0], dy[1] = y[1], (rate * t - law.mu(p, y[1], LOAD, y[2:]) * LOAD) / MASS
        law.rates(p, y[1], LOAD, y[2:], dy[2:])
        return dy

    def gone(t: float, y: Array) -> float:
        return float(y[0] - 1e-3)

    gone.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(field, (begin, 20.0 / rate + 1.0), start, "Radau", events=gone, rtol=1e-6, atol=1e-12)
    return max(law.mu(p, v, LOAD, z) * LOAD for v, z in zip(run.y[1], run.y[2:].T))


def loops(axes: Axes) -> None:
    """Friction over a displacement that turns at 5, -5, 2, -2 and 5 micrometres."""
    turns = np.array([0.0, 5.0, -5.0, 5.0, -2.0, 2.0, -5.0]) * 1e-6
    for label, colour, law in laws("LuGre", "elasto-plastic", "Dahl", "Maxwell slip"):
        x, mu, z = [], [], np.zeros(len(law.states))
        for begin, end in pairwise(turns):
            sign, times = math.copysign(1.0, end - begin), np.linspace(0.0, abs(end - begin) / 1e-6, 80)
            along, z = moved(law, lambda t: 1e-6, times, sign * z)
            mu.extend(sign * along)
            x.extend(begin + sign * 1e-6 * times)
            z = sign * z
        axes.plot(1e6 * np.array(x), mu, color=colour, label=label)
    axes.set(xlabel="displacement [µm]", ylabel="coefficient of friction", title="presliding")


def steps(axes: Axes) -> None:
    """The coefficient over the slip while the speed steps by a factor of ten, up and down."""
    chosen = "LuGre", "Maxwell slip", "rate and state, ageing", "rate and state, slip", "time of stick"
    for label, colour, law in laws(*chosen):
        z, slip, x, mu = np.zeros(len(law.states)), -60e-6, [], []
        for speed, length in ((1e-4, 60e-6), (1e-3, 20e-6), (1e-4, 20e-6)):
            times = np.linspace(0.0, length / speed, 400)
            along, z = moved(law, lambda t, speed=speed: speed, times, z)
            x.extend(slip + speed * times)
            mu.extend(along)
            slip += length
        shown = np.array(x) >= -4e-6
        axes.plot(1e6 * np.array(x)[shown], np.array(mu)[shown], color=colour, label=label)
    axes.set(xlabel="slip [µm]", ylabel="coefficient of friction", title="steps of the speed: 0.1, 1, 0.1 mm/s")


def lag(axes: Axes) -> None:
    """The coefficient over a slip speed that oscillates."""
    for frequency, style in ((10.0, "-"), (100.0, "--")):
        for label, colour, law in laws("LuGre", "Maxwell slip", "rate and state, ageing"):
            z = np.zeros(len(law.states))
            for _ in range(4):
                times = np.linspace(0.0, 1.0 / frequency, 200)
                speed = lambda t, f=frequency: 3e-3 * (1.0 - 0.95 * math.cos(2.0 * math.pi * f * t))  # noqa: E731
                mu, z = moved(law, speed, times, z)
            speeds = [1e3 * speed(t) for t in times]
            axes.plot(speeds, mu, style, color=colour, label=f"{label}, {frequency:g} Hz")
    axes.set(xlabel="slip speed [mm/s]", ylabel="coefficient of friction", title="Stribeck loops: 10 Hz, dashed 100 Hz")


def drift(axes: Axes) -> None:
    """The offset after each cycle of a slow force between 0.05 and 0.2 of the load, below all limits."""
    cycles = np.arange(31)
    for label, colour, law in laws("LuGre", "elasto-plastic", "Dahl", "Maxwell slip"):
        p, low, high = law.numbers(), 0.05, 0.2
        z, x, offsets = np.zeros(len(law.states)), 0.0, [0.0]
        for target in [high, low] * 30:
            z, slip = _carried(law, p, z, target)
            x += slip
            if target == low:
                offsets.append(x)
        offsets = [value - offsets[1] for value in offsets[1:]]
        axes.plot(cycles[:-1], 1e6 * np.array(offsets), color=colour, label=label)
    axes.set(xlabel="cycle", ylabel="drift [µm]", title="drift below the limit")


def _carried(law: Any, p: Any, z: Array, target: float) -> tuple[Array, float]:
    """States in the fixed frame and slip when friction has gone slowly to the coefficient `target`."""
    at = law.mu(p, 0.0, LOAD, z)
    sign = math.copysign(1.0, target - at)

    def rates(x: float, y: Array) -> Array:
        dz = np.zeros(len(y))
        law.rates(p, 1e-9, LOAD, y, dz)
        return dz / 1e-9

    def there(x: float, y: Array) -> float:
        return float(sign * law.mu(p, 0.0, LOAD, y) - target)

    there.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(rates, (0.0, 1e-3), sign * z, "Radau", events=there, rtol=1e-9, atol=1e-15)
    return sign * run.y[:, -1], sign * run.t[-1]


def main() -> None:
    """Write the figure."""
    with page(12.0, 11.0, layout="constrained") as figure:
        axes = figure.subplots(3, 2)
        for place, experiment in zip(axes.flat, (breakaway, loops, steps, lag, drift)):
            experiment(place)
        legend = axes.flat[-1]
        for label, (_, colour, _) in VALUES.items():
            legend.plot([], [], color=colour, label=label, lw=2.0)
        legend.set_axis_off()
        legend.legend(loc="center left", fontsize=11)
        figure.savefig(Path(__file__).with_suffix("").parent / "laws.png")


if __name__ == "__main__":
    main()
