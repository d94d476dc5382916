"""Every kind of recording is simulated again bit by bit; with one value, command or event changed it is not."""

import dataclasses
import json
from collections import Counter

import numpy as np
import pytest
from going import Going

import rig
from rig import scenes
from rig.bench.again.agreement import agreement, duration_ns, pairs
from rig.bench.again.replay import replay
from rig.bench.again.verify import command_faults, differences, verify
from rig.bench.live.plant_process import warm
from rig.bench.run.simulate import Recorded, simulate
from rig.record.save_run import save
from rig.scenes.scene import Scene

# scene, changes, simulated time [s]
SIMULATED = {
    "sector": ("lever_sector", {"sector.place": "0.2 rad"}, 0.5),
    "dither": ("belt_dither", {"dither.enable": "true"}, 0.4),
    "dither that a controller adapts": ("belt_dither_controlled", {"controllers.dither.enable_at": "0.2 s"}, 0.6),
    "shunt that the protocol switches": ("belt_shunt", {}, 4.1),
    "shunt that a controller switches": (
        "brake_shunt_listener",
        {"controllers.listener.threshold": "1 mm/s", "controllers.listener.hold": "50 ms"},
        0.2,
    ),
    "drop-outs and drift": (
        "belt",
        {"sensors.vibrometer.dropout_rate": "300 1/s", "sensors.normal_force.kind": "normal_force"},
        0.4,
    ),
}


@pytest.fixture(scope="module", params=SIMULATED)
def simulated(request):
    name, changes, duration = SIMULATED[request.param]
    return request.param, rig.simulate(rig.load(name, changes), duration)


def saved(run, path):
    save(run, path)
    return verify(path)


def with_values(run, name, t_ns, v):
    return dataclasses.replace(run, measurements={**run.measurements, name: type(run.measurements[name])(t_ns, v)})


def changed(run):
    """The run with one thing changed: what was changed, the run, and what the verification names."""
    for name, (t_ns, v) in run.measurements.items():
        bent, at = v.copy(), int(np.flatnonzero(np.isfinite(v))[v.size // 2])
        bent[at] = np.nextafter(bent[at], np.inf)
        yield f"a sample of {name}", with_values(run, name, t_ns, bent), f"meas/{name} differs at t = "
    for name, v in run.signals.items():
        bent = v.copy()
        bent[v.size // 2] = np.nextafter(bent[v.size // 2], np.inf)
        yield f"a value of {name}", dataclasses.replace(run, signals={**run.signals, name: bent}), f"{name} differs at "
    mode = run.mode.copy()
    mode[mode.size // 2] += 1
    yield "a mode set", dataclasses.replace(run, mode=mode), "mode set differs at t = "
    for name, commands in run.commands.items():
        steps = np.flatnonzero((np.diff(commands.values, axis=0) != 0.0).any(axis=1)) + 1
        assert steps.size, f"{name} never changes its command"
        values = commands.values.copy()
        values[steps[0]] = values[steps[0] - 1]  # it comes one frame late
        late = commands._replace(values=values)
        yield f"a command of {name}", dataclasses.replace(run, commands={**run.commands, name: late}), "differs at t = "
        for field, at in (("answered", commands.tick.size // 2), ("status", -1)):
            other = getattr(commands, field).copy()
            other[at] += 1 if field == "answered" else 2 - 2 * (other[at] == 2)  # safe values, or none
            bent = commands._replace(**{field: other})
            yield f"the {field} of {name}", dataclasses.replace(run, commands={**run.commands, name: bent}), "be right"
    kinds = {event["kind"]: i for i, event in enumerate(run.events) if event["source"] == "plant"}
    for kind in kinds.keys() & {"contact", "step", "mark", "parameter", "knock", "admitted"}:
        i, event = kinds[kind], run.events[kinds[kind]]
        earlier = event | {"t_ns": event["t_ns"] - 10 * run.frame_ns, "tick": event["tick"] - 10}
        for what, there in (("tick", [earlier]), ("text", [event | {"text": "?"}]), ("lack", [])):
            if what == "tick" and event["tick"] < 10:
                continue
            events = [*run.events[:i], *there, *run.events[i + 1 :]]
            yield f"the {what} of {kind}", dataclasses.replace(run, events=events), " differs at t = "


def test_it_is_simulated_again_bit_by_bit(simulated, tmp_path):
    found = saved(simulated[1], tmp_path / "run.mcap")
    assert found.passed, found.text()
    assert found.identical
    assert found.events == Counter(event["kind"] in ("contact", "step", "mark") for event in simulated[1].events)[True]


def test_nothing_in_it_can_be_changed(simulated, tmp_path):
    """A run with another command is simulated again; whatever else differs is compared with one re-simulation."""
    run, log = simulated[1], tmp_path / "run.mcap"
    save(run, log)
    scene, end_ns = Scene.from_json(run.scene), duration_ns(run)
    again = simulate(scene, {}, end_ns, Recorded(run.commands, run.events))
    assert agreement(pairs(run, again, modes=True), scene, False).first == ""
    for what, other, told in changed(run):
        if what.startswith("a command of"):
            faults = saved(other, tmp_path / "changed.mcap").faults
        else:
            values = agreement(pairs(other, again, modes=True), scene, False).first
            faults = [values, *differences(other, again, end_ns)[1], *command_faults(log, other, scene)]
        assert any(told in fault for fault in faults), (what, faults)
    bent = next(changed(run))
    assert any(bent[2] in fault for fault in saved(bent[1], tmp_path / "bent.mcap").faults)


def test_two_controllers_are_replayed_together(runs):
    """One of them answers every third step; the other one worked in the plant's process."""
    raw = json.loads(scenes.load("belt_normal_force", {"controllers.nf.enable_at": "0.1 s"}).to_json())
    other = scenes.load(
        "belt_velocity_feedback", {"controllers.belt.enable_at": "0.2 s", "controllers.belt.period": "3 ms"}
    )
    raw["controllers"]["bv"] = json.loads(other.to_json())["controllers"]["belt"]
    raw["controllers"]["nf"]["where"] = "plant"
    scene = Scene.from_json(json.dumps(raw))
    warm(scene)
    path = runs / "run.mcap"
    assert Going(scene, pace=None, duration=0.4, out=path).wait(100.0).exit_code == 0
    found = verify(path)
    assert found.passed, found.text()
    assert found.identical
    again = replay(path, ["nf", "bv"], pace=2.0)
    assert (again.divergence, again.unanswered, again.fault) == (None, 0, ""), again.text()
    assert again.compared == {"nf": 400, "bv": 134}
