"""Tonazzi and others (2020), sections 4 and 5: the coated beam on its disc; load and angle; a knock."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.recorded.hysteresis import hysteresis
from rig.analysis.three_stages import stages
from rig.analysis.upper_speed import upper_speed
from rig.papers.bistable import MM, diagram
from rig.papers.common import load, run
from rig.papers.entry import Comparison, Entry
from rig.view.palette import BLUE, GREEN, GREY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rig.record.run import Run

WINDOW = 0.2  # s, as in the paper
LOADS, ANGLES = (50.0, 40.0, 30.0, 20.0), (5.0, 10.0, 15.0, 20.0)
TABLE_3: dict[float, tuple[tuple[float, float], ...]] = {  # N -> upper and lower speed [mm/s] at each angle
    50.0: ((13.0, 7.5), (10.5, 6.5), (7.5, 6.0), (0.0, 0.0)),
    40.0: ((10.0, 6.5), (5.0, 2.0), (3.0, 1.5), (0.0, 0.0)),
    30.0: ((7.5, 4.5), (2.0, 0.5), (0.0, 0.0), (0.0, 0.0)),
    20.0: ((3.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
}


def _spectrogram(made: Run, axis: Axes, length: int, top: float) -> None:
    """Power of the acceleration over time and frequency."""
    with np.errstate(divide="ignore"):  # a stuck tip does not accelerate
        power, _, _, image = axis.specgram(
            made.signals["acceleration"], NFFT=length, Fs=1e9 / made.step_ns, noverlap=length // 2, cmap="magma"
        )
    high = 10.0 * math.log10(float(power.max()))
    image.set_clim(high - 90.0, high)
    axis.figure.colorbar(image, ax=axis, label="level [dB re 1 (m/s²)²/Hz]", pad=0.01)
    axis.set(xlabel="time [s]", ylabel="frequency [Hz]", ylim=(0.0, top))


def measured(figure: Figure) -> Iterator[Comparison]:
    """Run-up and run-down of the experiment: protocol, acceleration, spectrogram, RMS over the speed."""
    made = run(load("tip_epoxy"))
    panels = figure.subplot_mosaic([["time", "time"], ["speed", "lines"]])
    over_time, over_speed, lines = panels["time"], panels["speed"], panels["lines"]
    over_time.plot(made.time[::5], made.signals["acceleration"][::5], color=BLUE, lw=0.4)
    over_time.set(xlabel="time [s]", ylabel="acceleration [m/s²]")
    diagram(made, over_speed, WINDOW)
    over_speed.set_xlim(0.0, 20.0)
    _spectrogram(made, lines, 2048, 2000.0)
    speed = made.signals["surface_speed"]
    for t, expected in ((20.0, 44.0), (40.0, 44.0), (60.0, 0.0)):
        ours = MM * float(np.interp(t, made.time, speed))
        yield Comparison(f"speed of the disc at {t:g} s", "mm/s", ours, expected, "paper", absolute=1e-6)
    found = stages(made)
    assert found is not None
    yield Comparison("last stick at rising speed", "mm/s", MM * found.up, 13.0, "paper", absolute=0.25)
    yield Comparison("first stick at falling speed", "mm/s", MM * found.down, 5.68, "reference", absolute=0.3)
    import rig

    swept = rig.sweep(load("tip_epoxy", noise=None), "drive.speed", np.linspace(0.004, 0.012, 9))
    critical = [one.value for one in swept.critical]
    yield Comparison("sliding is unstable below", "mm/s", MM * critical[0], 7.5, "paper", absolute=0.02)
    [up] = [curve for curve in hysteresis(made, "acceleration", "surface_speed", WINDOW).curves if curve.branch.rises]
    ours = float(np.interp(9e-3, up.speed, up.rms))
    yield Comparison("RMS acceleration at rising speed, at 9 mm/s", "m/s²", ours, 10.196, "reference", relative=0.01)


def beam(figure: Figure) -> Iterator[Comparison]:
    """Draw the spectrogram of the run-up with the beam in several modes."""
    import rig

    made = run(load("tip_beam"))
    axis, near = figure.subplots(2, 1)
    _spectrogram(made, axis, 4096, 24000.0)
    axis.set_xlim(0.0, 3.0)
    part = (made.time > 1.2) & (made.time < 1.21)
    near.plot(MM * (made.time[part] - 1.2), made.signals["acceleration"][part], color=BLUE, lw=0.8)
    near.set(xlabel="time [ms], from 1.2 s", ylabel="acceleration [m/s²]")
    found = stages(made)
    assert found is not None
    yield Comparison("last stick at rising speed", "mm/s", MM * found.up, 13.0, "paper", absolute=0.4)
    more = stages(run(load("tip_beam", beam__modes=5, clock__frame=5e-6)))
    assert more is not None
    yield Comparison("last stick at rising speed, five modes", "mm/s", MM * more.up, math.nan, "paper")
    p = load("tip_beam").parameters.beam  # type: ignore[attr-defined]
    omega = p.reduced().omega / (2.0 * math.pi)
    stiff = p.modulus / (1.0 - p.poisson**2) * p.thickness**2 / 12.0
    for i, b in enumerate((1.8751041, 4.6940911, 7.8547574)):
        hertz = b**2 / (2.0 * math.pi * p.length**2) * math.sqrt(stiff / p.density)
        what = f"clamped beam, bending mode {i + 1}"
        yield Comparison(what, "Hz", float(omega[i]), hertz, "theory", relative=1e-4)
    slides = rig.modes(load("tip_beam", drive__speed=0.02)).sliding.equilibrium
    yield Comparison("force at the clamp over friction force", "", slides["clamp_force"] / slides["friction_force"],
                     1.0, "theory", relative=1e-9)  # fmt: skip


def _turned(degrees: float, eps: float) -> float:
    """Upper speed [m/s] of a beam at this angle; the compliance along its axis is `eps` of that in bending."""
    changes = {
        "tip__relief": 0.0,
        "tip__retardation": 1e-5,
        "inclination__angle": math.radians(degrees),
        "inclination__compliance": eps,
        "friction__mu_static": 0.3024,
        "friction__mu_kinetic": 0.3,
    }
    return upper_speed(load("tip", waviness=None, **changes).parameters)  # type: ignore[arg-type]


def parameters(figure: Figure) -> Iterator[Comparison]:
    """Upper speed over the angle of the beam, and both critical speeds over the load."""
    over_angle, over_load = figure.subplots(1, 2)
    over_angle.plot(ANGLES, [TABLE_3[50.0][i][0] / 13.0 for i in range(4)], "o", color=GREY, label="paper, 50 N")
    for eps, colour in ((0.002, BLUE), (0.0055, GREEN), (0.02, VERMILION)):
        ratios = [_turned(a, eps) / _turned(5.0, eps) for a in ANGLES]
        over_angle.plot(ANGLES, ratios, "-", color=colour, label=f"inclination, eps = {eps:g}")
        if eps == 0.0055:
            for a, ratio, (expected, bound) in zip(
                ANGLES[1:], ratios[1:], ((0.655, 0.075), (0.5, 0.07), (0.405, 0.065))
            ):
                what = f"{a:g} degrees: upper speed over that at 5"
                yield Comparison(what, "", ratio, expected, "reference", absolute=bound)
                stated = TABLE_3[50.0][ANGLES.index(a)][0] / TABLE_3[50.0][0][0]
                yield Comparison(f"{what}, 50 N", "", ratio, stated, "paper", absolute=0.05, missed=True)
    over_angle.set(xlabel="angle [degrees]", ylabel="upper speed over that at 5 degrees [1]", ylim=(0.0, 1.05))
    over_angle.legend()
    ours = [_critical(force) for force in LOADS]
    for which, (name, mark, colour) in enumerate((("upper", "s-", BLUE), ("lower", "v-", VERMILION))):
        printed = [TABLE_3[force][0][which] for force in LOADS]
        over_load.plot(LOADS, printed, mark[0], color=colour, mfc="none", markersize=8, label=f"{name}, paper")
        found = [one[which] for one in ours]
        over_load.plot(LOADS, found, mark, color=colour, markersize=4, label=f"{name}, tip_epoxy")
    over_load.set(xlabel="load [N]", ylabel="critical speed at 5 degrees [mm/s]", ylim=(0.0, None))
    over_load.legend()
    for force, (up, down) in zip(LOADS, ours):
        upper, lower = TABLE_3[force][0]
        close = 0.02 if force == 50.0 else 0.15
        yield Comparison(f"{force:g} N: upper speed", "mm/s", up, upper, "paper", close, missed=force < 40.0)
        yield Comparison(f"{force:g} N: lower speed", "mm/s", down, lower, "paper", relative=0.15, missed=force != 30.0)
        yield Comparison(f"{force:g} N: width of the bistable range", "mm/s", up - down, upper - lower, "paper",
                         relative=0.15, missed=force != 20.0)  # fmt: skip
    falls = sum(a > b for (a, _), (b, _) in pairwise(ours))
    yield Comparison("steps of the load that lower it, of 3", "", float(falls), 3.0, "paper")


def _critical(force: float) -> tuple[float, float]:
    """Speeds of the disc [mm/s] at the last stick while it rises and at the first one while it falls."""
    found = stages(run(load("tip_epoxy", load__force=force)))
    assert found is not None
    return MM * found.up, MM * found.down


def knocked(figure: Figure) -> Iterator[Comparison]:
    """Draw a knock at 9 mm/s, and the smallest knock that switches to stick-slip."""
    made = run(load("tip_knock"))
    axis, kicks = figure.subplots(2, 1)
    axis.plot(made.time, made.signals["acceleration"], color=BLUE, lw=0.4)
    axis.set(xlabel="time [s]", ylabel="acceleration [m/s²]")
    late = made.time > 7.0
    sticks = np.array([e["t_ns"] for e in made.plant_events if e["text"] == "contact slip ends"]) * 1e-9
    rms = float(np.std(made.signals["acceleration"][late]))
    hertz = float(1.0 / np.diff(sticks[sticks > 7.0]).mean())
    yield Comparison("RMS acceleration afterwards", "m/s²", rms, 10.196, "reference", relative=0.01)
    yield Comparison("frequency afterwards", "Hz", hertz, 249.70, "reference", absolute=0.05)
    quiet = float(np.std(made.signals["acceleration"][(made.time > 3.9) & (made.time < 4.0)]))
    yield Comparison("RMS acceleration before", "m/s²", quiet, 0.0, "reference", absolute=1e-3)
    printed = {8.0: 3.452, 9.0: 6.143, 10.0: 8.135, 11.0: 9.861, 12.0: 11.440}
    ours = {v: MM * _least(1e-3 * v) for v in printed}
    kicks.plot(list(printed), list(ours.values()), "o-", color=VERMILION)
    kicks.set(xlabel="speed of the disc [mm/s]", ylabel="least kick of the tip [mm/s]", ylim=(0.0, None))
    for v, expected in printed.items():
        yield Comparison(f"least kick at {v:g} mm/s", "mm/s", ours[v], expected, "reference", absolute=0.01)


def _least(speed: float) -> float:
    """Smallest velocity step [m/s] of the sliding tip that starts a persistent stick-slip, by bisection."""
    import rig
    from rig.papers.common import quiet

    rest = rig.modes(load("tip_knock", drive__speed=speed)).sliding.equilibrium["displacement"]

    def switches(kick: float) -> bool:
        start = {"start__displacement": rest, "start__velocity": kick}
        made = run(quiet(load("tip_knock", drive__speed=speed, **start)), 1.5)
        return bool(sum(event["text"] == "contact slip ends" for event in made.plant_events) > 50)

    low, high = 0.0, 2.0 * speed
    while high - low > 4e-6:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if switches(middle) else (middle, high)
    return high


ENTRIES = (
    Entry("bistable-9", "bistable", "Table 2 and Figures 2, 9 and 12", "run-up and run-down of the coated beam",
          ("tip_epoxy",), measured,
          "The paper's lower speed of 7.5 mm/s equals the speed at which sliding becomes unstable here. On the "
          "falling ramp steady sliding ends later, at 5.6 mm/s with the noise of the scene and at 4.1 mm/s "
          "without: this differs from the paper. In the paper the amplitude falls before 13 mm/s; here it rises to "
          "the end.",
          (9.6, 6.6)),
    Entry("bistable-9b", "bistable", "Figure 9", "spectrogram of a beam in several modes", ("tip_beam",), beam,
          "The paper does not state the dimensions of the beam; they are chosen. Vertical lines mark stick and "
          "release of the tip; they become horizontal lines as the sticks follow faster. There is no lower critical "
          "speed, because friction drops at once and the disc is even.",
          (9.6, 6.6)),
    Entry("bistable-10", "bistable", "Table 3, Figures 10 and 11", "load and angle", ("tip", "tip_epoxy"), parameters,
          "The trends agree: the speed falls with the angle and rises with the load. The values agree in part: at 50 "
          "N the ratios over the angle are 1 : 0.81 : 0.58 : 0 in the paper; inclination alone gives 1 : 0.63 : 0.47 "
          ": 0.38, without the zero at 20 degrees. At 30 and 20 N the paper has 7.5 and 3.0 mm/s; ours are higher. A "
          "force without friction (about 20 N) would explain the difference.", (9.6, 4.8)),
    Entry("bistable-13", "bistable", "Figure 13", "a knock switches from sliding to stick-slip", ("tip_knock",),
          knocked,
          "The paper states that a knock switches the motion, but not its strength; the smallest knock corresponds to "
          "the amplitude of the unstable cycle.", (9.6, 6.6)),
)  # fmt: skip
