"""Every scene that ships: it loads, it comes back from JSON, and each of its values says where it comes from."""

import json
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
EXPERIMENTS = set(
    """
    belt belt_b belt_c belt_c_damped belt_dither belt_dither_controlled belt_dither_sampled belt_fluctuating_load
    belt_hysteresis belt_normal_force belt_normal_force_acceleration belt_normal_force_displacement belt_remedy_damping
    belt_remedy_friction belt_remedy_load belt_remedy_speed belt_remedy_stiffness belt_slow_card belt_velocity_feedback
    four_dof north north_divergence pendulum pin seal_l seal_p tread tread_rough two_dof two_dof_dither
""".split()
)


@pytest.fixture(scope="module", params=scenes.names())
def scene(request, shipped):
    return next(scene for scene in shipped if scene.name == request.param)


def test_the_experiments_of_the_paper_ship():
    assert set(scenes.names()) >= EXPERIMENTS


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
    errors = [one.what for one in findings(scene) if one.level == "error"]
    assert errors == [] or scene.clock.unstable == "run"


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


def test_pendulum_at_its_contact_is_the_mass_on_the_belt():
    pendulum, belt = scenes.load("pendulum").parameters, scenes.load("belt").parameters
    r = pendulum.body.radius
    assert pendulum.body.inertia / r**2 == pytest.approx(belt.body.mass, rel=1e-12)
    assert pendulum.body.stiffness / r**2 == pytest.approx(belt.body.stiffness, rel=1e-12)
    assert pendulum.body.damping / r**2 == pytest.approx(belt.body.damping, rel=1e-12)
    assert pendulum.drive.speed * r == pytest.approx(belt.drive.speed, rel=1e-12)
    assert pendulum.friction == belt.friction
    assert pendulum.load.force == belt.load.force


def test_the_pendulum_protocol_accelerates_holds_and_decelerates():
    scene = scenes.load("pendulum")
    speeds = [step.to for step in scene.protocol if getattr(step, "target", "") == "drive.speed"]
    assert speeds == [0.0, 0.3, 0.0]
    assert scene.duration_ns == 21_000_000_000
    assert scene.moved == {"drive.speed": "ramped", "load.force": "ramped"}


def test_the_reference_scenes_match_the_closed_loop_tables():
    normal, belt = scenes.load("belt_normal_force"), scenes.load("belt_velocity_feedback")
    for scene in (normal, belt):
        assert scene.frame_ns == 1_000_000
        assert scene.duration_ns == 20_000_000_000
        assert all(sensor.ideal for sensor in scene.sensors.values())
        assert scene.parameters.start.displacement == 0.0
        assert scene.parameters.start.velocity == scene.parameters.drive.speed
    assert (normal.controllers["nf"].gain, normal.controllers["nf"].enable_at) == (200.0, 4.0)
    assert (belt.controllers["belt"].gain, belt.parameters.drive.lag) == (2.66, 0.01)


def test_json_of_a_scene_is_plain_and_si():
    raw = json.loads(scenes.load("pendulum", {"drive.speed": "2 rpm"}).to_json())
    assert raw["parameters"]["drive"]["speed"] == pytest.approx(0.2094395, rel=1e-6)
    assert raw["clock"]["frame"] == 0.001
    assert raw["origins"]["drive.speed"] == ["user", ""]
