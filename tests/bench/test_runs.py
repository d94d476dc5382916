"""Whole runs: plant, controller and recorder as processes over a private unix socket."""

import os
import re
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

import rig
from rig import bus, scenes
from rig.bench.again.replay import replay
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.outcome import Job
from rig.bench.live.plant_process import carry_out, warm
from rig.bench.run.simulate import Recorded, simulate
from rig.bus import address, messages
from rig.errors import BusError, Interrupted, UsageError
from rig.record.message_scan import Scan
from rig.view.process import TOPICS

SCENE = "belt_normal_force"


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
    left = [one for one in psutil.Process().children(recursive=True) if one not in before and one.is_running()]
    for one in left:
        one.kill()
    psutil.wait_procs(left, 5.0)
    assert not left


def ended(processes, seconds):
    """How long it took until none of the processes lived [s]."""
    begin = time.monotonic()
    _, alive = psutil.wait_procs(processes, seconds)
    assert not alive
    return time.monotonic() - begin


def same_bits(log, run):
    for name, known in run.measurements.items():
        assert log.measurements[name].v.tobytes() == known.v.tobytes()
        assert np.array_equal(log.measurements[name].t_ns, known.t_ns)
    at = np.searchsorted(run.time, log.time - 1e-9)
    for name, values in log.signals.items():
        assert values.tobytes() == run.signals[name][at].tobytes()
    for name, known in run.commands.items():
        assert log.commands[name].values.tobytes() == known.values.tobytes()
        assert np.array_equal(log.commands[name].tick, known.tick)


@pytest.mark.alone
def test_lockstep_gives_the_bits_of_a_run_in_one_process_on_a_busy_machine(folder):
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        in_lockstep(folder, scenes.load(SCENE), 2.0)
    finally:
        for process in busy:
            process.kill()
            process.wait()


@pytest.mark.parametrize(
    ("name", "changes", "duration"),
    [
        ("brake_active", {"controllers.nb.where": "process"}, 0.12),
        ("brake_active", {}, 0.15),
        ("brake_shunt_listener", {}, 0.2),
        ("plate", {"plate.damping_ratio": 0.0}, 0.3),
    ],
    ids=["20 kHz", "20 kHz in the plant's process", "every sample", "a film that opens"],
)
def test_in_lockstep_a_loop_at_20_khz_and_one_that_hears_every_sample_have_them_too(folder, name, changes, duration):
    in_lockstep(folder, scenes.load(name, changes), duration)


@pytest.mark.alone
def test_a_loop_at_20_khz_runs_live(folder):
    """The squeal of the brake is damped at the pace of the wall clock, with the bits of a run in one process."""
    scene = scenes.load("brake_active")
    outcome = Going(scene, duration=1.0, out=folder / "run.mcap").wait(100.0)
    timing = outcome.summary["timing"]
    assert (timing["each"], timing["frames"], timing["given_up"]) == (20, 1001, 0)
    assert outcome.summary["lost"] == {}
    assert outcome.summary["faults"] == []
    log = rig.open(folder / "run.mcap")
    assert log.commands["nb"].tick.tolist() == [*range(20_000)]
    same_bits(log, simulate(scene, duration_ns=10**9))
    assert verify(folder / "run.mcap").identical
    assert np.abs(log.measurements["vibrometer"].v[-2000:]).max() < 1e-3
    sent = Counter(record.topic for record in Scan(folder / "run.mcap"))
    assert sent["applied/nb"] <= 1001
    assert sent["act/nb"] == 0
    if timing["stolen_share"] > 0.02 and outcome.summary["verdict"] == "INVALID":
        pytest.skip(f"the host took {timing['stolen_share']:.1%} of the processors: the pace cannot be judged")
    assert outcome.summary["verdict"] != "INVALID", outcome.text()


def test_a_recording_of_one_in_the_plants_process_is_replayed_into_a_process(folder):
    """It was asked in every frame, and only one step in ten went over the bus."""
    fine = {"clock.frame": "0.1 ms", "controllers.nf.period": "0.1 ms", "controllers.nf.enable_at": "0.05 s"}
    scene = scenes.load(SCENE, {**fine, "controllers.nf.where": "plant"})
    going = Going(scene, pace=None, duration=0.3, out=folder / "run.mcap")
    assert going.wait(100.0).exit_code == 0
    found = replay(folder / "run.mcap", ["nf"])
    assert found.divergence is None
    assert found.compared == {"nf": 3000}
    assert (found.unanswered, found.fault) == (0, "")


def test_a_controller_cannot_be_started_beside_the_one_in_the_plants_process(folder):
    going = Going(scenes.load(SCENE, {"controllers.nf.where": "plant"}), duration=30.0, record=False)
    going.line("begin: begins with nf")
    with pytest.raises(BusError, match=r"a controller nf is already connected to run"):
        bus.join(role="controller", name="nf")
    with bus.join(role="operator", name="test") as session:
        session.ask("cmd/plant", {"do": "stop"}, 5.0)
    assert going.wait(20.0).summary["ended"] == "stopped by an operator"


def in_lockstep(folder, scene, duration):
    """Run with the scene's controllers in processes of their own, then in this one: the same bits."""
    warm(scene)
    outcome = Going(scene, pace=None, duration=duration, out=folder / "run.mcap").wait(350.0)
    assert outcome.exit_code == 0, outcome.text()
    assert outcome.summary["lost"] == {}
    same_bits(rig.open(folder / "run.mcap"), simulate(scene, duration_ns=round(duration * 1e9)))


@pytest.fixture
def picture(folder, monkeypatch):
    """The file that a supervised viewer writes, in place of a window: there is no screen here."""
    plain = supervise.RunProcesses.arguments

    def into_file(team, role, name):
        return [*plain(team, role, name), *(["--save", str(folder / "run.rrd")] if role == "viewer" else [])]

    monkeypatch.setattr(supervise.RunProcesses, "arguments", into_file)
    return folder / "run.rrd"


@pytest.mark.alone
def test_a_paced_run_loses_nothing(folder, picture):
    scene = scenes.load(SCENE, {"sensors.vibrometer.rate": "10 kHz"})
    going = Going(scene, duration=3.0, view=True, out=folder / "run.mcap")
    outcome = going.wait(100.0)
    assert outcome.summary["lost"] == {}, outcome.text()
    records = list(Scan(folder / "run.mcap"))
    recorded = Counter(record.topic for record in records)
    told = [messages.decode(record.topic, record.payload) for record in records if record.topic == "total/plant"][-1]
    sent = dict(zip(told.sent_topic, told.sent))
    assert {"step", "state", "health", "event/plant", "applied/nf", "meas/vibrometer"} < set(sent)
    assert {topic: recorded[topic] for topic in sent} == sent | {"total/plant": sent["total/plant"] + 1}  # this one too
    shown = sum(count for topic, count in recorded.items() if any(fnmatch(topic, one) for one in TOPICS))
    shown += recorded["state"] - 1  # the extremes of all outputs since the state before, which are not recorded
    assert f"viewer: the plant left; {shown} messages shown, none dropped" in going.lines
    assert picture.stat().st_size > 0
    assert outcome.died == ()
    assert outcome.summary["verdict"] in ("VALID", "DEGRADED", "INVALID")
    assert outcome.summary["timing"]["frames"] == 3001
    log = rig.open(folder / "run.mcap")
    assert not log.fault
    assert len(log.measurements["vibrometer"].v) == 30_001
    assert log.summary["verdict"] == outcome.summary["verdict"]
    assert log.summary["timing"] == outcome.summary["timing"]
    again = simulate(scene, {}, 3 * 10**9, Recorded(log.commands))
    same_bits(log, again)


@pytest.mark.alone
def test_the_plant_goes_on_without_the_others_and_a_second_run_beside_is_not_touched(folder, picture):
    first = Going(scenes.load(SCENE), duration=100.0, view=True, out=folder / "first.mcap", name="first")
    second = Going(scenes.load("belt"), duration=4.0, out=folder / "second.mcap", name="second")
    first.line("begins with nf, recorder, viewer")
    time.sleep(1.0)  # something has been written by then
    victims = {
        "controller nf": "rig.controllers.runtime.process",
        "recorder": "record",
        "viewer": "view",
    }
    for who, word in victims.items():
        first.process(f"{word} first").send_signal(signal.SIGKILL)
        first.line(f"{who} was killed by SIGKILL; the plant continues")
        first.line(f"{who} left at t = ")
    first.line("load.force to safe values")
    with bus.join("first", role="operator", name="test") as session:
        session.ask("cmd/plant", {"do": "stop"}, 5.0)
    outcome, other = first.wait(60.0), second.wait(60.0)
    assert outcome.summary["ended"] == "stopped by an operator"
    assert outcome.summary["verdict"] != "VALID"
    told = " ".join(outcome.summary["faults"])
    assert "controller nf left at t = " in told
    assert "recorder left at t = " in told
    assert "viewer" not in told  # it may come and go; the summary tells that it was killed
    assert all(f"{who} was killed by SIGKILL" in outcome.text() for who in victims)
    assert outcome.summary["loop"]["nf"]["safe"] > 0
    assert rig.open(folder / "first.mcap").time[-1] > 0.0
    assert (other.summary["ended"], other.died, other.summary["lost"]) == ("done", (), {})
    assert rig.open(folder / "second.mcap").time[-1] == 4.0


def test_nobody_outlives_the_plant(folder, picture):
    going = Going(scenes.load(SCENE), duration=60.0, view=True, out=folder / "run.mcap", name="killed")
    going.line("begins with nf, recorder, viewer")
    begun = time.monotonic()
    others = [going.process(f"{word} killed") for word in ("rig.controllers.runtime.process", "record", "view")]
    plant = going.process("rig.bench.live.plant_process")
    time.sleep(2.0)
    plant.send_signal(signal.SIGKILL)
    lived = time.monotonic() - begun
    assert ended(others, 5.0) < 3.0
    outcome = going.wait(20.0)
    assert outcome.exit_code == 1
    assert outcome.summary["verdict"] == "INVALID"
    assert "killed by SIGKILL" in outcome.text()
    assert rig.open(folder / "run.mcap").time[-1] > lived - 0.5
    assert address.list_runs() == []


def test_a_plant_that_was_held_up_says_so(folder):
    going = Going(scenes.load(SCENE), duration=2.0, out=folder / "run.mcap", name="held")
    going.line("begins with nf, recorder")
    plant = going.process("rig.bench.live.plant_process")
    plant.suspend()
    time.sleep(1.0)
    plant.resume()
    outcome = going.wait(20.0)
    assert outcome.summary["verdict"] == "INVALID"
    assert outcome.exit_code == 3
    assert outcome.summary["timing"]["given_up"] > 900
    assert any("s of the wall clock passed without a frame" in fault for fault in outcome.summary["faults"])
    assert outcome.summary["wall_seconds"] > 2.9  # no burst to make up for it
    assert outcome.summary["ticks"] == 2000


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
    deadline = time.monotonic() + 30.0
    while not (others := psutil.Process(starting.pid).children()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    starting.send_signal(signal.SIGINT)
    out, err = starting.communicate(timeout=20.0)
    assert (starting.returncode, out) == (130, "")
    assert err == "stopped by SIGINT before the first frame\n"
    ended(others, 5.0)


def test_ctrl_c_while_others_are_waited_for(folder):
    scene = scenes.load(SCENE)
    job = Job(scene.to_json(), run="waits", expect=(("controller", "nf"),), wait=60.0)

    def say(text):
        if text == "waiting for controller nf":
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted, match="stopped by SIGINT before the first frame"):
        carry_out(job, say)
    assert address.list_runs() == []


def test_ctrl_c_ends_a_run_in_order(folder, supervisor):
    supervisor.send_signal(signal.SIGINT)
    out, err = supervisor.communicate(timeout=20.0)
    assert supervisor.returncode in (3, 130), (out, err)
    assert "stopped by SIGINT" in out
    assert "none lost" in out
    assert not rig.open(folder / "run.mcap").fault


def test_nobody_outlives_the_supervisor(folder, supervisor):
    others = psutil.Process(supervisor.pid).children(recursive=True)
    assert len(others) == 3
    supervisor.kill()
    assert ended(others, 10.0) < 5.0
    assert not rig.open(folder / "run.mcap").fault


def test_a_plant_that_cannot_begin_says_why(folder):
    scene = scenes.load(SCENE, {"clock.limit": "1e-3"})
    with pytest.raises(UsageError, match="the state has left the limit") as fault:
        supervise.run(scene, duration=1.0, say=lambda _: None)
    assert fault.value.exit_code == 4


def test_a_controller_that_cannot_begin_is_not_waited_for(folder, monkeypatch):
    arguments = supervise.RunProcesses.arguments
    stranger = {"controller": "stranger"}
    monkeypatch.setattr(
        supervise.RunProcesses, "arguments", lambda run, *who: arguments(run, who[0], stranger.get(*who))
    )
    going = Going(scenes.load(SCENE), duration=0.5, out=folder / "run.mcap")
    outcome = going.wait(60.0)
    assert outcome.summary["ended"] == "done"
    assert outcome.summary["faults"] == ["controller nf was not here when the run began"]
    assert any("stranger" in line for line in going.lines)


def test_a_recording_that_cannot_be_written_is_no_reason_to_begin_without_the_controller(folder):
    scene = scenes.load(SCENE)
    (folder / "file").write_text("in the way")
    going = Going(scene, duration=0.5, out=folder / "file" / "run.mcap")
    outcome = going.wait(60.0)
    assert outcome.summary["ended"] == "done"
    assert outcome.summary["faults"] == ["recorder was not here when the run began"]
    assert any("run.mcap cannot be written" in line for line in going.lines)
    assert outcome.exit_code == 1 or outcome.summary["verdict"] == "INVALID"


def stalled(scene, path, who, seconds):
    """The outcome and the recording of a run in which one process was stopped for a while."""
    going = Going(scene, duration=seconds + 2.0, out=path)
    going.line("begin: ")
    time.sleep(0.5)
    process = going.process(who)
    process.suspend()
    time.sleep(seconds)
    process.resume()
    outcome = going.wait(60.0)
    return outcome, rig.open(path)


@pytest.mark.alone
def test_a_plant_that_hung_for_three_seconds_has_lost_nobody(folder, tmp_path):
    outcome, run = stalled(scenes.load(SCENE), tmp_path / "run.mcap", "rig.bench.live.plant_process", 3.0)
    assert outcome.died == ()
    summary = outcome.summary
    (passed,) = [fault for fault in summary["faults"] if "of the wall clock passed without a frame" in fault]
    assert float(passed.split()[0]) >= 2.9
    assert any("passed without a frame" in reason for reason in summary["reasons"])
    assert summary["lost"] == {}
    assert summary["verdict"] != "VALID"
    assert verify(tmp_path / "run.mcap").passed
    (pause,) = [event for event in run.events if event["kind"] == "pause"]
    answered = run.commands["nf"].tick
    assert np.count_nonzero(answered > pause["tick"] + 100) > 1000


@pytest.mark.parametrize("who", ["rig.controllers.runtime.process nf", "rig record"])
def test_a_process_that_hung_for_three_seconds_takes_part_again(folder, tmp_path, who):
    outcome, run = stalled(scenes.load(SCENE), tmp_path / "run.mcap", who, 3.0)
    assert outcome.died == ()
    assert verify(tmp_path / "run.mcap").passed == (not outcome.summary["lost"])
    assert not any("left at" in fault for fault in outcome.summary["faults"])
    assert run.commands["nf"].tick[-1] > outcome.summary["ticks"] - 100


@pytest.mark.slow
def test_a_plant_that_hung_for_longer_than_connections_last_is_joined_again(folder, tmp_path):
    outcome, run = stalled(scenes.load(SCENE), tmp_path / "run.mcap", "rig.bench.live.plant_process", 34.0)
    faults = outcome.summary["faults"]
    assert any(fault.startswith("controller nf was away from t = ") for fault in faults), faults
    assert any(fault.startswith("recorder was away from t = ") for fault in faults), faults
    (told,) = outcome.died  # the recorder, of what was sent while it had no connection
    assert re.search(r"recorder ended with code 1: .* messages, [1-9][0-9]* lost, ", told), told
    assert any(topic.endswith(" to recorder") and count > 0 for topic, count in outcome.summary["lost"].items())
    assert run.commands["nf"].tick[-1] > outcome.summary["ticks"] - 100
