"""Liu and Ouyang, Mech. Syst. Signal Process. (2022): regions of stick-slip of the lever over preload and speed.

Sliding is unstable below V1. Stick-slip exists up to V2, found by raising the speed or from a standing start. The disc
is uniform, or has a sector of different friction. "reference" is an independent computation with the values of the
scenes.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rig
from rig.analysis.map import Map
from rig.analysis.recorded.stick_speeds import Stages
from rig.papers.entry import Compared, Comparison, Entry, compared, load, thresholds
from rig.papers.liu_lever import COULOMB, RPM, at, both_starts, name_axes, start_near, sticks, three_stages
from rig.scenes.protocol import Ramp
from rig.view.palette import AMBER, BLUE, GREEN, GREY, VERMILION

LOADS = (10.0, 15.0, 20.0, 25.0, 30.0)
SECOND: dict[str, Any] = {"friction__mu_static": 0.38, "friction__mu_kinetic": 0.32}
_FOLD = {"stribeck": (3.413, 4.546, 5.585, 6.540, 7.461), "coulomb": (1.452, 2.182, 2.946, 3.708, 4.468)}
_BEFORE = 2.0 * math.pi - 1e-9  # just before the sector
_TURNS = 5.0  # of a disc with a sector: stick-slip may survive some passes of it
_SLOW_NS = 240 * 10**9
_NOISE = 0.02  # N/Hz^0.5: without it, sliding ends late at falling speed
_TRIED = (10.0, 20.0, 30.0)
_STANDING = {"": (3.3412, 5.4311, 6.9760), "45": (1.9926, 3.1957, 4.1410), "90": (1.9926, 3.1957, 4.1410)}
_CARRIED = {"45": (2.08, 3.37, 4.18), "90": (2.05, 3.37, 4.36)}
_RAMP = {"": (3.432407, 5.595284, 7.484681)}
_HOPF = (1.659746, 1.879013, 2.034443, 2.154880, 2.253175)
_ENDED = {
    (0.16, 0.04): 3,
    (0.24, 0.04): 3,
    (0.32, 0.04): 3,
    (0.40, 0.04): 3,
    (0.48, 0.04): 3,
    (0.16, 0.12): 0,
    (0.32, 0.12): 0,
    (0.32, 0.16): 0,
    (0.48, 0.12): 0,
    (0.48, 0.16): 0,
    (0.40, 0.12): 3,
}
"""Kinetic coefficient of the sector, and how far the static one is above it: starts of three that end stick-slip."""
_RAMPS = (
    "A virtual experiment, with process noise of 0.02 N/Hz^0.5 (chosen) and ramps of 240 s: without noise sliding ends "
    "late at falling speed, and with more noise both thresholds move towards each other. Another seed moves the upper "
    "threshold by up to 0.4 rpm and the lower one by up to 0.2 rpm. The text of the paper has lost all numbers of this "
    "figure: only the number and the order of the regions are compared."
)


def regions(figure: Figure) -> Compared:
    """Preload and speed: sliding, both, stick-slip; exponential and Coulomb law."""
    for axis, name in zip(figure.subplots(1, 2, sharey=True), ("stribeck", "coulomb")):
        hopf, fold = np.transpose([_carried(N0, name) for N0 in LOADS])
        _shade(axis, LOADS, hopf, fold)
        axis.set_title("exponential law" if name == "stribeck" else "Coulomb's law")
        names = [f"{name}, {N0:g} N" for N0 in LOADS]
        for at_load, ours, expected in zip(names, fold, _FOLD[name]):
            yield Comparison(f"{at_load}: V2", "rpm", float(ours), expected, "reference", absolute=0.06)
        if name == "stribeck":
            rows = ((f"{at_load}: V1", ours, expected) for at_load, ours, expected in zip(names, hopf, _HOPF))
            yield from compared(rows, "rpm", "reference", absolute=1e-4)
        else:
            rows = ((f"{at_load}: no V1 (0)", ours, 0.0) for at_load, ours in zip(names, hopf))
            yield from compared(rows, "rpm", "reference", absolute=0.0)


def _carried(N0: float, name: str) -> tuple[float, float]:
    """V1 (0 if there is none) and V2 [rpm], with the speed raised step by step."""
    scene = at(N0, 1.0, **(COULOMB if name == "coulomb" else {}))
    fold = _FOLD[name][LOADS.index(N0)]
    low = fold - 1.0
    high = fold + 0.6
    with tempfile.TemporaryDirectory() as folder:
        chart = rig.map(scene, f"drive.speed={low} rpm:{high} rpm:9", runs=("up",), out=folder, workers=1)
    assert isinstance(chart, Map)
    swept = rig.sweep(scene, "drive.speed", np.linspace(0.5 * RPM, 4.0 * RPM, 15))
    hopf = [crossing.value / RPM for crossing in swept.critical]
    return hopf[0] if hopf else 0.0, float(chart.ends[0, 0].mean()) / RPM


def _shade(
    axis: Axes,
    loads: tuple[float, ...],
    hopf: np.ndarray,
    fold: np.ndarray,
    names: tuple[str, str] = ("V2", "V1"),
) -> None:
    """Regions I, II, III over preload."""
    top = 8.5
    axis.fill_between(loads, fold, top, color=GREEN, alpha=0.18, lw=0)
    axis.fill_between(loads, hopf, fold, color=AMBER, alpha=0.25, lw=0)
    axis.fill_between(loads, 0.0, hopf, color=VERMILION, alpha=0.25, lw=0)
    axis.plot(loads, fold, "o-", color=BLUE, markersize=4, label=names[0])
    if hopf.any():
        axis.plot(loads, hopf, "s--", color="black", markersize=4, label=names[1])
        axis.text(26.0, 0.8, "III: stick-slip", ha="center")
    lower = float(np.interp(26.0, loads, hopf))
    upper = float(np.interp(26.0, loads, fold))
    axis.text(26.0, 0.55 * (lower + upper), "II: both", ha="center")
    axis.text(14.0, 6.8, "I: sliding", ha="center")
    axis.set(xlabel="preload [N]", ylabel="disc speed [rpm]", ylim=(0.0, top), xlim=(loads[0], loads[-1]))
    axis.legend(loc="upper left")


def representatives(
    figure: Figure, N0: float = 10.0, speeds: tuple[float, ...] = (5.0, 2.0, 1.0), sector: bool = False
) -> Compared:
    """Draw a point of each region, from a standing start (as on the way up) and from near sliding (as down)."""
    axes = figure.subplots(3, 2, sharex=True, sharey=True)
    outcomes = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    scene = "lever"
    changes: dict[str, Any] = {}
    seconds = 15.0
    lw = 0.6
    if sector:
        scene = "lever_sector"
        changes = {"sector__place": _BEFORE}
        seconds = _TURNS * 60.0 / min(speeds)
        lw = 0.4
    for row, rpm, expected, region in zip(axes, speeds, outcomes, ("I", "II", "III")):
        title = f"{region}: {rpm:g} rpm"
        what = f"{N0:g} N, {rpm:g} rpm"
        yield from both_starts(row, title, what, expected, seconds, N0, rpm, scene, lw, **changes)
    name_axes(axes)


@cache
def last_stick(N0: float, disc: str, low: float, high: float, close: float, near: bool = False) -> float:
    """Return the speed [rpm] between `low` and `high` up to which the rig still sticks, to `close`.

    It starts standing or, with `near`, near sliding. `disc`: "1", "2" (uniform, of that property), or the angle of the
    sector in degrees.
    """
    while high - low > close:
        middle = 0.5 * (low + high)
        if _alive(N0, disc, middle, near):
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@cache
def _alive(N0: float, disc: str, rpm: float, near: bool = False) -> bool:
    """Whether a contact still sticks after a minute, with a sector after five turns; `near`: begins near sliding."""
    start = start_near if near else at
    if disc in ("1", "2"):
        scene = start(N0, rpm, **(SECOND if disc == "2" else {}))
        seconds = 60.0
    else:
        scene = start(N0, rpm, "lever_sector", sector__span=math.radians(float(disc)), sector__place=_BEFORE)
        seconds = _TURNS * 60.0 / rpm
    return bool(sticks(rig.simulate(scene, seconds), 2.0))


def sectors(figure: Figure) -> Compared:
    """Draw V2 from a standing start: uniform, and with a sector of 45 and of 90 degrees that comes next.

    With a sector it lies between the reference's values from a standing start and with rising speed.
    """
    axis = figure.subplots()
    looks = {
        "45": (VERMILION, "o-", "sector of 45 degrees"),
        "90": ("black", "s:", "sector of 90 degrees"),
        "": (BLUE, "D-", "uniform"),
    }
    for disc, (colour, line, label) in looks.items():
        limits = []
        for i, (N0, number) in enumerate(zip(_TRIED, _STANDING[disc])):
            if not disc:
                limits.append(last_stick(N0, "1", number - 0.08, number + 0.08, 0.005))
                yield Comparison(f"uniform, {N0:g} N: V2", "rpm", limits[-1], number, "reference", absolute=0.01)
                continue
            low = number - 0.1
            high = _CARRIED[disc][i] + 0.1
            for rpm, lives in ((low, 1.0), (high, 0.0)):
                what = f"{disc} degrees, {N0:g} N, {rpm:.2f} rpm: sticks (1) or slides (0) after five turns"
                yield Comparison(what, "", float(_alive(N0, disc, rpm)), lives, "reference")
            limits.append(last_stick(N0, disc, low, high, 0.05))
        axis.plot(_TRIED, limits, line, color=colour, markersize=5, label=label)
    _over_preload(axis)


def _over_preload(axis: Axes) -> None:
    """Label the axes of a limit of stick-slip over the preload."""
    axis.set(xlabel="preload [N]", ylabel="disc speed up to which stick-slip exists [rpm]")
    axis.set(ylim=(0.0, 8.0), xlim=(9.0, 31.0))
    axis.legend(loc="upper left")


def sector_regions(figure: Figure) -> Compared:
    """Draw the regions with a sector of 45 and of 90 degrees: V1 from near sliding, V2 from a standing start."""
    reference = {"45": (1.667187, 2.076562, 2.348437), "90": (1.667187, 2.079687, 2.354687)}
    for axis, (disc, limits) in zip(figure.subplots(1, 2, sharey=True), reference.items()):
        lower = []
        upper = []
        for N0, expected, standing, carried in zip(_TRIED, limits, _STANDING[disc], _CARRIED[disc]):
            limit = last_stick(N0, disc, expected - 0.1, expected + 0.1, 0.003, near=True)
            what = f"{disc} degrees, {N0:g} N: V1, the lower limit of sliding"
            yield Comparison(what, "rpm", limit, expected, "reference", absolute=0.005)
            lower.append(limit)
            upper.append(last_stick(N0, disc, standing - 0.1, carried + 0.1, 0.05))
        _shade(axis, _TRIED, np.array(lower), np.array(upper))
        axis.set_title(f"sector of {disc} degrees")


def ramped(figure: Figure, discs: tuple[str, ...] = ("",)) -> Compared:
    """Draw the regions as ramps measure them: process noise, 240 s up to 8 rpm, hold, 240 s down.

    `discs`: "" uniform, or the angle of the sector [degrees].
    """
    axes = figure.subplots(1, len(discs), sharey=True, squeeze=False)[0]
    for axis, disc in zip(axes, discs):
        stages = [_thresholds(N0, disc, _NOISE) for N0 in _TRIED]
        down = np.array([stage.down / RPM for stage in stages])
        up = np.array([stage.up / RPM for stage in stages])
        _shade(axis, _TRIED, down, up, ("last stick, rising speed", "first stick, falling speed"))
        name = f"{disc} degrees" if disc else "uniform"
        axis.set_title(f"sector of {name}" if disc else name)
        for N0, below, above in zip(_TRIED, down, up):
            yield Comparison(f"{name}, {N0:g} N: last stick at rising speed", "rpm", above, math.nan, "paper")
            yield Comparison(f"{name}, {N0:g} N: first stick at falling speed", "rpm", below, math.nan, "paper")
            both = float(0.0 < below < above)
            what = f"{name}, {N0:g} N: two stable responses between them (1: yes)"
            yield Comparison(what, "", both, 1.0, "reference")
        for N0, expected in zip(_TRIED, _RAMP.get(disc, ())):
            silent = _thresholds(N0, disc, 0.0).up / RPM
            what = f"{name}, {N0:g} N, without noise: last stick at rising speed"
            yield Comparison(what, "rpm", float(silent), expected, "reference", absolute=0.02)


@cache
def _thresholds(N0: float, disc: str, noise: float) -> Stages:
    """Last stick of the way up and first one of the way down, on slow ramps."""
    changes = {"load__force": N0}
    if noise:
        changes["noise__force"] = noise
    if disc:
        changes["sector__span"] = math.radians(float(disc))
    scene = load("lever_sector_three_stage" if disc else "lever_three_stage", **changes)
    slow = [step.model_copy(update={"over": _SLOW_NS}) if isinstance(step, Ramp) else step for step in scene.protocol]
    return thresholds(rig.simulate(replace(scene, protocol=tuple(slow))))


def second(figure: Figure) -> Compared:
    """Draw the uniform disc of property 2, and the range between its domain of stick-slip and that of property 1."""
    axis = figure.subplots()
    limits: dict[str, list[float]] = {"1": [], "2": []}
    for disc, expected in (("1", _STANDING[""]), ("2", (1.9916, 3.1752, 3.9680))):
        for N0, number in zip(_TRIED, expected):
            limit = last_stick(N0, disc, number - 0.08, number + 0.08, 0.005)
            what = f"property {disc}, {N0:g} N: V2 from a standing start"
            yield Comparison(what, "rpm", limit, number, "reference", absolute=0.01)
            limits[disc].append(limit)
    axis.fill_between(_TRIED, limits["2"], limits["1"], color=VERMILION, alpha=0.2, lw=0)
    axis.plot(_TRIED, limits["1"], "D-", color=BLUE, markersize=5, label="property 1")
    axis.plot(_TRIED, limits["2"], "o--", color="black", markersize=5, label="property 2")
    axis.text(22.0, 4.4, "property 1 may stick and slip,\nproperty 2 only slides", ha="center")
    _over_preload(axis)


def effective(figure: Figure) -> Compared:
    """Draw the friction of the sector that ends stick-slip at 20 N and 4.5 rpm, from three positions on the disc."""
    kinetic = np.arange(0.08, 0.561, 0.04).tolist()
    falls = np.arange(0.0, 0.221, 0.02).tolist()
    pairs = [(round(mu, 2), round(fall, 2)) for mu in kinetic for fall in falls]
    ended = {pair: _ended(*pair) for pair in pairs}
    for (mu, fall), count in _ENDED.items():
        what = f"mu_k {mu:g}, mu_s {mu + fall:g}: ended, of three"
        yield Comparison(what, "", float(ended[mu, fall]), float(count), "reference")
    axis = figure.subplots()
    looks = {3: (BLUE, "all three starts"), 2: ("#6baed6", "two"), 1: ("#c6dbef", "one"), 0: ("white", "none")}
    for count, (colour, name) in looks.items():
        coefficients = [(mu, mu + fall) for (mu, fall), of_three in ended.items() if of_three == count]
        x, y = np.array(coefficients).reshape(-1, 2).T
        axis.plot(x, y, "s", color=colour, mec=GREY, mew=0.7, markersize=8, label=f"ends from {name}")
    from_all = {pair for pair, count in ended.items() if count == 3}
    for edge in _outline(from_all, 0.04, 0.02):
        x, y = np.transpose([(mu, mu + fall) for mu, fall in edge])
        axis.plot(x, y, color=VERMILION, lw=2.2)
    axis.plot([], [], color=VERMILION, lw=2.2, label="effective property 2")
    axis.plot([0.06, 0.58], [0.06, 0.58], color=GREY, lw=0.8, ls="--")
    axis.text(0.47, 0.41, "equal coefficients", ha="left", color="#555555")
    axis.set(xlabel="kinetic coefficient of the sector", ylabel="static coefficient of the sector", xlim=(0.04, 0.6))
    axis.legend(loc="upper left")


def _outline(cells: set[tuple[float, float]], width: float, height: float) -> list[list[tuple[float, float]]]:
    """The edges around cells of a grid, of which these are the middles."""
    edges = []
    for x, y in cells:
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            neighbour = (round(x + dx * width, 2), round(y + dy * height, 2))
            if neighbour in cells:
                continue
            a = x + 0.5 * dx * width
            b = y + 0.5 * dy * height
            across = 0.5 * abs(dy) * width
            up = 0.5 * abs(dx) * height
            edges.append([(a - across, b - up), (a + across, b + up)])
    return edges


def _ended(mu: float, fall: float) -> int:
    """From how many of three positions a sector ends stick-slip; `fall`: static above kinetic coefficient."""
    turn = 60.0 / 4.5
    count = 0
    for place in (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0):
        sector = {"sector__friction__mu_kinetic": mu, "sector__friction__mu_static": mu + fall, "sector__place": place}
        ran = rig.simulate(at(20.0, 4.5, "lever_sector", **sector), 5.0 * 60.0 / 4.5)
        count += not sticks(ran, turn)
    return count


ENTRIES = (
    Entry(
        "liu003-7",
        "liu003",
        "Figure 7",
        "regions over preload and speed",
        ("lever",),
        regions,
        "V2: the reference raises the speed in steps of 0.02 rpm and loses the cycle one to three steps early.",
    ),
    Entry(
        "liu003-10",
        "liu003",
        "Figure 10",
        "regions over preload and speed, measured on ramps",
        ("lever_three_stage",),
        ramped,
        _RAMPS,
    ),
    Entry(
        "liu003-11",
        "liu003",
        "Figure 11",
        "a point of each region at 10 N",
        ("lever",),
        representatives,
        size=(9.6, 6.4),
    ),
    Entry(
        "liu003-14",
        "liu003",
        "Figure 14",
        "regions over preload and speed with a sector",
        ("lever_sector",),
        sector_regions,
        "V2 from a standing start, V1 from near sliding, five turns each. The angle of the sector has little "
        "influence.",
    ),
    Entry(
        "liu003-15",
        "liu003",
        "Figure 15",
        "a point of each region with a sector, at 20 N",
        ("lever_sector",),
        partial(representatives, N0=20.0, speeds=(4.5, 2.5, 1.5), sector=True),
        "The sector begins right after the start and returns with every turn. The text of the paper has lost the "
        "speeds and the preload: these points are chosen.",
        (9.6, 6.4),
    ),
    Entry(
        "liu003-16",
        "liu003",
        "Figure 16",
        "accelerate, hold, decelerate with a sector",
        ("lever_sector_three_stage",),
        partial(three_stages, sector=True),
        "Without noise, as in figure 9. Stick-slip ends at a pass of the sector; the ramp of 60 s has only a few of "
        "them. The text of the paper has lost its numbers: only the order of the thresholds is compared.",
    ),
    Entry(
        "liu003-17",
        "liu003",
        "Figure 17",
        "regions with a sector, measured on ramps",
        ("lever_sector_three_stage",),
        partial(ramped, discs=("45", "90")),
        _RAMPS,
    ),
    Entry(
        "liu003-18",
        "liu003",
        "Figure 18",
        "a sector of different friction narrows the stick-slip domain",
        ("lever", "lever_sector"),
        sectors,
        "The angle of the sector has little influence. Close to the limit it depends on the phase of the cycle at "
        "the edge whether stick-slip survives the edge.",
    ),
    Entry(
        "liu003-19",
        "liu003",
        "Figure 19",
        "the part of the stick-slip domain that property 2 removes",
        ("lever",),
        second,
    ),
    Entry(
        "liu003-20",
        "liu003",
        "Figure 20",
        "friction of a sector that ends stick-slip",
        ("lever_sector",),
        effective,
        "At 4.5 rpm and 20 N, five turns from three positions on the disc. The paper shows a closed curve, whose "
        "numbers are lost. Compared where the result of the reference is certain.",
    ),
)
