"""An ideal instrument has the flaws that are stated, and no other."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

import pytest

import rig
from rig.errors import SceneError
from rig.scenes.scene import Scene
from rig.sensors import KINDS

SIMULATED = [kind for kind in sorted(KINDS) if not KINDS[kind].given]
FLAWS = [(kind, flaw) for kind in SIMULATED for flaw in KINDS[kind].perfect]
EXAMPLES = {"delay": "17 ms", "gain_error": 0.02, "offset": 0.003}  # told from none, where the default cannot be
ALONE = {"paths": {"distance": 0.5}}  # what must be stated with a flaw


def ideal(kind, **numbers):
    return KINDS[kind](kind=kind, ideal=True, **numbers)


def parts(sensor):
    return asdict(sensor.front_end())


@pytest.mark.parametrize("kind", SIMULATED)
def test_no_flaw_that_is_not_stated(kind):
    end = ideal(kind).front_end()
    assert end.response(2j * math.pi * 431.0) == pytest.approx(KINDS[kind](kind=kind).sensitivity, rel=1e-15)
    assert (end.delay_ns, end.offset, end.noise, end.resolution, end.slope, end.warmth) == (0, 0, 0, 0, 0, 0)
    assert (end.low, end.high, end.slew, end.dropout_rate, end.echoes) == (-math.inf, math.inf, math.inf, 0, ())


@pytest.mark.parametrize(("kind", "flaw"), FLAWS)
def test_a_stated_flaw_is_that_of_the_instrument_and_brings_no_other(kind, flaw):
    """All flaws stated one after the other add up to the instrument; each moves what it is about, and that alone."""
    default = KINDS[kind].model_fields[flaw].default
    given = ALONE.get(flaw, {}) | {flaw: EXAMPLES.get(flaw, default)}
    free, alone = parts(ideal(kind, **ALONE.get(flaw, {}))), parts(ideal(kind, **given))
    real = parts(KINDS[kind](kind=kind, **given))
    moved = {key for key in alone if alone[key] != free[key]}
    assert moved
    filters = {"poles", "residues", "direct"}
    same = moved - (filters if flaw in ("resonance", "highpass") else set())
    if kind == "microphone" and flaw in ("noise", "background"):  # of its noise it is one part
        same -= {"noise"}
        assert alone["noise"] < real["noise"]
    if kind == "accelerometer" and flaw == "temperature_sensitivity":  # without a high-pass the warming stays
        same -= {"warmth", "fade", "rise"}
    if flaw in ("delay", "processing"):
        same -= {"delay_ns"}
        assert alone["delay_ns"] == (17_000_000 if flaw == "delay" else 1_000_000)
    assert {key: alone[key] for key in same} == {key: real[key] for key in same}


def test_a_scene_reads_back_what_was_stated_and_nothing_else():
    with pytest.raises(SceneError, match=r"(?s)sensors.vibrometer.*dropout describes dropout_rate.*leave out dropout"):
        rig.load("belt_normal_force", {"sensors.vibrometer.dropout": "zero"})
    changes = {"sensors.vibrometer.delay": "17 ms", "sensors.vibrometer.noise": 1e-6}
    scene = rig.load("belt_normal_force", changes)
    again = Scene.from_json(scene.to_json())
    for name, sensor in scene.sensors.items():
        assert again.sensors[name].front_end() == sensor.front_end()
    assert again.to_json() == scene.to_json()
    values = scene.values()
    assert values["sensors.vibrometer.delay"] == (0.017, "s")
    assert "sensors.vibrometer.resolution" not in values


def test_an_old_recording_of_an_ideal_instrument_has_no_flaw():
    """Format 1 wrote down every number of it, and none of them was in force."""
    raw = json.loads(rig.load("belt_normal_force").to_json())
    raw["sensors"]["vibrometer"] = KINDS["laser_vibrometer"](delay=0.001).model_dump(mode="json") | {"ideal": True}
    del raw["format"]
    end = Scene.from_json(json.dumps(raw)).sensors["vibrometer"].front_end()
    assert (end.delay_ns, end.noise, end.poles, end.resolution) == (0, 0.0, (), 0.0)
