"""Runs that are started, changed and ended from the page: plant, controller and recorder are processes."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from full_disk import largest_file

import rig as package
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live.plant_process import warm

ROOT = Path(__file__).parents[2]
SCENE = "belt_normal_force"


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm(scenes.load(SCENE))


def test_a_run_is_started_watched_changed_and_stopped_and_its_recording_verified(client, another, listen, folder, rig):
    pages = [listen(), listen()]
    refused = client.post("/api/run", scene=SCENE, changes={"load.force": -3})
    assert (refused.status_code, refused.json()["error"].splitlines()[1]) == (
        422,
        "  load.force = -3: must be at least 0 N (given on the page)",
    )
    assert client.post("/api/run/command", do="pause").json() == {"error": "no run is active; start one first"}
    assert client.post("/api/run", scene=SCENE, changes={"load.force": "21 N"}).status_code == 200
    twice = another.post("/api/run", scene=SCENE)
    assert twice.status_code == 422
    assert "is active; stop it first" in twice.json()["error"]
    client.until("running")
    run = client.state()["run"]
    assert client.post("/api/run", scene=SCENE).status_code == 422
    assert listen().until("setup")["run"] == run  # what is refused takes nothing from the pages
    given = shlex.split(client.state()["command"])
    assert given[:3] == ["rig", "run", SCENE]
    assert rig("explain", *given[2:], "--json")[0] == 0  # its options are those of the command line
    nice = [
        one.nice()
        for one in psutil.Process().children(recursive=True)
        if {"rig.bench.live.plant_process", "nf"} & {*one.cmdline()}
    ]
    assert nice == [psutil.Process().nice()] * 2  # and not that of the threads that serve pages

    values = {one["key"]: one for one in pages[0].until("values")}
    assert values["load.force"]["value"] == 21.0
    assert values["controllers.nf.gain"]["value"] == 200.0
    assert (
        another.post("/api/run/set", key="drive.speed", value="70 mm/s", run=run).json()["values"]["drive.speed"]
        == 0.07
    )
    assert client.post("/api/run/set", key="controllers.nf.gain", value=150, run=run).status_code == 200
    assert client.post("/api/run/set", key="load.force", value=-1, run=run).json()["error"] == (
        "load.force = -1: must be 0 to 100000 N"
    )
    assert (
        "did you mean friction.mu_static"
        in client.post("/api/run/set", key="friction.mu_statc", value=1).json()["error"]
    )
    assert client.post("/api/run/command", do="knock", impulse=0.05, run=run).status_code == 200
    assert client.post("/api/run/command", do="knock", impulse="hard", run=run).status_code == 422
    assert client.post("/api/run/command", do="disconnect", controller="nf", run=run).status_code == 200
    old = client.post("/api/run/command", do="stop", run="belt-of-yesterday").json()["error"]
    assert "this page shows the run belt-of-yesterday, which has ended" in old
    assert client.post("/api/run/command", do="fly", run=run).status_code == 422

    assert client.post("/api/run/command", do="pause", run=run).status_code == 200
    assert client.state()["phase"] == "paused"
    stepped = [client.post("/api/run/command", do="step", run=run).json()["tick"] for _ in range(3)]
    assert stepped[0] <= stepped[1] <= stepped[2] <= stepped[0] + 2
    client.post("/api/run/command", do="resume", run=run)
    time.sleep(1.0)
    client.post("/api/run/command", do="stop", run=run)
    again = client.post("/api/run/command", do="stop", run=run).json()
    assert again in ({}, {"error": "no run is active; start one first"})  # the second on a slow machine
    ended = client.until("ended", 30.0)
    assert ended["outcome"]["ended"] == "stopped by an operator"
    assert ended["fault"] == ""
    time.sleep(0.3)
    for page in pages:
        assert page.newest["state"]["phase"] == "ended"
        assert page.newest["setup"]["run"] == run
        found = {one["key"]: one["value"] for one in page.newest["values"]}
        assert found["drive.speed"] == 0.07
        assert found["controllers.nf.gain"] == 150
        times = [t for frame in page.frames for t in frame.get("rows", {}).get("t", [])]
        assert times == sorted(times)
        assert len(times) > 100
        kinds = [event["kind"] for frame in page.frames for event in frame.get("events", [])]
        assert {"begin", "parameter", "knock", "disconnected", "paused", "single_step", "resumed", "stop"} <= {*kinds}
    log = folder / "recordings" / "runs" / ended["log"]
    found = verify(log)
    assert found.passed, found.text()


def test_an_emergency_stop_sets_the_safe_values_and_ends_the_run(client, listen):
    page = listen()
    client.post("/api/run", scene="belt")
    client.until("running")
    for value in (None, True, "", "status", "admit", [], ["stop"], {}, {"stop": 1}, "\0", 10**400):
        for body in ({"do": value}, {"do": "knock", "impulse": value}, {"do": "connect", "controller": value}):
            refused = client.post("/api/run/command", **body)
            assert refused.status_code == 422, (body, refused.text)
        for body in ({"key": value, "value": 1}, {"key": "drive.speed", "value": value}):
            refused = client.post("/api/run/set", **body)
            assert refused.status_code == 422, (body, refused.text)
    assert client.state()["phase"] == "running"
    assert client.post("/api/run/command", do="emergency").status_code == 200
    ended = client.until("ended", 30.0)
    assert ended["outcome"]["fault"] == "emergency stop by an operator"
    time.sleep(0.3)
    assert "emergency" in [event["kind"] for frame in page.frames for event in frame.get("events", [])]


def test_a_killed_plant_is_told_and_another_run_can_start(client):
    client.post("/api/run", scene="belt")
    client.until("running")
    plant = next(
        one
        for one in psutil.Process().children(recursive=True)
        if "rig.bench.live.plant_process" in " ".join(one.cmdline())
    )
    os.kill(plant.pid, signal.SIGKILL)
    ended = client.until("ended", 40.0)
    assert "the plant was killed by SIGKILL" in ended["outcome"]["text"]
    assert ended["outcome"]["ended"] == "the plant died"
    assert client.post("/api/run", scene="belt").status_code == 200
    client.until("running")


def test_the_verdict_so_far_counts_what_the_last_one_counts(client, listen):
    """A controller that is killed makes no frame late, and yet the run is not VALID."""
    page = listen()
    client.post("/api/run", scene=SCENE)
    client.until("running")
    before = page.until("status")
    assert set(before) >= {"verdict", "reasons", "step", "paused", "pace"}
    assert before["pace"] == 1.0
    nf = next(one for one in psutil.Process().children(recursive=True) if "nf" in one.cmdline())
    os.kill(nf.pid, signal.SIGKILL)
    page.until("status", lambda one: any("controller nf left at" in why for why in one["reasons"]), 20.0)
    assert page.newest["status"]["verdict"] in ("DEGRADED", "INVALID")
    client.post("/api/run/command", do="stop")
    ended = client.until("ended", 30.0)
    assert any("controller nf left at" in why for why in ended["outcome"]["reasons"])


def test_a_run_that_ends_by_itself_is_ending_and_a_stop_then_waits_for_nothing(client, listen):
    page = listen()
    client.post("/api/run", scene="belt", duration=0.5)
    page.until("state", lambda state: state["phase"] in ("ending", "ended"), 60.0)
    begin = time.monotonic()
    client.post("/api/run/command", do="stop")
    assert time.monotonic() - begin < 5.0
    client.until("ended", 30.0)
    page.until("state", lambda state: state["phase"] == "ended")
    assert page.phases.index("ending") < page.phases.index("ended")
    assert client.state()["outcome"]["ended"] != "stopped by an operator"


@pytest.fixture
def elsewhere(folder):
    """A run of the belt in another terminal."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rig", "run", "belt", "--duration", "300"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    yield process
    process.kill()
    process.communicate()


def test_a_run_of_another_terminal_is_followed_changed_left_and_stopped(client, another, listen, server, elsewhere):
    page = listen()
    deadline = time.monotonic() + 60.0
    while not (found := client.get("/api/live").json()):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    ((run, why),) = [(one["run"], one["why"]) for one in found]
    assert why == ""
    assert (
        "no run is called belt-of-yesterday" in client.post("/api/run/follow", run="belt-of-yesterday").json()["error"]
    )
    assert client.post("/api/run/leave").json() == {"error": "no run of another terminal is followed"}
    assert client.post("/api/run/follow", run=run).status_code == 200
    client.until("running")
    assert another.get("/api/live").json() == []
    assert "stop following it first" in another.post("/api/run", scene="belt").json()["error"]
    page.until("setup", lambda one: one["run"] == run)
    page.until("status", lambda one: one["pace"] == 1.0)
    assert client.post("/api/run/set", key="drive.speed", value=0.07, run=run).json()["values"]["drive.speed"] == 0.07
    client.post("/api/run/command", do="pause", run=run)
    assert client.post("/api/run/leave").status_code == 200
    client.until("ended")
    assert elsewhere.poll() is None

    client.post("/api/run/follow", run=run)
    client.until("paused")  # as it was left
    server.bench.control.end()  # at the end of the server
    client.until("ended")
    assert elsewhere.poll() is None
    client.post("/api/run/follow", run=run)
    client.until("paused")
    client.post("/api/run/command", do="resume", run=run)
    client.until("running")
    client.post("/api/run/command", do="stop", run=run)
    ended = client.until("ended", 30.0)
    assert ended["outcome"]["ended"] == "stopped by an operator"
    elsewhere.wait(30.0)


def test_a_recording_that_cannot_be_written_is_told(client, folder):
    (folder / "recordings").write_text("no folder")
    client.post("/api/run", scene="belt", duration=1.0)
    ended = client.until("ended")
    told = ended["fault"] or ended["outcome"]["text"]
    assert "recordings" in told
    assert ended["fault"] or ended["outcome"]["unrecorded"]


def test_a_disk_that_fills_during_a_run_is_told_and_the_run_goes_on(client, listen, folder):
    page = listen()
    with largest_file(150_000):
        client.post("/api/run", scene="belt")
        client.until("running")
        page.until("status", lambda one: any("recorder" in why for why in one["reasons"]), 40.0)
        assert page.newest["status"]["verdict"] in ("DEGRADED", "INVALID")
        before = page.frames[-1]["t"]
        page.until("state", lambda _: page.frames[-1]["t"] > before + 0.5)
        client.post("/api/run/command", do="stop")
        ended = client.until("ended", 60.0)
    assert ended["outcome"]["unrecorded"]
    (why,) = ended["outcome"]["died"]
    assert "cannot be written: File too large" in why
    assert "rig recover saves this part" in why
    assert why in ended["outcome"]["text"]
    (log,) = (folder / "recordings" / "runs").glob("*.mcap")
    assert len(package.open(log).time) > 10


def test_a_run_that_is_stopped_while_it_starts_leaves_nothing(client):
    client.post("/api/run", scene="belt")
    client.post("/api/run/command", do="stop")
    ended = client.until("ended", 30.0)
    assert "before the first frame" in ended["fault"] or ended["outcome"]


def test_a_suspended_page_costs_the_others_nothing_and_gets_what_is_newest(client, listen):
    page = listen()
    with client.socket() as suspended:  # it reads nothing
        client.post("/api/run", scene="belt", duration=3.0)
        client.until("ended")
        time.sleep(0.3)
        got = []
        while True:
            try:
                got.append(json.loads(suspended.recv(0.3)))
            except TimeoutError:
                break
            suspended.send(json.dumps({"ack": len(got)}))
    assert len([one for one in got if one["kind"] == "frames"]) <= 3
    assert next(one for one in reversed(got) if one["kind"] == "state")["state"]["phase"] == "ended"
    assert page.frames[-1]["t"] > 2.9


@pytest.mark.parametrize("body", [b"", b"{", b"[1]", b"null", b"5", b"[" * 10**5, b'"' + b"x" * (2 << 20) + b'"'])
def test_a_request_that_is_no_object_is_refused(client, body):
    found = client.http.post("/api/run", content=body)
    assert found.status_code == 422
    assert "the request is" in found.json()["error"]


def test_a_page_that_listens_gets_every_sample_of_the_sensor_in_order(client, listen):
    page = listen()
    client.post("/api/run", scene=SCENE, changes={"sensors.vibrometer.rate": 10_000}, duration=60.0)
    client.until("running")
    assert "vibrometer" in page.until("setup")["sound"]["sensors"]
    with client.socket(path="/sound/vibrometer") as socket, client.socket(path="/sound/nothing") as silent:
        begins, ends = [], []
        for _ in range(10):
            message = socket.recv(20.0)
            socket.send("")
            begins.append(np.frombuffer(message[:8], "<f8")[0])
            samples = np.frombuffer(message[8:], "<f4")
            ends.append(begins[-1] + samples.size / 10_000)
        np.testing.assert_allclose(begins[1:], ends[:-1], atol=1e-9)
        assert np.isfinite(samples).all()
        assert samples.any()
        with pytest.raises(TimeoutError):
            silent.recv(0.1)
    client.post("/api/run/command", do="stop")
    client.until("ended")
