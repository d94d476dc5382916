"""The plant as the others see it, on the twin of the bus: no process, but everything else is real."""

import json
import re
import threading
import time

import numpy as np
import pytest
from twin import Twin

from rig import controllers, scenes
from rig.bench.experiment import Experiment
from rig.bench.finalise import _verdict
from rig.bench.job import Job
from rig.bench.plant import Plant
from rig.bench.playback import Playback
from rig.bench.runner import PlantRunner
from rig.bench.simulate import simulate
from rig.bench.status import summary
from rig.bench.supervise import Team
from rig.bus import encode, messages
from rig.bus.arrivals import HEADER, Arrived, Count
from rig.bus.run_setup import fetch
from rig.controllers.runtime.file import load_file
from rig.controllers.runtime.process import Worker
from rig.errors import BusError, UsageError
from rig.motion.motion import Motion
from rig.quantities import si
from rig.record.run import Commands
from rig.scenes.scene import Scene

SCENE = "belt_normal_force"


@pytest.fixture(scope="module")
def scene():
    si("1 ms", "s")  # loads the units, as the process does before it begins
    return scenes.load(SCENE)


class Bench:
    """One run in a thread; the test plays everybody else."""

    def __init__(self, scene, **job):
        self.twin = Twin("test")
        self.stopped = ""
        self.job = Job(scene.to_json(), **{"wait": 5.0, **job})
        self.session = self.twin.open("plant", "plant")
        self.plant = Plant(self.session, self.job, lambda: self.stopped)
        self.me = self.twin.open("operator", "test")
        self.heard = self.me.subscribe("**", depth=1 << 20)
        self.session.announce()
        self.summary = None
        self.threads = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stopped = "by the test"
        for thread in self.threads:
            thread.join(20.0)
        assert not any(thread.is_alive() for thread in self.threads)

    def thread(self, function, *arguments):
        thread = threading.Thread(target=function, args=arguments, daemon=True)
        thread.start()
        self.threads.append(thread)
        return thread

    def begin(self):
        def run():
            self.plant.gather(lambda _: None)
            self.summary = self.plant.run(lambda _: None)
            self.session.close()

        return self.thread(run)

    def controller(self, name="nf"):
        """The controller of the scene, in a thread; returns what makes it leave."""
        session = self.twin.open("controller", name)
        gone = threading.Event()

        def run():
            described = fetch(session)
            worker = Worker(session, described, controllers.restored(described.controllers[name]))
            worker.follow(gone.is_set)
            session.close()

        self.thread(run)
        return gone

    def finish(self):
        for thread in self.threads:
            thread.join(20.0)
        messages_of = {}
        for message in self.heard.drain():
            messages_of.setdefault(message.topic, []).append(message.payload)
        return messages_of

    def events(self, heard):
        return [messages.decode("event/plant", payload) for payload in heard["event/plant"]]


def samples(heard, name):
    return np.concatenate([messages.decode(f"meas/{name}", p).v for p in heard[f"meas/{name}"]])


def test_lockstep_gives_the_bits_of_a_run_in_one_process(scene):
    with Bench(scene, pace=None, duration=1.0, expect=(("controller", "nf"),)) as bench:
        bench.controller()
        bench.begin()
        heard = bench.finish()
    run = simulate(scene, duration_ns=10**9)
    for name, known in run.measurements.items():
        assert samples(heard, name).tobytes() == known.v.tobytes()
    states = messages.state_type(bench.plant.runner.outputs)
    last = states.FromString(heard["state"][-1])
    assert last.t_ns == 10**9
    assert last.velocity == run.signals["velocity"][-1]
    applied = [messages.decode("applied/nf", payload) for payload in heard["applied/nf"]]
    assert [a.tick for a in applied] == run.commands["nf"].tick.tolist()
    assert np.array([list(a.values) for a in applied]).tobytes() == run.commands["nf"].values.tobytes()
    assert bench.summary["verdict"] == "VALID"
    assert bench.summary["exit_code"] == 0
    assert 0.0 < bench.summary["round_trip"]["p50"] <= bench.summary["round_trip"]["max"]


def test_a_paced_run_can_be_simulated_again_to_the_bit(scene):
    with Bench(scene, duration=1.0, pace=2.0, expect=(("controller", "nf"),)) as bench:
        bench.controller()
        bench.begin()
        time.sleep(0.2)
        told = bench.me.ask("param/plant", {"set": {"friction.mu_static": 0.45}}, 2.0)
        bench.me.ask("cmd/plant", {"do": "knock", "impulse": 0.2}, 2.0)
        waits = bench.me.ask("param/plant", {"set": {"load.force": 15.0}}, 2.0)
        bench.me.ask("cmd/plant", {"do": "disconnect", "controller": "nf"}, 2.0)
        heard = bench.finish()
    assert told["values"] == {"friction.mu_static": 0.45}
    assert waits["overruled"] == {"load.force": "nf"}
    applied = [messages.decode("applied/nf", payload) for payload in heard["applied/nf"]]
    commands = Commands(
        *(np.array([getattr(a, f) for a in applied], np.int64) for f in ("tick", "answered", "status")),
        np.array([list(a.values) for a in applied]),
    )
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    again = played(scene, bench.summary["ticks"], {"nf": commands}, events)
    for name, known in again.items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()
    assert any(commands.answered < commands.tick)


def played(scene, ticks, commands, events):
    """Samples of every sensor when a run is simulated again from what came from outside."""
    runner = PlantRunner(scene)
    experiment = Experiment(scene, runner, ticks * scene.frame_ns, None, exchange=Playback, events=events)
    experiment.exchange.play(commands)
    experiment.open()
    found = {name: [] for name in runner.bank.names}
    while True:
        for i, name in enumerate(runner.bank.names):
            found[name].append(runner.bank.samples(i).copy())
        if not experiment.begin():
            return found
        experiment.take_over()
        runner.frame()


@pytest.mark.parametrize("pace", [2.0, None], ids=["paced", "lockstep"])
def test_a_controller_that_joins_builds_the_rig_once(monkeypatch, pace):
    """It drives a load that has no command state, and the run can be simulated again to the bit."""
    scene, built = scenes.load("belt"), []
    replaced = Motion.replace
    monkeypatch.setattr(Motion, "replace", lambda motion, ready: built.append(motion) or replaced(motion, ready))
    here = () if pace else (("controller", "example_controller"),)  # in lockstep it joins before the first frame
    with Bench(scene, duration=1.5, pace=pace, expect=here) as bench:
        session, gone = bench.twin.open("controller", "example_controller"), threading.Event()

        def work():
            worker = Worker(session, fetch(session), load_file("docs/example_controller.py"))
            worker.follow(gone.is_set)
            session.close()

        bench.begin()
        bench.thread(work)
        heard = bench.finish()
    applied = [messages.decode("applied/example_controller", p) for p in heard["applied/example_controller"]]
    values = np.array([list(a.values) for a in applied])
    assert len(np.unique(values)) > 1
    assert built == [bench.plant.runner.motion]
    commands = Commands(
        *(np.array([getattr(a, f) for a in applied], np.int64) for f in ("tick", "answered", "status")), values
    )
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    again = played(scene, bench.summary["ticks"], {"example_controller": commands}, events)
    for name, known in again.items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()


@pytest.mark.parametrize("limits", [{}, {"displacement": 0.05}], ids=["", "with a limit"])
def test_no_frame_builds_a_rig_for_what_an_operator_tunes_and_the_protocol_sets_then(monkeypatch, limits):
    """A coefficient has no command state: each value is another matrix, built apart and in force at one tick."""
    raw = json.loads(scenes.load("belt_shunt").to_json()) | {"limits": limits}
    hold = {"step": "hold", "time": 1.5}
    raw["protocol"] = [hold, {"step": "set", "target": "shunt.resistance", "to": 40.0}, hold | {"time": 0.2}]
    scene = Scene.from_json(json.dumps(raw))
    monkeypatch.setattr("rig.bench.prepared_rigs.PAUSE_S", 0.05)
    built, ready = [], Motion.ready

    def noted(*given):
        built.append(threading.current_thread().name)
        return ready(*given)

    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        monkeypatch.setattr(Motion, "ready", noted)
        told = bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8, "load.force": 11.0}}, 5.0)
        heard = bench.finish()
    assert told["values"] == {"shunt.delta": -0.8, "load.force": 11.0}
    assert bench.plant.runner.values["shunt.resistance"] == 40.0
    assert set(built) == {"variant"}
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    assert [e["tick"] for e in events if e["kind"] == "parameter"] == [told["tick"]]
    again = played(scene, bench.summary["ticks"], {}, events)
    for name, known in again.items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()


def rebuilt_apart(bench, heard, scene, built):
    """The events of a run in which no frame built a rig, and which comes out the same when it is simulated again."""
    assert set(built) == {"variant"}
    commands = {}
    for topic in [topic for topic in heard if topic.startswith("applied/")]:
        said = [messages.decode(topic, payload) for payload in heard[topic]]
        commands[topic[8:]] = Commands(
            *(np.array([getattr(a, f) for a in said], np.int64) for f in ("tick", "answered", "status")),
            np.array([list(a.values) for a in said]),
        )
    events = [{"tick": e.tick, "kind": e.kind, "data": json.loads(e.data)} for e in bench.events(heard)]
    for name, known in played(scene, bench.summary["ticks"], commands, events).items():
        assert samples(heard, name).tobytes() == np.concatenate(known).tobytes()
    return events


@pytest.fixture
def built(monkeypatch):
    """Names of the threads that build matrices, once the second of these is called."""
    found, ready = [], Motion.ready

    def noted(*given):
        found.append(threading.current_thread().name)
        return ready(*given)

    return found, lambda: monkeypatch.setattr(Motion, "ready", noted)


def test_what_the_protocol_sets_right_after_an_operator_has_tuned_waits_for_its_matrices(built):
    """In the order of the protocol; what needs no other matrices does not wait."""
    found, begin = built
    steps = [("shunt.resistance", 40.0), ("friction.mu_static", 0.45), ("shunt.connected", 0)]
    steps.append(("shunt.resistance", 30.0))
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 0.5}
    raw["protocol"] = [hold, *({"step": "set", "target": key, "to": to} for key, to in steps), hold | {"time": 1.5}]
    scene = Scene.from_json(json.dumps(raw))
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()
        told = bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8}}, 5.0)
        heard = bench.finish()
    assert told["tick"] < 500
    runner = bench.plant.runner
    assert (runner.values["shunt.resistance"], runner.parameter("friction.mu_static")) == (30.0, 0.45)
    events = rebuilt_apart(bench, heard, scene, found)
    waited = {kind: [e for e in events if e["kind"] == kind] for kind in ("waits", "goes on")}
    assert [e["tick"] for e in waited["waits"]] == [500] * 3
    order = [e["data"]["action"] for e in waited["goes on"]]
    assert order == sorted(order)
    assert len(order) == 3
    assert all(e["tick"] > 500 for e in waited["goes on"])


class Gate:
    """Threads that build rigs wait here while it is closed."""

    def __init__(self, monkeypatch, takes_s=0.0):
        self.open, made = threading.Event(), PlantRunner.variant
        self.open.set()

        def variant(*given):
            if threading.current_thread().name == "variant":
                time.sleep(takes_s)
                self.open.wait(20.0)
            return made(*given)

        monkeypatch.setattr(PlantRunner, "variant", variant)


def test_steps_and_operators_get_their_matrices_beside_a_controller_that_asks_for_others_all_the_time(
    built, monkeypatch
):
    """Steps of one tick take effect at one tick; then it is the operator's turn, then the controller's."""
    found, begin = built
    steps = [("friction.mu_static", 0.45), ("shunt.delta", -0.8), ("body.mass", 1.1)]
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 1.0}
    raw["protocol"] = [hold, *({"step": "set", "target": key, "to": to} for key, to in steps), hold | {"time": 3.0}]
    raw["controllers"] = {"mine": {"kind": "shunt_schedule", "drive": "shunt.resistance"}}
    scene = Scene.from_json(json.dumps(raw))
    monkeypatch.setattr("rig.bench.rebuild.PAUSE_S", 0.0)
    Gate(monkeypatch, takes_s=0.1)
    with Bench(scene, pace=1.0) as bench:
        runner, over = bench.plant.runner, threading.Event()
        bench.begin()
        mine = bench.twin.open("controller", "mine")
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()

        def command():
            while not over.is_set():
                mine.publisher("act/mine").put(encode.act(runner.tick, 0, (30.0 + runner.tick % 10,)), 0)
                time.sleep(0.002)

        bench.thread(command)
        while runner.tick < 1001:
            time.sleep(0.001)
        told = bench.me.ask("param/plant", {"set": {"friction.mu_kinetic": 0.2}}, 5.0)
        then = runner.values["shunt.resistance"]
        while runner.values["shunt.resistance"] == then and runner.tick < 3900:
            time.sleep(0.01)
        over.set()
        heard = bench.finish()
    assert runner.values["shunt.resistance"] != then
    assert (runner.values["shunt.delta"], runner.parameter("friction.mu_static")) == (-0.8, 0.45)
    events = rebuilt_apart(bench, heard, scene, found)
    ticks = {kind: [e["tick"] for e in events if e["kind"] == kind] for kind in ("waits", "goes on")}
    assert ticks["waits"] == [1000] * 3
    [tick] = set(ticks["goes on"])
    assert 1000 < tick < told["tick"]
    assert bench.summary["postponed"] == {"waited": 3, "longest_s": pytest.approx(1e-3 * (tick - 1000)), "never": 0}
    assert f"3 steps waited for new matrices, the longest {1e-3 * (tick - 1000):.3g} s" in summary(bench.summary)


def test_a_step_that_still_waits_when_the_run_ends_is_told(built, monkeypatch):
    """The recording holds all the same: simulated again, it waits until the end, too."""
    found, begin = built
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 0.5}
    raw["protocol"] = [hold, {"step": "set", "target": "shunt.resistance", "to": 40.0}, hold]
    scene = Scene.from_json(json.dumps(raw))
    gate = Gate(monkeypatch)
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()
        bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8}}, 5.0)  # what was built for the step fits no more
        gate.open.clear()
        heard = bench.finish()
        gate.open.set()
    assert bench.plant.runner.values["shunt.resistance"] != 40.0
    told = "shunt.resistance = 40 of t = 0.5 s never took effect"
    assert told in bench.summary["faults"]
    assert told in bench.summary["reasons"]
    assert bench.summary["verdict"] != "VALID"
    assert bench.summary["postponed"] == {"waited": 1, "longest_s": pytest.approx(0.5), "never": 1}
    events = rebuilt_apart(bench, heard, scene, found)
    assert [(e["tick"], e["kind"]) for e in events if e["kind"] in ("waits", "goes on", "never")] == [
        (500, "waits"),
        (1000, "never"),
    ]


def test_an_operator_who_tunes_in_a_pause_does_not_wait_for_a_step_that_cannot_take_effect_then(built, monkeypatch):
    found, begin = built
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 0.5}
    raw["protocol"] = [hold, {"step": "set", "target": "shunt.resistance", "to": 40.0}, hold | {"time": 1.0}]
    scene = Scene.from_json(json.dumps(raw))
    gate = Gate(monkeypatch)
    with Bench(scene, pace=1.0) as bench:
        bench.begin()
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()
        bench.me.ask("param/plant", {"set": {"shunt.delta": -0.8}}, 5.0)
        gate.open.clear()
        while bench.plant.runner.tick < 510:
            time.sleep(0.001)
        bench.me.ask("cmd/plant", {"do": "pause"}, 5.0)
        gate.open.set()
        told = bench.me.ask("param/plant", {"set": {"shunt.delta": -0.7}}, 5.0)
        bench.me.ask("cmd/plant", {"do": "resume"}, 5.0)
        heard = bench.finish()
    runner = bench.plant.runner
    assert (runner.values["shunt.resistance"], runner.values["shunt.delta"]) == (40.0, -0.7)
    events = rebuilt_apart(bench, heard, scene, found)
    [tick] = [e["tick"] for e in events if e["kind"] == "goes on"]
    assert tick > told["tick"]


@pytest.mark.parametrize("by", ["operator", "protocol", "a successor"])
def test_no_frame_builds_a_rig_when_a_controller_that_commands_a_coefficient_is_disconnected(built, by):
    found, begin = built
    drives = ["shunt.resistance"] if by != "a successor" else ["shunt.resistance", "shunt.delta"]
    raw = json.loads(scenes.load("belt_shunt").to_json())
    hold = {"step": "hold", "time": 2.0}
    raw["protocol"] = [hold, {"step": "disconnect", "controller": "mine"}, hold] if by == "protocol" else [hold, hold]
    if by != "a successor":
        raw["controllers"] = {"mine": {"kind": "shunt_schedule", "drive": "shunt.resistance"}}
    scene = Scene.from_json(json.dumps(raw))
    with Bench(scene, pace=1.0) as bench:
        runner, over = bench.plant.runner, threading.Event()
        first = [runner.values[name] for name in drives]
        bench.begin()
        mine = bench.twin.open("controller", "mine")
        wanted = {"do": "admit", "controller": "mine", "drives": drives, "period_ns": scene.frame_ns}
        if by == "a successor":
            mine.ask("cmd/plant", wanted, 20.0)
        bench.me.ask("param/plant", {"get": ["shunt.delta"]}, 20.0)  # the frames have begun
        begin()

        def command():
            while not over.is_set():
                mine.publisher("act/mine").put(encode.act(runner.tick, 0, (50.0, -0.7)[: len(drives)]), 0)
                time.sleep(0.002)

        bench.thread(command)
        while [runner.values[name] for name in drives] != [50.0, -0.7][: len(drives)]:
            assert runner.tick < 2000
            time.sleep(0.01)
        if by == "operator":
            bench.me.ask("cmd/plant", {"do": "disconnect", "controller": "mine"}, 5.0)
        elif by == "a successor":  # which drives an actuator that has no command state yet, too
            yours, bench.plant.hub._admitted["mine"] = bench.twin.open("controller", "yours"), 0.0
            told = wanted | {"controller": "yours", "drives": [*drives, "load.force"]}
            yours.ask("cmd/plant", told, 5.0)
        while [runner.values[name] for name in drives] != first:
            assert runner.tick < 3900
            time.sleep(0.01)
        over.set()
        heard = bench.finish()
    rebuilt_apart(bench, heard, scene, found)


def test_a_controller_is_retuned_on_the_same_tick_in_every_mode(scene):
    raw = json.loads(scenes.load(SCENE, {"controllers.nf.enable_at": "0 s"}).to_json())
    hold, louder = {"step": "hold", "time": 0.1}, {"step": "set", "target": "controllers.nf.gain", "to": 500.0}
    raw["protocol"] = [hold, louder, hold, {"step": "disconnect", "controller": "nf"}, hold]
    changed = Scene.from_json(json.dumps(raw))
    with Bench(changed, pace=None, expect=(("controller", "nf"),)) as bench:
        bench.controller()
        bench.begin()
        heard = bench.finish()
    run = simulate(changed)
    raw["protocol"] = [hold]
    unchanged = simulate(Scene.from_json(json.dumps(raw)), duration_ns=3 * 10**8)
    for name, known in run.measurements.items():
        assert samples(heard, name).tobytes() == known.v.tobytes()
    loads = run.commands["nf"].values, unchanged.commands["nf"].values
    assert np.array_equal(loads[0][:100], loads[1][:100])
    assert not np.any(loads[0][100:200] == loads[1][100:200])
    again = simulate(changed, {}, 3 * 10**8, run.commands)
    assert again.measurements["vibrometer"].v.tobytes() == run.measurements["vibrometer"].v.tobytes()


HUGE, LONG = 10**4000, "x" * 5000


@pytest.mark.parametrize(
    ("topic", "body", "told"),
    [
        ("param/plant", {"set": {"load.force": HUGE}}, "must be 0 to"),
        ("param/plant", {"set": {"load.force": f"{HUGE} N"}}, "must be 0 to"),
        ("param/plant", {"set": {"body.mass": LONG}}, "expected a number, a space and a unit in kg"),
        ("param/plant", {"set": {LONG: 1.0}}, "unknown key"),
        ("param/plant", {"get": [LONG]}, "is not a parameter of this rig"),
        ("cmd/plant", {"do": "knock", "impulse": HUGE}, "it must be a finite number, -1e+06 to 1e+06 N*s"),
        ("cmd/plant", {"do": LONG}, "it can: begin"),
        ("cmd/plant", {"do": "connect", "controller": LONG}, "there are: nf"),
        ("cmd/plant", {"do": "admit", "controller": "a", "drives": [], "period_ns": HUGE}, "is no whole number of"),
        ("cmd/plant", {"do": "admit", "controller": "a", "drives": [], "period_ns": 1, LONG: 1}, "not permitted"),
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
                    ({"controller": "../../evil x"}, "'../../evil x': is no name"),
                    ({"controller": ""}, "is no name"),
                    ({"controller": "x" * 65}, "is no name"),
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


def test_a_controller_that_leaves_is_missed_and_the_verdict_says_so(scene):
    with Bench(scene, duration=1.0, expect=(("controller", "nf"),)) as bench:
        gone = bench.controller()
        bench.begin()
        while not bench.plant.experiment.exchange.lines["nf"].counts.taken and bench.summary is None:
            time.sleep(0.01)
        gone.set()
        heard = bench.finish()
    assert bench.summary["ended"] == "done"
    assert bench.summary["verdict"] != "VALID"
    assert any("controller nf left at t = " in fault for fault in bench.summary["faults"])
    assert bench.summary["loop"]["nf"]["safe"] == 1
    assert {"begin", "left", "safe", "end", "verdict"} <= {event.kind for event in bench.events(heard)}


def test_a_controller_that_hangs_is_evicted_from_lockstep(scene, monkeypatch):
    monkeypatch.setattr("rig.bench.lockstep.EVICTED", 0.3)
    with Bench(scene, pace=None, duration=0.2, expect=(("controller", "nf"),)) as bench:
        hung = bench.twin.open("controller", "nf")
        hung.announce()
        bench.begin()
        heard = bench.finish()
        hung.close()
    assert bench.summary["ended"] == "done"
    assert any("evicted at tick 0" in fault for fault in bench.summary["faults"])
    steps = [messages.decode("step", payload).tick for payload in heard["step"]]
    assert steps.count(0) > 3
    assert steps[-1] == 199


def test_a_lost_answer_is_asked_for_again(scene):
    with Bench(scene, pace=None, duration=0.3, expect=(("controller", "nf"),)) as bench:
        deaf = bench.twin.open("controller", "nf")
        steps, act = deaf.subscribe("step"), deaf.publisher("act/nf")
        deaf.announce()
        bench.begin()
        seen, answered = {}, []
        while (message := steps.get(1.0)) is not None:
            step = messages.decode("step", message.payload)
            seen[step.tick] = seen.get(step.tick, 0) + 1
            if step.tick % 7 or seen[step.tick] > 1:
                answered.append(step.tick)
                act.put(encode.act(step.tick, step.t_ns, (20.0 + step.tick % 5,)), step.t_ns)
            if step.tick == 299:
                break
        heard = bench.finish()
        deaf.close()
    assert sorted(set(answered)) == list(range(300))
    assert all(seen[tick] >= 2 for tick in range(0, 300, 7))
    applied = [messages.decode("applied/nf", payload) for payload in heard["applied/nf"]]
    assert [a.tick for a in applied] == list(range(300))


def test_a_refused_admission_takes_nothing_from_who_was_admitted_before(scene, monkeypatch):
    with Bench(scene, pace=None) as bench:
        operator, experiment = bench.plant.operator, bench.plant.experiment
        lines = experiment.exchange.lines
        wanted = {"do": "admit", "controller": "first", "drives": ["drive.speed"], "period_ns": scene.frame_ns}
        operator.cmd.asker = "guest-1"
        operator.command(wanted)
        line = lines["first"]
        operator.cmd.asker = "guest-2"
        for wrong in ({"period_ns": 1}, {"drives": ["drive.speed", "load.force"]}, {"reads": ["y"], "hears": True}):
            with pytest.raises(UsageError):
                operator.command(wanted | {"controller": "other"} | wrong)
            assert lines["first"] is line
        with pytest.raises(UsageError, match="first"):  # it may be about to tell that it is here
            operator.command(wanted | {"controller": "other"})
        monkeypatch.setattr("rig.bench.hub._ANNOUNCED_S", 0.0)
        assert operator.command(wanted | {"controller": "other"})["tick"] == 0
        assert set(lines) == {"nf", "other"}
        kinds = [event.kind for event in experiment.journal.events]
        assert kinds[-3:] == ["admitted", "dismissed", "admitted"]


def test_the_name_of_an_admitted_controller_is_free_as_soon_as_it_came_and_left(scene):
    with Bench(scene, pace=None) as bench:
        operator, hub = bench.plant.operator, bench.plant.hub
        wanted = {"do": "admit", "controller": "mine", "drives": ["drive.speed"], "period_ns": scene.frame_ns}
        operator.cmd.asker = "guest-1"
        operator.command(wanted)
        operator.cmd.asker = "guest-2"
        hub.look()
        with pytest.raises(UsageError, match="taken"):  # it may be about to tell that it is here
            operator.command(wanted)
        with bench.twin.open("controller", "mine") as mine:
            mine.announce()
            hub.look()
            with pytest.raises(UsageError, match="taken"):
                operator.command(wanted)
        hub.look()
        operator.command(wanted)


def test_a_name_that_has_commanded_keeps_its_number_of_actuators(scene):
    """A recording has one number of commands for each name; who has not commanded yet may come again with more."""
    with Bench(scene, pace=None) as bench:
        experiment, both = bench.plant.experiment, ["drive.speed", "load.force"]
        experiment.dismiss("nf")  # its load is free
        for drives in (both, ["drive.speed"]):
            experiment.admit("mine", drives, scene.frame_ns)
            experiment.dismiss("mine")
        experiment.admit("mine", ["drive.speed"], scene.frame_ns)
        experiment.exchange.receive("mine", 0, (0.1,))
        experiment.take_over()
        experiment.dismiss("mine")
        events = len(experiment.journal.events)
        with pytest.raises(UsageError, match=r"commanded 1 actuators before .* would now command 2; .* another name"):
            experiment.admit("mine", both, scene.frame_ns)
        assert len(experiment.journal.events) == events
        experiment.admit("mine", ["load.force"], scene.frame_ns)


def test_the_verdict_tells_of_every_life_of_a_controller_that_has_gone(scene):
    with Bench(scene, pace=None) as bench:
        experiment, hold = bench.plant.experiment, scene.clock.hold_frames
        for _ in range(2):
            experiment.admit("mine", ["drive.speed"], scene.frame_ns)
            experiment.exchange.receive("mine", experiment.runner.tick, (0.1,))
            for _ in range(hold + 2):
                experiment.take_over()
                experiment.runner.frame()
            experiment.dismiss("mine")
        assert "safe values stepped in for mine 2 times" in _verdict(bench.plant, {}, []).reasons


def test_what_is_still_being_built_at_the_end_of_a_run_is_refused(scene):
    with Bench(scene, duration=0.3) as bench:
        bench.plant.operator._carried_out = lambda body: lambda: None  # takes longer than the run
        bench.begin()
        with pytest.raises(BusError, match="the run ended before it was done"):
            bench.me.ask("cmd/plant", {"do": "admit"}, 20.0)
        bench.finish()


def test_strangers_are_refused_and_a_users_own_controller_is_admitted(scene):
    with Bench(scene, duration=3.0) as bench:
        bench.begin()
        mine = bench.twin.open("controller", "mine")
        act = mine.publisher("act/mine")
        act.put(encode.act(0, 0, (0.5,)), 0)
        act.put(b"garbage", 0)
        time.sleep(0.1)
        wanted = {"controller": "mine", "drives": ["drive.speed"], "period_ns": scene.frame_ns}
        tick = mine.ask("cmd/plant", {"do": "admit", **wanted}, 20.0)["tick"]
        mine.announce()
        act.put(encode.act(tick, 0, (0.5,)), 0)
        act.put(encode.act(10**9, 0, (0.7,)), 0)
        heard = bench.finish()
        mine.close()
    kinds = [event.kind for event in bench.events(heard)]
    assert "refused" in kinds
    assert "admitted" in kinds
    assert bench.summary["loop"]["refused"] == {"mine": 1}
    assert bench.summary["loop"]["mine"]["taken"] == 1
    assert bench.summary["loop"]["mine"]["refused"] == 1
    assert bench.summary["loop"]["mine"]["safe"] == 1


def test_commands_of_an_admitted_controller_count_only_from_the_user_that_asked(scene):
    with Bench(scene, pace=None) as bench:
        operator, hub = bench.plant.operator, bench.plant.hub
        wanted = {"do": "admit", "controller": "mine", "drives": ["drive.speed"], "period_ns": scene.frame_ns}

        def told(user, seq):
            header = HEADER.pack(seq, 0)
            act = Arrived(user, "act/mine", encode.act(0, 0, (0.5,)), header, True, messages.encoding("act/mine"))
            hub.acts.queue.put(act)
            found = hub.command()
            return found and found[0]

        assert told("guest-1", 0) is None  # not admitted
        operator.cmd.asker = "guest-1"
        operator.command(wanted)
        assert [told("guest-2", 1), told("mine", 2), told("guest-1", 3)] == [None, None, "mine"]
        operator.cmd.asker = "guest-2"
        with pytest.raises(UsageError, match="taken"):
            operator.command(wanted)
        operator.cmd.asker = "guest-1"  # the same process asks again
        operator.command(wanted)
        assert [told("guest-2", 4), told("guest-1", 5)] == [None, "mine"]
        refused = hub.session.door.told()
        assert refused["guest-1 on act/mine: not admitted"] == 1
        assert refused["guest-2 on act/mine: another one commands there"] == 2


def test_numerics_that_stop_are_told_and_the_run_is_concluded(scene):
    with Bench(scenes.load(SCENE, {"clock.limit": "1000"}), pace=1.0, duration=5.0) as bench:
        bench.begin()
        bench.me.ask("cmd/plant", {"do": "knock", "impulse": 1e5}, 2.0)
        heard = bench.finish()
    assert bench.summary["exit_code"] == 4
    assert bench.summary["ended"] == "diverged"
    (event,) = [e for e in bench.events(heard) if e.kind == "diverged"]
    told = json.loads(event.data)
    assert told["state"]
    assert "t = " in event.text
    assert "total/plant" in heard


def test_a_limit_leads_to_the_safe_state(scene):
    tight = scenes.load(SCENE, {"limits.displacement": "1 mm"})
    with Bench(tight, pace=None, duration=5.0) as bench:
        bench.begin()
        heard = bench.finish()
    assert bench.summary["exit_code"] == 4
    assert "displacement" in bench.summary["ended"]
    assert any(event.kind == "limit" for event in bench.events(heard))
    assert bench.summary["seconds"] < 1.5


def test_a_guest_under_a_made_up_role_is_not_missed(scene):
    with Bench(scene, pace=None, expect=(("recorder", "r"),)) as bench:
        plant, housekeeper, open_ = bench.plant, bench.plant.housekeeper, bench.twin.open
        first = [open_("recorder", "r"), open_("controller", "early")]
        for session in first:
            session.announce()
        housekeeper.notice()
        housekeeper.begin(0, None)
        plant.experiment.admit("mine", ["drive.speed"], scene.frame_ns)
        plant.session.door.reserved = frozenset({"recorder"})
        late = [("controller", "t0"), ("recorder", "rr"), ("controller", "mine"), ("recorder", "recorder")]
        for session in (others := [open_(*who) for who in late]):
            session.announce()
        housekeeper.notice()
        for session in (*first, *others):
            session.close()
        housekeeper.notice()
        told = [fault.partition(" left at")[0] for fault in housekeeper.faults]
        assert told == ["recorder r", "controller early", "controller mine", "recorder recorder"]
        noted = [event.text for event in plant.experiment.journal.events if event.kind == "left"]
        assert any("controller t0 left" in text for text in noted)


def test_a_guest_that_calls_itself_recorder_is_not_asked_and_not_believed(scene, monkeypatch):
    monkeypatch.setattr("rig.bench.finalise.ANSWERS_S", 60.0)
    with Bench(scene, pace=None, duration=0.1) as bench:
        bench.plant.session.door.reserved = frozenset({"recorder"})
        silent, liar, controller = (
            bench.twin.open(role, name)
            for role, name in (("recorder", "silent"), ("recorder", "liar"), ("controller", "mine"))
        )
        for session in (silent, liar, controller):
            session.announce()

        def lie():
            asked = liar.subscribe("total/plant")
            assert asked.get(20.0) is not None
            for session in (liar, controller):
                session.publisher(f"total/{session.name}").put(session.totals(), 0)

        bench.thread(lie)
        begin = time.monotonic()
        bench.begin()
        bench.finish()
    assert time.monotonic() - begin < 30.0
    assert (bench.summary["lost"], bench.summary["unknown"], bench.summary["faults"]) == ({}, [], [])


def test_only_the_plant_tells_that_the_run_is_over():
    twin, lines = Twin("told"), []
    team = Team.__new__(Team)  # without processes
    team._say, team._over = lines.append, False
    events = twin.open("operator", "supervisor").subscribe("event/*")
    guest, plant = (
        twin.open(role, name).publisher(f"event/{name}") for role, name in (("controller", "mine"), ("plant", "plant"))
    )
    for kind in ("end", "limit"):
        guest.put(messages.event(0, 0, "plant", kind, "so it says"), 0)
    team._tell(events)
    assert not team._over
    plant.put(messages.event(0, 0, "plant", "limit", "too far"), 0)
    plant.put(messages.event(0, 0, "plant", "end", "done"), 0)
    team._tell(events)
    assert team._over
    assert lines == ["    0.000 s  mine: limit: so it says", "    0.000 s  limit: too far"]


def test_a_backlog_is_no_flood(scene):
    """A controller that was held up answers every step that waited for it, once."""
    with Bench(scene, pace=None) as bench:
        hub = bench.plant.hub
        count = hub.acts.counts["act/nf"] = Count()

        def told(steps, commands):
            hub._step.sent += steps
            hub.asked += steps
            count.received += commands
            return hub.floods()

        assert told(200, 200) == []
        assert [told(200, 0) for _ in range(15)] == [[]] * 15
        assert told(211, 1869) == []
        assert told(200, 1542) == []
        assert told(200, 1800) == []
        assert told(200, 2000) == ["controller nf sent 2000 commands for 200 steps"]


def test_who_does_not_come_is_not_waited_for_forever(scene):
    with Bench(scene, pace=None, duration=0.1, wait=0.2, expect=(("controller", "nf"),)) as bench:
        bench.begin()
        bench.finish()
    assert "controller nf was not here when the run began" in bench.summary["faults"]
    assert bench.summary["verdict"] == "DEGRADED"


@pytest.mark.parametrize("policy", ["skip", "slow", "stop"])
def test_every_policy_ends_with_a_verdict(scene, policy):
    crowded = scenes.load(SCENE, {"clock.overrun": policy})
    with Bench(crowded, duration=0.3, pace=100.0) as bench:
        bench.begin()
        bench.finish()
    assert bench.summary["verdict"] == "INVALID"
    assert bench.summary["exit_code"] == 3
    assert bench.summary["timing"]["worst_us"] > 10.0
    if policy == "stop":
        assert "the scene asks to stop" in bench.summary["ended"]
        assert bench.summary["ticks"] < 300
    else:
        assert bench.summary["timing"]["given_up"] > 0
