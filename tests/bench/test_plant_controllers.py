"""Controllers and other processes of a live run: who is admitted, missed, evicted or not believed."""

import time

import pytest
from plant_in_thread import SCENE, Bench
from twin import Twin

from rig import scenes
from rig.bench.live import status
from rig.bench.live.supervise import EventLines
from rig.bus import encode, messages
from rig.bus.topics import HEADER, Arrived
from rig.errors import UsageError


def test_a_controller_that_leaves_is_missed_and_the_verdict_says_so(scene):
    with Bench(scene, duration=60.0, expect=(("controller", "nf"),)) as bench:
        gone = bench.controller()
        bench.begin()
        counts = bench.plant.experiment.exchange.queues["nf"].counts
        while not counts.taken:
            time.sleep(0.01)
        gone.set()
        while not counts.safe:
            time.sleep(0.01)
        told = bench.me.ask("param/plant", {"set": {"load.force": 17.0}}, 20.0)
        assert told["overruled"] == {"load.force": "nf"}  # its actuator stays reserved until it is disconnected
        bench.me.ask("cmd/plant", {"do": "disconnect", "controller": "nf"}, 20.0)
        assert bench.me.ask("param/plant", {"get": ["load.force"]}, 20.0)["values"] == {"load.force": 17.0}
        bench.stopped = "by the test"
        heard = bench.finish()
    assert bench.summary["ended"] == "by the test"
    assert bench.summary["verdict"] != "VALID"
    assert any("controller nf left at t = " in fault for fault in bench.summary["faults"])
    assert bench.summary["loop"]["nf"]["safe"] == 1
    assert {"begin", "left", "safe", "end", "verdict"} <= {event.kind for event in heard["event/plant"]}


def test_a_controller_that_hangs_is_evicted_from_lockstep(scene, monkeypatch):
    monkeypatch.setattr("rig.bench.live.asked_controllers.EVICTED", 0.3)
    with Bench(scene, pace=None, duration=0.2, expect=(("controller", "nf"),)) as bench:
        hung = bench.twin.open("controller", "nf")
        hung.announce()
        bench.begin()
        heard = bench.finish()
        hung.close()
    assert bench.summary["ended"] == "done"
    assert any("evicted at tick 0" in fault for fault in bench.summary["faults"])
    steps = [each.tick for each in heard["step"]]
    assert steps.count(0) > 3
    assert steps[-1] == 199


def test_a_refused_admission_takes_nothing_from_who_was_admitted_before(scene, monkeypatch):
    with Bench(scene, pace=None) as bench:
        operator, experiment = bench.plant.operator, bench.plant.experiment
        lines = experiment.exchange.queues
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
        monkeypatch.setattr("rig.bench.live.hub.ANNOUNCED_S", 0.0)
        assert operator.command(wanted | {"controller": "other"})["tick"] == 0
        assert set(lines) == {"nf", "other"}
        kinds = [event.kind for event in experiment.journal.events]
        assert kinds[-3:] == ["admitted", "dismissed", "admitted"]


def test_strangers_are_refused_and_a_users_own_controller_is_admitted(scene):
    with Bench(scene, duration=60.0) as bench:
        bench.begin()
        mine = bench.twin.open("controller", "mine")
        act = mine.publisher("act/mine")
        act.put(encode.act(0, 0, (0.5,)), 0)
        act.put(b"garbage", 0)
        act.sent += 800  # so many it claims to have sent meanwhile
        act.put(encode.act(1, 0, (0.5,)), 0)
        exchange = bench.plant.experiment.exchange
        while exchange.counters().get("refused") != {"mine": 2}:
            time.sleep(0.01)
        wanted = {"controller": "mine", "drives": ["drive.speed"], "period_ns": scene.frame_ns}
        tick = mine.ask("cmd/plant", {"do": "admit", **wanted}, 20.0)["tick"]
        mine.announce()
        act.put(encode.act(tick, 0, (0.5,)), 0)
        act.put(encode.act(10**9, 0, (0.7,)), 0)
        while not exchange.queues["mine"].counts.safe:
            time.sleep(0.01)
        bench.stopped = "by the test"
        heard = bench.finish()
        mine.close()
    assert {"refused", "admitted"} <= {event.kind for event in heard["event/plant"]}
    assert bench.summary["lost"] == {}
    assert not [reason for reason in bench.summary["reasons"] if "act/mine" in reason]
    counts = bench.summary["loop"]["mine"]
    assert (counts["taken"], counts["refused"], counts["safe"]) == (1, 1, 1)


def test_commands_of_an_admitted_controller_count_only_from_the_user_that_asked(scene):
    with Bench(scene, pace=None) as bench:
        operator, hub = bench.plant.operator, bench.plant.hub
        wanted = {"do": "admit", "controller": "mine", "drives": ["drive.speed"], "period_ns": scene.frame_ns}

        def told(user, seq):
            header = HEADER.pack(seq, 0)
            act = Arrived(user, "act/mine", encode.act(0, 0, (0.5,)), header, True, messages.encoding("act/mine"))
            hub.commands.acts.queue.put(act)
            found = hub.commands.next()
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
        refused = hub.session.inbound.refusals()
        assert refused["guest-1 on act/mine: not admitted"] == 1
        assert refused["guest-2 on act/mine: another one commands there"] == 2


def test_a_guest_that_calls_itself_recorder_is_not_asked_and_not_believed(scene, monkeypatch):
    monkeypatch.setattr("rig.bench.live.plant.ANSWERS_S", 100.0)
    with Bench(scene, pace=None, duration=0.1) as bench:
        bench.plant.session.inbound.reserved = frozenset({"recorder"})
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
        bench.begin()
        bench.finish()  # it would wait for longer than the threads may take
    assert (bench.summary["lost"], bench.summary["unknown"], bench.summary["faults"]) == ({}, [], [])


@pytest.mark.parametrize(("signs", "patience", "unknown"), [(3, 20.0, []), (10**6, 0.3, ["recorder recorder"])])
def test_a_recorder_that_is_behind_is_waited_for_while_it_catches_up_but_not_forever(
    scene, monkeypatch, signs, patience, unknown
):
    monkeypatch.setattr("rig.bench.live.plant.CATCH_UP_S", patience)
    with Bench(scene, pace=None, duration=0.1, expect=(("recorder", "recorder"),)) as bench:
        recorder = bench.twin.open("recorder", "recorder")
        heard, operator = recorder.subscribe("**", depth=1 << 16), bench.twin.open("operator", "o")
        ended = operator.subscribe("total/plant")
        recorder.announce()

        def catch_up():
            assert ended.get(20.0) is not None
            for _ in range(signs):
                time.sleep(0.1)
                recorder.publisher("total/recorder").put(recorder.totals(), 0)
                if bench.summary is not None:
                    return
            heard.drain()
            recorder.publisher("total/recorder").put(recorder.totals(), 0)

        bench.thread(catch_up)
        bench.begin()
        bench.finish()
    assert bench.summary["unknown"] == unknown
    assert bench.summary["lost"] == {}
    assert (bench.summary["faults"] == []) == (not unknown)


def test_only_the_plant_tells_that_the_run_is_over():
    twin, lines = Twin("told"), []
    shown = EventLines(lines.append)
    events = twin.open("operator", "supervisor").subscribe("event/*")
    guest, plant = (
        twin.open(role, name).publisher(f"event/{name}") for role, name in (("controller", "mine"), ("plant", "plant"))
    )
    for kind in ("end", "limit"):
        guest.put(messages.event(0, 0, "plant", kind, "so it says"), 0)
    shown.show(events)
    assert not shown.over
    plant.put(messages.event(0, 0, "plant", "limit", "too far"), 0)
    plant.put(messages.event(0, 0, "plant", "end", "done"), 0)
    shown.show(events)
    assert shown.over
    assert lines == ["    0.000 s  mine: limit: so it says", "    0.000 s  limit: too far"]


@pytest.mark.parametrize("where", ["process", "plant"])
def test_answers_that_are_not_finite_are_counted_in_the_summary(where, tmp_path):
    (tmp_path / "nf.py").write_text(
        "class Controller:\n"
        "    reads, drives, period_ns = ('vibrometer',), ('load.force',), 1_000_000\n"
        "    def start(self): return None\n"
        "    def update(self, state, t_ns, values): return None, (20.0 if t_ns < 20_000_000 else float('nan'),)\n"
    )
    scene = scenes.load(SCENE, {"controllers.nf.kind": str(tmp_path / "nf.py"), "controllers.nf.where": where})
    with Bench(scene, pace=None, duration=0.1, expect=(("controller", "nf"),) * (where == "process")) as bench:
        if where == "process":
            bench.controller()
        bench.begin()
        bench.finish()
    refused = bench.summary["controllers"]["nf"]["refused"]
    assert 79 <= refused <= 81  # the answer to the last step may be under way
    assert bench.summary["verdict"] == "DEGRADED"
    assert f"{refused} answers of nf not finite, and not sent" in bench.summary["reasons"]
    assert f"nf: {refused} answers not finite, and not sent" in status.summary(bench.summary)
