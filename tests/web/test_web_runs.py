"""Runs that are started, changed and ended from the page: plant, controller and recorder are processes."""

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from patience import PATIENCE_S, wait_for

from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live.plant_process import warm

ROOT = Path(__file__).parents[2]
SCENE = "belt_normal_force"


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm(scenes.load(SCENE))


def process_of(word):
    return next(child for child in psutil.Process().children(recursive=True) if word in child.cmdline())


def test_a_run_is_started_watched_changed_and_stopped_and_its_recording_verified(client, another, listen, folder, rig):
    pages = [listen(), listen()]
    told = client.refused("/api/run", scene=SCENE, changes={"load.force": -3})
    assert told == f"{SCENE}: load.force = -3: must be at least 0 N (given on the page)"
    assert client.command("pause") == {"error": "no run is active; start one first"}
    assert client.post("/api/run", scene=SCENE, changes={"load.force": "21 N"}, duration=600.0).status_code == 200
    assert "is active; stop it first" in another.refused("/api/run", scene=SCENE)
    run = client.until("running")["run"]
    assert client.refused("/api/run", scene=SCENE)
    assert listen().until("setup")["run"] == run  # what is refused takes nothing from the pages
    given = shlex.split(client.state()["command"])
    assert (given[:3], given[-2:]) == (["rig", "run", SCENE], ["--duration", "600.0"])
    assert rig("explain", *given[2:-2], "--json")[0] == 0  # its options are those of the command line
    own = psutil.Process().nice()  # and not that of the threads that serve pages
    assert [process_of(word).nice() for word in ("rig.bench.live.plant_process", "nf")] == [own] * 2

    def values(page):
        return {entry["key"]: entry["value"] for entry in page.until("values")}

    assert (values(pages[0])["load.force"], values(pages[0])["controllers.nf.gain"]) == (21.0, 200.0)
    answer = another.post("/api/run/set", key="drive.speed", value="70,0 mm/s", run=run).json()
    assert answer["values"]["drive.speed"] == 0.07
    assert client.post("/api/run/set", key="controllers.nf.gain", value=150, run=run).status_code == 200
    assert client.post("/api/run/set", key="load.force", value="15,5", run=run).status_code == 200
    assert (
        client.refused("/api/run/set", key="load.force", value=-1, run=run) == "load.force = -1: must be 0 to 100000 N"
    )
    assert "did you mean friction.mu_static" in client.refused("/api/run/set", key="friction.mu_statc", value=1)
    assert "error" not in client.command("knock", impulse=0.05, run=run)
    assert "error" not in client.command("knock", impulse="0,05 N s", run=run)
    assert client.refused("/api/run/command", do="knock", impulse="hard", run=run)
    assert "error" not in client.command("disconnect", controller="nf", run=run)
    old = client.refused("/api/run/command", do="stop", run="belt-of-yesterday")
    assert "this page shows the run belt-of-yesterday, which has ended" in old

    assert "error" not in client.command("pause", run=run)
    assert client.state()["phase"] == "paused"
    stepped = [client.command("step", run=run)["tick"] for _ in range(3)]
    assert stepped[0] <= stepped[1] <= stepped[2] <= stepped[0] + 2
    client.command("resume", run=run)
    for page in pages:
        page.until_time(stepped[-1] * 1e-3 + 0.2)
    client.command("stop", run=run)
    assert client.command("stop", run=run) in ({}, {"error": "no run is active; start one first"})
    ended = client.until("ended")
    assert ended["outcome"]["ended"] == "stopped by an operator"
    assert ended["fault"] == ""
    for page in pages:
        page.until("state", lambda state: state["phase"] == "ended")
        page.until_events("begin", "parameter", "knock", "disconnected", "paused", "single_step", "resumed", "stop")
        assert page.newest["setup"]["run"] == run
        assert (values(page)["drive.speed"], values(page)["controllers.nf.gain"]) == (0.07, 150)
        times = [t for frame in page.frames for t in frame.get("rows", {}).get("t", [])]
        assert times
        assert times == sorted(times)
    verified = verify(folder / "recordings" / "runs" / ended["log"])
    assert verified.passed, verified.text()


def test_an_emergency_stop_sets_the_safe_values_and_ends_the_run(client, listen):
    page = listen()
    client.post("/api/run", scene="belt", duration=600.0)
    client.until("running")
    for value in (None, True, "", "status", ["stop"], {"stop": 1}, "\0", 10**400):
        for body in ({"do": value}, {"do": "knock", "impulse": value}, {"do": "connect", "controller": value}):
            client.refused("/api/run/command", **body)
        for body in ({"key": value, "value": 1}, {"key": "drive.speed", "value": value}):
            client.refused("/api/run/set", **body)
    assert client.state()["phase"] == "running"
    assert "error" not in client.command("emergency")
    assert client.until("ended")["outcome"]["fault"] == "emergency stop by an operator"
    page.until_events("emergency")


def hear(client, sensor, period):
    """Who listens gets the samples in order; one that is busy loses the oldest that wait for it, and none twice."""
    with client.socket(path=f"/sound/{sensor}") as socket, client.socket(path="/sound/nothing") as silent:
        end = 0.0
        for _ in range(10):
            message = socket.recv(PATIENCE_S)
            socket.send("")
            (begin,), samples = np.frombuffer(message[:8], "<f8"), np.frombuffer(message[8:], "<f4")
            assert begin / period == pytest.approx(round(begin / period), abs=1e-5)
            assert begin > end - 0.5 * period
            assert np.isfinite(samples).all()
            assert samples.any()
            end = begin + samples.size * period
        with pytest.raises(TimeoutError):
            silent.recv(0.1)


def test_a_run_is_heard_and_its_killed_controller_and_plant_are_told_and_another_can_start(client, listen):
    """A controller that is killed makes no frame late, and yet the run is not VALID."""
    page = listen()
    client.post("/api/run", scene=SCENE, changes={"sensors.vibrometer.rate": 10_000}, duration=600.0)
    client.until("running")
    assert "vibrometer" in page.until("setup")["sound"]["sensors"]
    assert page.until("status")["pace"] == 1.0
    hear(client, "vibrometer", 1e-4)
    os.kill(process_of("nf").pid, signal.SIGKILL)
    status = page.until("status", lambda status: any("controller nf left at" in why for why in status["reasons"]))
    assert status["verdict"] in ("DEGRADED", "INVALID")
    os.kill(process_of("rig.bench.live.plant_process").pid, signal.SIGKILL)
    ended = client.until("ended")
    assert "the plant was killed by SIGKILL" in ended["outcome"]["text"]
    assert ended["outcome"]["ended"] == "the plant died"
    assert client.post("/api/run", scene="belt").status_code == 200
    client.until("running")


@pytest.fixture
def elsewhere(folder):
    """A run of the belt in another terminal."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rig", "run", "belt", "--duration", "3000"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    yield process
    process.kill()
    process.communicate()


def test_a_run_of_another_terminal_is_followed_changed_left_and_stopped(client, another, listen, server, elsewhere):
    page = listen()
    ((run, why),) = [(row["run"], row["why"]) for row in wait_for(lambda: client.get("/api/live").json())]
    assert why == ""
    assert "no run is called belt-of-yesterday" in client.refused("/api/run/follow", run="belt-of-yesterday")
    assert client.refused("/api/run/leave") == "no run of another terminal is followed"
    assert client.post("/api/run/follow", run=run).status_code == 200
    client.until("running")
    assert another.get("/api/live").json() == []
    assert "stop following it first" in another.refused("/api/run", scene="belt")
    page.until("setup", lambda setup: setup["run"] == run)
    page.until("status", lambda status: status["pace"] == 1.0)
    assert client.post("/api/run/set", key="drive.speed", value=0.07, run=run).json()["values"]["drive.speed"] == 0.07
    client.command("pause", run=run)
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
    client.command("resume", run=run)
    client.until("running")
    client.command("stop", run=run)
    assert client.until("ended")["outcome"]["ended"] == "stopped by an operator"
    elsewhere.wait(PATIENCE_S)


def test_a_recording_that_cannot_be_written_is_told(client, folder):
    (folder / "recordings").write_text("no folder")
    client.post("/api/run", scene="belt", duration=1.0)
    ended = client.until("ended")
    assert "recordings" in (ended["fault"] or ended["outcome"]["text"])
    assert ended["fault"] or ended["outcome"]["unrecorded"]


def test_a_run_that_is_stopped_while_it_starts_leaves_nothing(client):
    client.post("/api/run", scene="belt")
    client.command("stop")
    ended = client.until("ended")
    assert "before the first frame" in ended["fault"] or ended["outcome"]
