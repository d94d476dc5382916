"""Which sensors can be heard, and what a page that listens gets."""

from types import SimpleNamespace

import numpy as np
import pytest

from rig import scenes
from rig.bus import messages
from rig.bus.run_setup import Setup
from rig.web.sound import audible, packed


def setup_of(scene):
    sensors = {name: (one.delivers, round(1e9 / one.rate)) for name, one in scene.sensors.items()}
    return Setup(run="r", scene="{}", frame_ns=10**6, step_ns=10**6, outputs={}, sensors=sensors)


def arrived(name, t0_ns, dt_ns, v):
    return SimpleNamespace(topic=f"meas/{name}", said=messages.TYPES["Block"](t0_ns=t0_ns, dt_ns=dt_ns, v=v))


def test_a_scene_without_fast_sensors_says_which_it_has_and_which_scene_has_one():
    scene = scenes.load("belt")
    found = audible(setup_of(scene))
    assert found["sensors"] == {}
    for name, one in scene.sensors.items():
        assert f"{name} ({one.delivers}, {one.rate:g} Hz)" in found["why"]
    example = found["why"].rstrip(".").rpartition(" ")[2]
    assert audible(setup_of(scenes.load(example)))["why"] == ""


def test_the_samples_of_all_blocks_are_joined_and_gaps_are_silence():
    messages = [
        arrived("a", 2_000_000_000, 20_000, [1.5, float("nan")]),
        arrived("b", 0, 1, [9.0]),
        SimpleNamespace(topic="state", said=None),
        arrived("a", 2_000_040_000, 20_000, [-float("inf"), 0.25]),
    ]
    found = packed(messages, {"a", "c"})
    assert found.keys() == {"a"}
    assert np.frombuffer(found["a"][:8], "<f8")[0] == pytest.approx(2.0)
    assert np.frombuffer(found["a"][8:], "<f4").tolist() == [1.5, 0.0, 0.0, 0.25]
