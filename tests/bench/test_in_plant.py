"""Controllers that work in the plant's process, on the twin of the bus."""

import json
import threading

import numpy as np
import pytest
from twin import Twin

from rig import controllers, scenes
from rig.bench.live import asked_controllers
from rig.bench.live.outcome import Job
from rig.bench.live.plant import Plant
from rig.bench.run.simulate import simulate
from rig.bus import messages
from rig.bus.run_setup import fetch
from rig.controllers.blocks import feedback
from rig.controllers.runtime.process import Worker
from rig.errors import BusError
from rig.scenes.scene import Scene

IN_PLANT = {"controllers.nf.where": "plant", "controllers.nf.enable_at": "0.1 s"}


class Ran:
    """A run of `scene` from its first frame to its last; `meanwhile(me)` is what an operator does to it."""

    def __init__(self, scene, meanwhile=lambda me: None, **job):
        twin = Twin("test")
        session, me = twin.open("plant", "plant"), twin.open("operator", "test")
        heard = me.subscribe("**", depth=1 << 20)
        outside = [name for name in scene.controllers if name not in scene.in_plant]
        expect = tuple(("controller", name) for name in outside)
        self.plant = Plant(session, Job(scene.to_json(), wait=5.0, expect=expect, **job), lambda: "")
        session.announce()
        threads = [threading.Thread(target=self._control, args=(twin.open("controller", n),)) for n in outside]
        threads.append(threading.Thread(target=self._run, args=(session,)))
        for thread in threads:
            thread.start()
        meanwhile(me)
        for thread in threads:
            thread.join(30.0)
        assert not any(thread.is_alive() for thread in threads)
        self.heard = {}
        for message in heard.drain():
            self.heard.setdefault(message.topic, []).append(message.said or message.payload)

    @staticmethod
    def _control(session):
        described = fetch(session)
        worker = Worker(session, described, controllers.restored(described.controllers[session.name]))
        worker.follow(lambda: False)
        session.close()

    def _run(self, session):
        self.plant.gather(lambda _: None)
        self.summary = self.plant.run(lambda _: None)
        session.close()

    def events(self, who="plant"):
        return [(event.kind, event.text, json.loads(event.data)) for event in self.heard.get(f"event/{who}", ())]

    def samples(self, sensor):
        return np.concatenate([block.v for block in self.heard[f"meas/{sensor}"]])

    def commands(self, name):
        """Tick, answered, status and values of every command as it took effect."""
        rows = [messages.commands(applied) for applied in self.heard[f"applied/{name}"]]
        return [np.concatenate(column) for column in zip(*rows)]


def in_one_process(scene, duration):
    return simulate(scene, duration_ns=round(duration * 1e9))


def same_bits(ran, run):
    for sensor, known in run.measurements.items():
        assert ran.samples(sensor).tobytes() == known.v.tobytes()
    for name, known in run.commands.items():
        tick, answered, status, values = ran.commands(name)
        assert [tick.tolist(), answered.tolist(), status.tolist()] == [known.tick.tolist(), known.answered.tolist(),
                                                                       known.status.tolist()]  # fmt: skip
        assert values.tobytes() == known.values.tobytes()


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
    ran = Ran(scene, pace=pace, duration=0.6)
    same_bits(ran, in_one_process(scene, 0.6))
    assert ran.summary["ended"] == "done"
    assert ran.summary["faults"] == []
    assert ran.summary["lost"] == {}
    assert ran.summary["loop"]["nf"]["taken"] == 600 - int(delay[0])
    assert "act/nf" not in ran.heard


def test_so_are_those_of_two_that_both_work_there():
    scene = two(nf="plant", bv="plant")
    same_bits(Ran(scene, pace=3.0, duration=0.6), in_one_process(scene, 0.6))


@pytest.mark.parametrize("again", [asked_controllers.AGAIN, 1e-5])
def test_in_lockstep_so_are_those_of_one_there_and_one_in_its_own_process(monkeypatch, again):
    """A second answer to a step that was sent again would come between two ticks of a controller that is due rarely."""
    monkeypatch.setattr(asked_controllers, "AGAIN", again)
    scene = two(nf="plant")
    ran = Ran(scene, pace=None, duration=0.6)
    same_bits(ran, in_one_process(scene, 0.6))
    assert [topic for topic in sorted(ran.heard) if topic.startswith("act/")] == ["act/bv"]


def test_one_there_and_one_in_its_own_process_paced():
    ran = Ran(two(nf="plant"), pace=2.0, duration=0.6)
    ages = {name: np.subtract(*ran.commands(name)[:2]) for name in ("nf", "bv")}
    assert ages["nf"].max() == 0
    assert ages["bv"].min() >= 1
    assert ran.summary["loop"]["nf"]["taken"] == 600


def test_one_that_wants_every_sample_gets_every_one():
    scene = scenes.load("brake_shunt_listener", {"controllers.listener.where": "plant"})
    same_bits(Ran(scene, pace=None, duration=0.05), in_one_process(scene, 0.05))


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

    ran = Ran(scenes.load("belt_normal_force", IN_PLANT), meanwhile, pace=4.0, duration=1.0)
    assert told["list"]["units"]["gain"] == "N*s/m"
    assert "where" not in told["list"]["units"]
    assert told["set"]["gain"] == 321.0
    assert "gain: is 'much'; expected a number" in told["value"]
    assert "gian: no such parameter; near: gain" in told["key"]
    assert "where: is fixed while the rig runs" in told["fixed"]
    assert told["present"] == {("controller", "nf")}
    said = ran.events("nf")
    assert [data["set"] for kind, _, data in said if kind == "parameter"] == [{"gain": 321.0}]
    assert sum(kind == "refused" for kind, *_ in said) == 3
    assert said[-1][0] == "left"
    assert said[-1][2]["updates"] == 1000  # it goes on to hear, connected or not
    assert "disconnected" in [kind for kind, *_ in ran.events()]
    assert ran.summary["loop"]["nf"]["taken"] < 1000
    (total,) = ran.heard["total/nf"]
    assert dict(zip(total.sent_topic, total.sent))["event/nf"] == len(said)


def test_the_protocol_sets_and_disconnects_it_at_the_same_ticks_as_in_one_process():
    raw = json.loads(scenes.load("belt_normal_force", IN_PLANT).to_json())
    hold, louder = {"step": "hold", "time": 0.15}, {"step": "set", "target": "controllers.nf.gain", "to": 500.0}
    on, off = ({"step": step, "controller": "nf"} for step in ("connect", "disconnect"))
    raw["protocol"] = [hold, on, hold, louder, hold, off, hold, on, hold]
    scene = Scene.from_json(json.dumps(raw))
    ran = Ran(scene, pace=4.0)
    same_bits(ran, in_one_process(scene, 0.75))
    assert ran.commands("nf")[0].min() == 150
    assert [data["after_tick"] for kind, _, data in ran.events("nf") if kind == "parameter"] == [299]


@pytest.mark.parametrize(("pace", "how"), [(None, "raises"), (2.0, "answers nonsense")])
def test_one_that_fails_leaves_and_safe_values_step_in(monkeypatch, pace, how):
    sound = feedback.on_measured

    def update(constants, state, t_ns, values):
        if t_ns < 300_000_000:
            return sound(constants, state, t_ns, values)
        if how == "raises":
            raise ZeroDivisionError("there is no such force")
        return state, (1.0, 2.0)

    monkeypatch.setattr(feedback, "on_measured", update)
    ran = Ran(scenes.load("belt_normal_force", IN_PLANT), pace=pace, duration=0.6)
    why = (
        "controller nf failed at t = 0.3 s: ZeroDivisionError: there is no such force"
        if how == "raises"
        else "NormalForceFeedback.update commands (1.0, 2.0); expected a tuple with one number for each of load.force"
    )
    said = ran.events("nf")
    assert [kind for kind, *_ in said] == ["fault", "left"]
    assert why in said[0][1]
    assert why in " ".join(ran.summary["faults"])
    assert ran.summary["ended"] == "done"
    assert ran.summary["verdict"] != "VALID"
    assert any(fault.startswith("controller nf left at t = ") for fault in ran.summary["faults"])
    assert ran.summary["loop"]["nf"] | {"taken": 300, "safe": 1} == ran.summary["loop"]["nf"]
    assert ran.commands("nf")[0].tolist() == [*range(300), 350]
    assert ran.commands("nf")[2][-1] == 2
    assert len(ran.heard["total/nf"]) == 1


def test_one_that_has_left_is_tuned_no_more(monkeypatch):
    def update(constants, state, t_ns, values):
        raise ZeroDivisionError

    monkeypatch.setattr(feedback, "on_measured", update)
    raw = json.loads(scenes.load("belt_normal_force", IN_PLANT).to_json())
    louder = {"step": "set", "target": "controllers.nf.gain", "to": 500.0}
    raw["protocol"] = [{"step": "hold", "time": 0.1}, louder, {"step": "hold", "time": 0.1}]
    ran = Ran(Scene.from_json(json.dumps(raw)), pace=None)
    (refused,) = [text for kind, text, _ in ran.events() if kind == "refused"]
    assert refused == "controllers.nf.gain = 500: controller nf has left"
    assert ran.summary["ended"] == "done"


FINE = {"clock.frame": "0.1 ms", "controllers.nf.where": "plant", "controllers.nf.period": "0.1 ms"}


def fine(protocol=None, **where):
    """Frames of 0.1 ms, nf asked in each of them."""
    raw = json.loads(scenes.load("belt_normal_force", {**FINE, "controllers.nf.enable_at": "0.05 s"}).to_json())
    if where:
        raw["controllers"]["bv"] = json.loads(two().to_json())["controllers"]["bv"] | where
    raw["protocol"] = protocol or raw["protocol"]
    return Scene.from_json(json.dumps(raw))


@pytest.mark.parametrize("pace", [None, 1.0], ids=["lockstep", "paced"])
def test_short_frames_are_carried_and_told_in_pieces_with_the_same_bits(pace):
    scene = fine()
    ran = Ran(scene, pace=pace, duration=0.2)
    same_bits(ran, in_one_process(scene, 0.2))
    assert [step.tick for step in ran.heard["step"]] == [*range(0, 2001 if pace else 2000, 10)]
    assert [list(each.ticks) for each in ran.heard["applied/nf"]] == [[*range(k, k + 10)] for k in range(0, 2000, 10)]
    states = messages.state_type(ran.plant.runner.outputs)
    assert [states.FromString(each).t_ns for each in ran.heard["state"]] == [*range(0, 200_000_001, 5_000_000)]
    assert ran.summary["ticks"] == 2000
    if pace is not None:
        assert (ran.summary["timing"]["each"], ran.summary["timing"]["frames"]) == (10, 201)


def test_a_protocol_and_an_end_within_pieces_keep_their_ticks():
    hold, louder = {"step": "hold", "time": 0.0123}, {"step": "set", "target": "controllers.nf.gain", "to": 500.0}
    knock = {"step": "knock", "impulse": 0.1}
    off, on = ({"step": step, "controller": "nf"} for step in ("disconnect", "connect"))
    scene = fine([hold, on, hold, louder, knock, hold, off, hold, on, hold])
    ran = Ran(scene, pace=1.0)
    same_bits(ran, in_one_process(scene, 0.0615))
    assert ran.summary["ticks"] == 615
    assert [data["after_tick"] for kind, _, data in ran.events("nf") if kind == "parameter"] == [245]


def test_a_limit_within_a_piece_ends_in_the_safe_state_at_its_tick():
    scene = scenes.load("belt_normal_force", {**FINE, "limits.displacement": "1 mm"})
    ran, run = Ran(scene, pace=4.0), in_one_process(scene, 2.0)
    (told,) = [event["tick"] for event in run.events if event["kind"] == "limit"]
    (tick,) = [event.tick for event in ran.heard["event/plant"] if event.kind == "limit"]
    assert tick == told
    assert tick % 10
    same_bits(ran, run)


def test_numerics_that_stop_within_a_piece_lose_no_frame_before():
    raw = json.loads(fine([{"step": "hold", "time": 0.0123}, {"step": "knock", "impulse": 1e5}]).to_json())
    raw["clock"]["limit"] = 1000.0
    scene = Scene.from_json(json.dumps(raw))
    ran, run = Ran(scene, pace=1.0, duration=1.0), in_one_process(scene, 1.0)
    assert run.fault
    assert ran.summary["exit_code"] == 4
    assert ran.summary["fault"] == run.fault
    for sensor, known in run.measurements.items():
        assert ran.samples(sensor).tobytes() == known.v.tobytes()


def test_one_that_fails_within_a_piece_ends_at_its_tick(monkeypatch):
    sound = feedback.on_measured

    def update(constants, state, t_ns, values):
        if t_ns >= 123_400_000:
            raise ZeroDivisionError("there is no such force")
        return sound(constants, state, t_ns, values)

    monkeypatch.setattr(feedback, "on_measured", update)
    ran = Ran(fine(), pace=1.0, duration=0.2)
    (fault,) = [event for event in ran.heard["event/nf"] if event.kind == "fault"]
    assert (fault.tick, fault.text) == (
        1234,
        "controller nf failed at t = 0.1234 s: ZeroDivisionError: there is no such force",
    )
    assert ran.commands("nf")[0].tolist() == [*range(1234), 1284]
    assert ran.commands("nf")[2].tolist() == [*[0] * 1234, 2]
    assert ran.summary["ticks"] == 2000
    assert ran.summary["verdict"] != "VALID"


@pytest.mark.parametrize(("period", "frames"), [(0.003, 10), (0.0004, 4)])
def test_one_in_its_own_process_is_asked_whenever_it_is_due(period, frames):
    scene = fine(period=period)
    ran = Ran(scene, pace=None, duration=0.1)
    same_bits(ran, in_one_process(scene, 0.1))
    asked = dict.fromkeys(step.tick for step in ran.heard["step"])  # a busy machine makes the plant repeat a step
    assert [*asked] == [*range(0, 1000, frames)]


def test_where_all_are_in_their_own_processes_frames_are_carried_one_by_one():
    ran = Ran(scenes.load("belt_normal_force", {"clock.frame": "0.1 ms"}), pace=1.0, duration=0.05)
    assert ran.summary["timing"]["each"] == 1
    assert len(ran.heard["step"]) == 501


def test_a_guest_that_wants_every_frame_makes_pieces_of_one(monkeypatch):
    def meanwhile(me):
        me.ask("param/plant", {"get": ["load.force"]}, 20.0, patient=True)
        body = {"do": "admit", "controller": "mine", "drives": ["drive.speed"], "period_ns": 300_000, "reads": []}
        me.ask("cmd/plant", body, 20.0)

    scene = fine()
    ran = Ran(scene, meanwhile, pace=1.0, duration=0.5)
    (admitted,) = [event.tick for event in ran.heard["event/plant"] if event.kind == "admitted"]
    ticks = [step.tick for step in ran.heard["step"]]
    assert {*range(admitted // 30 * 30 + 30, 5001, 3)} <= {*ticks}
    assert [tick % 10 for tick in ticks if tick < admitted] == [0] * sum(tick < admitted for tick in ticks)
    assert ran.summary["ticks"] == 5000


def test_a_scene_that_does_not_say_where_is_read_as_before():
    raw = json.loads(scenes.load("belt_normal_force").to_json())
    assert raw["controllers"]["nf"].pop("where") == "process"
    assert Scene.from_json(json.dumps(raw)).in_plant == frozenset()
    assert scenes.load("belt_normal_force", IN_PLANT).in_plant == {"nf"}
