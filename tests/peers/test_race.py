"""Reference problems as scenes, and the race of solvers on them."""

import json
from pathlib import Path

import numpy as np
import pytest
from oscillator import Oscillator
from solvers import by_rig, by_scipy

import rig
from rig.analysis.cycles.motion_measures import Setting

NUM = json.loads((Path(__file__).parents[1] / "reference" / "num.json").read_text())
PROBLEMS = Path(__file__).parents[1] / "problems"
BEST = {"P1": Setting("exact"), "P2": Setting("dopri5", 1e-12), "P3": Setting("exact"), "P4": Setting("exact")}


def problem(name):
    return rig.load(PROBLEMS / f"{name.lower()}.toml")


@pytest.mark.parametrize("name", BEST)
def test_the_scenes_are_the_reference_problems(name):
    events = by_rig(problem(name), BEST[name], NUM[name]["duration"])()
    assert events == pytest.approx(NUM[name]["events"], abs=1e-10 * NUM[name]["period"])


@pytest.mark.parametrize("name", ["P1", "P2"])
def test_what_peers_are_given_is_the_same_problem(name):
    o = Oscillator.of(problem(name))
    found = by_scipy(o, ("DOP853", 1e-10))()
    assert np.abs(np.subtract(found, NUM[name]["events"])).max() < 1e-8 * NUM[name]["period"]
