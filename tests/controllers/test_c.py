"""Controllers compiled from C: the same bits in every kind of run, and faults that are only the controller's."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compile_c import InPython, compiled, controller, each_once, same

from rig import controllers, scenes
from rig.bench.run.simulate import Recorded, simulate
from rig.controllers import c
from rig.errors import PartError, SceneError, Untrusted
from rig.parts import trust_scene
from rig.record.reader import open as opened
from rig.record.save_run import save
from rig.scenes.scene import Scene

DOCS = Path(__file__).parents[2] / "docs"
LATE = "if (t >= 50000000) "


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """Compiles variants of the controller, each once."""
    return each_once(controller, tmp_path_factory.mktemp("libraries"), ".so")


def scene(library, base="belt", **more):
    given = {"kind": "c", "file": str(library)} | more
    return scenes.load(base, {f"controllers.nf.{key}": value for key, value in given.items()})


@pytest.fixture
def sound(libraries):
    return scene(libraries(), gain="0.3 N*s/mm")


def test_a_run_has_the_bits_of_the_same_controller_in_python(libraries, sound):
    python = simulate(sound, {"nf": InPython()}, duration_ns=400_000_000)
    for scene_of_it in (sound, scene(libraries(), gain=300.0, where="plant")):
        run = simulate(scene_of_it, duration_ns=400_000_000)
        same(python, run)
        assert np.ptp(run.measurements["vibrometer"].v) > 0.01


def test_a_recording_contains_the_library_but_no_path_and_is_verified_without_it(tmp_path, sound, monkeypatch):
    run, log = simulate(sound, duration_ns=100_000_000), tmp_path / "log.mcap"
    run.provenance = {}
    save(run, log)
    assert str(sound.controllers["nf"].file) == "nf.so"
    assert b"libraries" not in sound.to_json().encode()
    monkeypatch.setenv("RIG_TRUSTED", "")
    again = opened(log)
    recorded = Scene.from_json(again.scene)
    assert recorded == sound
    same(simulate(recorded, {}, 100_000_000, Recorded(again.commands, again.events)), run)
    c.OPENED.clear()
    with pytest.raises(Untrusted, match=r"nf\.so \(SHA-256 "):
        simulate(recorded, duration_ns=100_000_000)
    trust_scene(again.scene)
    same(simulate(recorded, duration_ns=100_000_000), run)


def test_a_library_whose_content_was_changed_is_refused(sound):
    text = json.loads(sound.to_json())
    text["controllers"]["nf"]["file"]["sha256"] = "0" * 64
    with pytest.raises(PartError, match="it was changed or is damaged, and is not run"):
        Scene.from_json(json.dumps(text))


def test_a_library_that_gives_up_loses_its_controller_and_the_run_continues(libraries):
    faulty = scene(libraries(more=LATE + "return 3;"))
    run = simulate(faulty, duration_ns=200_000_000)
    (lost,) = [event for event in run.events if event["kind"] == "lost"]
    assert lost["t_ns"] == 50_000_000
    assert "rig_controller_step returned 3" in lost["text"]
    assert run.summary["controllers"]["nf"]["updates"] == 50
    assert run.time[-1] == pytest.approx(0.2)
    assert run.commands["nf"].status[-1] != 0  # safe values
    same(simulate(faulty, {}, 200_000_000, Recorded(run.commands, run.events)), run)


CRASHES, HANGS = LATE + "*(volatile int *)0 = 1;", LATE + "for (;;) ;"


@pytest.mark.parametrize(
    ("more", "told"), [(CRASHES, "nf has crashed, which ends this process (SIGSEGV)"), (HANGS, "nf does not return, ")]
)
def test_a_crash_in_a_simulation_names_the_controller(libraries, more, told):
    options = ["-p", "controllers.nf.kind=c", "-p", f"controllers.nf.file={libraries(more=more)}"]
    command = [sys.executable, "-m", "rig", "simulate", "belt", *options, "--duration", "0.2"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120.0)
    assert ended.returncode == 1
    assert f"the code of controller {told}" in ended.stderr


@pytest.mark.parametrize(("more", "told"), [("*(volatile int *)0 = 1;", "SIGSEGV"), ("for (;;) ;", "SIGALRM")])
def test_a_library_whose_first_call_ends_its_process_is_refused(libraries, more, told):
    with pytest.raises(SceneError, match=rf"first call ends the process that makes it \({told}\)"):
        scene(libraries(more=more))


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"reads": ["laser"]}, 'controllers.nf.reads = "laser": the sensor is in m, '),
        (
            {"reads": ["vibrometer", "laser"]},
            "controllers.nf.reads: names 2, but nf.so has 1 inputs: vibrometer [m/s]",
        ),
        ({"gian": 3.0}, "controllers.nf.gian: unknown key; did you mean controllers.nf.gain?"),
        ({"file": __file__}, "test_c.py: cannot be loaded: invalid ELF header"),
    ],
)
def test_keys_of_the_scene_that_do_not_fit_are_named(libraries, more, told):
    with pytest.raises(SceneError) as refused:
        scene(libraries(), **more)
    assert told in str(refused.value)


def test_the_example_of_the_page_compiles_without_a_warning_and_reduces_the_limit_cycle(tmp_path):
    text = (DOCS / "example_controller.c").read_text()
    library = compiled(tmp_path / "example.so", text, "-I", controllers.__path__[0])
    free, held = (simulate(one, duration_ns=5_000_000_000) for one in (scenes.load("belt"), scene(library)))
    free_swing, swing = (np.ptp(run.signals["velocity"][-1000:]) for run in (free, held))
    assert swing < 0.01 * free_swing
