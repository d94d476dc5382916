"""Liu and Ouyang, Meccanica (2020), sections 3 and 4.2: tangential dither of a slider on a rotating flexible disc.

Geometry, material, stiffnesses and dampers are those of the paper. The assignment of the stiffnesses, the damping of
the disc and the coefficients of friction are those of the scenes. "reference" is an independent computation with these.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import rig
from rig.analysis.cycles.averaged import averaged
from rig.analysis.linear.modes import GENERATOR
from rig.analysis.linear.regions import regions
from rig.effects.disc_modes import free_modes
from rig.papers.entry import (
    Compared,
    Comparison,
    Entry,
    compared,
    dither_boundary,
    load,
    log_slope,
    numbered,
    quiet,
    table,
    tops,
)
from rig.scenes.axis import Axis
from rig.scenes.scene import Scene
from rig.view.palette import BLUE, GREEN, VERMILION

RADIUS = 0.1  # m, position of the slider
RATE = math.sqrt(1e5)  # rad/s, sqrt(contact stiffness / mass): unit of frequency ratios
CASES: dict[str, dict[str, Any]] = {
    "a": {"friction__law": "constant", "friction__mu": 0.3},
    "b": {},
    "c": {"friction__mu_static": 0.9, "friction__mu_kinetic": 0.8},
}
LOADS = (20.0, 50.0, 100.0, 150.0, 200.0)
_SLOW = np.sort([*np.linspace(0.5, 8.0, 31), 5.98, 5.998, 6.0 + 1e-4, 6.02])  # dither of 0.6 m/s: a = V at 6
# where a wave on the disc and the slider meet, ranges are narrow; the reference's grid misses some of them
_FAST = np.sort(
    [
        *np.arange(900.0, 940.0, 0.5),
        911.82,
        911.965,
        *np.arange(945.0, 1110.0, 5.0),
        *np.arange(1111.0, 1117.0, 0.5),
        *np.arange(1120.0, 1301.0, 5.0),
    ]
)
_SPEEDS = np.concatenate([_SLOW, np.geomspace(10.0, 890.0, 12), _FAST])
_BAND = "case {}, 100 N: sum of the unstable bands from 0.5 to 1300 rad/s"
_EDGES = {
    ("a", 20.0): (911.9541, 932.2011, 978.3737, 1245.8412),
    ("a", 100.0): (911.8730, 1245.6566),
    ("a", 200.0): (911.7743, 1245.5279),
    ("b", 20.0): (1.1100, 911.9533, 932.3555, 977.9398, 1246.5808),
    ("b", 50.0): (2.0138, 911.9228, 934.3958, 976.0186, 1246.4944),
    ("b", 100.0): (2.7037, 911.8724, 1246.3667),
    ("b", 200.0): (3.3954, 911.7739, 1246.1686),
}
"""Case and preload [N]: speeds of the reference at which sliding gains or loses stability [rad/s]."""
_TITLES = {"a": "(a) Coulomb, 0.3", "b": "(b) falling from 0.4 to 0.25", "c": "(c) falling from 0.9 to 0.8"}
_GAPS = "Short stable gaps near 919 and 1113 rad/s lie between the points of the reference's grid."


def at(case: str, N0: float, speed: float, scene: str = "disc_slider", **changes: Any) -> Scene:
    """Return the rig in a case of friction, at a preload [N] and a speed of the disc [rad/s]."""
    return quiet(load(scene, load__force=N0, drive__speed=speed, **CASES[case], **changes))


def modes(figure: Figure) -> Compared:
    """Modes of the free disc, and its frequencies as published."""
    disc: Any = load("disc_slider").parameters
    shapes = free_modes(disc.disc)
    shape, beside = figure.subplots(1, 2)
    radii = np.linspace(disc.disc.inner_radius, disc.disc.outer_radius, 120)
    for mode, colour, line in zip(shapes, (BLUE, VERMILION, GREEN, "black"), ("-", "--", "-.", ":")):
        label = f"{mode.diameters} nodal diameters"
        shape.plot(1e3 * radii, [mode.at(r) for r in radii], line, color=colour, label=label)
    shape.set(xlabel="radius [mm]", ylabel="shape, of mass one [1/sqrt(kg)]", title="shapes")
    shape.legend()
    frequencies = [2.0 * math.pi * hertz for hertz in rig.modes("disc_slider").free.values()]
    published = (1492, 1517, 1517, 1824, 1824, 2774, 2774)
    names = []
    for mode in shapes:
        parts = ("cosine", "sine") if mode.pair else ("-",)
        names += [f"{mode.diameters}, {part}" for part in parts]
    beside.set_title("natural frequencies [rad/s]")
    cells = [(name, f"{ours:.3f}", f"{printed}") for name, ours, printed in zip(names, frequencies, published)]
    table(beside, cells, ("nodal diameters", "ours", "published"), 10, 1.6)
    yield from numbered("natural frequency {}", frequencies, published, "rad/s", "paper", absolute=0.5)
    computed = (1491.9269, 1516.7573, 1823.8811, 2774.1939)
    rows = ((f"{mode.diameters} nodal diameters", mode.omega, expected) for mode, expected in zip(shapes, computed))
    yield from compared(rows, "rad/s", "reference", relative=1e-6)
    critical = min(mode.omega / mode.diameters for mode in shapes if mode.pair)
    yield Comparison("critical speed", "rad/s", critical, 911.94, "reference", absolute=0.005)


def instability(figure: Figure) -> Compared:
    """Speeds at which sliding is unstable, over the preload."""
    for row, case in zip(_panels(figure), CASES):
        speeds = _SPEEDS[::4] if case == "c" else _SPEEDS
        edges, unstable = _drawn(row, at(case, 100.0, 2.0), speeds)
        yield Comparison(_BAND.format(case), "rad/s", unstable[100.0], math.nan, "paper")
        if case == "c":
            yield Comparison("case c: edges", "", sum(map(len, edges.values())), 0.0, "reference")
        for N0 in LOADS:
            yield from _compared(f"case {case}, {N0:g} N: edge", edges[N0], _EDGES.get((case, N0), ()))
        row[0].set_title(_TITLES[case])


def _panels(figure: Figure) -> Any:
    """Three rows of slow and of fast speeds; nothing happens between the two ranges."""
    rows = figure.subplots(3, 2, sharex="col", sharey=True, width_ratios=(1.0, 1.6))
    for row in rows:
        row[0].set(ylabel="preload [N]", xlim=(0.0, _SLOW[-1]), ylim=(0.0, 220.0))
        row[1].set(xlim=(_FAST[0], _FAST[-1]))
    rows[-1, 0].set_xticks([0.0, 2.0, 4.0, 6.0, 8.0], ["0", "2", "4", "6", ""])  # 8 would touch the 900 beside it
    figure.supxlabel("speed of the disc [rad/s]; wide: sliding is unstable", fontsize=10.5)
    return rows


def _drawn(row: Any, scene: Scene, speeds: np.ndarray = _SPEEDS) -> tuple[dict[float, list[float]], dict[float, float]]:
    """Speeds [rad/s] at which sliding gains or loses stability, at each preload, with the unstable ranges drawn.

    Second, the sum of the unstable ranges [rad/s]. Nothing is drawn over speeds without steady sliding: there the
    contact would have to pull.
    """
    ranges = regions(scene, Axis.of("drive.speed", speeds, scene), Axis.of("load.force", LOADS, scene))
    edges: dict[float, list[float]] = {}
    wide = dict.fromkeys(LOADS, 0.0)
    for N0, ends, growth in zip(LOADS, ranges.edges, ranges.growth):
        crossings = [value for value, _ in ends]
        gaps = []  # where sliding does not exist, between two edges
        for number, (low, high) in enumerate(pairwise((speeds[0], *crossings, _SPEEDS[-1]))):
            inside = (speeds > low) & (speeds < high)
            if np.isnan(growth[inside]).any():
                gaps += [low, high]
                continue
            unstable = (growth[0] > 0.0) == (number % 2 == 0)
            wide[N0] += (high - low) * bool(unstable)
            colour, thickness = (VERMILION, 7) if unstable else (BLUE, 1.2)
            for axis in row:
                axis.hlines(N0, low, high, color=colour, lw=thickness)
        edges[N0] = [value for value in crossings if value not in gaps]
    return edges, wide


def _compared(what: str, edges: list[float], reference: tuple[float, ...]) -> Compared:
    """Each edge of the reference beside the nearest of ours."""
    for expected in reference:
        nearest = min(edges, key=lambda edge: abs(edge - expected), default=math.nan)
        yield Comparison(what, "rad/s", nearest, expected, "reference", absolute=1e-3)


def growing(figure: Figure) -> Compared:
    """Cases b at 2 rad/s and c at 20 rad/s, 100 N: angle, normal motion, the disc."""
    cases = (("b", 2.0, 1.6, 2.5694756), ("c", 20.0, 0.16, 38.764815))
    for row, (case, speed, seconds, expected) in zip(figure.subplots(2, 3), cases):
        still = rig.modes(at(case, 100.0, speed)).sliding
        yield Comparison(f"case {case}: growth rate", "1/s", still.growth, expected, "reference", relative=1e-6)
        more = rig.modes(at(case, 100.0, speed, disc__modes=20)).sliding.growth
        yield Comparison(f"case {case}: growth rate with 20 modes of the disc", "1/s", more, math.nan, "paper")
        rest = still.equilibrium["displacement"]
        height = still.equilibrium["height"]
        near = at(case, 100.0, speed, start__displacement=1.01 * rest, start__height=height)
        ran = rig.simulate(near, seconds)
        _three(row, ran, case)
        rate = _rate(ran, rest)
        yield Comparison(f"case {case}: growth, simulated", "1/s", rate, expected, "theory", relative=0.05)


def _three(row: Any, ran: Any, case: str) -> None:
    outputs = (
        ("angle", 1e3, "angle [mrad]"),
        ("height", 1e3, "height [mm]"),
        ("deflection", 1e6, "disc at the rim [um]"),
    )
    for axis, (name, factor, label) in zip(row, outputs):
        axis.plot(ran.time, factor * ran.signals[name], color=BLUE, lw=0.5)
        axis.set(xlabel="time [s]", ylabel=label, title=f"case {case}" if name == "angle" else "")


def _rate(ran: Any, rest: float) -> float:
    """Growth rate of the displacement's vibration about rest over the second half of a run [1/s]."""
    x = ran.signals["displacement"] - rest
    t = ran.time
    top = tops(x)
    top = top[(x[top] > 0.0) & (t[top] > 0.5 * t[-1])]
    return log_slope(t[top], x[top])


def quenched(figure: Figure) -> Compared:
    """Draw the same with dither above its boundary, at twenty times sqrt(kc / m)."""
    omega = 20.0 * RATE
    hertz = omega / (2.0 * math.pi)
    cases = (("b", 2.0, 1.3, 1.2), ("c", 20.0, 1.5, 0.9))
    for row, (case, speed, times, seconds) in zip(figure.subplots(2, 3), cases):
        force = times * speed * RADIUS * omega
        dithered = at(case, 100.0, speed, "disc_slider_dither", dither__amplitude=force, dither__frequency=hertz)
        ran = rig.simulate(dithered, seconds)
        _three(row, ran, case)
        last = ran.time > 0.9 * seconds
        ripple = 0.5 * float(np.ptp(ran.signals["angle"][last]))
        theory = force / (omega**2 * RADIUS)
        yield Comparison(f"case {case}: ripple A / (m omega^2 r0)", "rad", ripple, theory, "theory", relative=0.03)
        first = ran.time < 0.1 * seconds
        height = ran.signals["height"]
        left = float(np.ptp(height[last]) / np.ptp(height[first]))
        yield Comparison(f"case {case}: normal motion left, of that at first", "", left, 0.0, "theory", absolute=0.25)


def boundary(figure: Figure) -> Compared:
    """Amplitude above which dither stabilises, averaged and simulated, beside independent simulations."""
    left, right = figure.subplots(1, 2)
    edges = {
        "b": {3: 0.8859, 5: 0.9578, 10: 0.9859, 20: 0.9953},
        "c": {3: 1.1422, 5: 1.2047, 10: 1.2297, 20: 1.2328},
    }
    for axis, case, speed, expected in ((left, "b", 2.0, 1.0), (right, "c", 20.0, 1.2362385)):
        V = speed * RADIUS
        averaged = _largest(case, speed)
        yield Comparison(f"case {case}: averaged, a / V", "", averaged, expected, "reference", relative=1e-6)
        top = 22.0 * averaged * V * RATE * 1e-3
        axis.plot([0.0, 22.0], [0.0, top], color=BLUE, label="averaged")
        ratios = np.array(list(edges[case]))
        simulated = np.array(list(edges[case].values()))
        forces = simulated * V * RATE * ratios * 1e-3
        axis.plot(ratios, forces, "o", color=VERMILION, mfc="none", ms=9.0, label="reference, simulated")
        shaken = at(case, 100.0, speed, "disc_slider_dither")
        for ratio in (10, 20):
            _, averaged, lost = dither_boundary(shaken, ratio * RATE, V, np.linspace(0.8, 1.45, 6))
            force = lost * V * RATE * ratio * 1e-3
            axis.plot([ratio], [force], "x", color="black", label="simulated" if ratio == 10 else "")
            what = f"case {case}: simulated at ratio {ratio}, over averaged"
            yield Comparison(what, "", lost / averaged, 1.0, "theory", absolute=0.05)
        axis.set_title(f"case {case}, {speed:g} rad/s")
        axis.set(xlabel="frequency of the dither over sqrt(kc / m) [1]", ylabel="amplitude of the dither [kN]")
        axis.set(xlim=(0.0, 22.0), ylim=(0.0, None))
        axis.legend(loc="upper left")


def _largest(case: str, speed: float) -> float:
    """The largest a / V at which averaged sliding is neutrally stable."""
    V = speed * RADIUS

    def growth(ratio: float) -> float:
        return mean_growth(case, 100.0, speed, ratio * V)

    ratios = np.linspace(1.6, 1.0 + 1e-6, 13)
    rates = [growth(ratio) for ratio in ratios]
    for high, low, after in zip(ratios, ratios[1:], rates[1:]):
        if after > 0.0:
            return float(brentq(growth, low, high, xtol=1e-9))
    return 1.0 if growth(1.0 - 1e-6) > 0.0 else 0.0


def mean_growth(case: str, N0: float, speed: float, fast: float) -> float:
    """Return the largest growth rate of averaged sliding with dither of speed `fast` [m/s], to leading order."""
    omega = 20.0 * RATE
    shaken = {"dither__amplitude": fast * omega, "dither__frequency": omega / (2.0 * math.pi)}
    system = at(case, N0, speed, "disc_slider_dither", **shaken).assemble().system()
    sine, cosine = (system.names.index(name) for name in GENERATOR)
    mean = averaged(system, sine, cosine, fast * omega, leading=True)
    return float(mean.eigenvalues()[0].real)


def instability_shaken(figure: Figure) -> Compared:
    """Draw the regions again, with dither of 0.6 m/s."""
    reference = {"b": (6.000099, 6.911980, 911.872406, 1246.366730), "c": (4.927391, 5.994225, 6.000099)}
    omega = 20.0 * RATE
    shaken = {"dither__amplitude": 0.6 * omega, "dither__frequency": omega / (2.0 * math.pi), "dither__enable": True}
    for row, case in zip(_panels(figure), CASES):
        edges, unstable = _drawn(row, at(case, 100.0, 2.0, "disc_slider_dither", **shaken))
        yield Comparison(_BAND.format(case), "rad/s", unstable[100.0], math.nan, "paper")
        for low, high in zip(edges[100.0][:2], edges[100.0][1:2]):
            what = f"case {case}, 100 N: width of the lowest unstable band"
            yield Comparison(what, "rad/s", high - low, math.nan, "paper")
        yield from _compared(f"case {case}, 100 N: edge", edges[100.0], reference.get(case, ()))
        row[0].set_title(f"case {case}, shaken with 0.6 m/s")


ENTRIES = (
    Entry("liu000-table-1", "liu000", "Table 1", "the disc and its natural frequencies", ("disc_slider",), modes),
    Entry(
        "liu000-8",
        "liu000",
        "Figure 8",
        "where sliding is unstable, over speed and preload",
        ("disc_slider",),
        instability,
        f"{_GAPS} White in (b) and (c): steady sliding would need a tensile contact force.",
        (9.6, 7.2),
    ),
    Entry(
        "liu000-9",
        "liu000",
        "Figure 9",
        "growth from near sliding",
        ("disc_slider",),
        growing,
        "The disc has the seven modes of the paper. With more modes the growth of case b is 7 % lower.",
        (9.6, 5.6),
    ),
    Entry(
        "liu000-10", "liu000", "Figure 10", "the same under dither", ("disc_slider_dither",), quenched, size=(9.6, 5.6)
    ),
    Entry(
        "liu000-11",
        "liu000",
        "Figure 11",
        "stabilising dither over its frequency",
        ("disc_slider_dither",),
        boundary,
        "Stable above the lines. Crosses: runs displaced along the least stable mode; circles: runs of the reference.",
    ),
    Entry(
        "liu000-12",
        "liu000",
        "Figure 12",
        "where sliding is unstable under dither",
        ("disc_slider_dither",),
        instability_shaken,
        f"Averaged to leading order. {_GAPS} The paper states that the regions are greatly diminished. Here dither "
        "removes the instability at the lowest speeds, and another one begins where the speed of the disc exceeds "
        "that of the dither; the bands at high speeds stay.",
        (9.6, 7.2),
    ),
)
