"""Faults of sensors and actuators at stated times: what they do, and the same bits in every mode."""

import json

import numpy as np
import pytest
from plant_in_thread import bits, ran, recorded, same_bits

import rig
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.bench.run import checkpoint
from rig.bench.run.simulate import Recorded, simulate
from rig.cli.app import program
from rig.record.compare import compare
from rig.scenes.scene import Scene

ON = {"controllers.nf.enable_at": "0.05 s", "sensors.vibrometer.rate": "2 kHz"}


def fault(name, **values):
    return {f"faults.{name}.{key}": value for key, value in values.items()}


def of_sensor(kind, at="0.3 s", name="a", **more):
    return fault(name, sensor="vibrometer", kind=kind, at=at, **more)


def of_load(kind, at="0.3 s", name="b", **more):
    return fault(name, actuator="load.force", kind=kind, at=at, **more)


ALL = {
    **of_sensor("freeze", "0.2 s", "frozen", duration="0.1 s"),
    **of_sensor("drift", "0.3 s", "drifts", duration="0.1 s", rate="0.1 m/s^2"),
    **of_sensor("spike", "0.4 s", "spike", height="0.1 m/s"),
    **of_sensor("dropout", "0.45 s", "away", duration="0.05 s"),
    **of_sensor("wrong_sign", "0.7 s", "turned", duration="0.1 s"),
    **of_load("authority", "0.25 s", "weak", factor=0.5, duration="0.2 s"),
    **of_load("jam", "0.6 s", "jammed", duration="0.15 s"),
}


def belt(changes=None):
    return rig.load("belt_normal_force", ON | (changes or {}))


def told(run):
    return [(round(event["t_ns"] * 1e-9, 6), event["text"]) for event in run.plant_events if event["kind"] == "fault"]


@pytest.fixture(scope="module")
def faulty():
    return rig.simulate(belt(ALL), 1.0)


@pytest.mark.parametrize(
    ("kind", "more", "made"),
    [
        ("freeze", {}, lambda t, v, before: np.full_like(v, before)),
        ("drift", {"rate": "0.5 m/s^2"}, lambda t, v, before: v + 0.5 * (t - 0.3)),
        ("spike", {"height": "-2 m/s", "duration": "0.01 s"}, lambda t, v, before: v - 2.0),
        ("spike", {"height": "1 mm/s"}, lambda t, v, before: v + 1e-3),
        ("dropout", {}, lambda t, v, before: np.zeros_like(v)),
        ("wrong_sign", {}, lambda t, v, before: -v),
    ],
)
def test_what_a_sensor_reads_with_a_fault(kind, more, made):
    """The controller is not connected, so the motion is that of the sound rig."""
    off = {"controllers.nf.enable_at": "10 s"}
    run, whole = rig.simulate(belt({**of_sensor(kind, **more), **off}), 0.5), rig.simulate(belt(off), 0.5)
    (t_ns, v), (_, true) = run.measurements["vibrometer"], whole.measurements["vibrometer"]
    end = 310_000_000 if "duration" in more else 300_000_001 if kind == "spike" else 10**9  # one sample
    here = (t_ns >= 300_000_000) & (t_ns < end)
    expected = made(t_ns[here] * 1e-9, true[here], true[~here & (t_ns < 300_000_000)][-1])
    assert v[here] == pytest.approx(expected, abs=1e-14)
    assert v[~here].tobytes() == true[~here].tobytes()
    assert run.signals["velocity"].tobytes() == whole.signals["velocity"].tobytes()


def test_a_jammed_actuator_stays_where_it_is_and_a_weak_one_reaches_a_part():
    run = rig.simulate(
        belt({**of_load("jam", duration="0.1 s"), **of_load("authority", "0.4 s", "c", factor=0.25)}), 0.5
    )
    load, asked = run.signals["normal_force"], run.commands["nf"]
    jammed = load[(run.time > 0.3001) & (run.time < 0.4)]
    assert set(jammed) == {load[np.searchsorted(run.time, 0.3 - 1e-9)]}
    assert len(set(asked.values[300:400].ravel())) > 90
    weak = run.time > 0.4001
    steps = np.ceil(run.time[weak] * 1e3 - 1e-6).astype(int) - 1  # the command that holds up to this instant
    known = dict(zip(asked.tick.tolist(), asked.values[:, 0].tolist()))
    whole = load[weak][::2]
    assert whole == pytest.approx([0.25 * known[step] for step in steps[::2]], rel=1e-12)


def test_a_move_of_the_protocol_goes_on_after_a_jam():
    """A lag follows its command; the jam holds what has been reached."""
    raw = json.loads(rig.load("belt", {"load.lag": "5 ms", "friction.mu_static": "0.45"}).to_json())
    ramp = {"step": "ramp", "target": "load.force", "to": 40.0, "over": 0.4}
    jam = {"kind": "jam", "actuator": "load.force", "at": 0.1, "duration": 0.1}
    run = simulate(Scene.from_json(json.dumps(raw | {"protocol": [ramp], "faults": {"stuck": jam}})))
    load = run.signals["normal_force"]
    held = load[(run.time > 0.1) & (run.time <= 0.2)]
    assert np.ptp(held) < 1e-12
    assert held[0] == pytest.approx(20.0 + 50.0 * 0.1 - 0.25, abs=0.05)  # the lag of 5 ms at 50 N/s
    assert load[-1] == pytest.approx(40.0, abs=0.3)


def test_faults_are_events_and_are_verified(faulty, tmp_path):
    assert told(faulty)[:4] == [
        (0.2, "frozen: vibrometer is frozen"),
        (0.25, "weak: load.force reaches only 0.5 of its command"),
        (0.3, "frozen is over: vibrometer is sound again"),
        (0.3, "drifts: vibrometer drifts with 0.1 m/s^2"),
    ]
    assert len(told(faulty)) == 13  # a spike of one sample has no end
    again = simulate(belt(ALL), {}, 10**9, Recorded(faulty.commands, faulty.events))
    assert bits(again) == bits(faulty)
    found = verify(recorded(tmp_path, faulty))
    assert found.passed, found.text()
    assert found.events >= 13


def test_in_lockstep_it_has_the_same_bits(faulty):
    _, heard = ran(belt(ALL), pace=None, duration=1.0)
    same_bits(heard, faulty)
    events = [(e.tick, e.text) for e in heard["event/plant"] if e.kind == "fault"]
    assert events == [(round(t * 1e3), text) for t, text in told(faulty)]


def test_a_fork_has_the_bits_of_the_run_that_goes_on(monkeypatch, tmp_path, faulty):
    monkeypatch.setattr(checkpoint, "STEPS", 100)
    log = recorded(tmp_path, rig.simulate(belt(ALL), 0.8))
    for at in (0.25, 0.65):  # in a fault of the sensor and of the load
        found = fork(log, at, duration_ns=round((1.0 - at) * 1e9))
        assert compare(faulty, found).identical
        assert told(found) == told(faulty)


def test_a_fault_after_the_end_is_a_warning():
    run = rig.simulate(belt(of_sensor("freeze", "3 s")), 0.5)
    (warning,) = [event["text"] for event in run.plant_events if event["kind"] == "warning"]
    assert warning == (
        "faults.a.at: 3 s is after the end of the run at 0.5 s, so this fault never acts (vibrometer is frozen); let "
        "it begin earlier or run longer"
    )


def test_explain_lists_the_faults_and_links_of_a_recording(tmp_path, capsys):
    about = ALL | {"network.act.nf.loss": "50 %"}
    log = recorded(tmp_path, rig.simulate(belt(about), 0.4))
    program(["explain", str(log)], standalone_mode=False)
    told = capsys.readouterr().out
    assert "0.25 s  weak: load.force reaches only 0.5 of its command" in told
    assert "act/nf" in told
    program(["explain", str(log), "--json"], standalone_mode=False)
    found = json.loads(capsys.readouterr().out)
    assert [one["t"] for one in found["faults"]] == [0.2, 0.25, 0.3, 0.3, 0.4, 0.4]
    assert found["network"]["act/nf"]["sent"] == 400
