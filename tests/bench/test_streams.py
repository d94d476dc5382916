"""Streams: measured channels of a real rig in a paced run, in its recording, and where they are refused."""

import os
import threading
import time
import tracemalloc
from itertools import pairwise
from math import nan, sin

import numpy as np
import pytest
from boards import Sender, board_port, in_c, measured, program, streaming

import rig
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.stream_ports import StreamPorts
from rig.bench.run.journal import Journal
from rig.bench.run.runner import PlantRunner
from rig.errors import DeviceError, SceneError, UsageError
from rig.scenes.scene import Scene

FOLLOW = """
format = 1
based_on = "belt"

[sensors.roller]
kind = "stream"
port = "{port}"
reads = "surface_speed"
delivers = "m/s"

[[protocol]]
step = "follow"
channels = {{"drive.speed" = "roller"}}
time = "{time}"
"""


def roller(port, **keys):
    """Changes of a scene that give it a stream."""
    table = {"kind": "stream", "port": port, "reads": "surface_speed", "delivers": "m/s"} | keys
    return {f"sensors.roller.{key}": value for key, value in table.items()}


def two_rollers(port):
    """Changes of a scene that give it two streams of one port."""
    second = {key.replace("roller", "second"): value for key, value in roller(port).items()}
    return roller(port) | second | {"sensors.second.channel": 2}


def following(folder, port, seconds=2.0):
    (folder / "real.toml").write_text(FOLLOW.format(port=port, time=f"{seconds} s"))
    return folder / "real.toml"


def taking(scene, ticks=100):
    runner = PlantRunner(scene, truthful=True, piece=ticks, measured={})
    journal = Journal(scene.frame_ns, lambda: runner.tick)
    return runner, journal, StreamPorts(scene, runner, journal)


def port_of(kind, tmp_path):
    return board_port() if kind == "udp" else f"serial:{tmp_path / 'board'}"


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_the_newest_values_are_the_samples_and_come_again_bit_by_bit(kind, tmp_path):
    port = port_of(kind, tmp_path)
    scene = scenes.load("belt", two_rollers(port))
    sender = Sender(port)
    runner, journal, ports = taking(scene)
    expected = []
    for k in range(100):
        if not 20 <= k < 80:
            sender.send(measured(k, sin(k), -0.0 if k % 2 else -float(k)))
            time.sleep(0.001)
        else:
            time.sleep(0.002)
        ports.receive()
        last = k if not 20 <= k < 80 else 19
        expected.append((sin(last), 0.0 if last % 2 else -float(last)))
        runner.frame()
    samples = runner.measurements.samples()
    assert [samples["roller"].v[:100].tolist(), samples["second"].v[:100].tolist()] == [list(x) for x in zip(*expected)]
    age = samples["roller_age"].v[:100]
    assert age[:20].max() < 0.05 < age[79]
    assert np.all(np.diff(age[20:80]) > 0.0)
    assert [event.kind for event in journal.events] == ["stream lost", "stream back"]
    assert ports.counters() == {port: {"frames": 40, "damaged": 0, "other": 0, "unfit": 0, "lost": 1}}
    assert ports.faults() == [f"the stream at {port} was lost 1 time"]
    again = PlantRunner(Scene.from_json(scene.to_json()), truthful=True, piece=100, measured=samples)
    while again.tick < 100:
        again.frames(100 - again.tick)
    for name, each in again.measurements.samples().items():
        assert each.v.tobytes() == samples[name].v.tobytes(), name
    ports.close()
    sender.close()


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_the_frames_in_c_are_read(kind, tmp_path):
    port = port_of(kind, tmp_path)
    scene = scenes.load("belt", two_rollers(port))
    with program(in_c(tmp_path, "measured_on_host.c"), kind, port.rpartition(":")[2]):
        _, _, ports = taking(scene)
        (stream,) = ports.ports
        read = set()
        while len(read) < 100:
            stream.receive(0.5)
            read.add(stream.values)
        ports.close()
    read.discard(())
    assert all(v == -1e3 / round(1e3 * t) and t == 1e-3 * round(1e3 * t) for t, v in read)
    assert stream.counts["damaged"] <= 1  # the port was opened within a frame
    assert stream.counts["other"] == stream.counts["unfit"] == 0


def test_what_is_wrong_is_counted_and_not_used():
    port = board_port()
    scene = scenes.load("belt", roller(port))
    sender = Sender(port)
    _, _, ports = taking(scene)
    good = measured(1000, 0.5)
    late = [measured(number, 9.0) for number in (1000, 999, 990)]
    unfit = [measured(1001, 9.0, 9.0), measured(1001), measured(1001, nan)]
    for frame in (good, *late, *unfit, b"", good[:-1], good + b"x", b"\x70" + good[1:]):
        sender.send(frame)
    ports.ports[0].receive(0.5)
    assert ports.ports[0].values == (0.5,)
    assert ports.ports[0].counts == {"frames": 1, "damaged": 4, "other": 3, "unfit": 3, "lost": 0}
    sender.send(measured(3, 0.25, width=4))  # the board was reset, and has float32
    ports.ports[0].receive(0.5)
    assert ports.ports[0].values == (0.25,)
    ports.close()
    sender.close()


def test_random_bytes_and_foreign_frames_change_no_value():
    port = board_port()
    scene = scenes.load("belt", roller(port))
    sender = Sender(port)
    stranger = Sender(board_port())
    _, _, ports = taking(scene)
    sender.send(measured(1, 0.5))
    ports.ports[0].receive(0.5)
    tracemalloc.start()
    sizes = []
    for k in range(10_000):
        sender.send(os.urandom(100))
        stranger.send(measured(k + 2, 9.0), sender.address.number + 1)
        ports.ports[0].receive(0.1)
        if k % 1000 == 999:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert ports.ports[0].values == (0.5,)
    assert ports.ports[0].counts["frames"] == 1
    assert ports.ports[0].counts["damaged"] >= 9_990
    assert max(after - before for before, after in pairwise(sizes)) < 20_000
    ports.close()
    sender.close()
    stranger.close()


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"port": "COM3"}, 'expected "serial:/dev/ttyACM0" or "udp:HOST:PORT"'),
        ({"delivers": "rad/s"}, "surface_speed.*is in m/s, a stream reads rad/s"),
        ({"reads": "radar"}, "has no such output"),
        ({"delay": "1 ms"}, "leave out delay, gain_error and ideal"),
        ({"channel": 2}, "have the channels 2; expected each from 1 on once"),
        ({"rate": "3 kHz"}, "a stream has one sample in every frame or fewer"),
    ],
)
def test_wrong_tables_are_refused(changes, text):
    with pytest.raises(SceneError, match=text):
        scenes.load("belt", roller("udp:127.0.0.1:5007") | {f"sensors.roller.{k}": v for k, v in changes.items()})


def test_a_port_has_a_controller_or_streams():
    with pytest.raises(SceneError, match=r"sensors\.roller\.port.*is the port of controllers\.nf, too"):
        scenes.load("belt_device", roller("udp:127.0.0.1:5005"))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('"drive.speed" = "roller"', '"drive.speed" = "laser"', "laser is in m, drive.speed in m/s"),
        ('"drive.speed" = "roller"', '"drive.speed" = "nobody"', "unknown sensor nobody"),
        ('time = "2.0 s"', "", "needs a file, or the time"),
        ('time = "2.0 s"', 'time = "1 s"\nbegin = "1 s"', "begin and end are times of a recording"),
    ],
)
def test_wrong_steps_are_refused(old, new, text, tmp_path):
    file = following(tmp_path, "udp:127.0.0.1:5007")
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(SceneError, match=text):
        scenes.load(file)


def test_a_stream_is_refused_where_no_clock_is_kept(tmp_path):
    scene = scenes.load(following(tmp_path, board_port()))
    refusal = r"sensors\.roller: a stream is measured while a run keeps pace with the clock"
    with pytest.raises(UsageError, match=refusal):
        rig.simulate(scene)
    with pytest.raises(UsageError, match=refusal):
        supervise.run(scene, pace=None, record=False)
    with pytest.raises(UsageError, match=refusal):
        supervise.run(scene, lockstep=True, record=False)


def test_without_a_board_another_kind_takes_its_place(tmp_path):
    scene = scenes.load(following(tmp_path, board_port(), 0.5), {"sensors.roller.kind": "laser_vibrometer"})
    run = rig.simulate(scene)
    assert run.summary["ended"] == "done"
    assert [event["text"] for event in run.events if event["kind"] == "step"] == [
        "drive.speed follows roller for 0.5 s"
    ]
    assert np.all(np.isfinite(run.signals["surface_speed"]))


def test_a_silent_board_is_told_before_the_run(monkeypatch):
    for module in ("rig.bench.live.stream_ports", "rig.machine.board"):
        monkeypatch.setattr(f"{module}.BOOT_S", 0.1)
    port = board_port()
    scene = scenes.load("belt", roller(port))
    sender = Sender(port)
    _, _, ports = taking(scene)
    sender.send(b"hello")
    with pytest.raises(
        DeviceError, match=r"no values within 0\.1 s; received so far: 1 damaged frame; is the board on"
    ):
        ports.wait(lambda: False)
    ports.close()
    sender.close()


def test_a_real_belt_drives_the_simulated_one(runs, tmp_path):
    port = board_port()
    scene = scenes.load(following(tmp_path, port))
    with streaming(port, lambda k: (0.1 + 0.02 * sin(0.006 * k),)) as board:

        def leave():
            time.sleep(0.7)
            board.away.set()
            time.sleep(0.3)
            board.away.clear()

        thread = threading.Thread(target=leave)
        outcome = supervise.run(scene, out=runs / "log.mcap", begun=lambda name: thread.start())
        thread.join()
    assert outcome.exit_code in (0, 3), outcome.text()
    assert outcome.summary["streams"][port]["frames"] > 1000
    run = rig.open(runs / "log.mcap")
    speed, age = run.measurements["roller"].v, run.measurements["roller_age"].v
    assert 0.0795 < speed.min() < 0.09 < 0.11 < speed.max() < 0.1205
    assert run.signals["surface_speed"].max() == pytest.approx(speed.max(), abs=1e-4)
    if outcome.summary["streams"][port]["lost"]:  # it was away within the run
        assert outcome.summary["verdict"] != "VALID"
        assert age.max() > 0.05
        assert "was lost" in outcome.text()
    verified = verify(runs / "log.mcap")
    assert verified.passed
    assert verified.identical
    again = rig.fork(runs / "log.mcap", 1.0)
    assert again.measurements["roller"].v.tobytes() == speed.tobytes()
    with pytest.raises(UsageError, match=r"what the hardware of roller has sent ends at 2 s; from 1 s on"):
        rig.fork(runs / "log.mcap", 1.0, duration=3.0)
