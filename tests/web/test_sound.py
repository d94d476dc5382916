"""Which sensors can be heard, and what a page that listens gets."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest
from patience import PATIENCE_S

from rig import scenes
from rig.bus import messages
from rig.bus.run_setup import Setup
from rig.web.sound import AHEAD, KEPT, Sounds, audible, packed


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


def test_a_slow_page_gets_the_newest_samples_and_a_fast_one_all():
    async def test():
        sounds = Sounds()
        slow, fast, other = sounds.connect("a"), sounds.connect("a"), sounds.connect("b")
        assert sounds.wanted == {"a", "b"}
        got = []
        for k in range(100):
            sounds.offer({"a": bytes([k])})
            for message in await fast.next():
                got.append(message)
                fast.heard("")
            if k < AHEAD:
                assert await slow.next() == [bytes([k])]
        assert got == [bytes([k]) for k in range(100)]
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(slow.next(), 0.05)
        for _ in range(AHEAD):
            slow.heard("")
        assert await slow.next() == [bytes([k]) for k in range(100 - KEPT, 100 - KEPT + AHEAD)]
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(other.next(), 0.05)
        for one in (slow, fast):
            sounds.disconnect(one)
        assert sounds.wanted == {"b"}

    asyncio.run(asyncio.wait_for(test(), PATIENCE_S))
