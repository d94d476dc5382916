"""Links that are made worse on purpose: the same bits in all clocks, in a re-simulation and in a fork."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_in_thread import bits, ran, recorded, same_bits

import rig
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.bench.run import checkpoint
from rig.bench.run.simulate import Recorded, simulate
from rig.bus import messages
from rig.bus.impaired_link import HeardSensor
from rig.record.compare import compare
from rig.record.rebuilt_traffic import RebuiltTraffic
from rig.scenes.scene import Scene

ON = {"controllers.nf.enable_at": "0.05 s"}
FLAWS = ("delay", "jitter", "loss", "duplicate", "reorder")
BAD = {f"network.meas.vibrometer.{key}": value for key, value in zip(FLAWS, ("2 ms", "1.5 ms", "5 %", "5 %", "true"))}
BAD |= {f"network.act.nf.{key}": value for key, value in zip(FLAWS, ("3 ms", "3 ms", "10 %", "3 %", "true"))}
BAD["network.seed"] = 3


def belt(changes=None):
    return rig.load("belt_normal_force", ON | (changes or {}))


@pytest.fixture(scope="module")
def bad():
    return rig.simulate(belt(BAD), 1.0)


@pytest.mark.parametrize("links", [("meas.vibrometer",), ("act.nf",), ("meas.vibrometer", "act.nf")])
def test_links_without_faults_have_the_bits_of_no_links(links):
    run = rig.simulate(belt({f"network.{link}.delay": "0 s" for link in links}), 1.0)
    assert bits(run) == bits(rig.simulate(belt(), 1.0))
    assert {counts["sent"] for counts in run.summary["network"].values()} <= {1000, 1001}
    assert not any(n for counts in run.summary["network"].values() for what, n in counts.items() if what != "sent")


@settings(max_examples=4)
@given(st.integers(0, 30), st.integers(1, 4))
def test_a_constant_delay_of_commands_is_the_delay_of_the_controller(delay, period):
    about = {"controllers.nf.period": f"{period} ms"}
    link = rig.simulate(belt({**about, "network.act.nf.delay": f"{delay} ms"}), 0.3)
    own = rig.simulate(belt({**about, "controllers.nf.delay": f"{delay} ms"}), 0.3)
    assert bits(link) == bits(own)
    assert link.summary["exchange"] == own.summary["exchange"]


def test_a_link_that_loses_all_commands_leaves_the_actuator_to_the_protocol():
    run = rig.simulate(belt({"network.act.nf.loss": "100 %"}), 0.5)
    assert run.commands["nf"].tick.size == 0
    assert run.summary["network"]["act/nf"] == {"sent": 500, "delayed": 0, "lost": 500, "duplicated": 0, "reordered": 0}
    assert set(run.signals["normal_force"]) == {20.0}


def test_a_controller_that_hears_nothing_commands_nothing():
    run = rig.simulate(belt({"network.meas.vibrometer.loss": 1}), 0.5)
    assert run.commands["nf"].tick.size == 0
    assert run.summary["controllers"]["nf"] == {"updates": 0, "held": 500, "refused": 0, "skipped": 0}


def test_a_recorded_run_is_simulated_again_to_the_bit_and_its_commands_are_checked(bad, tmp_path):
    scene = belt(BAD)
    again = simulate(scene, {}, 10**9, Recorded(bad.commands, bad.events))
    assert bits(again) == bits(bad)
    found = verify(recorded(tmp_path, bad))
    assert found.passed, found.text()
    assert found.identical
    lost = scene.links("act")["nf"]
    number = next(n for n in range(500, 900) if lost.loses(n))
    commands = bad.commands["nf"]
    at = int(np.searchsorted(commands.tick, number + 4))
    answered = commands.answered.copy()
    answered[at] = number
    forged = dataclasses.replace(bad, commands={"nf": commands._replace(answered=answered)})
    assert "link loses the answer" in verify(recorded(tmp_path, forged, "forged.mcap")).text()


@pytest.mark.parametrize(("at", "steps"), [(0.6, 10**9), (0.55, 100)], ids=["", "from a checkpoint"])
def test_a_fork_has_the_bits_of_the_run_that_goes_on(monkeypatch, tmp_path, bad, at, steps):
    monkeypatch.setattr(checkpoint, "STEPS", steps)
    log = recorded(tmp_path, rig.simulate(belt(BAD), 0.6))
    continued = fork(log, at, duration_ns=round((1.0 - at) * 1e9))
    assert ("checkpoint_ns" in continued.provenance) == (steps == 100)
    assert compare(bad, continued).identical
    assert continued.summary["network"] == bad.summary["network"]
    assert verify(recorded(tmp_path, continued, "fork.mcap")).passed


class Listens:
    """Notes what it hears, and drives the load."""

    drives = ("load.force",)

    def __init__(self, sensor, period_ns, every_sample=False):
        self.reads, self.period_ns, self.every_sample = (sensor,), period_ns, every_sample
        self.told = []

    def start(self):
        return None

    def update(self, state, t_ns, values):
        self.told.append((t_ns, list(values[0]) if self.every_sample else values[0]))
        return None, (20.0,)


@pytest.mark.parametrize("every_sample", [False, True])
def test_a_controller_hears_what_follows_from_measurements_seed_and_tick(every_sample):
    """Connected or not: until 0.3 s it is disconnected, and called for many ticks at once."""
    about = {
        "network.meas.vibrometer.delay": "7.5 ms",
        "network.meas.vibrometer.jitter": "7 ms",
        "network.meas.vibrometer.loss": "20 %",
        "network.meas.vibrometer.duplicate": "20 %",
        "sensors.vibrometer.rate": "4 kHz",
        "controllers.nf.period": "1 ms" if every_sample else "3 ms",
    }
    raw = json.loads(belt(about).to_json())
    hold, connect = {"step": "hold", "time": 0.3}, {"step": "connect", "controller": "nf"}
    scene = Scene.from_json(json.dumps(raw | {"protocol": [hold, connect, hold]}))
    period = 1 if every_sample else 3
    listens = Listens("vibrometer", period * scene.frame_ns, every_sample)
    run = simulate(scene, {"nf": listens}, 600_000_000)
    over, (t_ns, v) = HeardSensor(scene.links("meas")["vibrometer"]), run.measurements["vibrometer"]
    ends = np.searchsorted(t_ns, np.arange(-1, 601) * scene.frame_ns, "right")
    expected = []
    for tick in range(600):
        heard = over.tick(tick, v[ends[tick] : ends[tick + 1]].tolist())
        if tick % period == 0 and np.isfinite(over.latest):
            expected.append((tick * scene.frame_ns, heard if every_sample else over.latest))
    counts = run.summary["network"]["meas/vibrometer"]
    assert min(counts["delayed"], counts["lost"], counts["duplicated"]) > 50
    assert [one for one in listens.told if one[0] >= expected[0][0]] == expected


def test_in_lockstep_and_in_the_plant_it_has_the_same_bits_and_the_steps_hold_what_was_heard(bad):
    scene = belt(BAD)
    bench, heard = ran(scene, pace=None, duration=1.0)
    same_bits(heard, bad)
    assert bench.summary["network"] == bad.summary["network"]
    assert bench.summary["verdict"] == "VALID"
    steps = {step.tick: step for step in heard["step"]}  # a step that is not answered in time is repeated
    rebuilt = RebuiltTraffic(bad, list(bad.signals), frozenset(), lambda: scene.links("meas"))
    again = [messages.decode("step", record.payload) for record in rebuilt if record.topic == "step"]
    for one, other in zip(steps.values(), again):
        assert (one.tick, list(one.fresh)) == (other.tick, list(other.fresh))
        assert np.array(one.values).tobytes() == np.array(other.values).tobytes()
    inside = rig.simulate(belt(BAD | {"controllers.nf.where": "plant"}), 1.0)
    assert bits(inside) == bits(bad)
