"""A new mechanism for friction-induced vibration and noise, section 3.2: the plate's modes, eigenvalues, ramps.

"paper" is what the paper prints, "reference" an independent computation with other elements. The paper prints neither
the size of the foam nor the thickness of the film; both are calibrated, so that frequencies on foam are a fit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rig
from rig.papers.entry import Compared, Comparison, Entry, load, numbered
from rig.plants.plate import Parameters
from rig.plants.structures.plate_model import Reduced
from rig.record.run import Reals
from rig.scenes.scene import Scene
from rig.view.palette import AMBER, BLUE, GREEN, GREY, VERMILION

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
        x = 1e3 * model.surface.x
        y = 1e3 * model.surface.y
        mesh = axis.pcolormesh(x, y, shape / top, cmap="RdBu", vmin=-1.0, vmax=1.0, shading="gouraud")
        shapes.append(axis)
        title = f"{1e-3 * model.frequencies[mode]:.2f} kHz (paper {1e-3 * printed:.1f})"
        axis.set(title=title, aspect="equal", xlabel="length x [mm]")
        if not column:
            axis.set_ylabel("width y [mm]")
    figure.colorbar(mesh, ax=shapes, label="shape over its largest [1]", pad=0.01)
    ran = rig.simulate(scene)
    rung = ran.signals["plate_acceleration"]
    density = np.abs(np.fft.rfft(np.hanning(len(rung)) * rung))
    hertz = np.fft.rfftfreq(len(rung), ran.time[1] - ran.time[0])
    axis = figure.add_subplot(grid[1, :])
    axis.semilogy(1e-3 * hertz, density / density.max(), color=BLUE, lw=0.9)
    for printed in _PRINTED:
        axis.axvline(1e-3 * printed, color=VERMILION, ls="--", lw=1.0)
    axis.set(
        title="acceleration of a corner after a knock; dashed: the paper",
        xlabel="frequency [kHz]",
        ylabel="acceleration over\nits largest [1]",
        xlim=(0.0, 15.0),
        ylim=(1e-6, 2.0),
    )
    ours = model.frequencies[first].tolist()
    for young, expected in _FREE.items():
        what = f"free plate, {1e-9 * young:g} GPa: mode {{}}"
        yield from numbered(what, _elastic(plate__young=young), expected, "Hz", "reference", relative=3e-3)
    yield from numbered("free plate, 200 GPa: mode {}", ours, _PRINTED, "Hz", "paper", relative=5e-3)
    finer = "free plate, 200 GPa, finer elements: mode {}"
    yield from numbered(finer, _elastic(**_FINER), (math.nan,) * 3, "Hz", "paper")
    near = [np.abs(hertz - frequency) < 100.0 for frequency in ours]
    lines = [float(hertz[rows][np.argmax(density[rows])]) for rows in near]
    yield from numbered("knocked: line {}", lines, ours, "Hz", "theory", absolute=4.0)
    on_foam = _model(load("plate")).frequencies
    yield from numbered("on foam: mode {}", on_foam, _ON_FOAM, "Hz", "reference", relative=3e-3)


def _elastic(**changes: Any) -> Reals:
    """Frequencies of the free plate without those of its rigid motions [Hz]."""
    frequencies = _model(load("plate_free", **changes)).frequencies
    return frequencies[frequencies > 1.0]


def _audible(mu: float, position: float, **changes: Any) -> list[Any]:
    """Modes below 12 kHz of the undamped plate under a bonded slider, by frequency."""
    scene = load("plate_cea", plate__damping_ratio=0.0, friction__mu=mu, slider__position=position, **changes)
    modes = [mode for mode in rig.modes(scene).sliding.modes if mode.frequency < _AUDIBLE]
    return sorted(modes, key=lambda mode: mode.frequency)


def _khz(modes: list[Any]) -> list[float]:
    """Frequencies of modes [kHz]."""
    return [1e-3 * mode.frequency for mode in modes]


def eigenvalues(figure: Figure) -> Compared:
    """Frequencies below 12 kHz over friction, with the slider at three positions, as in figure 8 and tables 2 to 4."""
    values = np.linspace(0.0, 1.0, 6)
    grows = 0.0
    for axis, (title, (position, still, sliding)) in zip(figure.subplots(1, 3, sharey=True), _CASES.items()):
        modes = [_audible(float(mu), position) for mu in values]
        count = min(map(len, modes))
        axis.plot(values, [_khz(row[:count]) for row in modes], color=BLUE)
        for mu, printed in ((0.0, still), (1.0, sliding)):
            axis.plot([mu] * len(printed), 1e-3 * np.array(printed), "x", color=VERMILION)
        axis.set(title=title, xlabel="friction coefficient", ylim=(8.0, 12.0))
        growth_rates = [mode.growth for row in modes for mode in row]
        grows = max([grows, *growth_rates])
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
        position = _CASES[title][0]
        for how, finer in (("80 modes", {"plate__modes": 80}), ("finer elements", _FINER)):
            before = _audible(0.0, position, **finer)[number - 1].frequency
            after = _audible(1.0, position, **finer)[number - 1].frequency
            what = f"{title}: shift of mode {number} up to mu = 1, {how}"
            yield Comparison(what, "Hz", after - before, math.nan, "paper")
    yield Comparison("largest growth rate below 12 kHz, mu up to 1", "1/s", grows, 0.0, "paper", absolute=1e-2)


def ramps(figure: Figure) -> Compared:
    """Draw pressure and speed over time, as in figure 9, and the response of the slider."""
    ran = rig.simulate(load("plate"), 0.3)
    pressing, moving, way = figure.subplots(3, 1, sharex=True)
    area = 0.043 * 0.0253
    pressing.plot(ran.time, 1e-6 * ran.signals["normal_force"] / area, color=BLUE, lw=0.8)
    pressing.set(ylabel="mean pressure [MPa]", title="pressure from 0 to 0.1 s, speed from 0.1 to 0.2 s")
    moving.plot(ran.time, 1e3 * ran.signals["surface_speed"], color=GREEN)
    moving.set_ylabel("speed [mm/s]")
    way.plot(ran.time, 1e3 * ran.signals["position"], color=AMBER)
    way.set(ylabel="distance [mm]", xlabel="time [s]")
    for axis in (pressing, moving, way):
        for time in (0.1, 0.2):
            axis.axvline(time, color=GREY, lw=0.7, ls="--")

    def at(name: str, time: float) -> float:
        return float(np.interp(time, ran.time, ran.signals[name]))

    force = ran.signals["normal_force"][(ran.time > 0.1) & (ran.time < 0.2)]
    mean = 1e-6 * float(force.mean()) / area
    yield Comparison("mean pressure from 0.1 s on", "MPa", mean, 0.1, "paper", relative=1e-3)
    yield Comparison("speed at 0.15 s", "m/s", at("surface_speed", 0.15), 0.005, "paper", relative=1e-9)
    yield Comparison("speed at 0.3 s", "m/s", at("surface_speed", 0.3), 0.01, "paper", relative=1e-9)
    yield Comparison("travel at 0.1 s", "m", at("position", 0.1), 0.0, "theory", absolute=1e-12)
    yield Comparison("travel at 0.2 s", "m", at("position", 0.2), 5e-4, "theory", relative=1e-6)


ENTRIES = (
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
)
