"""The plant of a live run on the twin of the bus: the bits of all modes, how runs end."""

import json
import time

import numpy as np
import pytest
from plant_in_thread import SCENE, Bench, ran, same_again, same_bits

from rig import scenes
from rig.bench.run.simulate import Recorded, simulate
from rig.scenes.scene import Scene


def test_a_paced_run_can_be_simulated_again_to_the_bit(scene):
    with Bench(scene, duration=60.0, pace=2.0, expect=(("controller", "nf"),)) as bench:
        bench.controller()
        bench.begin()
        told = bench.me.ask("param/plant", {"set": {"friction.mu_static": 0.45}}, 20.0)
        while not bench.plant.experiment.exchange.queues["nf"].counts.taken:
            time.sleep(0.01)
        bench.me.ask("cmd/plant", {"do": "knock", "impulse": 0.2}, 20.0)
        waits = bench.me.ask("param/plant", {"set": {"load.force": 15.0}}, 20.0)
        bench.me.ask("cmd/plant", {"do": "disconnect", "controller": "nf"}, 20.0)
        time.sleep(0.1)
        bench.stopped = "by the test"
        heard = bench.finish()
    assert told["values"] == {"friction.mu_static": 0.45}
    assert waits["overruled"] == {"load.force": "nf"}
    same_again(bench, heard)
    assert any(applied.answered < applied.tick for applied in heard["applied/nf"])


def test_a_controller_is_retuned_on_the_same_tick_in_every_mode(scene):
    raw = json.loads(scenes.load(SCENE, {"controllers.nf.enable_at": "0 s"}).to_json())
    hold, louder = {"step": "hold", "time": 0.1}, {"step": "set", "target": "controllers.nf.gain", "to": 500.0}
    raw["protocol"] = [hold, louder, hold, {"step": "disconnect", "controller": "nf"}, hold]
    changed = Scene.from_json(json.dumps(raw))
    _, heard = ran(changed, pace=None)
    run = simulate(changed)
    raw["protocol"] = [hold]
    unchanged = simulate(Scene.from_json(json.dumps(raw)), duration_ns=3 * 10**8)
    same_bits(heard, run)
    loads = run.commands["nf"].values, unchanged.commands["nf"].values
    assert np.array_equal(loads[0][:100], loads[1][:100])
    assert not np.any(loads[0][100:200] == loads[1][100:200])
    again = simulate(changed, {}, 3 * 10**8, Recorded(run.commands))
    assert again.measurements["vibrometer"].v.tobytes() == run.measurements["vibrometer"].v.tobytes()


def test_numerics_that_stop_are_told_and_the_run_is_concluded(scene):
    with Bench(scenes.load(SCENE, {"clock.limit": "1000"}), pace=1.0, duration=60.0) as bench:
        bench.begin()
        bench.me.ask("cmd/plant", {"do": "knock", "impulse": 1e5}, 20.0)
        heard = bench.finish()
    assert bench.summary["exit_code"] == 4
    assert bench.summary["ended"] == "diverged"
    (event,) = [e for e in heard["event/plant"] if e.kind == "diverged"]
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
    assert any(event.kind == "limit" for event in heard["event/plant"])
    assert bench.summary["seconds"] < 1.5


@pytest.mark.parametrize("policy", ["skip", "slow", "stop"])
def test_every_policy_ends_with_a_verdict(scene, policy):
    crowded = scenes.load(SCENE, {"clock.overrun": policy})
    with Bench(crowded, duration=0.3, pace=1e5) as bench:
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
