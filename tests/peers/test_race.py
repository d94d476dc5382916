"""The race of solvers: what peers are given is the reference problem."""

import json
from pathlib import Path

import numpy as np
import pytest
from oscillator import Oscillator
from solvers import by_scipy

import rig

NUM = json.loads((Path(__file__).parents[1] / "reference" / "num.json").read_text())
PROBLEMS = Path(__file__).parents[1] / "problems"


def problem(name):
    return rig.load(PROBLEMS / f"{name.lower()}.toml")


@pytest.mark.parametrize("name", ["P1", "P2"])
def test_what_peers_are_given_is_the_same_problem(name):
    o = Oscillator.of(problem(name))
    found = by_scipy(o, ("DOP853", 1e-10))()
    assert np.abs(np.subtract(found, NUM[name]["events"])).max() < 1e-8 * NUM[name]["period"]
