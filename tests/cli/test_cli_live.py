"""Commands that use a live run: tune, topic."""

import json
import threading
from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest

from rig import bus
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
