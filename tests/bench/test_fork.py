"""A recording is continued from one of its instants: without changes the same bits, with changes from there on."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from plant_in_thread import recorded

import rig
from rig.bench.again.agreement import ELSEWHERE, ROUNDED, changed_place
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.errors import LogError, UsageError
from rig.record.compare import compare

# name, changes, duration [s], instant [s]
CASES = [  # more with checkpoints: tests/bench/test_checkpoint.py
    ("pendulum", {"friction.mu_static": "0.45"}, 12.0, 11.3),  # a protocol that connects a controller, noisy sensors
    ("belt_slow_card", {}, 2.0, 1.225),  # commands on their way at the instant
    ("plate", {}, 0.02, 0.01),  # a film, the method kick
]

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden"
ON = {"controllers.nf.enable_at": "0.1 s"}


@pytest.fixture(scope="module")
def belt(tmp_path_factory):
    """A recording of 2 s with a controller."""
    return recorded(tmp_path_factory.mktemp("belt"), rig.simulate(rig.load("belt_normal_force", ON), 2.0))


@pytest.mark.parametrize(("name", "changes", "duration", "at"), CASES, ids=[case[0] for case in CASES])
def test_without_changes_it_has_the_bits_of_the_uninterrupted_run(tmp_path, name, changes, duration, at):
    whole = rig.simulate(rig.load(name, changes), duration)
    short = rig.simulate(rig.load(name, changes), at)
    log = recorded(tmp_path, short)
    for start in (None, 0.5 * at):
        length = round(duration * 1e9) - round((start or at) * 1e9)
        found = fork(log, start, duration_ns=length)
        same = compare(whole, found)
        assert same.identical, same
        assert found.energy == whole.energy
        assert [e for e in found.events if e["kind"] != "fork"] == whole.events


def test_a_change_acts_from_the_instant_on_and_the_fork_verifies_alone(belt, tmp_path):
    found = fork(belt, 1.25, {"drive.speed": "0.1 m/s", "controllers.nf.gain": 3.0}, 500_000_000)
    old = rig.open(belt)
    same = compare(old, found)
    assert min(one.time for one in same.differences if one.differing) >= 1.25
    here = found.time < 1.25
    assert (found.signals["velocity"][here] == old.signals["velocity"][:1250]).all()
    assert found.time[-1] == pytest.approx(1.75)
    assert not (found.signals["velocity"][~here] == old.signals["velocity"][1250:1751]).all()
    assert found.provenance["ancestor"] == belt.name
    assert found.provenance["instant_ns"] == "1250000000"
    assert len(found.provenance["ancestor_sha256"]) == 64
    log = recorded(tmp_path, found)
    belt_again = verify(log)
    assert belt_again.passed, belt_again.text()
    assert belt_again.identical
    # and it is continued like any other recording, from before and after its own fork
    for at in (0.9, 1.5):
        again = fork(log, at, duration_ns=round((1.75 - at) * 1e9))
        assert compare(found, again).identical is (at > 1.25)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"clock.frame": "2 ms"}, "clock.frame: is fixed while the rig runs"),
        ({"start.displacement": "1 mm"}, "start.displacement: is fixed while the rig runs"),
        ({"protocol": "none"}, "protocol: its steps go on as they are. For other steps change values one after the"),
        ({"controllers.nf": "none"}, "controllers.nf: name one value of a controller"),
        ({"controllers.fn.gain": 1.0}, "there is no such controller; known: nf"),
    ],
)
def test_what_cannot_change_in_the_middle_is_refused(belt, changes, words):
    with pytest.raises(UsageError) as refused:
        fork(belt, 1.0, changes, 10**8)
    assert words in str(refused.value)


@pytest.mark.parametrize("at", [0.0, 2.001, float("nan")])
def test_an_instant_outside_is_refused(belt, at):
    with pytest.raises(UsageError, match="up to its end at 2 s"):
        fork(belt, at, duration_ns=10**8)


def test_a_recording_that_does_not_repeat_is_refused(belt, tmp_path):
    run = rig.open(belt)
    run.signals["velocity"][300] = np.nextafter(run.signals["velocity"][300], 1.0)
    log = recorded(tmp_path, run)
    with pytest.raises(LogError, match=r"velocity differs at t = 0\.3 s"):
        fork(log, 1.0, duration_ns=10**8)
    assert fork(log, 0.25, duration_ns=10**8).time[-1] == pytest.approx(0.35)  # before the damage


def test_a_recording_that_breaks_off_is_continued_from_what_is_there(belt, tmp_path):
    log = tmp_path / "cut.mcap"
    data = belt.read_bytes()
    log.write_bytes(data[: len(data) // 2])
    assert rig.open(log).damage
    assert compare(fork(log, 0.25, duration_ns=10**9), rig.simulate(rig.load("belt_normal_force", ON), 1.25)).identical


def test_a_run_that_ended_by_itself_is_not_continued_from_its_end(tmp_path):
    scene = rig.load("belt", {"friction.mu_static": "0.45", "limits.displacement": "1 mm"})
    run = rig.simulate(scene, duration=2.0)
    log = recorded(tmp_path, run)
    with pytest.raises(UsageError, match=r"is beyond its limit .* name an instant before"):
        fork(log, duration_ns=10**8)


def test_changes_that_an_operator_made_to_a_controller_are_repeated(belt, tmp_path):
    run = rig.open(belt)
    told = {
        "t_ns": 499 * 10**6,
        "tick": 499,
        "source": "nf",
        "kind": "parameter",
        "text": "",
        "data": {"set": {"gain": 1e-3}, "after_tick": 499},
    }
    tuned = fork(belt, 0.5, {"controllers.nf.gain": 1e-3}, 10**9)
    live = recorded(tmp_path, dataclasses.replace(tuned, events=[*run.events, told]))  # as a live run records it
    assert compare(fork(live, 1.0, duration_ns=5 * 10**8), tuned).identical


@pytest.mark.parametrize("name", ["pendulum", "plate_free"])
def test_a_live_recording_is_continued(name, tmp_path):
    log = GOLDEN / f"{name}.mcap"
    run = rig.open(log)
    end = float(run.time[-1])
    found = fork(log, 0.6 * end, duration_ns=round(0.1 * end * 1e9))
    same = compare(run, found, end=0.6 * end)
    assert same.within(ELSEWHERE) if ROUNDED & {*changed_place(run)} else same.agree
    assert verify(recorded(tmp_path, found)).identical


def test_the_protocol_goes_on_and_without_steps_a_duration_is_needed(tmp_path):
    scene = rig.load("belt")
    log = recorded(tmp_path, rig.simulate(scene, 1.0))
    assert fork(log, 0.5).time[-1] == pytest.approx(scene.duration_ns * 1e-9)
    log = recorded(tmp_path, rig.simulate(dataclasses.replace(scene, protocol=()), 0.2))
    with pytest.raises(UsageError, match="state a duration"):
        fork(log)


def test_a_window_of_a_run_is_refused(belt, tmp_path, monkeypatch):
    run = dataclasses.replace(rig.open(belt), window="rms(vibrometer) > 0.2", begin_ns=500_000_000)
    monkeypatch.setattr("rig.record.reader.open", lambda path: run)
    with pytest.raises(UsageError, match=r"is a window of a run, from 0\.5 s on"):
        fork(belt, 1.0, duration_ns=10**8)
