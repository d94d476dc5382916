"""Controllers and other processes of a live run: who is admitted, missed, evicted or not believed."""

import time

import pytest
from plant_in_thread import SCENE, Bench

from rig import scenes
from rig.bench.live import status
from rig.bus import encode


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
