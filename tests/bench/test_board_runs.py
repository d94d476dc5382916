"""Live runs with a controller on a board: lockstep and paced, and what happens when the board is away."""

import threading
import time

import pytest
from boards import FAULTS, board_port, on_board, standing_in

import rig
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live import supervise
from rig.bench.live.outcome import keeps_up
from rig.bench.live.plant_process import warm
from rig.bench.run.simulate import simulate
from rig.cli import printing
from rig.errors import DeviceError, ExitCode, UsageError

BASE = "belt_normal_force"
SOON = {"controllers.nf.enable_at": "0.2 s"}


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm(scenes.load(BASE))


def events_of(run, *kinds):
    return [(event["source"], event["kind"]) for event in run.events if event["kind"] in kinds]


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_lockstep_has_the_bits_of_the_shipped_controller(kind, runs, tmp_path):
    scene, law = on_board(BASE, board_port() if kind == "udp" else f"serial:{tmp_path / 'board'}", changes=SOON)
    with standing_in(scene.controllers["nf"].port, law, "missing") as board:
        outcome = supervise.run(scene, pace=None, duration=1.0, out=runs / "log.mcap")
    assert outcome.exit_code == 0, outcome.text()
    assert board.steps == 1000
    run = rig.open(runs / "log.mcap")
    other = simulate(scenes.load(BASE, SOON), duration_ns=10**9)
    for name, samples in other.measurements.items():
        assert samples.v.tobytes() == run.measurements[name].v.tobytes()
    assert outcome.summary["controllers"]["nf"]["again"] >= 15
    assert verify(runs / "log.mcap").identical


def test_lockstep_ends_without_its_board_and_keeps_the_recording(runs):
    scene, law = on_board(BASE, board_port(), changes=SOON)
    with standing_in(scene.controllers["nf"].port, law) as board:

        def leave(name):
            while board.steps < 300:
                time.sleep(0.01)
            board.away.set()

        began = []

        def begun(name):
            began.append(threading.Thread(target=leave, args=(name,)))
            began[0].start()

        outcome = supervise.run(scene, pace=None, duration=100.0, out=runs / "log.mcap", begun=begun)
        began[0].join()
    assert outcome.exit_code == ExitCode.FAILED, outcome.text()
    assert outcome.summary["ended"] == "a board does not answer"
    assert "no answer within 2 s" in str(rig.open(runs / "log.mcap").events)
    assert verify(runs / "log.mcap").passed


def test_a_paced_run_goes_on_without_its_board_and_with_it_again(runs):
    scene, law = on_board(BASE, board_port(), changes=SOON)
    with standing_in(scene.controllers["nf"].port, law, reset_every=500) as board:

        def leave():
            while board.steps < 1200:
                time.sleep(0.01)
            board.away.set()
            time.sleep(0.5)
            board.away.clear()

        thread = threading.Thread(target=leave)
        outcome = supervise.run(scene, duration=4.0, out=runs / "log.mcap", begun=lambda name: thread.start())
        thread.join()
    run = rig.open(runs / "log.mcap")
    assert events_of(run, "device lost", "device back", "safe", "back")[:4] == [
        ("nf", "device lost"),
        ("plant", "safe"),
        ("nf", "device back"),
        ("plant", "back"),
    ]
    assert outcome.summary["verdict"] != "VALID"
    counts = outcome.summary["controllers"]["nf"]
    assert counts["missed"] >= 300
    assert counts["resets"] >= 4
    assert ("nf", "device reset") in events_of(run, "device reset")
    assert "without an answer of the board" in outcome.text()
    assert verify(runs / "log.mcap").passed


@pytest.mark.alone
@pytest.mark.parametrize(("kind", "most_s"), [("udp", 0.05), ("serial", 0.5)])
def test_a_board_is_in_force_again_soon_after_its_return(kind, most_s, runs, tmp_path):
    scene, law = on_board(
        BASE, board_port() if kind == "udp" else f"serial:{tmp_path / 'board'}", changes=SOON, baud=921600
    )
    with standing_in(scene.controllers["nf"].port, law) as board:
        left_ns = returned_ns = 0

        def leave():
            nonlocal left_ns, returned_ns
            while board.steps < 300:
                time.sleep(0.01)
            board.gone.set()
            time.sleep(0.7)
            at, left_ns = board.last
            returned_ns = left_ns + 1e9 * (time.perf_counter() - at)
            board.gone.clear()

        thread = threading.Thread(target=leave)
        outcome = supervise.run(scene, duration=1.7, out=runs / "log.mcap", begun=lambda name: thread.start())
        thread.join()
    run = rig.open(runs / "log.mcap")
    times = {}
    for event in run.events:
        if event["t_ns"] >= left_ns:
            times.setdefault(event["kind"], event["t_ns"])
    answered_ns = run.commands["nf"].answered * scene.frame_ns
    last_ns = answered_ns[answered_ns <= left_ns].max()  # the last answer may have been on its way
    hold_ns = scene.clock.hold_frames * scene.frame_ns
    assert left_ns <= times["device lost"] < returned_ns
    assert last_ns + hold_ns <= times["safe"] <= left_ns + hold_ns + 20e6
    assert times["back"] - returned_ns <= 1e9 * most_s
    assert outcome.summary["verdict"] != "VALID"
    assert verify(runs / "log.mcap").passed


def test_a_run_does_not_begin_without_its_board(tmp_path):
    scene, _ = on_board(BASE, board_port())
    older = tmp_path / "log.mcap"
    older.write_text("an older recording")
    told = []
    with pytest.raises(UsageError, match="controller nf is not here: a run does not begin without its board"):
        supervise.run(scene, duration=1.0, out=older, replace=True, say=told.append)
    assert "no answer within 3 s; is the board on" in str(told)
    assert "the plant continues" not in str(told)
    assert older.read_text() == "an older recording"
    assert list(tmp_path.iterdir()) == [older]


def test_what_a_port_cannot_carry_is_refused_before_the_run(tmp_path, capsys):
    absent, _ = on_board(BASE, f"serial:{tmp_path / 'ttyUSB0'}")
    with pytest.raises(DeviceError, match="ttyUSB0: there is no such port"):
        keeps_up(absent, None)
    (tmp_path / "ttyUSB0").touch()
    with pytest.raises(DeviceError, match=r"60 bytes, and 115200 baud carry 11\.52 bytes in a period of 1 ms; needed"):
        keeps_up(absent, 1.0)
    keeps_up(absent, None)  # nobody waits in lockstep
    slow, _ = on_board(BASE, f"serial:{tmp_path / 'ttyUSB0'}", period="10 ms")
    keeps_up(slow, 1.0)
    (tmp_path / "ttyACM0").touch()
    by_usb, _ = on_board(BASE, f"serial:{tmp_path / 'ttyACM0'}")
    keeps_up(by_usb, 1.0)
    printing.run_warnings(by_usb, 1.0)
    told = capsys.readouterr().err
    assert "115200 baud carry 11.52 bytes in a period of 1 ms; needed: 600000 baud" in told
    assert "a USB port without a UART (CDC) ignores the rate, rig tool device measures it" in told


def as_uart(answer):
    """Send an answer after the time that 115200 baud need for it and for its step."""
    time.sleep(2 * len(answer) * 10 / 115200)
    return [answer]


@pytest.mark.slow
@pytest.mark.alone
def test_a_uart_of_115200_baud_holds_ten_milliseconds(runs, tmp_path, monkeypatch):
    monkeypatch.setitem(FAULTS, "uart", as_uart)
    scene, law = on_board(BASE, f"serial:{tmp_path / 'board'}", changes=SOON, period="10 ms")
    with standing_in(scene.controllers["nf"].port, law, "uart", every=1):
        outcome = supervise.run(scene, duration=10.0, out=runs / "log.mcap")
    assert outcome.summary["verdict"] == "VALID", outcome.text()
    assert outcome.summary["round_trip"]["p50"] > 5e3  # us
    assert verify(runs / "log.mcap").identical
