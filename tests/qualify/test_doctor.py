"""What the doctor says of a machine, and what the warm-up compiles."""

import json
import os

import numpy as np
import pytest

import rig
from rig.analysis.pool import kernel_shapes
from rig.compiled import kernel
from rig.qualify.doctor import Spread, doctor, judge, warmup

SCENES = ("belt", "brake_active", "north")
PUNCTUAL = np.full(1000, 60_000)


def late(share):
    found = PUNCTUAL.copy()
    found[: round(share * len(found))] = 5_000_000
    return found


@pytest.fixture(scope="module")
def report():
    before = os.sched_getscheduler(0)
    told = []
    found = doctor(0.2, told.append, SCENES)
    assert os.sched_getscheduler(0) == before
    assert len(told) == 3
    return found


def test_an_examination_is_plain(report):
    told = json.loads(json.dumps(report.to_json()))
    assert [row["scene"] for row in told["scenes"]] == list(SCENES)
    assert all(row.scene in report.text() for row in report.scenes)
    assert report.fault == ""
    assert report.bus.count > 0
    assert 5.0 < report.bus.p50 > report.put.p50
    assert report.sleep.p50 > 0.0
    assert report.hybrid.p50 >= 0.0


@pytest.mark.parametrize(("share", "verdict"), [(0.0, "VALID"), (0.01, "VALID"), (0.03, "DEGRADED"), (0.06, "INVALID")])
def test_the_verdict_follows_the_share_of_late_frames(share, verdict):
    assert judge(rig.load("belt"), np.full(100, 30_000), late(share), None).verdict == verdict


def test_frames_that_fill_their_time_are_invalid_a_longer_frame_helps_and_what_is_published_counts():
    costs = np.full(100, 900_000)
    tight = judge(rig.load("belt"), costs, PUNCTUAL, None)
    assert tight.verdict == "INVALID"
    assert "a longer clock.frame" in tight.reason
    assert judge(rig.load("belt", {"clock.frame": "2 ms"}), costs, PUNCTUAL, None).verdict == "VALID"
    put = Spread.of(np.full(10, 400_000))
    assert judge(rig.load("belt"), np.full(100, 30_000), PUNCTUAL, put).verdict == "INVALID"


def test_a_scene_that_is_slow_is_judged_at_its_own_pace():
    costs = np.full(2000, 900_000)
    slow = judge(rig.load("brake", {"clock.pace_limit": 0.5}), costs, PUNCTUAL, None)
    assert slow.verdict == "VALID"
    assert "at most 0.5" in slow.reason
    assert judge(rig.load("brake"), costs, PUNCTUAL, None).verdict == "INVALID"


def test_a_scene_without_kernels_is_not_judged():
    found = judge(rig.load("belt"), None, PUNCTUAL, None)
    assert found.verdict == "unknown"
    assert "rig tool warmup" in found.reason


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    called = []
    monkeypatch.setattr(kernel.FOLDER, "path", tmp_path)
    for way in ("run_briefly", "analyse_briefly"):
        monkeypatch.setattr(kernel_shapes, way, lambda scene: called.append(scene.name))
    return called


def test_two_workers_seldom_need_the_same_new_kernels_at_a_time(compiled, monkeypatch):
    """Consecutive shapes have different methods, as long as there are two; the film comes last of the first ones."""
    by_shape = {kernel_shapes.shape(rig.load(name)): rig.load(name) for name in ("belt", "pendulum", "plate", "belt_c")}
    monkeypatch.setattr(kernel_shapes, "compile_all", lambda missing, *_: called.extend(missing))
    called: list[kernel_shapes.Shape] = []
    kernel_shapes.prepare(by_shape.values())
    belt, pendulum, plate, belt_c = by_shape
    assert called == [belt_c, belt, plate, pendulum]


def test_every_shipped_scene_is_ready_after_a_warm_up(compiled, shipped, monkeypatch):
    monkeypatch.setattr("rig.qualify.torture.cells.needed", lambda: [])  # of the torture test
    monkeypatch.setattr(rig.scenes, "load", dict(zip(rig.scenes.names(), shipped)).get)
    warmup()
    assert {*map(kernel_shapes.shape, shipped)} <= kernel_shapes.ready()
    tight = [*map(kernel_shapes.analysed_shape, shipped)]
    assert {*tight} <= kernel_shapes.ready()
    assert any(kind.long for kind in tight)
