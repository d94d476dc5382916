"""A new mechanism for friction-induced vibration and noise, section 3.2.3: the slider on the plate in time.

After the first opening of the contact the motion is chaotic, so that only statistics are compared: "reference" is an
independent computation of the same model by velocity Verlet, with 96 points and bristles of 0.4 of the film's normal
stiffness. The figures of the paper are curves; only the statements in its text are compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

import rig
from rig.analysis.linear.modes import at_rest
from rig.papers.entry import Compared, Comparison, Entry, load
from rig.plants.plate import Parameters
from rig.record.film_points import Points
from rig.record.run import Reals, Run
from rig.scenes.protocol import Load, Ramp
from rig.view.palette import AMBER, BLUE, GREEN, GREY, VERMILION
from rig.view.pressure import draw_map, draw_scale

_LEVER = 0.0126 + 0.001  # m, height of the slider's upper face above the plate
_OFFSET = 0.3 * _LEVER  # m, of the pressure centre in steady sliding
_ONSET = 0.547  # s, extrapolated to step zero
_HEAVE = 9260.0  # Hz: the strongest line of the normal acceleration below 12 kHz
_RATE = 80e3  # Hz: the flutter at 49.9 kHz keeps its amplitude at this rate; at 100 kHz it would beat
_WINDOW = 4096  # samples
_TOP = 15e3  # Hz
_LINES = {11: (5.3, 5.5, 8.7), 13: (5.5, 8.7, 11.0), 14: (4.4, 4.6, 7.3, 7.5, 8.4, 8.8)}  # kHz
_AREA = 0.043 * 0.0253  # m^2, of the slider
_FLUTTER = (39e3, 42e3)  # Hz: the mode with roll of the slider that opens the film
_RESOLUTIONS: dict[str, tuple[str, dict[str, Any]]] = {  # the coarser one, and what differs from scene plate_converged
    "40 modes": ("", {"plate__modes": 40}),
    "60 modes": ("40 modes", {"plate__modes": 60}),
    "80 modes": ("60 modes", {"plate__modes": 80}),
    "120 modes": ("80 modes", {}),
    "160 modes": ("120 modes", {"plate__modes": 160}),
    "16 x 14 elements": (
        "120 modes",
        {"plate__elements_along": 16, "plate__elements_across": 14, "foam__elements_through": 3},
    ),
    "16 x 12 points": ("120 modes", {"film__along": 16, "film__across": 12}),
    "step 0.5 us": ("120 modes", {"clock__rk4_step": 0.5e-6}),
}
_MOVES = {  # changes of more than 5 %
    ("60 modes", "largest growth rate"),
    ("120 modes", "largest growth rate"),
    ("120 modes", "flutter begins"),
    ("16 x 12 points", "flutter begins"),
    ("160 modes", "70 to 80 kHz"),
}


def _onset(ran: Run) -> float:
    """Time of the first opening [s]; NaN if none opens."""
    opened = np.flatnonzero(ran.signals["openings"] > 0.0)
    return float(ran.time[opened[0]]) if len(opened) else float("nan")


def _density(ran: Run, values: Reals, begin: float) -> tuple[Reals, Reals]:
    """Frequencies [Hz] and power spectral density from `begin` [s] on, mean of Hann windows that overlap by half."""
    rate = 1.0 / float(ran.time[1] - ran.time[0])
    hertz, density = welch(values[ran.time >= begin], rate, np.hanning(_WINDOW))
    return hertz, density


def _spectrum(axis: Any, hertz: Reals, density: Reals, printed: Sequence[float], title: str) -> None:
    """Draw the amplitude spectrum, linear as in the paper, and the lines that the paper names."""
    shown = (hertz > 1000.0) & (hertz < _TOP)
    amplitude = np.sqrt(3.0 * density[shown] * (hertz[1] - hertz[0]))  # of a sine, with the bandwidth of the window
    axis.plot(1e-3 * hertz[shown], amplitude, color=BLUE, lw=0.9)
    top = 1.12 * float(amplitude.max())
    for i, line in enumerate(printed):
        axis.axvline(line, color=VERMILION, ls="--", lw=0.9)
        height = top if i % 2 == 0 else 0.9 * top  # neighbours stand close together
        axis.text(line, height, f" {line:g} ", color=VERMILION, fontsize=9, ha="left", va="top")
    axis.set(title=title, ylabel="amplitude\n[m/s^2]", xlim=(0.0, 1e-3 * _TOP), ylim=(0.0, top))


def normal(figure: Figure) -> Compared:
    """Normal acceleration of the slider over the first second, and its spectrum: figures 10 and 11."""
    ran = rig.simulate(load("plate"), 1.2)
    history, lines = figure.subplots(2, 1)
    acceleration = ran.signals["slider_acceleration"]
    onset = _onset(ran)
    history.plot(ran.time, acceleration, color=BLUE, lw=0.3)
    history.set(
        title="figure 10: normal acceleration of the slider, 10 mm/s, 0.1 MPa; dashed: first opening",
        ylabel="acceleration\n[m/s^2]",
        xlabel="time [s]",
        xlim=(0.0, 1.0),
    )
    history.axvline(onset, color=VERMILION, lw=0.9, ls="--")
    hertz, density = _density(ran, acceleration, onset)
    title = "figure 11: its spectrum from the first opening on; dashed: lines that the paper names [kHz]"
    _spectrum(lines, hertz, density, _LINES[11], title)
    lines.set_xlabel("frequency [kHz]")
    slides = (ran.time > 0.3) & (ran.time < onset - 0.05)
    before = float(np.abs(acceleration[slides]).max())
    after = float(acceleration[ran.time > onset + 0.05].std())
    closed = ran.signals["contact_fraction"][ran.time > onset]
    yield Comparison("first opening", "s", onset, _ONSET, "reference", absolute=0.05)
    yield Comparison("RMS after it over the largest before it: it grows", "", after / before, 1.0, "paper", floor=True)
    yield Comparison("largest share of open points", "", 1.0 - float(closed.min()), 0.5, "reference", floor=True)
    near = (hertz >= 8000.0) & (hertz <= 12000.0)
    line = float(hertz[near][np.argmax(density[near])])
    yield Comparison("strongest line from 8 to 12 kHz", "Hz", line, _HEAVE, "reference", relative=0.02)


def _pressures(ran: Run, along: int, across: int) -> Reals:
    """Pressure [MPa] at every sample, point along and point across."""
    names = [f"pressure_{i}_{j}" for i in range(1, along + 1) for j in range(1, across + 1)]
    return np.stack([1e-6 * ran.signals[name] for name in names], axis=1).reshape(-1, along, across)


def maps(figure: Figure) -> Compared:
    """Draw the pressure in the contact at instants before and after its first opening, as in figure 12."""
    scene = load("plate_96")
    ran = rig.simulate(scene, 0.8)
    onset = _onset(ran)
    pressure = _pressures(ran, 12, 8)
    centre = ran.signals["pressure_centre_x"]
    free = np.flatnonzero((ran.time > onset + 0.05) & (ran.signals["normal_force"] > 30.0))
    rear = int(free[np.argmin(centre[free])])
    front = int(free[np.argmax(centre[free])])
    opened = int(free[np.argmin(ran.signals["contact_fraction"][free])])
    both = int(free[np.argmax(_on_both_edges(pressure[free]))])
    ramp, sliding, before, opening = (int(np.searchsorted(ran.time, t)) for t in (0.15, 0.3, onset - 0.02, onset))
    instants = {
        "0.15 s: the ramp": ramp,
        "0.3 s: sliding": sliding,
        "20 ms before": before,
        "first opening": opening,
        "centre at the rear": rear,
        "centre at the front": front,
        "most points open": opened,
        "load on both edges": both,
    }
    grid = figure.add_gridspec(3, 4, height_ratios=(1.0, 1.0, 1.1))
    points = Points.of(scene)
    assert points is not None
    for k, (title, i) in enumerate(instants.items()):
        axis = figure.add_subplot(grid[k // 4, k % 4])
        draw_map(axis, points.surfaces, [1e6 * pressure[i]], points.scale)
        axis.set_title(f"{title}\n{ran.time[i]:.4f} s", fontsize=9)
        axis.tick_params(labelsize=8)
        axis.set_xlabel("along [mm]" if k >= 4 else "", fontsize=8)
        axis.set_ylabel("across [mm]" if k % 4 == 0 else "", fontsize=8)
    beyond = float(1e6 * pressure[list(instants.values())].max()) > points.scale
    draw_scale(axis, points.scale, beyond, ax=figure.axes, fraction=0.03)
    axis = figure.add_subplot(grid[2, :])
    axis.plot(ran.time, 1e3 * centre, color=BLUE, lw=0.4)
    axis.axhline(1e3 * _OFFSET, color=VERMILION, ls="--", lw=0.9, label="mu h: 4.08 mm")
    axis.set(ylabel="pressure centre [mm]", xlabel="time [s]", xlim=(0.05, 0.8), ylim=(-22.0, 22.0))
    axis.legend(loc="upper left")
    slides = (ran.time > 0.25) & (ran.time < 0.45)
    offset = 1e3 * float(centre[slides].mean())
    yield Comparison("pressure centre in sliding", "mm", offset, 1e3 * _OFFSET, "theory", absolute=0.02)
    uneven = np.abs(pressure - pressure[:, :, ::-1])[ran.time < onset].max()
    yield Comparison("largest difference from side to side before", "MPa", float(uneven), 0.0, "paper", absolute=1e-9)
    for what, i, sign in (("foremost", front, 1.0), ("rearmost", rear, -1.0)):
        share = sign * float(centre[i]) / 0.0215
        yield Comparison(f"pressure centre, {what}: of the half length", "", share, 0.5, "reference", floor=True)


def _on_both_edges(pressure: Reals) -> Reals:
    """How much both edges across the travel are loaded at once, over the square of the mean pressure [sample]."""
    rear = pressure[:, :2].mean(axis=(1, 2))
    front = pressure[:, -2:].mean(axis=(1, 2))
    mean = pressure.mean(axis=(1, 2))
    return np.asarray((rear * front) / (mean**2 + 0.05**2))


def tangential(figure: Figure) -> Compared:
    """Spectra of the tangential acceleration of examples 2 and 3: figures 13 and 14."""
    axes = figure.subplots(2, 1, sharex=True)
    onsets = []
    examples = ((13, "plate_example_2", "3 mm/s, 0.1 MPa"), (14, "plate_example_3", "3 mm/s, 0.3 MPa"))
    for axis, (number, scene, title) in zip(axes, examples):
        ran = rig.simulate(load(scene), 1.2)
        onset = _onset(ran)
        onsets.append(onset)
        hertz, density = _density(ran, _LEVER * ran.signals["pitch_acceleration"], onset)
        _spectrum(axis, hertz, density, _LINES[number], f"figure {number}: {title}; dashed: the paper [kHz]")
        closed = ran.signals["contact_fraction"][ran.time > onset]
        what = f"{title}: largest share of open points"
        yield Comparison(what, "", 1.0 - float(closed.min()), 0.3, "reference", floor=True)
    axes[1].set_xlabel("frequency [kHz]")
    yield Comparison("first opening, 0.3 MPa over 0.1 MPa", "", onsets[1] / onsets[0], 1.0, "theory", relative=0.05)


def scaling(figure: Figure) -> Compared:
    """Draw speed and pressure at a frozen position: tripling both gives the same motion, three times larger."""
    upper, lower = figure.subplots(2, 1, sharex=True)
    runs: dict[str, tuple[Reals, Reals, float]] = {}
    for title, speed, force, colour, axis in (
        ("10 mm/s, 0.1 MPa", 0.01, 108.79, BLUE, upper),
        ("30 mm/s, 0.3 MPa", 0.03, 326.37, VERMILION, upper),
        ("3 mm/s, 0.1 MPa", 0.003, 108.79, GREEN, lower),
        ("3 mm/s, 0.3 MPa", 0.003, 326.37, AMBER, lower),
    ):
        held = {"slider__travels": False, "slider__position": 0.004, "sensors__accelerometer__rate": _RATE}
        scene = load("plate", **held)
        ends = {Load: {"force": force}, Ramp: {"to": speed}}
        protocol = tuple(step.model_copy(update=ends.get(type(step))) for step in scene.protocol)  # type: ignore[call-overload]
        ran = rig.simulate(replace(scene, protocol=protocol), 0.4)
        share = ran.signals["pitch_velocity"] / force
        opens = _onset(ran)
        runs[title] = ran.time, share, opens
        style = "--" if colour == VERMILION else "-"
        axis.plot(ran.time, share, color=colour, lw=0.6, ls=style, label=f"{title}: opens at {opens:.4f} s")
    for axis in (upper, lower):
        low, high = axis.get_ylim()
        axis.set(ylabel="pitch velocity\nover the load [rad/(N s)]", xlim=(0.1, 0.4), ylim=(low, 1.5 * high))
        axis.legend(loc="upper left", ncols=2)
        axis.axhline(0.0, color=GREY, lw=0.5)
    upper.set_title("slider held at 4 mm")
    lower.set_xlabel("time [s]")
    time, slow, onset = runs["10 mm/s, 0.1 MPa"]
    _, three, later = runs["30 mm/s, 0.3 MPa"]
    before = time < onset
    error = float(np.abs(slow - three)[before].max() / np.abs(slow[before]).max())
    yield Comparison("same speed over pressure: difference before the opening", "", error, 0.0, "theory", absolute=1e-4)
    yield Comparison("same speed over pressure: first opening", "s", later, onset, "theory", absolute=1e-4)


def _sliding(position: float, **changes: Any) -> tuple[float, Any]:
    """Least pressure [kPa] and eigenvalues [1/s] with positive frequency of steady sliding in scene plate_converged."""
    _, at = at_rest(load("plate_converged", slider__position=position, **changes))
    forces = at.modes.normal @ at.x + at.modes.normal_t @ at.T
    least = 1e-3 * float(forces.min()) * len(forces) / _AREA
    rates = at.eigenvalues()
    return least, rates[rates.imag > 0.0]


def _flutter_growth(rates: Any) -> float:
    """Largest growth rate among eigenvalues in the band `_FLUTTER` [1/s]."""
    inside = np.abs(rates.imag / math.pi - sum(_FLUTTER)) < np.ptp(_FLUTTER)
    return float(rates.real[inside].max())


def resolution(figure: Figure) -> Compared:
    """Draw the flutter that opens the film over resolutions, and the damping ratios below which modes flutter."""
    growing, critical = figure.subplots(1, 2)
    places = np.linspace(1.25e-3, 6.25e-3, 21)
    quantities_of: dict[str, dict[str, float]] = {}
    for name, (coarser, changes) in _RESOLUTIONS.items():
        quantities: dict[str, float] = {}
        if "clock__rk4_step" not in changes:
            pressures, rates = zip(*(_sliding(place, **changes) for place in places.tolist()))
            growth = np.array([_flutter_growth(eigenvalues) for eigenvalues in rates])
            growing.plot(1e3 * places, growth, label=name, ls="-" if "modes" in name else "--")
            turns = np.flatnonzero(np.diff(np.sign(growth)))
            zeros = places[turns] - growth[turns] * np.diff(places)[turns] / np.diff(growth)[turns]
            quantities |= {
                "least pressure at 3.5 mm [kPa]": pressures[9],
                "largest growth rate [1/s]": float(growth.max()),
                "flutter begins [mm]": 1e3 * float(zeros[0]),
                "flutter ends [mm]": 1e3 * float(zeros[-1]),
            }
        if coarser in ("80 modes", "120 modes"):
            ran = rig.simulate(load("plate_converged", **changes), 0.45)
            quantities["first opening [s]"] = _onset(ran)
        for what, ours in quantities.items():
            title, unit = what[:-1].split(" [")
            before = quantities_of.get(coarser, {}).get(what, math.nan)
            missed = (name, title) in _MOVES
            yield Comparison(f"{name}: {title}", unit, ours, before, "coarser", relative=0.05, missed=missed)
        quantities_of[name] = quantities
    growing.axhline(0.0, color=GREY, lw=0.7)
    growing.set(title="growth at 40 kHz", xlabel="position of the slider [mm]", ylabel="growth rate [1/s]")
    growing.set_ylim(-600.0, None)
    growing.legend(fontsize=8)
    yield from _critical_ratios(critical)


def _critical_ratios(axis: Any) -> Compared:
    """Draw the damping ratio below which each mode flutters, at 23 positions along the travel."""
    coarser = dict[tuple[int, int], float]()
    for name, colour in (("120 modes", BLUE), ("160 modes", VERMILION)):
        bare = {"plate__damping": [[0.0, 0.0], [1e5, 0.0]], **_RESOLUTIONS[name][1]}
        rates = np.concatenate([_sliding(place, **bare)[1] for place in np.linspace(0.0, 0.0437, 23).tolist()])
        khz = 5e-4 / math.pi * rates.imag
        ratio = rates.real / rates.imag
        flutters = ratio > 1e-5
        axis.plot(khz[flutters], ratio[flutters], "o", color=colour, markersize=3, label=f"undamped, {name}")
        for low, high in pairwise((0, 25, 30, 44, 60, 70, 80)):
            inside = (khz > low) & (khz < high)
            worst = float(ratio[inside].max())
            before = coarser.get((low, high), math.nan)
            coarser[low, high] = worst
            band = f"{low} to {high} kHz"
            missed = (name, band) in _MOVES
            what = f"{name}, {band}: critical damping ratio"
            yield Comparison(what, "", worst, before, "coarser", relative=0.05, absolute=1e-6, missed=missed)
    scene = load("plate_converged").parameters
    assert isinstance(scene, Parameters)
    hertz, ratio = np.array(scene.plate.damping).T
    axis.plot(1e-3 * hertz, ratio, color=GREY, label="of the scene")
    axis.set(
        title="damping ratio below which a mode flutters",
        xlabel="frequency [kHz]",
        ylabel="ratio [1]",
        xlim=(0.0, 80.0),
        ylim=(0.0, 0.012),
    )
    axis.legend(loc="upper left", fontsize=8)


ENTRIES = (
    Entry(
        "detachment-10",
        "detachment",
        "Figures 10 and 11",
        "normal acceleration of example 1 and its spectrum",
        ("plate",),
        normal,
        "Steady sliding, then growth, then a vibration that the opening of the contact limits, as in the paper. The "
        "onset is not converged: it depends on the number of modes of the plate, and "
        "on a little noise, which excites the modes with roll of the slider. That of scene plate_converged does not "
        "depend on the modes, but on damping that nobody has measured (docs/plate.md). The reference has as many "
        "modes, so "
        "that its agreement checks the program only. The line is heave of plate and slider, at 9.25 kHz (8.7 in "
        "the paper). The foam was chosen to "
        "have shear modes at 5.4 and 5.5 kHz, which do not stand out. Nearly all power lies at 20 to 50 kHz, above "
        "the range of the paper. Gaps are nanometres wide. At 9.6 mm the flutter of this scene ends, and the "
        "vibration decays.",
        (9.6, 6.4),
    ),
    Entry(
        "detachment-12",
        "detachment",
        "Figure 12",
        "pressure maps of example 1",
        ("plate_96",),
        maps,
        "Before the opening the pressure is higher at the leading edge (the front, on the right; on the left in the "
        "paper) and equal on both sides. Then its centre moves from edge to edge and patches open, as in the paper. "
        "The block is rigid, so that the pressure is highest at its edges, also at the trailing one, where the "
        "paper shows almost zero; it is lowest in the middle. The instants are chosen from a chaotic motion, among "
        "those with more than 30 N. The paper's shift at 1.39 s and its saddle shape are not compared.",
        (9.6, 7.0),
    ),
    Entry(
        "detachment-13",
        "detachment",
        "Figures 13 and 14",
        "tangential spectra of examples 2 and 3",
        ("plate_example_2", "plate_example_3"),
        tangential,
        "The lines that the paper names at 0.3 MPa (4.4, 4.6, 7.3 and 7.5 kHz) are not reproduced, nor is the "
        "disappearance of the line at 11 kHz. The tangential acceleration is that of the slider's lower side. "
        "Motion and spectra above 12 kHz hold for 40 modes of the plate; they have not converged.",
        (9.6, 6.6),
    ),
    Entry(
        "detachment-onset",
        "detachment",
        "Section 3.2.3",
        "onset of the completed plate over resolutions and damping",
        ("plate_converged",),
        resolution,
        "The film opens where the slider enters a region in which a mode with its roll flutters at 40 kHz. From "
        "120 modes (73 kHz) on, greatest growth, least pressure, region and first opening change by less than 5 % "
        "with modes, elements and step; below, modes between 50 and 73 kHz yield more at 40 kHz than their static "
        "deflection. With finer points the region begins 0.17 mm later. On the right: below 39 kHz no mode "
        "flutters without any damping; above 40 kHz the assumed damping decides which modes do, and nobody has "
        "measured it (docs/plate.md).",
        (9.6, 4.8),
    ),
    Entry(
        "detachment-vp",
        "detachment",
        "Section 3.2.3",
        "sensitivity to speed and pressure",
        ("plate",),
        scaling,
        "With the slider held the equations are homogeneous: only the ratio of speed to pressure matters, and "
        "tripling both gives the same motion, three times larger. Growth is exponential until the tangential "
        "vibration speed of the contact reaches the speed of travel, where friction saturates: a higher speed gives "
        "more vibration, and a higher pressure at one speed acts like a lower speed. An influence of pressure "
        "alone, as in the paper, is not reproduced.",
        (9.6, 6.0),
    ),
)
