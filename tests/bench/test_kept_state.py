"""A plant runner returns to a state that it has kept, with the same bits from there on."""

from dataclasses import replace

import numpy as np
import pytest

from rig import scenes
from rig.bench.run.runner import PlantRunner
from rig.errors import UsageError

SCENES = ("belt", "pendulum", "brake_shunt")


def scene(name, **changes):
    return (
        scenes.load(name, {"sensors.extra.kind": "laser_vibrometer", **changes})
        if name == "belt"
        else scenes.load(name)
    )


def carried(runner, frames=150):
    """The latest measurements after each frame, and energy balance and state at the end."""
    seen = []
    for _ in range(frames):
        runner.frames(1)
        seen.append(runner.bank.latest.copy())
    return np.array(seen).tobytes(), runner.motion.x.tobytes(), runner.motion.energy(), runner.bank.counters()


@pytest.mark.parametrize("name", SCENES)
def test_from_the_begin_on_another_seed_gives_the_bits_of_a_new_rig(name):
    runner, again = PlantRunner(scene(name)), PlantRunner(replace(scene(name), seed=5))
    begin = runner.keep()
    other = carried(runner)
    runner.back(begin, seed=5)
    fresh = carried(again)
    assert carried(runner) == fresh
    noisy = any(one.front_end().noise for one in scene(name).sensors.values())
    assert noisy == (fresh[0] != other[0])


def test_actuators_return_to_their_values():
    runner = PlantRunner(replace(scene("belt"), driven=frozenset({"load.force"})))
    begin = runner.keep()
    plain = carried(runner)
    runner.back(begin)
    runner.apply("load.force", 35.0)
    assert carried(runner) != plain
    assert runner.values["load.force"] == 35.0
    runner.back(begin)
    assert runner.values["load.force"] == pytest.approx(20.0)
    assert carried(runner) == plain


def test_what_cannot_return_says_why():
    runner = PlantRunner(scene("belt"))
    kept = runner.keep()
    runner.set_parameter("body.mass", 4.0)
    with pytest.raises(UsageError, match="the rig was built anew since this state was kept"):
        runner.back(kept)
    truthful = PlantRunner(scene("belt"), truthful=True)
    with pytest.raises(UsageError, match="a runner that keeps all outputs cannot return"):
        truthful.back(truthful.keep())
    with pytest.raises(UsageError, match="a rig with the method kick cannot return"):
        PlantRunner(scenes.load("points")).keep()
