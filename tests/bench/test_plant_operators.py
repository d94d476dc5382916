"""What operators may ask of the plant of a live run, and what it refuses."""

import time

import pytest
from plant_in_thread import Bench, same_again

from rig.bench.run.experiment import RUN_DOWN_NS
from rig.errors import BusError, ExitCode

LONG = "x" * 5000
ADMIT = {"do": "admit", "controller": "x", "drives": [], "period_ns": 10**6}
WRONG = [
    ("param/plant", {"set": {"friction.mu_statc": 0.4}}, "did you mean friction.mu_static"),
    ("param/plant", {"set": {"load.force": 5.0, "friction.mu_static": -1.0}}, "mu_static"),
    ("param/plant", {"set": {"load.force": "3 m"}}, "load.force"),
    ("param/plant", {"set": {LONG: 1.0}}, "unknown key"),
    ("param/plant", {"sett": {}}, "has 'sett'; it can have"),
    ("cmd/plant", {"do": "knock"}, "needs 'impulse'"),
    ("cmd/plant", {"do": "connect", "controller": "fn"}, "no controller is called fn; there are: nf"),
    ("cmd/plant", {"do": "step"}, "the run is not paused; pause it first"),
    ("cmd/plant", {"do": "admit", "controller": 5, "drives": "x"}, "controller: .*\n.*drives: .*\n.*period_ns: "),
    *[
        ("cmd/plant", ADMIT | wrong, text)
        for wrong, text in [
            ({"drives": ["load.force"]}, "by nf"),
            ({"controller": "../../evil x"}, "'../../evil x': is not a name"),
            ({"controller": "plant"}, "'plant' is taken"),
            ({"period_ns": 10**18}, "between 1 ms and 3600 s"),
            ({"period_ns": 1500}, "is no whole number of"),
            ({"drives": ["drive.speed"] * 2}, "is named twice"),
            ({"reads": ["y"], "hears": True}, "no sensor y; the sensors are vibrometer"),
        ]
    ],
]


def test_operators_stop_pause_and_are_told_what_is_wrong_and_what_is_allowed(scene):
    with Bench(scene, pace=1.0) as bench:
        bench.begin()

        def ask(topic, **body):
            return bench.me.ask(topic, body, 20.0)

        status = ask("cmd/plant", do="status")
        assert status["verdict"] in ("VALID", "DEGRADED", "INVALID")
        assert status["reasons"]
        assert (status["paused"], status["pace"]) == (False, 1.0)
        assert status["step"] >= 0
        for topic, body, wrong in WRONG:
            with pytest.raises(BusError, match=wrong) as refused:
                ask(topic, **body)
            assert len(str(refused.value)) < 700  # only the begin of what is long is repeated
        assert ask("param/plant", set={})["values"] == {}
        assert "parameter" not in [event.kind for event in bench.plant.experiment.journal.events]
        assert ask("param/plant", get=["friction", "load.force"])["values"]["load.force"] == 20.0
        for _ in range(2):
            ask("cmd/plant", do="pause")
        time.sleep(0.1)  # the frame under way ends
        first = ask("param/plant", get=[])["tick"]
        time.sleep(0.1)
        assert ask("param/plant", get=["load.force"])["tick"] == first
        for frames in (0, "two"):
            with pytest.raises(BusError, match=r'"frames" is .*; expected a whole number from 1 to 10000'):
                ask("cmd/plant", do="step", frames=frames)
        for frames in (3, 1):
            ask("cmd/plant", do="step", frames=frames)
            first += frames
            while (tick := ask("param/plant", get=[])["tick"]) < first:
                time.sleep(0.01)
            assert tick == first
        ask("cmd/plant", do="resume")
        while ask("cmd/plant", do="status")["tick"] <= first + 1:
            time.sleep(0.01)
        ask("cmd/plant", do="stop")
        heard = bench.finish()
    assert bench.summary["ended"] == "stopped by an operator"
    events = heard["event/plant"]
    assert [e.kind for e in events if e.kind in ("paused", "resumed", "stop")] == ["paused", "resumed", "stop"]
    assert [e.text for e in events if e.kind == "single_step"] == ["3 single steps", "1 single step"]


def test_an_emergency_stop_goes_to_the_safe_values_also_out_of_a_pause_and_simulates_again(scene):
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        ask = bench.me.ask
        ask("param/plant", {"set": {"drive.speed": 0.07, "load.force": 30.0}}, 20.0)
        time.sleep(0.1)
        ask("cmd/plant", {"do": "pause"}, 20.0)
        tick = ask("cmd/plant", {"do": "emergency"}, 20.0)["tick"]
        ask("cmd/plant", {"do": "emergency"}, 20.0)
        for topic, body in (
            ("param/plant", {"set": {"load.force": 40.0}}),
            ("cmd/plant", {"do": "knock", "impulse": 0.1}),
            ("cmd/plant", {"do": "connect", "controller": "nf"}),
        ):
            with pytest.raises(BusError, match="in its safe state and ends: emergency stop by an operator"):
                ask(topic, body, 20.0)
        heard = bench.finish()
    inputs = bench.plant.runner.inputs
    assert bench.plant.runner.values["drive.speed"] == inputs["drive.speed"].safe
    assert bench.plant.runner.values["load.force"] == inputs["load.force"].safe
    assert bench.summary["ended"] == bench.summary["fault"] == "emergency stop by an operator"
    assert bench.summary["exit_code"] == ExitCode.STOPPED
    assert bench.summary["ticks"] == tick + RUN_DOWN_NS // scene.frame_ns
    events = same_again(bench, heard)
    assert [event["tick"] for event in events if event["kind"] == "emergency"] == [tick]
