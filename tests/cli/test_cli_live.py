"""Commands that use a live run: tune, topic."""

import json
import threading
from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest
from going import Going
from plant_in_thread import Bench

from rig import bus, scenes
from rig import open as opened
from rig.bus import encode
from rig.bus.run_setup import Setup
from rig.errors import UsageError


@pytest.fixture
def plant(runs):
    """A run with one topic and one parameter, in this process."""
    tuned = {}

    def serve(body):
        tuned.update(body.get("set", {}))
        if unknown := [key for key in [*body.get("set", {}), *body.get("get", ())] if key not in TUNABLE]:
            raise UsageError(f"{unknown[0]}: unknown key")
        overruled = {"drive.speed": "nf"} if "drive.speed" in body.get("set", {}) else {}
        return {"values": {"load.force": 15.0, "drive.speed": 0.06}, "units": TUNABLE, "overruled": overruled}

    def command(body):
        tuned.update(body)
        return {"t_ns": 1_500_000_000}

    with bus.host("tried", scene="belt") as session:
        described = Setup("tried", "{}", 1_000_000, 1_000_000, {"velocity": "m/s"}, {"laser": ("m/s", 1_000_000)})
        servers = [session.serve("param/plant", serve), session.serve("scene", lambda _: described.to_json())]
        servers.append(session.serve("cmd/plant", command))
        publisher, ticks = session.publisher("meas/laser"), count()

        def publish():
            tick = next(ticks)
            publisher.put(encode.block(tick, tick * 1_000_000, 1_000_000, np.array([0.5])), tick * 1_000_000)

        session.announce()
        with polled(*servers, each=publish):
            yield tuned


@contextmanager
def polled(*servers, each=lambda: None):
    """Another thread that answers the queries, and calls `each` now and then."""
    stop = threading.Event()

    def live():
        while not stop.wait(0.005):
            for server in servers:
                server.poll()
            each()

    thread = threading.Thread(target=live)
    thread.start()
    yield
    stop.set()
    thread.join(5.0)


TUNABLE = {"load.force": "N", "drive.speed": "m/s"}


OPERATIONS = (
    (["pause"], {"do": "pause"}, "paused at t = 1.500000 s"),
    (["resume"], {"do": "resume"}, "continues from t = 1.500000 s"),
    (["step", "--frames", "3"], {"do": "step", "frames": 3}, "3 single steps from t = 1.500000 s"),
    (["stop"], {"do": "stop"}, "stopped at t = 1.500000 s"),
    (["stop", "--emergency"], {"do": "emergency"}, "emergency stop at t = 1.500000 s: all actuators"),
    (["knock", "-0.02"], {"do": "knock", "impulse": -0.02}, "knock with -0.02 N s at t = 1.500000 s"),
    (["knock", "-0,02 N*s"], {"do": "knock", "impulse": -0.02}, "knock with -0.02 N s at t = 1.500000 s"),
    (["connect", "nf"], {"do": "connect", "controller": "nf"}, "nf is connected from t = 1.500 s on"),
    (["disconnect", "nf"], {"do": "disconnect", "controller": "nf"}, "nf is disconnected from t = 1.500 s on"),
    (["tune", "load.force", "15,5 N"], {"load.force": "15.5 N"}, "load.force = 15"),
    (["tune", "load.force"], {}, "load.force = 15"),
    (["tune"], {}, "load.force"),
)


def test_operators_of_a_live_run_name_it_and_ask_which_if_there_are_several(rig, plant):
    for arguments, asked, told in OPERATIONS:
        plant.clear()
        code, out, err = rig("live", *arguments)
        assert (code, plant) == (0, asked), err
        assert told in out
        assert "run tried" in out
    plant.clear()
    with bus.host("second", scene="belt"):
        for arguments in (["pause"], ["tune", "load.force", "15 N"]):
            code, _, err = rig("live", *arguments)
            assert (code, "several runs are live: second, tried; name one with --run" in err) == (2, True), err
            assert plant == {}
        assert "run tried" in rig("live", "pause", "--run", "tried")[1]
    code, _, err = rig("live", "knock", "hard")
    assert (code, "IMPULSE is 'hard'" in err) == (2, True)


def test_a_run_that_is_not_paused_is_not_said_to_continue(rig, runs):
    with Bench(scenes.load("belt_normal_force"), pace=None) as bench:
        command = bench.plant.operator.command
        changed = [command({"do": what})["changed"] for what in ("resume", "pause", "pause", "resume", "resume")]
    assert changed == [False, True, False, True, False]


@pytest.fixture
def mine(plant):
    """A controller in that run, with one parameter."""
    tuned = {}

    def serve(body):
        tuned.update(body.get("set", {}))
        return {"values": {"swing": tuned.get("swing", 10.0)}, "units": {"swing": "N"}}

    with bus.join("tried", role="controller", name="mine") as session:
        server = session.serve("param/mine", serve)
        session.announce()
        with polled(server):
            yield tuned


def test_a_parameter_of_a_controller_is_tuned_by_its_short_name_too(rig, mine):
    for key, value in (("mine.swing", "5"), ("controllers.mine.swing", "7")):
        code, out, err = rig("live", "tune", key, value)
        assert (code, out) == (0, f"{key} = {value}  (run tried)\n"), err
    assert mine == {"swing": 7.0}
    assert rig("live", "tune", "mine.swing")[1] == "mine.swing = 7  (run tried)\n"
    assert rig("live", "tune", "drive.speed")[1] == "drive.speed = 0.06  (run tried)\n"
    for key, told in (("mine", "name the parameter too"), ("controllers.nf.gain", "there are: mine")):
        code, _, err = rig("live", "tune", key, "1")
        assert code == 2
        assert told in err


def test_tune_lists_what_can_be_tuned(rig, mine):
    rows = [line.split() for line in rig("live", "tune")[1].splitlines()]
    assert ["load.force", "15", "N", "plant"] in rows
    assert ["mine.swing", "10", "N", "mine"] in rows
    assert {row["key"] for row in json.loads(rig("live", "tune", "--json")[1])} == {
        "load.force",
        "drive.speed",
        "mine.swing",
    }
    code, _, err = rig("live", "tune", "load.forse", "1")
    assert (code, "unknown key" in err, "lists what can be tuned" in err) == (2, True, True)


def test_a_value_that_is_not_in_force_is_told_to_wait(rig, plant):
    told = "nf drives drive.speed; the value 0.06 takes effect when nf is disconnected  (run tried)\n"
    assert rig("live", "tune", "drive.speed", "0.06")[1] == told
    assert json.loads(rig("live", "tune", "drive.speed", "0.06", "--json")[1])["overruled"] == {"drive.speed": "nf"}
    assert rig("live", "tune", "drive.speed")[1] == "drive.speed = 0.06  (run tried)\n"


def test_topics_of_a_live_run_are_heard(rig, plant):
    code, out, err = rig("live", "topic", "hz", "meas/*", "--for", "0.3", "--json")
    assert code == 0, err
    (row,) = json.loads(out)
    assert (row["topic"], row["lost"], row["hz"] > 20.0) == ("meas/laser", 0, True)
    code, out, err = rig("live", "topic", "echo", "meas/laser", "--count", "2")
    first, second = map(json.loads, out.splitlines())
    assert (code, first["v"], second["seq"]) == (0, [0.5], first["seq"] + 1), err
    assert "meas/laser" in rig("live", "topic", "ls", "--for", "0.2")[1]


WATCHER = """
import sys
from rig.controllers.blocks.base import Gain, Section

NAMES = []
sys.addaudithook(lambda event, given: NAMES.append(given[0]) if event == "import" else None)

class Parameters(Section):
    gain: Gain = 1.0

class Controller:
    reads, drives, period_ns = ("vibrometer",), (), 1_000_000

    def __init__(self, section, numbers):
        self.section = section

    def start(self):
        return ()

    def update(self, state, t_ns, values):
        if t_ns < 10_000_000:  # the rehearsal, and what loading this file needs
            NAMES.clear()
        return state, ()

    def take_messages(self):
        told = [f"imports {name}" for name in NAMES]
        NAMES.clear()
        return told
"""


def test_no_command_of_an_operator_makes_a_running_loop_import_anything(rig, runs):
    (runs / "watcher.py").write_text(WATCHER)
    kind = str(runs / "watcher.py")
    changes = {"controllers.outside.kind": kind, "controllers.inside.kind": kind, "controllers.inside.where": "plant"}
    going = Going(scenes.load("belt_normal_force", changes), duration=60.0, out=runs / "run.mcap")
    going.line("begin: begins with")
    for arguments, fault in (
        ("tune", ""),
        ("tune friction.mu_static 45%", ""),
        ("tune body.mass 4900g", ""),
        ("tune drive.speed 61mm/s", ""),
        ("tune load.force 15.5kp", "load.force: is '15.5kp'"),
        *((f"tune {name}.gain 0.2V*s/mm", "") for name in ("outside", "controllers.inside")),
        *((f"tune {name}.gain 5kg", "gain: is '5kg'; expected a unit") for name in ("outside", "inside", "nf")),
        *((f"tune {name}.period 2ms", "is fixed") for name in ("outside", "inside")),
        ("tune outside.gian 1V", "no such parameter; near: gain"),
        ("tune nf.gain 0.15N*s/mm", ""),
        ("knock 20N*ms", ""),
        ("pause", ""),
        ("step --frames 3", ""),
        ("resume", ""),
        ("disconnect nf", ""),
        ("connect nf", ""),
        ("connect nobody", "no controller is called nobody"),
        ("stop --emergency", ""),
    ):
        code, _, err = rig("live", *arguments.split())
        assert (code, fault in err) == (2 if fault else 0, True), (arguments, err)
    going.wait(60.0)
    run = opened(runs / "run.mcap")
    assert [event["text"] for event in run.events if event["kind"] == "log"] == []
    tuned = [event["data"]["set"] for event in run.events if event["kind"] == "parameter"]
    assert {"gain": pytest.approx(200.0)} in tuned
