"""What is due at the first tick is in force in the first samples, in every mode."""

import json

import numpy as np
import pytest

import rig
from rig.bench.run.simulate import Recorded, simulate
from rig.scenes.scene import Scene


def with_protocol(name, *steps, **changes):
    raw = json.loads(rig.load(name, {key.replace("__", "."): value for key, value in changes.items()}).to_json())
    raw |= {"protocol": [*steps, {"step": "hold", "time": 0.05}], "controllers": {}}
    return Scene.from_json(json.dumps(raw))


def put(target, to):
    return {"step": "set", "target": target, "to": to}


def test_the_pendulum_begins_at_rest_with_a_light_load():
    """Its protocol sets the disc to 0 and the load to 2 N; both lag behind no command at the start."""
    run = simulate(rig.load("pendulum"), {}, 10**8, recorded=Recorded({}))
    assert run.signals["disc_speed"][0] == 0.0
    assert run.signals["normal_force"][0] == 2.0
    assert abs(run.signals["friction_force"][0]) < 1e-9  # the body sticks: nothing pulls at it
    assert abs(run.measurements["disc_speed"].v[0]) < 0.01
    assert abs(run.measurements["normal_force"].v[0] - 2.0) < 0.5


@pytest.mark.parametrize(
    ("step", "signal", "value"),
    [
        (put("drive.speed", 0.2), "slip_speed", 0.14),
        (put("load.force", 5.0), "normal_force", 5.0),
        ({"step": "load", "force": 5.0, "over": 0.0}, "normal_force", 5.0),
        ({"step": "ramp", "target": "drive.speed", "to": 0.2, "over": 0.01}, "slip_speed", 0.0),
        ({"step": "knock", "impulse": 0.5}, "velocity", 0.16),
    ],
    ids=["drive", "load", "load step", "ramp", "knock"],
)
def test_what_is_due_at_tick_0_is_in_the_first_sample(step, signal, value):
    run = simulate(with_protocol("belt", step), {})
    assert run.signals[signal][0] == pytest.approx(value, rel=1e-12, abs=1e-15)
    if signal == "velocity":
        assert run.measurements["vibrometer"].v[0] == pytest.approx(value, rel=1e-3)


def test_a_parameter_set_at_tick_0_is_in_the_first_sample():
    start = {"start__displacement": "2 mm", "start__velocity": "0 m/s"}
    run = simulate(with_protocol("belt", put("body.stiffness", 5000.0), **start), {})
    known = simulate(with_protocol("belt", body__stiffness="5000 N/m", **start), {})
    assert np.allclose(run.signals["acceleration"], known.signals["acceleration"], rtol=1e-12, atol=0.0)


def test_a_wait_that_comes_first_is_judged_by_the_first_sample():
    wait = {"step": "wait", "sensor": "vibrometer", "above": 0.05, "timeout": 1.0}
    run = simulate(with_protocol("belt", wait, put("drive.speed", 0.1)), {})
    (told,) = [event for event in run.events if event["text"].startswith("set drive.speed")]
    assert told["tick"] == 0
