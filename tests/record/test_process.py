"""The recorder as a process: its file is complete, and nothing is harmed when it is killed."""

import json
import time

import numpy as np
import pytest
from patience import PATIENCE_S, wait_for

from rig import bus
from rig.bus import encode, messages
from rig.bus.run_setup import Setup
from rig.record import reader
from rig.record.curves import derived
from rig.record.message_scan import Scan

RECORDER = """
import json, sys
from dataclasses import asdict
from pathlib import Path
from rig.errors import RigError
from rig.record.recorder import record
try:
    record(None, Path(sys.argv[1]), lambda r: print(json.dumps(asdict(r) | {"lost": r.lost}), flush=True))
except RigError as fault:
    print(fault, flush=True)
    sys.exit(fault.exit_code)
"""

OUTPUTS = {"displacement": "m", "velocity": "m/s"}
SENSORS = {"laser": ("m/s", 100_000), "gauge": ("N", 1_000_000), "pickup": ("rad/s", 1_000_000)}


class Plant:
    """Publishes what the plant of a rig does: 1 kHz frames, a laser of 10 kHz in blocks of 10 ms."""

    def __init__(self, session):
        self.session = session
        told = Setup(session.run, '{"plant": "belt"}', 1_000_000, 100_000, OUTPUTS, SENSORS)
        self.scene = session.serve("scene", lambda body: told.to_json())
        self.watch = session.watch()
        self.totals, self.acts = session.subscribe("total/*"), session.subscribe("act/*")
        session.announce()
        self.sent = []
        self.state = encode.StateEncoder(2)
        self.frame = 0

    def wait_for_recorder(self):
        def here():
            self.scene.poll(0.02)
            self.watch.poll()
            return ("recorder", "recorder") in self.watch.present

        wait_for(here)

    def put(self, topic, payload, t_ns):
        self.session.publisher(topic).put(payload, t_ns)
        self.sent.append((topic, payload, t_ns))

    def advance(self, frames, pace=True):
        begun = time.monotonic() - self.frame * 1e-3
        for _ in range(frames):
            k, now = self.frame, self.frame * 1_000_000
            self.put("step", encode.step(k, now, np.full(3, k + 0.5), np.ones(3, np.int64)), now)
            self.put("state", self.state(now, k, 0, np.array([k, -k], float)), now)
            self.put("applied/feedback", encode.applied(k, now, k - 1, 0, [float(k)]), now)
            for name in ("gauge", "pickup"):
                self.put(f"meas/{name}", encode.block(k, now, 1_000_000, [k * 0.1]), now)
            if k % 10 == 0:
                self.put("meas/laser", encode.block(k, now, 100_000, np.arange(100) + k * 10.0), now)
            self.frame += 1
            if pace and (left := begun + self.frame * 1e-3 - time.monotonic()) > 0.0:
                time.sleep(left)

    def finish(self):
        data = json.dumps({"late": 3, "energy": {"supplied": 2.0}})
        now = self.frame * 1_000_000
        self.put("total/plant", self.session.totals(), now)
        while "total/plant" not in (answer := self.totals.get(PATIENCE_S)).said.heard_topic:
            pass  # it catches up
        event = messages.TYPES["Event"](t_ns=now, source="plant", kind="verdict", text="VALID", data=data)
        self.put("event/plant", event.SerializeToString(), now)
        self.session.close()
        return messages.decode("total/recorder", answer.payload)


@pytest.fixture
def plant(runs):
    with bus.host("recorded") as session:
        yield Plant(session)


def test_a_second_of_traffic_is_in_the_file_as_they_were_sent(plant, script, tmp_path):
    path = tmp_path / "new" / "run.mcap"
    recorder = script(RECORDER, path)
    plant.wait_for_recorder()
    plant.advance(1000)
    told = plant.finish()
    account = json.loads(recorder.communicate(timeout=PATIENCE_S)[0])
    found = [record for record in Scan(path) if not derived(record.topic)]
    for topic in {topic for topic, _, _ in plant.sent}:
        sent = [(payload, t_ns) for name, payload, t_ns in plant.sent if name == topic]
        assert [(r.payload, r.t_ns) for r in found if r.topic == topic] == sent, topic
        assert [r.seq for r in found if r.topic == topic] == list(range(len(sent))), topic
    assert (account["lost"], account["late"], account["totals"]) == (0, {}, True)
    assert account["ended"] == "the plant left"
    assert account["received"]["step"] == 1000
    assert dict(zip(told.heard_topic, told.received))["step"] == 1000
    run = reader.open(path)
    assert not run.fault
    assert run.summary == {"verdict": "VALID", "late": 3}
    assert run.energy == {"supplied": 2.0}
    assert np.array_equal(run.signals["velocity"], -np.arange(1000.0))
    assert np.array_equal(run.measurements["laser"].v, np.arange(10_000.0))
    assert np.array_equal(run.commands["feedback"].tick, np.arange(1000))
    assert [e["kind"] for e in run.events] == ["verdict"]
    logged = [r.t_ns for r in Scan(path)]
    assert logged == sorted(logged)


@pytest.mark.alone
def test_a_killed_recorder_leaves_all_but_the_last_half_second(plant, script, tmp_path):
    path = tmp_path / "run.mcap"
    recorder = script(RECORDER, path)
    plant.wait_for_recorder()
    plant.advance(900)
    wait_for(lambda: max((record.t_ns for record in Scan(path)), default=0) > 400_000_000)  # nothing comes any more
    recorder.kill()
    recorder.wait()
    spans = []
    for _ in range(50):  # the plant carries on
        begun = time.perf_counter()
        plant.advance(1, pace=False)
        spans.append(time.perf_counter() - begun)
    assert sorted(spans)[25] < 0.1
    assert [(p.name, p.here) for p in plant.watch.poll(PATIENCE_S)] == [("recorder", False)]
    run = reader.open(path)
    assert run.fault
    assert run.scene == '{"plant": "belt"}'
    assert run.time[-1] >= 0.9 - 0.5
    assert np.array_equal(run.signals["displacement"], np.arange(run.time.size))
