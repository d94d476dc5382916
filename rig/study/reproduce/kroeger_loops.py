"""Kroeger, Neubauer, Popp (2008), section 4: control loops, the tuned mass, dither."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.study.reproduce.common import BLUE, GREY, RED, law_of, load, quiet, run
from rig.study.reproduce.entry import Comparison, Entry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


def feedback(figure: Figure) -> Iterator[Comparison]:
    """Normal-force feedback switched on at 4 s, gains 0 to 400 N s/m."""
    yield from _loops(
        figure, "belt_normal_force", (0.0, 100.0, 200.0, 300.0, 400.0), "N s/m",
        {100.0: ("L", 0.064), 200.0: ("rate", -1.88), 300.0: ("rate", -4.68), 400.0: ("rate", -7.49)},
    )  # fmt: skip


def belt_feedback(figure: Figure) -> Iterator[Comparison]:
    """Belt-velocity feedback switched on at 4 s."""
    yield from _loops(
        figure, "belt_velocity_feedback", (0.0, 0.5, 1.33, 2.66), "",
        {0.5: ("L", 0.137), 1.33: ("rate", -1.32), 2.66: ("rate", -7.57)},
    )  # fmt: skip


def _loops(
    figure: Figure, name: str, gains: tuple[float, ...], unit: str, reference: Mapping[float, tuple[str, float]]
) -> Iterator[Comparison]:
    axes = figure.subplots(len(gains), 1, sharex=True)
    for axis, gain in zip(axes, gains):
        scene = load(name)
        key = next(iter(scene.controllers))
        ran = run(load(name, **{f"controllers__{key}__gain": gain}), 20.0)
        v = ran.signals["velocity"]
        axis.plot(ran.time, 1e3 * v, color=BLUE, lw=0.6)
        axis.set_ylabel(f"K = {gain:g}")
        if gain in reference:
            kind, expected = reference[gain]
            if kind == "L":
                tail = v[ran.time > 16.0]
                amplitude = 0.5 * float(tail.max() - tail.min())
                yield Comparison(
                    f"K = {gain:g} {unit}: amplitude", "m/s", amplitude, expected, "reference", absolute=3e-3
                )
            else:
                yield Comparison(
                    f"K = {gain:g} {unit}: decay", "1/s", decay(ran.time, v), expected, "reference", relative=0.05
                )
    axes[-1].set_xlabel("time [s]; velocity in mm/s")


def decay(time: Array, v: Array) -> float:
    """Slope of ln of the positive maxima of v between 1e-6 and 0.018 m/s after 4 s [1/s]."""
    after = time > 4.0
    t, w = time[after], v[after]
    top = np.flatnonzero((w[1:-1] > w[:-2]) & (w[1:-1] >= w[2:])) + 1
    top = top[(w[top] > 1e-6) & (w[top] < 0.018)]
    return float(np.polyfit(t[top], np.log(w[top]), 1)[0])


def tuned_mass(figure: Figure) -> Iterator[Comparison]:
    """Largest growth rate over tilt and damping of the absorber."""
    from matplotlib.colors import TwoSlopeNorm

    import rig

    tilts, ratios = np.linspace(-1.2, 1.2, 81), np.linspace(0.03, 0.6, 39)
    growth = np.empty((len(ratios), len(tilts)))
    for i, ratio in enumerate(ratios):
        scene = load("belt_tuned_mass", tuned_mass__damping_ratio=float(ratio))
        growth[i] = rig.sweep(scene, "tuned_mass.angle", tilts).largest
    axis = figure.subplots()
    norm = TwoSlopeNorm(0.0, min(float(growth.min()), -1e-3), max(float(growth.max()), 1e-3))
    mesh = axis.pcolormesh(tilts, ratios, growth, cmap="RdBu_r", norm=norm, shading="nearest")
    axis.contour(tilts, ratios, growth, levels=[0.0], colors="black", linewidths=1.0)
    figure.colorbar(mesh, label="largest growth rate [1/s]")
    mu = 0.379929
    axis.axvline(-0.5 * math.atan(mu), color=GREY, ls="--", lw=1.0)
    axis.set(xlabel="tilt [rad]", ylabel="damping ratio D2")
    for tilt, expected in ((0.305, (-0.281, -0.715, -0.063)), (-0.305, (0.546, 0.499, 0.467))):
        for ratio, rate in zip((0.05, 0.1, 0.2), expected):
            scene = load("belt_tuned_mass", tuned_mass__angle=tilt, tuned_mass__damping_ratio=ratio)
            found = rig.modes(scene).sliding.growth
            yield Comparison(f"tilt {tilt:+g}, D2 {ratio:g}", "1/s", found, rate, "reference", absolute=6e-4)


def dither(figure: Figure) -> Iterator[Comparison]:
    """Effective friction under dither of the belt, averaged and simulated at 150 Hz."""
    from rig.study.averaged import mean_friction

    law = law_of(load("belt"))
    amplitudes = np.array([0.005 * k for k in range(1, 61) if k != 12])
    mean = [mean_friction(law, 0.06, 1.0, complex(a))[0] for a in amplitudes]
    axis = figure.subplots()
    axis.plot(1e3 * amplitudes, mean, color=BLUE, label="averaged")
    simulated = []
    for amplitude, expected in ((0.08, 0.1123), (0.10, 0.0717), (0.15, 0.0401), (0.20, 0.0303)):
        scene = quiet(load("belt_dither", dither__amplitude=amplitude, dither__enable=True))
        ran = run(scene, 12.0)
        last = ran.time > 8.0
        mu = float(np.mean(ran.signals["friction_force"][last]) / 20.0)
        simulated.append((amplitude, mu))
        yield Comparison(f"simulated at {1e3 * amplitude:g} mm/s", "", mu, expected, "reference", relative=0.01)
    axis.plot([1e3 * a for a, _ in simulated], [mu for _, mu in simulated], "o", color=RED, label="simulated, 150 Hz")
    axis.axvline(60.0, color=GREY, lw=0.7, ls="--")
    axis.set(xlabel="amplitude of the dither [mm/s]", ylabel="mean friction coefficient", ylim=(0.0, None))
    axis.legend()


ENTRIES = (
    Entry("kroeger-20", "kroeger", "Figure 20", "normal-force feedback", ("belt_normal_force",), feedback,
          size=(9.6, 7.6)),
    Entry("kroeger-22", "kroeger", "Figure 22", "belt-velocity feedback", ("belt_velocity_feedback",), belt_feedback,
          size=(9.6, 7.0)),
    Entry("kroeger-23", "kroeger", "Figure 23", "tuned mass over tilt and damping", ("belt_tuned_mass",), tuned_mass,
          "Mirror-symmetric about -atan(mu)/2 (dashed)."),
    Entry("kroeger-dither", "kroeger", "Section 4", "mean friction under dither", ("belt_dither",), dither),
)  # fmt: skip
