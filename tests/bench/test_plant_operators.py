"""What operators may ask of the plant of a live run, and what it refuses."""

import json
import re
import threading
import time

import numpy as np
import pytest
from plant_in_thread import Bench, played, samples

from rig.bench.run.experiment import RUN_DOWN_NS
from rig.bench.run.rig_variants import RigVariants
from rig.errors import BusError, ExitCode, UsageError

HUGE, LONG = 10**4000, "x" * 5000


@pytest.mark.parametrize(
    ("topic", "body", "told"),
    [
        ("param/plant", {"set": {"load.force": HUGE}}, "must be 0 to"),
        ("param/plant", {"set": {"load.force": f"{HUGE} N"}}, "must be 0 to"),
        ("param/plant", {"set": {"body.mass": LONG}}, "expected a number and a unit in kg"),
        ("param/plant", {"set": {LONG: 1.0}}, "unknown key"),
        ("param/plant", {"get": [LONG]}, "is not a parameter of this rig"),
        ("cmd/plant", {"do": "knock", "impulse": HUGE}, "it must be a finite number, -1e+06 to 1e+06 N*s"),
        ("cmd/plant", {"do": LONG}, "it can: begin"),
        ("cmd/plant", {"do": "connect", "controller": LONG}, "there are: nf"),
        ("cmd/plant", {"do": "admit", "controller": "a", "drives": [], "period_ns": HUGE}, "is no whole number of"),
        ("cmd/plant", {"do": "admit", "controller": "a", "drives": [], "period_ns": 1, LONG: 1}, "unknown key"),
    ],
)
def test_a_refusal_tells_what_is_allowed_and_repeats_only_the_begin_of_what_is_long(scene, topic, body, told):
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        with pytest.raises(BusError, match=re.escape(told)) as refused:
            bench.me.ask(topic, body, 20.0)
    assert len(str(refused.value)) < 700


def test_operators_stop_pause_and_are_told_what_is_wrong(scene):
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        ask = bench.me.ask
        found = ask("cmd/plant", {"do": "status"}, 20.0)
        assert found["verdict"] in ("VALID", "DEGRADED", "INVALID")
        assert found["reasons"]
        assert (found["paused"], found["pace"]) == (False, 1.0)
        assert found["step"] >= 0
        for topic, body, wrong in [
            ("param/plant", {"set": {"friction.mu_statc": 0.4}}, "did you mean friction.mu_static"),
            ("param/plant", {"set": {"friction.mu_static": "x"}}, "mu_static"),
            ("param/plant", {"set": {"load.force": 5.0, "friction.mu_static": -1.0}}, "mu_static"),
            ("param/plant", {"set": 5}, '"set" is 5; expected the keys to change'),
            ("param/plant", {"set": "x"}, "\"set\" is 'x'; expected the keys to change"),
            ("param/plant", {"get": "load.force"}, "\"get\" is 'load.force'; expected a list of keys"),
            ("param/plant", {"get": [5]}, "expected a list of keys"),
            ("param/plant", {"list": True, "set": {"load.force": 5.0}}, '"list" comes alone'),
            ("param/plant", {"list": 1}, '"list" is 1; expected true'),
            ("param/plant", {"sett": {}}, "has 'sett'; it can have"),
            ("param/plant", {"get": ["nothing"]}, "nothing"),
            ("param/plant", {"get": ["nothing"], "set": {"load.force": 5.0}}, "nothing"),
            ("cmd/plant", {"do": "knock", "impulse": "hard"}, "\"impulse\" is 'hard'; expected a number"),
            ("cmd/plant", {"do": "knock", "impulse": True}, '"impulse" is True; expected a number'),
            ("param/plant", {"set": {"load.force": "3 m"}}, "load.force"),
            ("param/plant", {"set": {"load.force": -1.0}}, "must be"),
            ("cmd/plant", {"do": "fly"}, "cannot 'fly'"),
            ("cmd/plant", {"do": "knock"}, "needs 'impulse'"),
            ("cmd/plant", {"do": "connect", "controller": "fn"}, "no controller is called fn"),
            ("cmd/plant", {"do": "admit", "controller": "x", "drives": ["load.force"], "period_ns": 10**6}, "by nf"),
            (
                "cmd/plant",
                {"do": "admit", "controller": 5, "drives": "x"},
                "controller: .*\n.*drives: .*\n.*period_ns: ",
            ),
            *[
                ("cmd/plant", {"do": "admit", "controller": "x", "drives": [], "period_ns": 10**6} | wrong, text)
                for wrong, text in [
                    ({"controller": "../../evil x"}, "'../../evil x': is not a name"),
                    ({"controller": ""}, "is not a name"),
                    ({"controller": "x" * 65}, "is not a name"),
                    ({"controller": "plant"}, "'plant' is taken"),
                    ({"period_ns": -(10**6)}, "period of -1000000 ns"),
                    ({"period_ns": 0}, "period of 0 ns"),
                    ({"period_ns": 10**18}, "between 1 ms and 3600 s"),
                    ({"period_ns": 1e6}, "period_ns: "),
                    ({"period_ns": True}, "period_ns: "),
                    ({"period_ns": float("nan")}, "not finite"),
                    ({"drives": ["drive.speed", "drive.speed"]}, "drive.speed: is named twice"),
                    ({"drives": [5]}, "drives.0: "),
                    ({"hears": "yes"}, "hears: "),
                    ({"sees": 1}, "sees: "),
                    ({"reads": ["y"]}, "no sensor y; the sensors are vibrometer"),
                ]
            ],
            (
                "cmd/plant",
                {"do": "admit", "controller": "x", "reads": ["y"], "drives": [], "period_ns": 10**6, "hears": True},
                "no sensor y; the sensors are vibrometer",
            ),
        ]:
            with pytest.raises(BusError, match=wrong):
                ask(topic, body, 2.0)
        assert ask("param/plant", {"set": {}}, 2.0)["values"] == {}
        assert "parameter" not in [event.kind for event in bench.plant.experiment.journal.events]
        assert ask("param/plant", {"get": ["friction", "load.force"]}, 2.0)["values"]["load.force"] == 20.0
        ask("cmd/plant", {"do": "pause"}, 2.0)
        first = ask("cmd/plant", {"do": "pause"}, 2.0)["tick"]
        time.sleep(0.1)
        assert ask("param/plant", {"get": ["load.force"]}, 2.0)["tick"] == first
        ask("cmd/plant", {"do": "resume"}, 2.0)
        time.sleep(0.1)
        assert ask("cmd/plant", {"do": "stop"}, 2.0)["tick"] > first
        heard = bench.finish()
    assert bench.summary["ended"] == "stopped by an operator"
    assert not any("passed without a frame" in fault for fault in bench.summary["faults"])
    kinds = [event.kind for event in bench.events(heard)]
    assert [kind for kind in kinds if kind in ("paused", "resumed", "stop")] == ["paused", "resumed", "stop"]


def test_what_cannot_be_tuned_is_refused_with_what_can(scene):
    with Bench(scene, pace=None) as bench:
        operator, experiment = bench.plant.operator, bench.plant.experiment
        for key, value in (("start.velocity", 1.0), ("friction.law", "coulomb")):
            with pytest.raises(UsageError, match=f"{key}: is fixed while the rig runs\n.*tuned: .*load.force") as told:
                operator.parameters({"set": {key: value}})
            assert "start." not in str(told.value).partition("\n")[2]
        assert not experiment.journal.events
        with pytest.raises(UsageError, match="known: ") as told:
            operator.parameters({"set": {"zzz": 1.0}})
        assert str(told.value).count("drive.speed,") == str(told.value).count("load.force,") == 1


def test_a_value_that_a_controller_overrules_is_told_to_wait(scene):
    with Bench(scene, pace=None) as bench:
        operator, exchange = bench.plant.operator, bench.plant.experiment.exchange
        assert operator.parameters({"set": {"load.force": 21.0}})["overruled"] == {}  # it has not commanded yet
        exchange.receive("nf", 0, (7.0,))
        exchange.take_over()
        told = operator.parameters({"set": {"load.force": 5.0, "drive.speed": 0.07}})
        assert told["values"] == {"load.force": 5.0, "drive.speed": 0.07}
        assert told["overruled"] == {"load.force": "nf"}
        assert operator.parameters({"get": ["load.force"]})["values"] == {"load.force": 7.0}
        operator.command({"do": "disconnect", "controller": "nf"})
        told = operator.parameters({"get": ["load.force"]})
        assert (told["values"], told["overruled"]) == ({"load.force": 5.0}, {})


def test_what_is_still_being_built_at_the_end_of_a_run_is_refused(scene, monkeypatch):
    over, variant = threading.Event(), RigVariants.build

    def after_the_run(variants, wanted, after=None):
        over.wait(20.0)
        return variant(variants, wanted, after)

    wanted = {"do": "admit", "controller": "mine", "drives": ["drive.speed"], "period_ns": scene.frame_ns}
    with Bench(scene, duration=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["drive.speed"]}, 20.0)  # the frames have begun
        monkeypatch.setattr(RigVariants, "build", after_the_run)
        with pytest.raises(BusError, match="the run ended before it was done"):
            bench.me.ask("cmd/plant", wanted, 20.0)
        over.set()
        bench.finish()


def test_a_paused_run_computes_single_steps(scene):
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        ask = bench.me.ask
        with pytest.raises(BusError, match="the run is not paused; pause it first"):
            ask("cmd/plant", {"do": "step"}, 5.0)
        ask("cmd/plant", {"do": "pause"}, 5.0)
        for frames in (0, True, "two", 10**6):
            with pytest.raises(BusError, match=r'"frames" is .*; expected a whole number from 1 to 10000'):
                ask("cmd/plant", {"do": "step", "frames": frames}, 5.0)
        time.sleep(0.1)
        first = ask("param/plant", {"get": []}, 5.0)["tick"]
        ask("cmd/plant", {"do": "step", "frames": 3}, 5.0)
        time.sleep(0.2)
        assert ask("param/plant", {"get": []}, 5.0)["tick"] == first + 3
        ask("cmd/plant", {"do": "step"}, 5.0)
        time.sleep(0.1)
        assert ask("param/plant", {"get": []}, 5.0)["tick"] == first + 4
        ask("cmd/plant", {"do": "resume"}, 5.0)
        time.sleep(0.1)
        assert ask("cmd/plant", {"do": "stop"}, 5.0)["tick"] > first + 4
        heard = bench.finish()
    steps = [event.text for event in bench.events(heard) if event.kind == "single_step"]
    assert steps == ["3 single steps", "1 single step"]


def test_an_emergency_stop_goes_to_the_safe_values_also_out_of_a_pause_and_simulates_again(scene):
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        ask = bench.me.ask
        ask("param/plant", {"set": {"drive.speed": 0.07, "load.force": 30.0}}, 5.0)
        time.sleep(0.1)
        ask("cmd/plant", {"do": "pause"}, 5.0)
        tick = ask("cmd/plant", {"do": "emergency"}, 5.0)["tick"]
        ask("cmd/plant", {"do": "emergency"}, 5.0)
        for topic, body in (
            ("param/plant", {"set": {"load.force": 40.0}}),
            ("cmd/plant", {"do": "knock", "impulse": 0.1}),
            ("cmd/plant", {"do": "connect", "controller": "nf"}),
        ):
            with pytest.raises(BusError, match="in its safe state and ends: emergency stop by an operator"):
                ask(topic, body, 5.0)
        heard = bench.finish()
    inputs = bench.plant.runner.inputs
    assert bench.plant.runner.values["drive.speed"] == inputs["drive.speed"].safe
    assert bench.plant.runner.values["load.force"] == inputs["load.force"].safe
    assert bench.summary["ended"] == bench.summary["fault"] == "emergency stop by an operator"
    assert bench.summary["exit_code"] == ExitCode.STOPPED
    assert bench.summary["ticks"] == tick + RUN_DOWN_NS // scene.frame_ns
    events = [
        {"kind": e.kind, "tick": e.tick, "t_ns": e.t_ns, "source": "plant", "text": e.text, "data": json.loads(e.data)}
        for e in bench.events(heard)
    ]
    assert [event["tick"] for event in events if event["kind"] == "emergency"] == [tick]
    again = played(scene, bench.summary["ticks"], {}, events)
    for name, known in again.items():
        assert np.concatenate(known).tolist() == samples(heard, name).tolist()
