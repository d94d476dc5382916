"""Controllers that work in the plant's process, on the twin of the bus."""

import json

import pytest
from plant_in_thread import commands, ran, same_bits

from rig import scenes
from rig.bench.live import asked_controllers
from rig.bench.run.simulate import simulate
from rig.controllers.blocks import feedback
from rig.errors import BusError
from rig.scenes.scene import Scene

IN_PLANT = {"controllers.nf.where": "plant", "controllers.nf.enable_at": "0.1 s"}


def in_one_process(scene, duration):
    return simulate(scene, duration_ns=round(duration * 1e9))


def events(heard, who="plant"):
    return [(event.kind, event.text, json.loads(event.data)) for event in heard.get(f"event/{who}", ())]


def two(**where):
    """A scene of two controllers; `where` each of them works."""
    raw = json.loads(scenes.load("belt_normal_force", {"controllers.nf.enable_at": "0.1 s"}).to_json())
    other = scenes.load(
        "belt_velocity_feedback", {"controllers.belt.enable_at": "0.2 s", "controllers.belt.period": "3 ms"}
    )
    raw["controllers"]["bv"] = json.loads(other.to_json())["controllers"]["belt"]
    for name, place in where.items():
        raw["controllers"][name]["where"] = place
    return Scene.from_json(json.dumps(raw))


@pytest.mark.parametrize(("pace", "delay"), [(None, "3 ms"), (2.0, "0 ms")], ids=["lockstep", "paced"])
def test_the_bits_are_those_of_a_run_in_one_process(pace, delay):
    scene = scenes.load("belt_normal_force", IN_PLANT | {"controllers.nf.delay": delay})
    bench, heard = ran(scene, pace=pace, duration=0.6)
    same_bits(heard, in_one_process(scene, 0.6))
    assert bench.summary["ended"] == "done"
    assert [fault for fault in bench.summary["faults"] if "of the wall clock" not in fault] == []  # a busy machine
    assert bench.summary["lost"] == {}
    assert bench.summary["loop"]["nf"]["taken"] == 600 - int(delay[0])
    assert "act/nf" not in heard


def test_in_lockstep_so_are_those_of_one_there_and_one_in_its_own_process(monkeypatch):
    """A second answer to a step that was sent again would come between two ticks of a controller that is due rarely."""
    monkeypatch.setattr(asked_controllers, "AGAIN", 1e-5)
    scene = two(nf="plant")
    _, heard = ran(scene, pace=None, duration=0.6)
    same_bits(heard, in_one_process(scene, 0.6))
    assert [topic for topic in sorted(heard) if topic.startswith("act/")] == ["act/bv"]


def test_one_that_wants_every_sample_gets_every_one():
    scene = scenes.load("brake_shunt_listener", {"controllers.listener.where": "plant"})
    same_bits(ran(scene, pace=None, duration=0.05)[1], in_one_process(scene, 0.05))


def test_operators_tune_it_ask_it_and_are_refused_as_by_any_controller():
    told = {}

    def meanwhile(me):
        me.ask("cmd/plant", {"do": "pause"}, 20.0, patient=True)
        told["list"] = me.ask("param/nf", {"list": True}, 20.0)
        told["set"] = me.ask("param/nf", {"set": {"gain": 321.0}}, 20.0)["values"]
        for key, changes in (("value", {"gain": "much"}), ("key", {"gian": 1.0}), ("fixed", {"where": "process"})):
            with pytest.raises(BusError) as refused:
                me.ask("param/nf", {"set": changes}, 20.0)
            told[key] = str(refused.value)
        me.ask("cmd/plant", {"do": "disconnect", "controller": "nf"}, 20.0)
        me.ask("cmd/plant", {"do": "resume"}, 20.0)
        told["present"] = me.present("controller/*")

    bench, heard = ran(scenes.load("belt_normal_force", IN_PLANT), meanwhile, pace=0.5, duration=1.0)
    assert told["list"]["units"]["gain"] == "N*s/m"
    assert "where" not in told["list"]["units"]
    assert told["set"]["gain"] == 321.0
    assert "gain: is 'much'; expected a number" in told["value"]
    assert "gian: no such parameter; near: gain" in told["key"]
    assert "where: is fixed while the rig runs" in told["fixed"]
    assert told["present"] == {("controller", "nf")}
    said = events(heard, "nf")
    assert [data["set"] for kind, _, data in said if kind == "parameter"] == [{"gain": 321.0}]
    assert sum(kind == "refused" for kind, *_ in said) == 3
    assert said[-1][0] == "left"
    assert said[-1][2]["updates"] == 1000  # it goes on to hear, connected or not
    assert "disconnected" in [kind for kind, *_ in events(heard)]
    assert bench.summary["loop"]["nf"]["taken"] < 1000
    (total,) = heard["total/nf"]
    assert dict(zip(total.sent_topic, total.sent))["event/nf"] == len(said)


def test_one_that_fails_leaves_and_safe_values_step_in(monkeypatch):
    sound = feedback.on_measured

    def update(constants, state, t_ns, values):
        if t_ns < 300_000_000:
            return sound(constants, state, t_ns, values)
        return state, (1.0, 2.0)

    monkeypatch.setattr(feedback, "on_measured", update)
    bench, heard = ran(scenes.load("belt_normal_force", IN_PLANT), pace=2.0, duration=0.6)
    why = "NormalForceFeedback.update commands (1.0, 2.0); expected a tuple with one number for each of load.force"
    said = events(heard, "nf")
    assert [kind for kind, *_ in said] == ["fault", "left"]
    assert why in said[0][1]
    assert why in " ".join(bench.summary["faults"])
    assert bench.summary["ended"] == "done"
    assert bench.summary["verdict"] != "VALID"
    assert any(fault.startswith("controller nf left at t = ") for fault in bench.summary["faults"])
    assert bench.summary["loop"]["nf"] | {"taken": 300, "safe": 1} == bench.summary["loop"]["nf"]
    assert commands(heard, "nf")[0].tolist() == [*range(300), 350]
    assert commands(heard, "nf")[2][-1] == 2
    assert len(heard["total/nf"]) == 1


FINE = {"clock.frame": "0.1 ms", "controllers.nf.where": "plant", "controllers.nf.period": "0.1 ms"}


def test_a_protocol_and_an_end_within_pieces_keep_their_ticks():
    """Frames of 0.1 ms, nf asked in each of them."""
    raw = json.loads(scenes.load("belt_normal_force", {**FINE, "controllers.nf.enable_at": "0.05 s"}).to_json())
    hold, louder = {"step": "hold", "time": 0.0123}, {"step": "set", "target": "controllers.nf.gain", "to": 500.0}
    knock = {"step": "knock", "impulse": 0.1}
    off, on = ({"step": step, "controller": "nf"} for step in ("disconnect", "connect"))
    raw["protocol"] = [hold, on, hold, louder, knock, hold, off, hold, on, hold]
    scene = Scene.from_json(json.dumps(raw))
    bench, heard = ran(scene, pace=1.0)
    same_bits(heard, in_one_process(scene, 0.0615))
    assert bench.summary["ticks"] == 615
    assert [data["after_tick"] for kind, _, data in events(heard, "nf") if kind == "parameter"] == [245]
