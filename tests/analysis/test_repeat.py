"""One scene with many seeds: what spreads, and how far; what is done when it is interrupted."""

import json
from dataclasses import replace

import numpy as np
import pytest

import rig as lab
from rig.analysis.repeat import repeat
from rig.analysis.studies.runs import random_parts
from rig.errors import UsageError

NOISY = {"noise.force": "0.01"}
OPENS = {"plate.damping_ratio": "0", "slider.position": "4 mm", "noise.force": "1e-6"}
"""A point opens after 0.11 s."""


@pytest.fixture(scope="module")
def belt():
    return lab.load("belt_c_damped", NOISY)


@pytest.fixture(scope="module")
def found(belt):
    return repeat(belt, 3, duration=1.5, workers=2)


def test_each_run_is_that_of_its_seed(belt, found):
    assert found.seeds == (belt.seed, belt.seed + 1, belt.seed + 2)
    for one in found.seen:
        run = lab.simulate(replace(belt, seed=one.seed), 1.5)
        assert one.numbers["rms displacement"].value == run.signals["displacement"].std()
        assert one.numbers["rms displacement"].unit == "m"
    assert len(set(found.values("rms displacement"))) == 3


def test_workers_change_no_number(belt, found):
    assert repeat(belt, 3, duration=1.5, workers=1).seen == found.seen


def test_median_and_range_are_those_of_the_runs(found):
    v = found.values("rms velocity")
    [one] = [s for s in found.spreads if s.name == "rms velocity"]
    assert (one.runs, one.median, one.least, one.greatest) == (3, float(np.median(v)), min(v), max(v))
    numbers = found.seen[0].numbers
    assert numbers["amplitude displacement"].value > 0.0
    assert numbers["frequency displacement"].unit == "Hz"
    assert not any("opening" in name for name in numbers)


def test_what_has_no_spread_is_refused_with_what_to_do(belt):
    with pytest.raises(UsageError, match=r"plate: nothing in it is random.*all 4 runs are the same.*-p noise.force="):
        lab.repeat("plate", 4, 1.0)
    with pytest.raises(UsageError, match="1 runs have no spread"):
        lab.repeat(belt, 1, 1.0)
    assert random_parts(lab.load("pendulum")) != ()  # noise of sensors
    assert random_parts(lab.load("belt", {"noise.force": "0"})) == random_parts(lab.load("belt"))


def test_what_is_done_is_told_when_it_is_stopped(belt):
    done = []
    how = {"duration": 0.5, "workers": 1, "progress": lambda count, total: done.append(count)}
    part = repeat(belt, 1000, **how, stop=lambda: "interrupted" if done and done[-1] >= 2 else "")
    assert 2 <= len(part.seen) < 1000
    assert f"{len(part.seen)} of 1000 runs (interrupted)" in part.text()
    assert part.spreads


def test_a_film_of_points_tells_its_first_opening_and_statistics_from_there_on():
    scene = lab.load("plate", OPENS)
    found = repeat(scene, 2, duration=0.14, workers=1)
    assert found.opened == 2
    assert all(0.1 < t < 0.13 for t in found.values("first opening"))
    names = [one.name for one in found.spreads]
    for name in ("mean contact_fraction", "least contact_fraction", "rms slider_acceleration",
                 "range pressure_centre_x", "band meas/accelerometer 12500..25000 Hz"):  # fmt: skip
        assert name in names
    assert not any("pressure_1_1" in name for name in names)
    assert "opened in 2 of 2 runs" in found.text()
    assert "chaotic" in found.text()


def test_the_command_tells_json_and_figure(rig, tmp_path):
    asked = ("simulate", "belt_c_damped", "-p", "noise.force=0.01", "--duration", "1", "--repeat", "2")
    code, out, _ = rig(*asked, "--figure", tmp_path / "spread.png", "--json")
    told = json.loads(out)
    assert code == 0
    assert (tmp_path / "spread.png").stat().st_size > 10_000
    assert len(told["runs"]) == 2
    assert {"name", "unit", "runs", "median", "least", "greatest"} == told["spread"][0].keys()
    code, _, err = rig(*asked, "--out", tmp_path / "run.mcap")
    assert (code, "--repeat writes no recordings" in err) == (2, True)


def test_one_run_and_what_it_is_made_of_say_that_it_is_chaotic(rig):
    p = [part for key, value in OPENS.items() for part in ("-p", f"{key}={value}")]
    code, out, _ = rig("simulate", "plate", *p, "--duration", "0.14")
    assert code == 0
    assert "a point opens first at t = 0.1" in out
    assert "its numbers are statistics" in out
    code, out, _ = rig("simulate", "plate", "--duration", "0.02")
    assert "no point opens" in out
    assert "chaotic" in rig("explain", "plate")[1]
    assert "chaotic" not in rig("explain", "belt")[1]
