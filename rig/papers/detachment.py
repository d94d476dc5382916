"""A new mechanism for friction-induced vibration and noise: four degrees of freedom, and a slider on a plate.

Section 3.1, mode coupling with four degrees of freedom. The paper prints the matrices, and the eigenvalues as curves;
its only number is the coalescence at 1. "reference" is an independent computation of the printed matrices,
"theory" the closed form h^2 = 5000 (1 - mu) of rig.plants.four_dof.

Section 3.2, the plate's modes, complex eigenvalues, ramps.
"paper" is what the paper prints, "reference" an independent computation with other elements. The paper prints neither
the size of the foam nor the thickness of the film; both are calibrated, so that frequencies on foam are a fit.

Section 3.2.3, the plate in time.
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
from rig.analysis.modes import at_rest
from rig.analysis.modes_report import Mode
from rig.papers.entry import Compared, Comparison, Entry, load, numbered, quiet, tops
from rig.plants.plate import Parameters
from rig.plants.structures.plate_model import Reduced
from rig.record.film_points import Points
from rig.record.run import Reals, Run
from rig.scenes.protocol import Load, Ramp
from rig.scenes.scene import Scene
from rig.view.palette import AMBER, BLUE, GREEN, GREY, VERMILION
from rig.view.pressure import draw_map, draw_scale

_MEETS = (10.0, 17.320508075688775)  # rad/s
_BELOW = {
    0.0: (7.653668647, 11.370546244, 16.453287760, 18.477590650),
    0.5: (8.480705122, 11.041845831, 16.675660126, 18.112913643),
    0.9: (9.391304549, 10.514622242, 17.013016167, 17.657955682),
}  # rad/s
_ABOVE = {1.01: (0.1766938980, 0.1020709363), 1.5: (1.2218069077, 0.7248964932)}  # 1/s
_GROWS = (4.0, 9.0)  # s: range of the fit
_LIFTS = 9.257839536912664  # s


def _critical(**changes: object) -> list[float]:
    """Friction coefficients up to 3 at which sliding becomes unstable."""
    swept = rig.sweep(load("four_dof", **changes), "friction.mu", np.linspace(0.0, 3.0, 61))
    return [crossing.value for crossing in swept.critical if crossing.becomes == "unstable"]


def _four_dof_modes(mu: float) -> Sequence[Mode]:
    return rig.modes(load("four_dof", friction__mu=mu)).sliding.modes


def _frequencies(mu: float) -> list[float]:
    """Frequencies at a friction coefficient [rad/s]."""
    return sorted(2.0 * math.pi * mode.frequency for mode in _four_dof_modes(mu))


def four_dof_eigenvalues(figure: Figure) -> Compared:
    """Draw frequencies and growth rates over the friction coefficient, as in figure 6."""
    swept = rig.sweep("four_dof", "friction.mu", np.linspace(0.0, 2.0, 201))
    turning, growth = figure.subplots(1, 2)
    turning.plot(swept.axis.values, 2.0 * math.pi * swept.frequency, ".", color=BLUE, markersize=3)
    growth.plot(swept.axis.values, swept.growth, ".", color=BLUE, markersize=3)
    for axis in (turning, growth):
        axis.axvline(1.0, color=VERMILION, ls="--", lw=1.0)
        axis.set_xlabel("friction coefficient")
    turning.set(title="frequencies", ylabel="imaginary part [rad/s]")
    growth.set(title="growth rates", ylabel="real part [1/s]")
    [limit] = _critical()
    yield Comparison("critical friction coefficient", "", limit, 1.0, "paper", absolute=1e-9)
    met = (_MEETS[0], _MEETS[0], _MEETS[1], _MEETS[1])
    yield from numbered("mu = 1: frequency {}", _frequencies(1.0), met, "rad/s", "theory", absolute=1e-6)
    for mu, printed in _BELOW.items():
        what = f"mu = {mu:g}: frequency {{}}"
        yield from numbered(what, _frequencies(mu), printed, "rad/s", "reference", absolute=1e-8)
    for mu, (fast, slow) in _ABOVE.items():
        rates = sorted(mode.growth for mode in _four_dof_modes(mu))
        what = f"mu = {mu:g}: growth rate"
        yield from numbered(what, rates, (-fast, -slow, slow, fast), "1/s", "reference", absolute=1e-8)
    [turned] = _critical(spring_3__angle=0.25 * math.pi, drive__speed=-0.3)
    yield Comparison("both couplings with the other sign: critical", "", turned, 1.0, "theory", absolute=1e-9)
    for what, changes in (
        ("only spring 3 with the other sign", {"spring_3__angle": 0.25 * math.pi}),
        ("only friction with the other sign", {"drive__speed": -0.3}),
    ):
        yield Comparison(f"{what}: critical values up to 3", "", float(len(_critical(**changes))), 0.0, "reference")
    [damped] = _critical(spring_1__damping=0.2)
    yield Comparison("one damper, beside spring 1: critical", "", damped, 0.5, "theory", absolute=1e-9)


def histories(figure: Figure) -> Compared:
    """Draw the model of figure 5 in time: growth from near sliding, then lift-off and stick."""
    growing, along, across = figure.subplots(3, 1)
    near = quiet(load("four_dof", friction__mu=1.5, start__displacement=0.008, start__height=-0.008 * (1.0 - 1e-5),
                      start__body_1_displacement=0.004, start__body_3_height=-0.004))  # fmt: skip
    ran, rate = rig.simulate(near, _GROWS[1]), rig.modes(near).sliding.growth
    v = np.abs(ran.signals["velocity"])
    top = tops(v)
    top = top[ran.time[top] > _GROWS[0]]
    slope, height = np.polyfit(ran.time[top], np.log(v[top]), 1)
    growing.semilogy(ran.time, v, color=BLUE, lw=0.8)
    growing.semilogy(
        ran.time, np.exp(height + slope * ran.time), color=VERMILION, ls="--", label=f"fitted: {slope:.4f} 1/s"
    )
    growing.set(
        title="mu = 1.5, from 1e-5 off sliding", ylabel="|velocity| [m/s]", xlabel="time [s]", ylim=(1e-7, None)
    )
    growing.legend(loc="lower right")
    yield Comparison("mu = 1.5: growth rate, simulated", "1/s", float(slope), rate, "theory", relative=0.02)

    ran = rig.simulate(quiet(load("four_dof")), 30.0)
    times_of = {what: [e["t_ns"] * 1e-9 for e in ran.events if e["text"] == what] for what in
            ("load opens", "contact slip ends")}  # fmt: skip
    for axis, name, title in ((along, "displacement", "along the belt"), (across, "height", "away from the belt")):
        axis.plot(ran.time, 1e3 * ran.signals[name], color=BLUE, lw=0.8)
        for (what, times), colour in zip(times_of.items(), (VERMILION, AMBER)):
            axis.axvline(times[0], color=colour, ls="--", lw=1.0, label=f"first: {what}")
        axis.set(title=f"body 2 {title}, mu = 1.1", ylabel=f"{name} [mm]", xlim=(0.0, 30.0))
    across.axhline(0.0, color=GREY, lw=0.7)
    across.set_xlabel("time [s]")
    along.legend(loc="upper left")
    yield Comparison("mu = 1.1: first lift-off", "s", times_of["load opens"][0], _LIFTS, "reference", absolute=1e-6)


_FREE = {230e9: (6114.0, 8613.6, 11623.4), 200e9: (5701.3, 8032.2, 10838.9)}  # Hz, with 16 x 14 x 2 elements
_PRINTED = (5700.0, 8000.0, 10800.0)
_ON_FOAM = (5357.0, 5470.0, 5922.0)
_CASES = {  # position of the slider: frequencies at mu = 0 and mu = 1 below 12 kHz [Hz]
    "case 1, start": (0.0, (9455.0, 9478.0, 10601.0), (9841.0, 10012.0, 10947.0)),
    "case 2, middle": (0.02185, (9491.0, 9535.0, 10697.0), (9623.0, 10073.0, 10916.0)),
    "case 3, end": (0.0437, (9455.0, 9477.0, 10601.0), (8355.0, 9739.0, 10855.0, 11277.0)),
}
_FINER: dict[str, Any] = {"plate__elements_along": 14, "plate__elements_across": 12}  # the scenes have 10 x 8
_AUDIBLE = 12e3  # Hz, upper limit of the paper


def _model(scene: Scene) -> Reduced:
    """The plate's modes."""
    assert isinstance(scene.parameters, Parameters)
    return scene.parameters.reduced()


def modal(figure: Figure) -> Compared:
    """Draw the first three modes of the free plate, and the spectrum of a knock."""
    scene = load("plate_free")
    model = _model(scene)
    first = np.flatnonzero(model.frequencies > 1.0)[:3]
    grid = figure.add_gridspec(2, 3, height_ratios=(1.0, 1.0))
    shapes = []
    for column, (mode, printed) in enumerate(zip(first, _PRINTED)):
        axis = figure.add_subplot(grid[0, column])
        shape = model.surface.shapes[mode, 2]
        top = float(np.abs(shape).max())
        mesh = axis.pcolormesh(1e3 * model.surface.x, 1e3 * model.surface.y, shape / top, cmap="RdBu", vmin=-1.0,
                               vmax=1.0, shading="gouraud")  # fmt: skip
        shapes.append(axis)
        axis.set(title=f"{1e-3 * model.frequencies[mode]:.2f} kHz (paper {1e-3 * printed:.1f})", aspect="equal",
                 xlabel="length x [mm]")  # fmt: skip
        if not column:
            axis.set_ylabel("width y [mm]")
    figure.colorbar(mesh, ax=shapes, label="shape over its largest [1]", pad=0.01)
    made = rig.simulate(scene)
    rung = made.signals["plate_acceleration"]
    density = np.abs(np.fft.rfft(np.hanning(len(rung)) * rung))
    hertz = np.fft.rfftfreq(len(rung), made.time[1] - made.time[0])
    axis = figure.add_subplot(grid[1, :])
    axis.semilogy(1e-3 * hertz, density / density.max(), color=BLUE, lw=0.9)
    for printed in _PRINTED:
        axis.axvline(1e-3 * printed, color=VERMILION, ls="--", lw=1.0)
    axis.set(title="acceleration of a corner after a knock; dashed: the paper", xlabel="frequency [kHz]",
             ylabel="acceleration over\nits largest [1]", xlim=(0.0, 15.0), ylim=(1e-6, 2.0))  # fmt: skip
    own = model.frequencies[first].tolist()
    for young, expected in _FREE.items():
        what = f"free plate, {1e-9 * young:g} GPa: mode {{}}"
        yield from numbered(what, _elastic(plate__young=young), expected, "Hz", "reference", relative=3e-3)
    yield from numbered("free plate, 200 GPa: mode {}", own, _PRINTED, "Hz", "paper", relative=5e-3)
    finer = "free plate, 200 GPa, finer elements: mode {}"
    yield from numbered(finer, _elastic(**_FINER), (math.nan,) * 3, "Hz", "paper")
    near = [np.abs(hertz - frequency) < 100.0 for frequency in own]
    lines = [float(hertz[rows][np.argmax(density[rows])]) for rows in near]
    yield from numbered("knocked: line {}", lines, own, "Hz", "theory", absolute=4.0)
    on_foam = _model(load("plate")).frequencies
    yield from numbered("on foam: mode {}", on_foam, _ON_FOAM, "Hz", "reference", relative=3e-3)


def _elastic(**changes: Any) -> Reals:
    """Frequencies of the free plate without those of its rigid motions [Hz]."""
    frequencies = _model(load("plate_free", **changes)).frequencies
    return frequencies[frequencies > 1.0]


def _audible(mu: float, position: float, **changes: Any) -> list[Any]:
    """Modes below 12 kHz of the undamped plate under a bonded slider, by frequency."""
    scene = load("plate_cea", plate__damping_ratio=0.0, friction__mu=mu, slider__position=position, **changes)
    return sorted((m for m in rig.modes(scene).sliding.modes if m.frequency < _AUDIBLE), key=lambda m: m.frequency)


def eigenvalues(figure: Figure) -> Compared:
    """Frequencies below 12 kHz over friction, with the slider at three positions, as in figure 8 and tables 2 to 4."""
    values = np.linspace(0.0, 1.0, 6)
    grows = 0.0
    for axis, (title, (position, still, sliding)) in zip(figure.subplots(1, 3, sharey=True), _CASES.items()):
        modes = [_audible(float(mu), position) for mu in values]
        count = min(map(len, modes))
        axis.plot(values, [[1e-3 * m.frequency for m in row[:count]] for row in modes], color=BLUE)
        for mu, printed in ((0.0, still), (1.0, sliding)):
            axis.plot([mu] * len(printed), 1e-3 * np.array(printed), "x", color=VERMILION)
        axis.set(title=title, xlabel="friction coefficient", ylim=(8.0, 12.0))
        grows = max([grows, *(m.growth for row in modes for m in row)])
        at_rest = [mode.frequency for mode in modes[0]]
        yield from numbered(f"{title}, mu = 0: mode {{}}", at_rest, still, "Hz", "paper", relative=0.015)
        shifts = [after.frequency - before for before, after in zip(at_rest, modes[-1])]
        printed_shifts = [after - before for before, after in zip(still, sliding)]
        what = f"{title}: shift of mode {{}} up to mu = 1"
        yield from numbered(what, shifts, printed_shifts, "Hz", "paper", relative=0.25, missed=True)
        if axis.get_subplotspec().is_first_col():
            axis.set_ylabel("frequency [kHz]")
    axis.plot([], [], color=BLUE, label="ours")
    axis.plot([], [], "x", color=VERMILION, label="paper")
    axis.legend(loc="lower left")
    for title, number in (("case 1, start", 2), ("case 3, end", 1)):
        for how, finer in (("80 modes", {"plate__modes": 80}), ("finer elements", _FINER)):
            before, after = (_audible(mu, _CASES[title][0], **finer)[number - 1].frequency for mu in (0.0, 1.0))
            what = f"{title}: shift of mode {number} up to mu = 1, {how}"
            yield Comparison(what, "Hz", after - before, math.nan, "paper")
    yield Comparison("largest growth rate below 12 kHz, mu up to 1", "1/s", grows, 0.0, "paper", absolute=1e-2)


def ramps(figure: Figure) -> Compared:
    """Draw pressure and speed over time, as in figure 9, and the response of the slider."""
    made = rig.simulate(load("plate"), 0.3)
    pressing, moving, way = figure.subplots(3, 1, sharex=True)
    area = 0.043 * 0.0253
    pressing.plot(made.time, 1e-6 * made.signals["normal_force"] / area, color=BLUE, lw=0.8)
    pressing.set(ylabel="mean pressure [MPa]", title="pressure from 0 to 0.1 s, speed from 0.1 to 0.2 s")
    moving.plot(made.time, 1e3 * made.signals["surface_speed"], color=GREEN)
    moving.set_ylabel("speed [mm/s]")
    way.plot(made.time, 1e3 * made.signals["position"], color=AMBER)
    way.set(ylabel="distance [mm]", xlabel="time [s]")
    for axis in (pressing, moving, way):
        for time in (0.1, 0.2):
            axis.axvline(time, color=GREY, lw=0.7, ls="--")

    def at(name: str, time: float) -> float:
        return float(np.interp(time, made.time, made.signals[name]))

    force = made.signals["normal_force"][(made.time > 0.1) & (made.time < 0.2)]
    mean = 1e-6 * float(force.mean()) / area
    yield Comparison("mean pressure from 0.1 s on", "MPa", mean, 0.1, "paper", relative=1e-3)
    yield Comparison("speed at 0.15 s", "m/s", at("surface_speed", 0.15), 0.005, "paper", relative=1e-9)
    yield Comparison("speed at 0.3 s", "m/s", at("surface_speed", 0.3), 0.01, "paper", relative=1e-9)
    yield Comparison("travel at 0.1 s", "m", at("position", 0.1), 0.0, "theory", absolute=1e-12)
    yield Comparison("travel at 0.2 s", "m", at("position", 0.2), 5e-4, "theory", relative=1e-6)


_LEVER = 0.0126 + 0.001  # m, height of the slider's upper face above the plate
_OFFSET = 0.3 * _LEVER  # m, of the pressure centre in steady sliding
_ONSET = 0.547  # s, extrapolated to step zero
_HEAVE = 9260.0  # Hz: the strongest line of the normal acceleration below 12 kHz
_RATE = 80e3  # Hz: the flutter at 49.9 kHz keeps its amplitude at this rate; at 100 kHz it would beat
_WINDOW = 4096  # samples
_TOP = 15e3  # Hz
_LINES = {11: (5.3, 5.5, 8.7), 13: (5.5, 8.7, 11.0), 14: (4.4, 4.6, 7.3, 7.5, 8.4, 8.8)}  # kHz


def _onset(made: Run) -> float:
    """Time of the first opening [s]; NaN if none opens."""
    opened = np.flatnonzero(made.signals["openings"] > 0.0)
    return float(made.time[opened[0]]) if len(opened) else float("nan")


def _density(made: Run, values: Reals, begin: float) -> tuple[Reals, Reals]:
    """Frequencies [Hz] and power spectral density from `begin` [s] on, mean of Hann windows that overlap by half."""
    hertz, density = welch(values[made.time >= begin], 1.0 / float(made.time[1] - made.time[0]), np.hanning(_WINDOW))
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
    made = rig.simulate(load("plate"), 1.2)
    history, lines = figure.subplots(2, 1)
    acceleration, onset = made.signals["slider_acceleration"], _onset(made)
    history.plot(made.time, acceleration, color=BLUE, lw=0.3)
    history.set(title="figure 10: normal acceleration of the slider, 10 mm/s, 0.1 MPa; dashed: first opening",
                ylabel="acceleration\n[m/s^2]", xlabel="time [s]", xlim=(0.0, 1.0))  # fmt: skip
    history.axvline(onset, color=VERMILION, lw=0.9, ls="--")
    hertz, density = _density(made, acceleration, onset)
    title = "figure 11: its spectrum from the first opening on; dashed: lines that the paper names [kHz]"
    _spectrum(lines, hertz, density, _LINES[11], title)
    lines.set_xlabel("frequency [kHz]")
    before = float(np.abs(acceleration[(made.time > 0.3) & (made.time < onset - 0.05)]).max())
    after = float(acceleration[made.time > onset + 0.05].std())
    closed = made.signals["contact_fraction"][made.time > onset]
    yield Comparison("first opening", "s", onset, _ONSET, "reference", absolute=0.05)
    yield Comparison("RMS after it over the largest before it: it grows", "", after / before, 1.0, "paper", floor=True)
    yield Comparison("largest share of open points", "", 1.0 - float(closed.min()), 0.5, "reference", floor=True)
    near = (hertz >= 8000.0) & (hertz <= 12000.0)
    line = float(hertz[near][np.argmax(density[near])])
    yield Comparison("strongest line from 8 to 12 kHz", "Hz", line, _HEAVE, "reference", relative=0.02)


def _pressures(made: Run, along: int, across: int) -> Reals:
    """Pressure [MPa] at every sample, point along and point across."""
    names = [f"pressure_{i}_{j}" for i in range(1, along + 1) for j in range(1, across + 1)]
    return np.stack([1e-6 * made.signals[name] for name in names], axis=1).reshape(-1, along, across)


def maps(figure: Figure) -> Compared:
    """Draw the pressure in the contact at instants before and after its first opening, as in figure 12."""
    scene = load("plate_96")
    made = rig.simulate(scene, 0.8)
    onset, pressure = _onset(made), _pressures(made, 12, 8)
    centre = made.signals["pressure_centre_x"]
    free = np.flatnonzero((made.time > onset + 0.05) & (made.signals["normal_force"] > 30.0))
    rear, front = (int(free[pick(centre[free])]) for pick in (np.argmin, np.argmax))
    opened = int(free[np.argmin(made.signals["contact_fraction"][free])])
    half = pressure[free]
    both = int(free[np.argmax((half[:, :2].mean(axis=(1, 2)) * half[:, -2:].mean(axis=(1, 2))) /
                                (half.mean(axis=(1, 2)) ** 2 + 0.05**2))])  # fmt: skip
    early = [int(np.searchsorted(made.time, t)) for t in (0.15, 0.3, onset - 0.02, onset)]
    titles = ("0.15 s: the ramp", "0.3 s: sliding", "20 ms before", "first opening", "centre at the rear",
              "centre at the front", "most points open", "load on both edges")  # fmt: skip
    grid = figure.add_gridspec(3, 4, height_ratios=(1.0, 1.0, 1.1))
    shown = [*early, rear, front, opened, both]
    points = Points.of(scene)
    assert points is not None
    for k, (i, title) in enumerate(zip(shown, titles)):
        axis = figure.add_subplot(grid[k // 4, k % 4])
        draw_map(axis, points.surfaces, [1e6 * pressure[i]], points.scale)
        axis.set_title(f"{title}\n{made.time[i]:.4f} s", fontsize=9)
        axis.tick_params(labelsize=8)
        axis.set_xlabel("along [mm]" if k >= 4 else "", fontsize=8)
        axis.set_ylabel("across [mm]" if k % 4 == 0 else "", fontsize=8)
    draw_scale(axis, points.scale, float(1e6 * pressure[shown].max()) > points.scale, ax=figure.axes, fraction=0.03)
    axis = figure.add_subplot(grid[2, :])
    axis.plot(made.time, 1e3 * centre, color=BLUE, lw=0.4)
    axis.axhline(1e3 * _OFFSET, color=VERMILION, ls="--", lw=0.9, label="mu h: 4.08 mm")
    axis.set(ylabel="pressure centre [mm]", xlabel="time [s]", xlim=(0.05, 0.8), ylim=(-22.0, 22.0))
    axis.legend(loc="upper left")
    quiet = (made.time > 0.25) & (made.time < 0.45)
    yield Comparison("pressure centre in sliding", "mm", 1e3 * float(centre[quiet].mean()), 1e3 * _OFFSET, "theory",
                     absolute=0.02)  # fmt: skip
    uneven = np.abs(pressure - pressure[:, :, ::-1])[made.time < onset].max()
    yield Comparison("largest difference from side to side before", "MPa", float(uneven), 0.0, "paper", absolute=1e-9)
    for what, i, sign in (("foremost", front, 1.0), ("rearmost", rear, -1.0)):
        yield Comparison(f"pressure centre, {what}: of the half length", "", sign * float(centre[i]) / 0.0215, 0.5,
                         "reference", floor=True)  # fmt: skip


def tangential(figure: Figure) -> Compared:
    """Spectra of the tangential acceleration of examples 2 and 3: figures 13 and 14."""
    axes = figure.subplots(2, 1, sharex=True)
    onsets = []
    for axis, number, scene, title in zip(axes, (13, 14), ("plate_example_2", "plate_example_3"),
                                          ("3 mm/s, 0.1 MPa", "3 mm/s, 0.3 MPa")):  # fmt: skip
        made = rig.simulate(load(scene), 1.2)
        onsets.append(_onset(made))
        hertz, density = _density(made, _LEVER * made.signals["pitch_acceleration"], onsets[-1])
        _spectrum(axis, hertz, density, _LINES[number], f"figure {number}: {title}; dashed: the paper [kHz]")
        closed = made.signals["contact_fraction"][made.time > onsets[-1]]
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
        scene, ends = load("plate", **held), {Load: {"force": force}, Ramp: {"to": speed}}
        protocol = tuple(step.model_copy(update=ends.get(type(step))) for step in scene.protocol)  # type: ignore[call-overload]
        made = rig.simulate(replace(scene, protocol=protocol), 0.4)
        share = made.signals["pitch_velocity"] / force
        runs[title] = made.time, share, _onset(made)
        style = "--" if colour == VERMILION else "-"
        axis.plot(made.time, share, color=colour, lw=0.6, ls=style, label=f"{title}: opens at {runs[title][2]:.4f} s")
    for axis in (upper, lower):
        low, high = axis.get_ylim()
        axis.set(ylabel="pitch velocity\nover the load [rad/(N s)]", xlim=(0.1, 0.4), ylim=(low, 1.5 * high))
        axis.legend(loc="upper left", ncols=2)
        axis.axhline(0.0, color=GREY, lw=0.5)
    upper.set_title("slider held at 4 mm")
    lower.set_xlabel("time [s]")
    (time, slow, onset), (_, three, later) = runs["10 mm/s, 0.1 MPa"], runs["30 mm/s, 0.3 MPa"]
    before = time < onset
    error = float(np.abs(slow - three)[before].max() / np.abs(slow[before]).max())
    yield Comparison("same speed over pressure: difference before the opening", "", error, 0.0, "theory", absolute=1e-4)
    yield Comparison("same speed over pressure: first opening", "s", later, onset, "theory", absolute=1e-4)


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


def _sliding(position: float, **changes: Any) -> tuple[float, Any]:
    """Least pressure [kPa] and eigenvalues [1/s] with positive frequency of steady sliding in scene plate_converged."""
    _, at = at_rest(load("plate_converged", slider__position=position, **changes))
    forces = at.modes.normal @ at.x + at.modes.normal_t @ at.T
    rates = at.eigenvalues()
    return 1e-3 * float(forces.min()) * len(forces) / _AREA, rates[rates.imag > 0.0]


def resolution(figure: Figure) -> Compared:
    """Draw the flutter that opens the film over resolutions, and the damping ratios below which modes flutter."""
    growing, critical = figure.subplots(1, 2)
    places = np.linspace(1.25e-3, 6.25e-3, 21)
    found: dict[str, dict[str, float]] = {}
    for name, (coarser, changes) in _RESOLUTIONS.items():
        own: dict[str, float] = {}
        if "clock__rk4_step" not in changes:
            pressures, rates = zip(*(_sliding(place, **changes) for place in places.tolist()))
            growth = np.array(
                [r.real[np.abs(r.imag / math.pi - sum(_FLUTTER)) < np.ptp(_FLUTTER)].max() for r in rates]
            )
            growing.plot(1e3 * places, growth, label=name, ls="-" if "modes" in name else "--")
            turns = np.flatnonzero(np.diff(np.sign(growth)))
            zeros = places[turns] - growth[turns] * np.diff(places)[turns] / np.diff(growth)[turns]
            own |= {
                "least pressure at 3.5 mm [kPa]": pressures[9],
                "largest growth rate [1/s]": float(growth.max()),
                "flutter begins [mm]": 1e3 * float(zeros[0]),
                "flutter ends [mm]": 1e3 * float(zeros[-1]),
            }
        if coarser in ("80 modes", "120 modes"):
            own["first opening [s]"] = _onset(rig.simulate(load("plate_converged", **changes), 0.45))
        for what, ours in own.items():
            title, unit = what[:-1].split(" [")
            before = found.get(coarser, {}).get(what, math.nan)
            missed = (name, title) in _MOVES
            yield Comparison(f"{name}: {title}", unit, ours, before, "coarser", relative=0.05, missed=missed)
        found[name] = own
    growing.axhline(0.0, color=GREY, lw=0.7)
    growing.set(
        title="growth at 40 kHz", xlabel="position of the slider [mm]", ylabel="growth rate [1/s]", ylim=(-600.0, None)
    )
    growing.legend(fontsize=8)
    yield from _critical_ratios(critical)


def _critical_ratios(axis: Any) -> Compared:
    """Draw the damping ratio below which each mode flutters, at 23 positions along the travel."""
    bands = dict[tuple[int, int], float]()
    for name, colour in (("120 modes", BLUE), ("160 modes", VERMILION)):
        bare = {"plate__damping": [[0.0, 0.0], [1e5, 0.0]], **_RESOLUTIONS[name][1]}
        rates = np.concatenate([_sliding(place, **bare)[1] for place in np.linspace(0.0, 0.0437, 23).tolist()])
        khz, ratio = 5e-4 / math.pi * rates.imag, rates.real / rates.imag
        axis.plot(khz[ratio > 1e-5], ratio[ratio > 1e-5], "o", color=colour, markersize=3, label=f"undamped, {name}")
        for low, high in pairwise((0, 25, 30, 44, 60, 70, 80)):
            worst, before = float(ratio[(khz > low) & (khz < high)].max()), bands.get((low, high), math.nan)
            bands[low, high] = worst
            what, missed = f"{low} to {high} kHz", (name, f"{low} to {high} kHz") in _MOVES
            what = f"{name}, {what}: critical damping ratio"
            yield Comparison(what, "", worst, before, "coarser", relative=0.05, absolute=1e-6, missed=missed)
    scene = load("plate_converged").parameters
    assert isinstance(scene, Parameters)
    hertz, ratio = np.array(scene.plate.damping).T
    axis.plot(1e-3 * hertz, ratio, color=GREY, label="of the scene")
    axis.set(title="damping ratio below which a mode flutters", xlabel="frequency [kHz]", ylabel="ratio [1]",
             xlim=(0.0, 80.0), ylim=(0.0, 0.012))  # fmt: skip
    axis.legend(loc="upper left", fontsize=8)


ENTRIES = (
    Entry(
        "detachment-5",
        "detachment",
        "Figure 5",
        "the model with four degrees of freedom, in time",
        ("four_dof",),
        histories,
        "The paper shows the model, but no motion. Belt speed, preload and start are chosen. In the text mass 1 is "
        "preloaded and slides on the belt; in the matrices it is mass 2, as in this rig.",
        (9.6, 8.0),
    ),
    Entry(
        "detachment-6",
        "detachment",
        "Figure 6",
        "eigenvalues over the friction coefficient",
        ("four_dof",),
        four_dof_eigenvalues,
        "The paper prints curves and one number, the coalescence at 1. The comparisons with other signs and with a "
        "damper are ours: the rig flutters only if friction couples against spring 3, and one damper halves the "
        "limit.",
    ),
    Entry(
        "detachment-7",
        "detachment",
        "Table 1 and Figure 7",
        "modes of the plate, free and on foam",
        ("plate_free", "plate"),
        modal,
        "With the modulus of table 1, 230 GPa, the frequencies of the free plate are 7 % above those in the paper; "
        "with 200 GPa they agree. The paper does not state the sizes of foam and film: the frequencies on foam are "
        "calibrated.",
        (9.6, 6.2),
    ),
    Entry(
        "detachment-8",
        "detachment",
        "Figure 8 and Tables 2 to 4",
        "complex eigenvalues with the slider at three positions",
        ("plate_cea",),
        eigenvalues,
        "The largest shift by friction has the direction of the paper, up at the start and down at the end, but is 4 "
        "and 10 times smaller. The other shifts are far smaller, and at the end of the other sign. No mode below "
        "12 kHz flutters, as in the paper. Above 12 kHz, beyond the range of the "
        "paper, modes do flutter (with 40 modes from a friction coefficient of 0.26 at the start); it opens the "
        "contact "
        "in the time simulation. The fourth mode of table 4 is not reproduced. According to the paper the foam's "
        "base moves along x; its frequencies are those of a fixed base, which is computed here.",
        (9.6, 4.8),
    ),
    Entry(
        "detachment-9",
        "detachment",
        "Figure 9",
        "ramps of pressure and speed",
        ("plate",),
        ramps,
        "The paper imposes the speed at the base of the foam; here the slider moves. The inertia force of the ramp, "
        "0.065 N, is neglected.",
        (9.6, 5.4),
    ),
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
