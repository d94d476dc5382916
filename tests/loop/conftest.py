"""Closed loops in one process, and what is read off them: amplitude and decay of the velocity after switching on."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rig

ON = 4.0  # s, the control is switched on
SMALLEST, LARGEST = 1e-6, 0.018  # m/s, maxima of v that the decay is fitted to


@pytest.fixture(scope="session")
def loop():
    def run(scene, controller, gain, delay=0.0, rate=1000.0, duration=20.0, **changes):
        """One run of `scene`; `gain` as text with its unit, `delay` of the loop [s], `rate` of the sampling [Hz]."""
        given = {
            f"controllers.{controller}.gain": gain,
            f"controllers.{controller}.delay": f"{delay!r} s",
            f"controllers.{controller}.period": f"{1.0 / rate!r} s",
        }
        if rate > 1000.0:
            given["clock.frame"] = f"{1.0 / rate!r} s"
        done = rig.simulate(rig.load(scene, given | changes), duration)
        assert done.fault == ""
        return done

    def normal_force(gain, **how):
        return run("belt_normal_force", "nf", f"{gain!r} N*s/m", **how)

    def belt(gain, **how):
        return run("belt_velocity_feedback", "belt", gain, **how)

    return SimpleNamespace(normal_force=normal_force, belt=belt, amplitude=amplitude, decay=decay)


def amplitude(run, start=None, end=None):
    """Half peak-to-peak of the velocity between `start` and `end`, by default over the last 4 s [m/s]."""
    last = run.time[-1] if end is None else end
    seen = run.signals["velocity"][(run.time >= (last - 4.0 if start is None else start)) & (run.time <= last)]
    return 0.5 * float(np.ptp(seen))


def decay(run):
    """Slope of ln of the positive maxima of v between 1e-6 and 0.018 m/s [1/s], and how many there were.

    Counted from the last maximum above 0.018 m/s: before it, maxima of the switching transient come between.
    """
    after = run.time >= ON
    t, v = run.time[after], run.signals["velocity"][after]
    peaks = np.flatnonzero((v[1:-1] > v[:-2]) & (v[1:-1] >= v[2:])) + 1
    t, v = t[peaks], v[peaks]
    large = np.flatnonzero(v > LARGEST)
    first = large[-1] + 1 if len(large) else 0
    small = np.flatnonzero(v[first:] < SMALLEST)
    last = first + small[0] if len(small) else len(v)
    if last - first < 3:
        return float("nan"), int(last - first)
    return float(np.polyfit(t[first:last], np.log(v[first:last]), 1)[0]), int(last - first)


@pytest.fixture(scope="session")
def tables():
    path = Path(__file__).parents[1] / "reference" / "kroger.json"
    return json.loads(path.read_text())["loop"]
