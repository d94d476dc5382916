"""The run before a paced run: what it finds out, and the bits of the run that follows it."""

import os

import numpy as np
import pytest
from compile_c import controller
from twin import Twin

from rig import scenes
from rig.bench.live import supervise
from rig.bench.live.outcome import Job, keeps_up
from rig.bench.live.plant import Plant
from rig.bench.live.plant_process import carry_out
from rig.bench.live.rehearsal import visited
from rig.bench.run.simulate import begun
from rig.errors import Interrupted, UsageError


def job_of(scene, **more):
    return Job(scene.to_json(), **more)


@pytest.fixture(scope="module")
def scene():
    return scenes.load("belt_shunt")


def test_a_paced_run_builds_no_mode_set_after_its_first_frame(scene):
    job = job_of(scene, duration=3.0, pace=30.0, wait=0.0)

    def added(sets):
        plant = Plant(Twin("test").open("plant", "plant"), job, lambda: "", sets)
        motion, begin, first = plant.runner.motion, plant.housekeeper.begin, []
        foresee = motion.foresee
        motion.foresee = lambda keys: foresee(keys, most=0)

        def begins(*given):
            first.append(len(motion.mode_sets.sets))
            begin(*given)

        plant.housekeeper.begin = begins
        plant.run(lambda _: None)
        return len(motion.mode_sets.sets) - first[0]

    assert added(()) > 0
    assert added(visited(scene, job)) == 0


def outputs(experiment, frames):
    """The outputs at each frame, as long as the experiment goes on."""
    found = []
    while experiment.runner.tick < frames and experiment.begin():
        experiment.exchange.take_over()
        experiment.runner.frame()
        found.append(experiment.runner.output_values().copy())
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "over", "speed"),
    [
        ("north_divergence", {}, 0.0),
        ("belt_remedy_damping", {}, 0.06),
        ("belt_remedy_damping", {"limits.displacement": 0.006}, 0.0),
    ],
)
def test_a_run_whose_rigs_were_built_before_its_first_frame_has_the_same_bits(name, over, speed):
    scene = scenes.load(name, over)
    sets = visited(scene, job_of(scene))

    def prepare(experiment):
        experiment.runner.motion.foresee(sets)
        experiment.prepared_rigs()

    prepared, _ = begun(scene, {}, before=prepare)
    plain, _ = begun(scene, {})
    found, known = (outputs(one, 10_000) for one in (prepared, plain))
    assert prepared.runner.values["drive.speed"] == plain.runner.values["drive.speed"] == speed
    assert found.tobytes() == known.tobytes()


def test_a_pace_that_a_scene_cannot_keep_is_refused_with_what_works():
    scene = scenes.load("belt", {"clock.pace_limit": 0.5})
    for pace in (None, 0.1, 0.5):
        keeps_up(scene, pace)
    with pytest.raises(UsageError, match=r"pace of 1: its pace is at most 0.5.*rig run --lockstep.*--pace 0.5"):
        carry_out(Job(scene.to_json()))


CRASHES = """
import ctypes, os

class Controller:
    reads, drives, period_ns = ("vibrometer",), ("load.force",), 1_000_000

    def start(self):
        return 0

    def update(self, state, t_ns, values):
        if t_ns > 20_000_000:
            {}
        return state, (20.0,)
"""


def test_a_controller_that_crashes_in_the_rehearsal_is_named(runs, tmp_path):
    (tmp_path / "crashes.py").write_text(CRASHES.format("ctypes.string_at(8)"))
    scene = scenes.load("belt", {"controllers.mine.kind": str(tmp_path / "crashes.py")})
    with pytest.raises(UsageError, match=r"the plant was killed by SIGSEGV.* called the controller mine"):
        supervise.run(scene, duration=0.5, record=False, say=lambda _: None)


def test_a_library_in_c_that_crashes_ends_its_own_process_only(runs, tmp_path):
    library = controller(tmp_path / "crashes.so", more="if (t >= 50000000) *(volatile int *)0 = 1;")
    scene = scenes.load("belt", {"controllers.mine.kind": "c", "controllers.mine.file": str(library)})
    outcome = supervise.run(scene, duration=0.5, record=False, say=lambda _: None)
    assert outcome.died == ("controller mine was killed by SIGSEGV",)
    assert outcome.summary["seconds"] == 0.5
    assert outcome.summary["loop"]["mine"]["safe"] == 1


def test_a_controller_that_does_not_return_in_the_rehearsal_is_named(runs, tmp_path, monkeypatch):
    monkeypatch.setattr(supervise, "SILENT_S", 0.5)
    (tmp_path / "crashes.py").write_text(CRASHES.format("import time; time.sleep(60.0)"))
    scene = scenes.load("belt", {"controllers.mine.kind": str(tmp_path / "crashes.py")})
    said, interrupts = [], []

    def say(text):
        said.append(text)
        if "has not answered" in text:
            interrupts.append("SIGINT")

    with pytest.raises(Interrupted, match="called the controller mine"):
        supervise.run(scene, duration=0.5, record=False, say=say, interrupts=interrupts)
    assert said == ["the plant rehearses the run; the controller mine has not answered for 0.5 s. Ctrl-C ends it"]


def test_a_folder_that_may_not_be_written_is_told_before_the_run(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write everywhere
    with pytest.raises(UsageError, match=r"recordings/runs cannot be written: .*; name a file with --out"):
        supervise.run(scenes.load("belt"), duration=0.1, say=lambda _: None)
