"""Every scene that ships: it loads, it comes back from JSON, and each of its values says where it comes from."""

import re
import tomllib

import numpy as np
import pytest

from rig import scenes, simulate
from rig.bench.run.before import findings
from rig.quantities import ORIGINS
from rig.scenes.scene import Scene
from rig.scenes.shipped import card

NUMBER = re.compile(r"[+-]?[\d.]")


@pytest.fixture(scope="module", params=scenes.names())
def scene(request, shipped):
    return next(scene for scene in shipped if scene.name == request.param)


def test_a_scene_comes_back_from_json_unchanged(scene):
    again = scenes.Scene.from_json(scene.to_json())
    assert again == scene
    assert again.to_json() == scene.to_json()
    assert again.digest == scene.digest


def test_every_value_bears_an_origin_and_needs_no_unit_library(scene):
    """Start-up counts: 0.3 s of pint for a factor of one would be wasted."""
    text = scenes.path(scene.name).read_text(encoding="utf-8")
    assert list(_bare(tomllib.loads(text))) == []
    assert {origin.origin for origin in scene.origins.values()} <= set(ORIGINS)
    assert not re.search(r'\["[-+.\de]+\s+(ms|us|kHz|mm|um|rpm|mN|deg)\b', text)


def _bare(raw, key=""):
    """Keys of values that stand without an origin; names, choices and switches are no values."""
    if isinstance(raw, dict):
        for name, value in raw.items():
            if name not in ("format", "title", "about", "text"):
                yield from _bare(value, f"{key}.{name}" if key else name)
    elif isinstance(raw, list) and not (len(raw) in (2, 3) and raw[1] in ORIGINS):
        for i, value in enumerate(raw, 1):
            yield from _bare(value, f"{key}[{i}]")
    elif (isinstance(raw, int | float) and not isinstance(raw, bool)) or (isinstance(raw, str) and NUMBER.match(raw)):
        yield key


def test_a_scene_says_what_one_sees_and_a_list_reads_it(scene):
    told = card(scene.name)
    assert scene.name.startswith((told["plant"], "seal"))  # the seal is a friction law, on the belt
    assert (told["title"], told["plant"]) == (scene.title, scene.plant)
    assert told["title"]
    assert told["about"]
    assert scene.about.startswith(told["about"])
    assert told["pace_limit"] == scene.clock.pace_limit
    assert ([f"scene {told['based_on']}"] if told["based_on"] else []) == list(scene.bases[:1])
    assert scene.notes == ()


def test_nothing_speaks_against_a_run_of_a_scene(scene):
    """Assembled and looked at as before a run; nothing is compiled."""
    told = findings(scene)
    assert not [one.what for one in told if one.level == "error"] or scene.clock.unstable == "run"
    assert not [one.what for one in told if "too coarse" in one.what]


@pytest.mark.slow  # compiles every kind of rig
def test_a_scene_runs_for_a_frame(scene):
    run = simulate(scene, 2e-9 * scene.frame_ns)
    assert run.fault == ""
    assert run.time[-1] == pytest.approx(2e-9 * scene.frame_ns)
    assert all(np.isfinite(values).all() for values in run.signals.values())


def test_a_scene_that_cannot_keep_up_with_the_clock_says_why(shipped):
    limited = [scene for scene in shipped if scene.clock.pace_limit is not None]
    assert "brake_disc_modes" in [scene.name for scene in limited]
    for scene in limited:
        assert scene.clock.pace_limit > 0.0
        assert " us" in scene.slow or " ms" in scene.slow
        assert Scene.from_json(scene.to_json()).slow == scene.slow
