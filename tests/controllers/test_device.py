"""A controller on a board: the bits of the shipped controller, whatever happens to its answers, and what is refused."""

import os
import socket
import tracemalloc
from contextlib import ExitStack
from math import nan

import numpy as np
import pytest
from boards import FAULTS, Sender, board_port, in_c, in_python, on_board, program, standing_in
from compile_c import InPython

import rig
from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live import rehearsal
from rig.bench.live.outcome import Job
from rig.bench.run.simulate import simulate
from rig.controllers import device
from rig.controllers.runtime.stand_in import started
from rig.design import described
from rig.errors import ControllerFailed, DeviceError, ExitCode, SceneError, UsageError
from rig.machine.board import ACT, STEP, Address, Frame, Line
from rig.qualify import doctor

TWO = {
    "controllers.nf.kind": "lti",
    "controllers.nf.reads": ["vibrometer", "laser"],
    "controllers.nf.drives": ["load.force", "drive.speed"],
    "controllers.nf.A": [[0.9, 0.1], [0.0, 0.8]],
    "controllers.nf.B": [[1.0, 0.3], [0.2, 0.1]],
    "controllers.nf.C": [[-30.0, 5.0], [0.01, 0.02]],
    "controllers.nf.D": [[-100.0, 10.0], [0.05, 0.1]],
}
"""A controller with two inputs and two outputs."""
SOON = {"controllers.nf.enable_at": "0.2 s"}
LONG = {"belt_normal_force": (20, None), "pendulum": (21, None), "belt": (20, TWO)}


def same(run, other):
    """Two runs have the same measurements and commands, to the last bit."""
    assert run.failure is None
    assert run.measurements.keys() == other.measurements.keys()
    for name, samples in run.measurements.items():
        assert samples.v.tobytes() == other.measurements[name].v.tobytes(), name
    for name, commands in run.commands.items():
        assert np.array_equal(commands.tick, other.commands[name].tick)
        assert commands.values.tobytes() == other.commands[name].values.tobytes()


def port_of(kind, tmp_path):
    return board_port() if kind == "udp" else f"serial:{tmp_path / 'board'}"


@pytest.fixture(scope="module")
def shipped():
    """base -> the run with the controller in this process, for a number of seconds."""
    made = {}

    def run(base, seconds, changes=None):
        key = base, seconds, str(changes)
        if key not in made:
            made[key] = simulate(scenes.load(base, changes), duration_ns=round(seconds * 1e9))
        return made[key]

    return run


@pytest.mark.parametrize("kind", ["udp", "serial"])
@pytest.mark.parametrize("base", LONG)
def test_a_board_gives_the_bits_of_the_shipped_controller(base, kind, shipped, tmp_path):
    seconds, changes = LONG[base]
    scene, law = on_board(base, port_of(kind, tmp_path), changes=changes)
    with standing_in(scene.controllers["nf"].port, law) as board:
        run = simulate(scene, boards=True, duration_ns=seconds * 10**9)
    same(run, shipped(base, seconds, changes))
    assert board.steps == run.commands["nf"].tick.size if base != "pendulum" else board.steps == 21000
    assert np.ptp(run.commands["nf"].values, axis=0).min() > 0.0


@pytest.mark.parametrize("kind", ["udp", "serial"])
@pytest.mark.parametrize("fault", [*FAULTS, "other"])
def test_a_disturbed_answer_changes_no_bit(fault, kind, shipped, tmp_path):
    scene, law = on_board("belt_normal_force", port_of(kind, tmp_path), changes=SOON)
    with standing_in(scene.controllers["nf"].port, law, fault) as board:
        run = simulate(scene, boards=True, duration_ns=2 * 10**9)
    same(run, shipped("belt_normal_force", 2, SOON))
    assert np.ptp(run.commands["nf"].values) > 10.0
    assert board.steps == 2000  # the law never advances twice in a step
    counts = run.summary["controllers"]["nf"]
    seen = {"garbage": "damaged", "half": "damaged", "missing": "again", "late": "again"}.get(fault, "other")
    assert counts[seen] >= 36
    assert counts["missed"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["udp", "serial"])
@pytest.mark.parametrize("fault", [*FAULTS, "other"])
@pytest.mark.parametrize("base", ["pendulum", "belt"])
def test_a_disturbed_answer_changes_no_bit_of_a_long_run(base, fault, kind, shipped, tmp_path):
    seconds, changes = LONG[base]
    scene, law = on_board(base, port_of(kind, tmp_path), changes=changes)
    with standing_in(scene.controllers["nf"].port, law, fault):
        run = simulate(scene, boards=True, duration_ns=seconds * 10**9)
    same(run, shipped(base, seconds, changes))
    assert run.summary["controllers"]["nf"]["missed"] == 0


def test_a_disturbed_answer_changes_no_bit_with_two_values(shipped):
    scene, law = on_board("belt", board_port(), changes=TWO)
    with standing_in(scene.controllers["nf"].port, law, "other"):
        run = simulate(scene, boards=True, duration_ns=10**9)
    same(run, shipped("belt", 1, TWO))


def test_a_reset_is_seen_in_the_next_frame():
    scene, law = on_board("belt_normal_force", board_port())
    with standing_in(scene.controllers["nf"].port, law, reset_every=500) as board:
        run = simulate(scene, boards=True, duration_ns=2 * 10**9)
    resets = [event["tick"] for event in run.events if event["kind"] == "device reset"]
    assert np.diff(resets).tolist() == [499] * (len(resets) - 1)  # a frame more is asked: that which begins the law
    assert board.steps == run.commands["nf"].tick.size == 2000


def test_noise_and_frames_of_others_put_no_command_in_force():
    """1e6 random bytes at the port of the answers, and 1e4 frames of another address."""
    port = board_port()
    number = Address.read(port).number
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line = Line(Address.read(port), "float64", 1)
    line.open()
    board = Sender(port)
    tracemalloc.start()
    sizes = []
    for k in range(5_000):
        board.send(os.urandom(200))
        for number_of_frame in (2 * k, 2 * k + 1):
            act = Frame(ACT, number_of_frame, 0, (9.0,)).to_bytes()
            stranger.sendto(act, ("127.0.0.1", number + 1))
        assert line.ask(STEP, 1, (0.0,), 0.0002) is None
        sizes += [tracemalloc.get_traced_memory()[0]] if k % 500 == 499 else []
    tracemalloc.stop()
    assert line.counts["damaged"] >= 4_950
    assert line.counts["missed"] == line.counts["asked"] == 5_000
    assert line.counts["other"] == line.counts["unfit"] == 0
    assert max(np.diff(sizes)) < 20_000
    stranger.close()
    board.close()
    line.close()


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_the_program_in_c_gives_the_same_bits(kind, shipped, tmp_path):
    port = port_of(kind, tmp_path)
    scene, _ = on_board("belt_normal_force", port)
    with program(in_c(tmp_path), kind, port.rpartition(":")[2]):
        same(simulate(scene, boards=True, duration_ns=20 * 10**9), shipped("belt_normal_force", 20))


def test_the_sketch_gives_the_same_bits(shipped, tmp_path):
    scene, _ = on_board("belt_normal_force", port_of("serial", tmp_path))
    with program(in_c(tmp_path, "arduino_on_host.cpp"), "serial", tmp_path / "board"):
        same(simulate(scene, boards=True, duration_ns=5 * 10**9), shipped("belt_normal_force", 5))


def test_the_program_in_python_gives_the_same_bits(shipped):
    port = board_port()
    scene, _ = on_board("belt_normal_force", port)
    with in_python(port):
        same(simulate(scene, boards=True, duration_ns=20 * 10**9), shipped("belt_normal_force", 20))


def refusal(changes):
    with pytest.raises(SceneError) as refused:
        scenes.load("belt_normal_force", changes)
    return str(refused.value)


BOARD = {
    "controllers.nf.kind": "device",
    "controllers.nf.port": "udp:127.0.0.1:5005",
    "controllers.nf.reads": "vibrometer",
    "controllers.nf.drives": "load.force",
    **{f"controllers.nf.{key}": "none" for key in ("sensor", "gain", "enable_at")},
}


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("port", "ttyACM0", 'expected "serial:/dev/ttyACM0" or "udp:HOST:PORT"'),
        ("where", "plant", "a board is asked by a process of its own"),
        ("values", "int16", "float64"),
        ("baud", "0", "must be greater than 0"),
        ("patience", "1 ms", "not below the period of 1 ms"),
        ("reads", "vibrometer, vibrometer", "names one twice"),
        ("reads", "radar", "unknown sensor"),
        ("drives", "belt.force", "no such actuator"),
        ("gain", "3", "unknown key"),
    ],
)
def test_a_key_that_cannot_be_used_is_refused(key, value, text):
    assert text in refusal(BOARD | {f"controllers.nf.{key}": value})


def test_two_controllers_on_one_port_are_refused():
    other = {key.replace("nf", "other"): value for key, value in BOARD.items() if value != "none"}
    told = refusal(BOARD | other | {"controllers.other.drives": "drive.speed"})
    assert "controllers.other.port = udp:127.0.0.1:5005: is the port of controllers.nf" in told


def test_a_board_without_an_answer_ends_the_run_with_all_that_was_computed(monkeypatch):
    monkeypatch.setattr(device, "ANSWER_S", 0.4)
    scene, law = on_board("belt_normal_force", board_port())
    told = []

    def stop():
        told.append(1)
        if len(told) == 10:
            leave()
        return ""

    with ExitStack() as stack:
        stack.enter_context(standing_in(scene.controllers["nf"].port, law))
        leave = stack.pop_all().close
        with pytest.raises(ControllerFailed, match=r"udp:.*no answer within 0\.4 s") as failed:
            rig.simulate(scene, 5.0, stop)
    run = failed.value.run
    assert run.time[-1] == pytest.approx(1.0)
    assert run.summary["controllers"]["nf"]["missed"] == 1
    assert failed.value.exit_code == ExitCode.FAILED


def test_a_silent_board_is_told_before_the_run(monkeypatch):
    monkeypatch.setattr("rig.machine.board.BOOT_S", 0.2)
    scene, _ = on_board("belt_normal_force", board_port())
    with pytest.raises(DeviceError, match=r"no answer within 0\.2 s; is the board on"):
        rig.simulate(scene, 1.0)


def test_another_number_of_values_is_told(shipped, monkeypatch):
    monkeypatch.setattr(device, "ANSWER_S", 0.2)
    two, law = on_board("belt", board_port(), changes=TWO)
    scene, _ = on_board("belt_normal_force", two.controllers["nf"].port, reads=["vibrometer", "normal_force"])
    with (
        standing_in(two.controllers["nf"].port, law),
        pytest.raises(ControllerFailed, match="with 2 values of 8 bytes"),
    ):
        rig.simulate(scene, 1.0)


class NotFinite(InPython):
    def update(self, state, t_ns, values):
        state, commands = super().update(state, t_ns, values)
        return state, (nan,) if t_ns == 500_000_000 else commands


def test_an_answer_that_is_not_finite_is_as_that_of_any_controller():
    scene, _ = on_board("belt_normal_force", board_port())
    with standing_in(scene.controllers["nf"].port, NotFinite()):
        run = rig.simulate(scene, 1.0)
    same(run, simulate(scene, {"nf": NotFinite()}, duration_ns=10**9))
    assert run.summary["controllers"]["nf"]["refused"] == 1
    assert [event["kind"] for event in run.events if event["kind"] == "not finite"]


def test_a_reset_is_seen_and_the_law_starts_again():
    scene, law = on_board("belt_normal_force", board_port())
    with standing_in(scene.controllers["nf"].port, law, reset_every=500):
        run = rig.simulate(scene, 5.0)
    resets = [event for event in run.events if event["kind"] == "device reset"]
    assert len(resets) == run.summary["controllers"]["nf"]["resets"] == 10
    assert run.commands["nf"].tick.size == 5000


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_float32_is_the_rounded_law(kind, tmp_path, shipped):
    scene, law = on_board("belt_normal_force", port_of(kind, tmp_path), changes=SOON, values="float32")
    with standing_in(scene.controllers["nf"].port, law):
        run = rig.simulate(scene, 0.5)
    values = run.commands["nf"].values[:300]
    assert np.array_equal(values, values.astype(np.float32))
    assert np.ptp(values) > 1.0
    assert np.allclose(values, shipped("belt_normal_force", 0.5, SOON).commands["nf"].values[:300], rtol=1e-6)


def last(run):
    return float(run.signals["displacement"][-1])


def test_nobody_but_a_run_drives_a_board(tmp_path):
    scene, law = on_board("belt_normal_force", board_port())
    refusal = "a board takes part in rig simulate and rig run only"
    with standing_in(scene.controllers["nf"].port, law) as board:
        with pytest.raises(DeviceError, match=refusal):
            rig.study(scene, {"drive.speed": [0.1, 0.2]}, [last], out=tmp_path, duration=0.1, workers=1)
        with pytest.raises(DeviceError, match=refusal):
            simulate(scene, duration_ns=10**8)
        assert rehearsal.rehearse(scene, Job(scene.to_json(), duration=0.1)).sets
        assert doctor.costs(scene, least=10).size >= 10
    assert board.steps == 0


def test_it_is_verified_without_board_and_continued_by_its_commands_only(tmp_path, monkeypatch):
    monkeypatch.setattr("rig.machine.board.BOOT_S", 0.5)  # how long a board that is not there is waited for
    scene, law = on_board("belt_normal_force", board_port())
    log = tmp_path / "log.mcap"
    with standing_in(scene.controllers["nf"].port, law):
        run = rig.simulate(scene, 6.0)
    run.save(log)
    verified = verify(log)
    assert verified.passed
    assert verified.identical
    with pytest.raises(UsageError, match=r"nf ran on a board.*with --recorded"):
        rig.fork(log, 4.5)
    same(rig.fork(log, 4.5, recorded=True), run)
    with pytest.raises(UsageError, match=r"ends at 6 s; from 4\.5 s on a duration of at most 1\.5 s"):
        rig.fork(log, 4.5, duration=2.0, recorded=True)
    with standing_in(scene.controllers["nf"].port, law):
        told = rig.fork(log, 4.5, recorded=True).events
    assert "the board of nf gives 4500 recorded commands again" in [event["text"] for event in told]
    with standing_in(scene.controllers["nf"].port, InPython()):
        told = rig.fork(log, 4.5, recorded=True).events
    warned = [event["text"] for event in told if event["kind"] == "warning"]
    assert "the board of nf gives other commands than the recording: " in warned[0]
    other = rig.fork(log, 4.5, {"drive.speed": "0.15 m/s"}, duration=1.0, recorded=True)
    assert other.time[-1] == pytest.approx(5.5)
    assert np.array_equal(other.commands["nf"].values, run.commands["nf"].values[: other.commands["nf"].tick.size])
    other.save(tmp_path / "other.mcap")
    assert verify(tmp_path / "other.mcap").passed


@pytest.mark.parametrize(
    ("scene", "base", "seconds"), [("belt_device", "belt_normal_force", 2), ("pendulum_device", "pendulum", 21)]
)
def test_the_shipped_scenes_run_with_the_shipped_stand_in(scene, base, seconds, shipped):
    port = board_port()
    with started(port, described(scenes.load(base, SOON))["nf"]):
        run = rig.simulate(scene, seconds, overrides={"controllers.nf.port": port})
    same(run, shipped(base, seconds, SOON))
    assert np.ptp(run.commands["nf"].values) > 1.0
    here = board_port()
    _, law = on_board("belt_normal_force", here)
    taken = pytest.raises(
        DeviceError, match="the stand-in for the board ended with code 1: it cannot answer there: Addr"
    )
    with standing_in(here, law), taken, started(here, described(scenes.load(base))["nf"]):
        pass
