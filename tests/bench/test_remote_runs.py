"""Runs whose controller, recorder and operator come by TLS, each with a ticket, as from another host.

Other hosts are processes with a directory of live runs of their own. Where the system lets a test make namespaces of
the network, they have one; else an address of the loopback device stands for their host.
"""

import signal
import time

import pytest
from patience import wait_for
from remote_run import SCENE, Elsewhere, RemoteRun
from same_bits import same_bits

import rig
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live.plant_process import warm
from rig.bench.run.simulate import simulate


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Nothing is compiled while a test waits."""
    warm(scenes.load(SCENE))


@pytest.fixture
def elsewhere(tmp_path):
    made = Elsewhere(tmp_path)
    yield made
    made.end()


def test_in_lockstep_over_tls_the_bits_are_those_of_simulate(runs, elsewhere, tmp_path):
    log = tmp_path / "here.mcap"
    going = RemoteRun(tmp_path, lockstep=True, pace=None, duration=2.0, out=log)
    going.line("waiting for controller nf (ticket ")
    recorder = elsewhere.rig("live", "record", "--ticket", going.tickets["recorder"], "--out", "far.mcap")
    wait_for(lambda: (tmp_path / "far.mcap").exists(), recorder.told.read_text)
    controller = elsewhere.rig("live", "control", "nf", "--ticket", going.tickets["nf"])
    outcome = going.wait(120.0)
    assert outcome.summary["exit_code"] == 0, outcome.text()
    assert outcome.summary["links"]["nf"]["p50"] > 0.0
    assert "nf on another host: " in outcome.text()
    assert (controller.wait(30.0), recorder.wait(30.0)) == (0, 0)
    assert "none lost" in recorder.told.read_text()
    known = simulate(scenes.load(SCENE), duration_ns=2 * 10**9)
    for path in (log, tmp_path / "far.mcap"):
        same_bits(rig.open(path), known, {})
        assert verify(path).identical


def test_a_controller_that_is_killed_comes_back_with_its_ticket_and_others_do_not(runs, elsewhere, tmp_path):
    going = RemoteRun(tmp_path, duration=60.0, out=tmp_path / "here.mcap")
    first = elsewhere.rig("live", "control", "nf", "--ticket", going.tickets["nf"])
    going.line("begins with nf")
    code, told = elsewhere.asked("live", "control", "nf", "--ticket", going.tickets["nf"])
    assert code == 2
    assert "the seat nf is taken: another process uses this ticket" in told
    first.send_signal(signal.SIGKILL)
    going.line("left: controller nf left")
    going.line("safe: ")
    again = elsewhere.rig("live", "control", "nf", "--ticket", going.tickets["nf"])
    going.line("joined: controller nf is here")
    code, told = elsewhere.asked("live", "tune", "nf.gain", "--ticket", going.tickets["operator"])
    assert code == 0
    assert told.startswith("nf.gain = ")
    assert elsewhere.asked("live", "stop", "--ticket", going.tickets["operator"])[0] == 0
    outcome = going.wait(60.0)
    assert outcome.summary["ended"] == "stopped by an operator"
    assert outcome.summary["verdict"] != "VALID"
    assert again.wait(30.0) == 0
    code, told = elsewhere.asked("live", "control", "nf", "--ticket", going.tickets["nf"], "--wait", "0")
    assert code == 2
    assert "nobody listens at " in told


def test_a_plant_that_is_killed_is_told_by_each_process(runs, elsewhere, tmp_path):
    going = RemoteRun(tmp_path, duration=60.0, out=tmp_path / "here.mcap", record=False)
    controller = elsewhere.rig("live", "control", "nf", "--ticket", going.tickets["nf"])
    going.line("begins with nf")
    recorder = elsewhere.rig("live", "record", "--ticket", going.tickets["recorder"], "--out", "far.mcap")
    going.line("joined: recorder remote-recorder is here")
    going.process("rig.bench.live.plant_process").kill()
    begun = time.monotonic()
    assert controller.wait(12.0) == 2
    assert recorder.wait(12.0 - (time.monotonic() - begun)) == 1
    for process in (controller, recorder):
        assert "is gone: nobody listens there any more" in process.told.read_text()
    going.wait(60.0)
