"""Whole runs: plant, controller and recorder as processes over a private unix socket.

The machine may be busy: frames may then be late and messages lost, and the run has to say so. What a test expects is
compared with what the run tells, never with the clock.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import psutil
import pytest
from going import Going
from same_bits import same_bits

import rig
from rig import bus, scenes
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.plant_process import warm
from rig.bench.run.simulate import Recorded, simulate
from rig.bus import address, messages
from rig.errors import UsageError
from rig.record.message_scan import Scan
from rig.view.process import TOPICS

SCENE = "belt_normal_force"
CONTROLLER, PLANT = "rig.controllers.runtime.process", "rig.bench.live.plant_process"


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Nothing is compiled while a test waits."""
    for name in (SCENE, "belt"):
        warm(scenes.load(name))


@pytest.fixture
def folder(runs):
    """A directory of live runs; no process that the test has started is left."""
    before = set(psutil.Process().children(recursive=True))
    yield runs
    left = [child for child in psutil.Process().children(recursive=True) if child not in before and child.is_running()]
    for child in left:
        child.kill()
    psutil.wait_procs(left, 5.0)
    assert not left


def ended(processes):
    """Wait until none of the processes lives."""
    _, alive = psutil.wait_procs(processes, 30.0)
    assert not alive


@pytest.mark.parametrize(
    ("name", "changes", "duration"),
    [(SCENE, {"controllers.nf.enable_at": "0.2 s"}, 0.5), ("brake_shunt_listener", {}, 0.1)],
    ids=["", "every sample"],
)
def test_lockstep_gives_the_bits_of_a_run_in_one_process(folder, name, changes, duration):
    scene = scenes.load(name, changes)
    warm(scene)
    outcome = Going(scene, pace=None, duration=duration, out=folder / "run.mcap").wait(300.0)
    assert outcome.exit_code == 0, outcome.text()
    assert outcome.summary["lost"] == {}
    same_bits(rig.open(folder / "run.mcap"), simulate(scene, duration_ns=round(duration * 1e9)), {})


def test_a_loop_at_20_khz_runs_live_in_the_plants_process(folder):
    """The squeal of the brake is damped at the pace of the wall clock, with the bits of a run in one process."""
    scene = scenes.load("brake_active")
    outcome = Going(scene, duration=0.5, out=folder / "run.mcap").wait(300.0)
    timing, lost = outcome.summary["timing"], outcome.summary["lost"]
    assert (timing["each"], timing["frames"]) == (20, 501)
    run, log = simulate(scene, duration_ns=5 * 10**8), rig.open(folder / "run.mcap")
    same_bits(log, run, lost)
    assert lost or verify(folder / "run.mcap").identical
    assert run.commands["nb"].tick.tolist() == [*range(10_000)]
    assert np.abs(run.measurements["vibrometer"].v[-2000:]).max() < 1e-3
    sent = Counter(record.topic for record in Scan(folder / "run.mcap"))
    assert sent["applied/nb"] <= 501
    assert sent["act/nb"] == 0


@pytest.fixture
def picture(folder, monkeypatch):
    """The file that a supervised viewer writes, in place of a window: there is no screen here."""
    plain = supervise.RunProcesses.arguments

    def into_file(team, role, name):
        return [*plain(team, role, name), *(["--save", str(folder / "run.rrd")] if role == "viewer" else [])]

    monkeypatch.setattr(supervise.RunProcesses, "arguments", into_file)
    return folder / "run.rrd"


def test_everything_that_a_paced_run_sends_is_recorded_or_told_as_lost(folder, picture):
    scene = scenes.load(SCENE, {"sensors.vibrometer.rate": "10 kHz"})
    going = Going(scene, duration=1.5, view=True, out=folder / "run.mcap")
    outcome = going.wait(100.0)
    lost = outcome.summary["lost"]
    records = list(Scan(folder / "run.mcap"))
    recorded = Counter(record.topic for record in records)
    told = [messages.decode(record.topic, record.payload) for record in records if record.topic == "total/plant"][-1]
    sent = dict(zip(told.sent_topic, told.sent)) | dict.fromkeys(["total/plant"], recorded["total/plant"])
    assert {"step", "state", "health", "event/plant", "applied/nf", "meas/vibrometer"} < set(sent)
    missing = {f"{topic} to recorder": count - recorded[topic] for topic, count in sent.items()}
    assert {name: count for name, count in missing.items() if count} == {
        name: count for name, count in lost.items() if name.endswith(" to recorder")
    }
    if not lost:
        shown = sum(count for topic, count in recorded.items() if any(fnmatch(topic, pattern) for pattern in TOPICS))
        shown += recorded["state"] - 1  # the extremes of all outputs since the state before, which are not recorded
        assert f"viewer: the plant left; {shown} messages shown, none dropped" in going.lines
    assert picture.stat().st_size > 0
    assert outcome.died == ()
    log = rig.open(folder / "run.mcap")
    assert not log.fault
    assert outcome.summary["timing"]["frames"] == 1501
    assert (log.summary["verdict"], log.summary["timing"]) == (outcome.summary["verdict"], outcome.summary["timing"])
    if not lost:
        same_bits(log, simulate(scene, {}, 15 * 10**8, Recorded(log.commands)), lost)


def test_the_plant_goes_on_without_the_others_and_a_second_run_beside_is_not_touched(folder, picture):
    first = Going(scenes.load(SCENE), duration=100.0, view=True, out=folder / "first.mcap", name="first")
    second = Going(scenes.load("belt"), duration=1.0, out=folder / "second.mcap", name="second")
    first.line("begins with nf, recorder, viewer")
    with bus.join("first", role="operator", name="test") as session:
        states, file = session.subscribe("state"), folder / "first.mcap"
        begun = file.stat().st_size
        while states.get(20.0).t_ns < 5 * 10**8 or file.stat().st_size == begun:
            pass  # until something has been written
        for who, word in {
            "controller nf": CONTROLLER,
            "recorder": f"record {folder}/first.mcap",
            "viewer": "view",
        }.items():
            first.process(word).send_signal(signal.SIGKILL)
            first.line(f"{who} was killed by SIGKILL; the plant continues")
            first.line(f"{who} left at t = ")
        first.line("load.force to safe values")
        session.ask("cmd/plant", {"do": "stop"}, 20.0)
    outcome, other = first.wait(60.0), second.wait(60.0)
    assert outcome.summary["ended"] == "stopped by an operator"
    assert outcome.summary["verdict"] != "VALID"
    told = " ".join(outcome.summary["faults"])
    assert "controller nf left at t = " in told
    assert "recorder left at t = " in told
    assert "viewer" not in told  # it may come and go; the summary tells that it was killed
    assert all(f"{who} was killed by SIGKILL" in outcome.text() for who in ("controller nf", "recorder", "viewer"))
    assert outcome.summary["loop"]["nf"]["safe"] > 0
    assert rig.open(folder / "first.mcap").time[-1] > 0.0
    assert (other.summary["ended"], other.died) == ("done", ())
    assert rig.open(folder / "second.mcap").time[-1] == 1.0


def test_nobody_outlives_the_plant(folder, picture):
    going = Going(scenes.load(SCENE), duration=60.0, view=True, out=folder / "run.mcap", name="killed")
    going.line("begins with nf, recorder, viewer")
    others = [going.process(word) for word in (CONTROLLER, "record", "view")]
    with bus.join("killed", role="operator", name="test") as session:
        states = session.subscribe("state")
        while states.get(20.0).t_ns < 10**9:
            pass
    going.process(PLANT).send_signal(signal.SIGKILL)
    ended(others)
    outcome = going.wait(60.0)
    assert outcome.exit_code == 1
    assert outcome.summary["verdict"] == "INVALID"
    assert "killed by SIGKILL" in outcome.text()
    assert rig.open(folder / "run.mcap").time[-1] > 0.0
    assert address.list_runs() == []


def stalled(path, seconds, *who):
    """The outcome and the recording of a run in which processes were stopped for a while."""
    going = Going(scenes.load(SCENE), duration=seconds + 1.0, out=path)
    going.line("begin: ")
    time.sleep(0.2)
    processes = [going.process(words) for words in who]
    for process in processes:
        process.suspend()
    time.sleep(seconds)
    for process in processes:
        process.resume()
    outcome = going.wait(seconds + 60.0)
    return outcome, rig.open(path)


def test_a_plant_that_was_held_up_says_so_and_has_lost_nobody(folder):
    outcome, run = stalled(folder / "run.mcap", 2.0, PLANT)
    summary = outcome.summary
    assert (summary["verdict"], outcome.exit_code, outcome.died) == ("INVALID", 3, ())
    assert summary["ticks"] == 3000
    assert summary["timing"]["given_up"] > 1500
    assert summary["wall_seconds"] > 4.5  # no burst to make up for it
    (passed,) = [fault for fault in summary["faults"] if "of the wall clock passed without a frame" in fault]
    assert float(passed.split()[0]) >= 1.9
    longest = max((event for event in run.events if event["kind"] == "pause"), key=lambda e: e["data"]["late_ns"])
    assert np.any(run.commands["nf"].tick > longest["tick"] + 100)
    assert verify(folder / "run.mcap").passed == (not summary["lost"])


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_plant_that_is_held_up_all_the_time_does_not_grow(folder):
    """From minute 2 to minute 15 by at most 5 MB, with several pauses and safe values in each second."""
    going = Going(scenes.load(SCENE), duration=900.0, out=folder / "run.mcap")
    going.line("begin: ")
    plant, controller = going.process(PLANT), going.process(f"{CONTROLLER} nf")
    held, sizes, begun = random.Random(1), [], time.monotonic()
    while (minutes := (time.monotonic() - begun) / 60.0) < 15.0:
        time.sleep(held.uniform(0.02, 0.3))
        process = held.choice([plant, plant, controller])
        process.suspend()
        time.sleep(held.choice([0.005, 0.02, 0.06, 0.06, 0.15, 0.3]))
        process.resume()
        if minutes > 2.0:
            sizes.append(plant.memory_info().rss)
    os.kill(plant.pid, signal.SIGINT)
    outcome = going.wait(60.0)
    pauses = [event for event in rig.open(folder / "run.mcap").events if event["kind"] in ("pause", "safe", "back")]
    assert len(pauses) > 1000, outcome.text()
    assert max(sizes) - sizes[0] < 5e6


def test_processes_that_hung_take_part_again(folder):
    outcome, run = stalled(folder / "run.mcap", 2.0, f"{CONTROLLER} nf", "rig live record")
    assert outcome.died == ()
    assert verify(folder / "run.mcap").passed == (not outcome.summary["lost"])
    assert not any("left at" in fault for fault in outcome.summary["faults"])
    assert run.commands["nf"].answered[-1] > outcome.summary["ticks"] - 500


@pytest.fixture
def starting(folder):
    """A supervisor in a process of its own, its run not yet begun."""
    path = os.pathsep.join([str(Path(rig.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, "-m", "rig", "run", SCENE, "--duration", "60", "--out", str(folder / "run.mcap")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    yield process
    process.kill()
    process.communicate()


@pytest.fixture
def supervisor(starting):
    """The same, once its run has begun."""
    for line in starting.stderr:
        if "begins with" in line:
            break
    return starting


def test_ctrl_c_before_there_is_a_run_ends_everything_at_once(starting):
    deadline = time.monotonic() + 60.0
    while not (others := psutil.Process(starting.pid).children()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    starting.send_signal(signal.SIGINT)
    out, err = starting.communicate(timeout=60.0)
    assert (starting.returncode, out) == (130, "")
    assert err == "stopped by SIGINT before the first frame\n"
    ended(others)


def test_ctrl_c_ends_a_run_in_order(folder, supervisor):
    supervisor.send_signal(signal.SIGINT)
    out, err = supervisor.communicate(timeout=60.0)
    assert supervisor.returncode in (3, 130), (out, err)
    assert "stopped by SIGINT" in out
    assert not rig.open(folder / "run.mcap").fault


def test_nobody_outlives_the_supervisor(folder, supervisor):
    others = psutil.Process(supervisor.pid).children(recursive=True)
    assert len(others) == 3
    supervisor.kill()
    ended(others)
    assert not rig.open(folder / "run.mcap").fault


def test_a_plant_that_cannot_begin_says_why(folder):
    scene = scenes.load(SCENE, {"clock.limit": "1e-3"})
    with pytest.raises(UsageError, match="the state has left the limit") as fault:
        supervise.run(scene, duration=1.0, say=lambda _: None)
    assert fault.value.exit_code == 4
