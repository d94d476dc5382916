"""A slider that its protocol takes beyond the plate's edge: told before the run, and the run ends there."""

from dataclasses import replace

import plate_ride
import pytest

import rig
from rig.bench.run.before import meets_edge
from rig.scenes import load

SMALL = plate_ride.SMALL | {"plate.modes": 4}


def test_a_protocol_that_ends_on_the_plate_is_not_spoken_of():
    assert meets_edge(load("plate", SMALL)) == ""
    assert meets_edge(load("plate", SMALL | {"slider.position": 0.04, "slider.travels": False})) == ""
    assert meets_edge(load("plate_free")) == ""
    assert meets_edge(load("belt")) == ""


@pytest.mark.parametrize(("duration", "told"), [(0.12, False), (0.2, True), (None, True)])
def test_a_slider_at_the_edge_is_told_as_far_as_the_run_goes(duration, told):
    """On the ramp from 0.1 s on it is 0.05 t^2 further: the 0.2 mm that are left take 63 ms."""
    scene = load("plate", SMALL | {"slider.position": 0.0435})
    found = meets_edge(scene, duration)
    assert ("beyond the plate's edge by 0.2 s: to 44 mm, but its travel ends at 43.7 mm" in found) == told
    run = rig.simulate(scene, duration)
    assert bool(run.fault) == told
    if told:
        assert "the slider has reached the end of its travel, 0.0437 m" in run.fault
        assert run.time[-1] == pytest.approx(0.1 + 0.0632, abs=1e-3)


def test_a_slider_that_runs_backwards_ends_at_the_rear_edge():
    scene = replace(load("plate", SMALL | {"slider.position": 1e-5, "drive.speed": -0.01}), protocol=())
    assert "to -0.01 mm, but its travel begins at 0 mm" in meets_edge(scene, 0.002)
    said = rig.simulate(scene, 0.002).fault
    assert said.startswith("the slider runs backwards and has reached the rear end of its travel, 0 m\n  at t = 0.001")
    assert said.endswith("smaller values")
    assert said.count(" = ") < 20


def test_a_command_says_so_before_it_runs(rig):
    changes = [f"-p{key}={value}" for key, value in SMALL.items()]
    code, _, said = rig("simulate", "plate", *changes, "-p", "slider.position=43.5 mm", "--duration", "0.2")
    assert code == 4
    assert said.startswith("warning: the protocol takes the slider beyond the plate's edge by 0.2 s")
    assert "the slider has reached the end of its travel, 0.0437 m\n  at t = 0.163" in said
