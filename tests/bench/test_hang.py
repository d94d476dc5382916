"""A controller that hangs in a live run and continues: what takes effect, and what repeats."""

import subprocess
import sys

import pytest

from rig import parts
from rig.bench.again.fork import fork
from rig.bench.again.replay import replay
from rig.bench.again.verify import verify
from rig.bench.run.command_queue import SAFE
from rig.record import reader
from rig.record.message_scan import Scan
from rig.record.recorded_setup import head, setup_of

CODE = """
import os
import signal
import subprocess
import sys

class Controller:
    reads, drives, period_ns, every_sample = ("vibrometer",), ("load.force",), 1_000_000, {every}

    def start(self):
        return 0.0, 0

    def update(self, state, t_ns, values):
        mean, count = state
        for v in values[0] if {every} else values:
            mean, count = 0.99 * mean + v, count + 1
        if t_ns == 400_000_000 and os.environ.pop("HANGS", ""):
            here = os.getpid()
            subprocess.Popen(["sh", "-c", "sleep 0.4; kill -CONT " + str(here)])
            os.kill(here, signal.SIGSTOP)
        return (mean, count), (20.0 + 5.0 * mean + 0.1 * (count % 7),)
"""
AT = 1.1


def acts(log):
    """Tick -> the command that the controller sent for it."""
    scan = Scan(log)
    decode, sent = reader.Decoder(setup_of(head(log))), {}
    for record in scan:
        if record.topic == "act/nf":
            act = decode(record.topic, record.payload)
            sent[act.tick] = tuple(act.values)
    return sent


@pytest.mark.slow
@pytest.mark.parametrize("every", [False, True])
def test_a_controller_that_was_stopped_skips_and_the_recording_repeats_it(every, tmp_path, monkeypatch):
    mine, log = tmp_path / "mine.py", tmp_path / "run.mcap"
    mine.write_text(CODE.format(every=every))
    options = ["-p", f"controllers.nf.kind={mine}", "--duration", "1.5", "--out", str(log)]
    monkeypatch.setenv("HANGS", "once")
    command = [sys.executable, "-m", "rig", "run", "belt_normal_force", *options]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120.0)
    assert ended.returncode in (0, 3), ended.stderr  # 3: a busy machine
    monkeypatch.delenv("HANGS")

    run = reader.open(log)
    parts.trust_scene(run.scene)
    commands, limit = run.commands["nf"], 1 + 50
    own = commands.status != SAFE
    assert (commands.tick - commands.answered)[own].max() <= limit
    assert {"safe", "back", "skipped"} <= {event["kind"] for event in run.events}
    assert run.summary["controllers"]["nf"]["skipped"] > limit
    assert not [topic for topic in run.summary["lost"] if topic == "step to nf"]

    assert verify(log).identical
    again = replay(log, ["nf"])
    assert (again.passed, again.silent["nf"]) == (True, 0)
    tick = round(AT * 1000)
    found = fork(log, AT, duration_ns=20_000_000).commands["nf"]
    first = found.answered.tolist().index(tick)
    assert tuple(found.values[first]) == acts(log)[tick]
