"""Dither: averaged friction, what it does to growth, and the same by simulation at 150 Hz.

Set PEND, characteristic A; Kroeger et al. (2008) section 4 mention it, numbers: tests/reference/kroger.json.
"""

import math

import numpy as np
import pytest

from rig.analysis.cycles.averaged import averaged

FREQUENCY = 150.0
M, C, D, F0 = 5.0, 2500.0, 2.0, 20.0
PERIODS = 20  # ms: three periods of the dither, over which it averages out exactly


def mu(v):
    """Characteristic A."""
    return (0.18 + 0.32 * np.exp(-np.abs(v) / 0.05)) * np.sign(v)


def averaged_friction(speed, amplitude, nodes=400_000):
    """Mean of mu over a period of the dither, and its slope over the speed, by plain quadrature of the law.

    Where the slip speed passes through zero mu jumps by 2 mu_s: that jump over the steepness there counts, twice.
    """
    v = speed + amplitude * np.sin((np.arange(nodes) + 0.5) * 2.0 * math.pi / nodes)
    slope = float((-0.32 / 0.05 * np.exp(-np.abs(v) / 0.05)).mean())
    if amplitude > speed:
        slope += 2.0 * 0.5 / (math.pi * math.sqrt(amplitude**2 - speed**2))
    return float(mu(v).mean()), slope


def growth_by_quadrature(speed, amplitude):
    """-(d + F0 dT/dv) / 2m [1/s]."""
    return -(D + F0 * averaged_friction(speed, amplitude)[1]) / (2.0 * M)


@pytest.mark.parametrize(
    ("speed", "amplitude"), [(0.06, 0.03), (0.06, 0.08), (0.06, 0.1), (0.215, 0.1), (0.06, 0.3), (0.215, 0.25)]
)
def test_growth_told_by_the_rig_is_that_of_the_quadrature(move, speed, amplitude):
    """The averaged growth of `rig modes` and that of the plain mean of the law."""
    run = move("belt_dither", {"dither.amplitude": amplitude, "drive.speed": speed, "dither.enable": True})
    names = run.motion.system.names
    found = averaged(run.motion.system, names.index("dither.sin"), names.index("dither.cos"), amplitude)
    assert found.eigenvalues()[0].real == pytest.approx(growth_by_quadrature(speed, amplitude), rel=1e-4, abs=1e-4)


def quiet(values):
    """Values per millisecond without their dither: means over three of its periods."""
    return np.convolve(values, np.full(PERIODS, 1.0 / PERIODS), mode="valid")


@pytest.mark.parametrize("amplitude", [0.08, 0.15, 0.3])
def test_effective_friction_by_simulation(move, kroger, amplitude):
    """1 %, once the limit cycle has gone; the mean spring force over the load."""
    changes = {"dither.amplitude": amplitude, "dither.enable": True}
    run = move("belt_dither", changes, duration=16.0, tolerance=1e-6)
    x = quiet(run["displacement"])[-3000:]
    assert np.ptp(x) < 0.02 * x.mean()
    found = C * x.mean() / F0
    assert found == pytest.approx(kroger["dither"]["averaged"][repr(amplitude)]["mu_eff"], rel=0.01)
    assert found == pytest.approx(kroger["dither"]["simulated_mu"][repr(amplitude)], rel=0.01)


@pytest.mark.parametrize(("speed", "amplitude", "time"), [(0.215, 0.1, 12.0), (0.06, 0.03, 1.0)])
def test_growth_by_simulation(move, speed, amplitude, time):
    """Small motions about dithered sliding grow at the averaged rate, 5 %."""
    run = move(
        "belt_dither", {"dither.amplitude": amplitude, "drive.speed": speed, "dither.enable": True}, tolerance=1e-10
    )
    run.write("x", F0 * averaged_friction(speed, amplitude)[0] / C)
    run.write("x'", 2e-4)
    run.motion.advance(round(time * 1e3))
    v = quiet(run["velocity"])
    peaks = np.flatnonzero((v[1:-1] > v[:-2]) & (v[1:-1] >= v[2:])) + 1
    peaks = peaks[v[peaks] > 0.0][1:]
    top = v[peaks] - (v[peaks + 1] - v[peaks - 1]) ** 2 / (8.0 * (v[peaks - 1] - 2.0 * v[peaks] + v[peaks + 1]))
    rate = np.polyfit(run.time[peaks], np.log(top), 1)[0]
    assert top[-1] < 0.02
    assert rate == pytest.approx(growth_by_quadrature(speed, amplitude), rel=0.05)


def test_dither_ends_the_limit_cycle_and_its_end_brings_it_back(move):
    run = move("belt_dither", duration=4.0)
    amplitude = run.motion.system.names.index("dither.cos")
    assert np.ptp(run["velocity"][-1000:]) > 0.15
    run.motion.write(amplitude, 0.1)
    run.motion.advance(6000)
    assert np.ptp(quiet(run["velocity"])[-1000:]) < 1e-3
    run.motion.write(amplitude, 0.0)
    run.write("dither.sin", 0.0)
    run.motion.advance(4000)
    assert np.ptp(run["velocity"][-1000:]) > 0.15


def test_dither_on_the_mass_is_dither_on_the_belt_in_its_frame(move):
    """A force m w a shakes the mass as the belt would shake: the same mean friction, 1 %."""
    force = M * 2.0 * math.pi * FREQUENCY * 0.1
    run = move("belt_dither", {"dither.on": "mass", "dither.amplitude": force, "dither.enable": True}, duration=12.0)
    assert C * quiet(run["displacement"])[-3000:].mean() / F0 == pytest.approx(0.0717, rel=0.01)


def test_dither_on_the_load_lifts_the_contact_off(move):
    """N = 20 N + 30 N sin: open for arccos(2/3) / pi of each period, friction absent then, never pulled."""
    run = move(
        "belt_dither",
        {"dither.on": "load", "dither.amplitude": 30.0, "dither.enable": True},
        step_ms=0.05,
        duration=2.0,
    )
    N, T = run["normal_force"], run["friction_force"]
    assert N.min() == 0.0
    assert N.max() == pytest.approx(50.0, rel=1e-3)
    assert np.mean(N == 0.0) == pytest.approx(math.acos(2.0 / 3.0) / math.pi, abs=2e-3)
    assert np.all(T[N == 0.0] == 0.0)
    opens, closes = run.times("load opens"), run.times("load closes")
    assert closes - opens == pytest.approx(math.acos(2.0 / 3.0) / (math.pi * FREQUENCY), abs=1e-7)
    assert abs(run.motion.energy()["error"]) < 1e-6
