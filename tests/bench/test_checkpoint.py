"""A recording is continued from a checkpoint: the bits are those of a simulation from the begin on."""

import dataclasses

import pytest
from plant_in_thread import recorded

import rig
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.bench.run import checkpoint
from rig.record.compare import compare
from rig.record.save_run import save
from rig.scenes.protocol import STEPS

# name, changes, duration [s], instant [s]
CASES = [
    ("pendulum", {"friction.mu_static": "0.45"}, 11.0, 10.5),  # a protocol that connects a controller, noisy sensors
    ("belt_slow_card", {}, 2.0, 1.225),  # commands on their way, a protocol that waits for a sensor
    ("brake_active", {}, 0.06, 0.04),  # a controller of every sample, with filters; many states
    ("belt_shunt", {}, 1.0, 0.6),
    ("brake_shunt", {}, 0.05, 0.04),  # microphone with echoes
    ("lever_sector", {}, 1.0, 0.7),
    ("tread_rough", {}, 0.15, 0.1),  # process noise
    ("belt", {"sensors.vibrometer.dropout_rate": "5 Hz", "friction.mu_static": "0.45"}, 2.0, 1.3),
]


def kept(monkeypatch, scene, seconds, count=7):
    """Let recordings keep `count` checkpoints in `seconds`."""
    monkeypatch.setattr(checkpoint, "STEPS", round(seconds * 1e9 / count) // scene.step_ns)


def told(run):
    return [event for event in run.events if event["kind"] != "fork"]


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A fork of a belt with a controller: values were tuned at 0.5 s. Checkpoints before and after."""
    scene, folder = rig.load("belt_normal_force", {"controllers.nf.enable_at": "0.1 s"}), tmp_path_factory.mktemp("t")
    with pytest.MonkeyPatch.context() as patch:
        kept(patch, scene, 2.0)
        log = recorded(folder, rig.simulate(scene, 1.0), "first.mcap")
        changes = {"drive.speed": "0.1 m/s", "friction.mu_static": 0.42, "controllers.nf.gain": 3.0}
        return fork(log, 0.5, changes, 1_500_000_000)


@pytest.mark.parametrize(("name", "changes", "duration", "at"), CASES, ids=[case[0] for case in CASES])
def test_from_a_checkpoint_it_has_the_bits_of_the_uninterrupted_run(monkeypatch, tmp_path, name, changes, duration, at):
    scene = rig.load(name, changes)
    kept(monkeypatch, scene, at)
    whole = rig.simulate(scene, duration)
    log = recorded(tmp_path, rig.simulate(scene, at), "run.mcap")
    start = round(0.7 * at, 3)
    continued = fork(log, start, duration_ns=round((duration - start) * 1e9))
    assert 0 < int(continued.provenance["checkpoint_ns"]) < start * 1e9
    same = compare(whole, continued)
    assert same.identical, same
    assert told(continued) == whole.events
    assert continued.energy == whole.energy
    assert [continued.summary[key] == whole.summary[key] for key in ("plant", "sensors")] == [True, True]
    assert continued.checkpoints.keys() == whole.checkpoints.keys()


def test_values_that_were_tuned_before_the_checkpoint_hold_after_it(tuned, tmp_path):
    log = recorded(tmp_path, tuned, "second.mcap")
    found = fork(log, 1.7, duration_ns=300_000_000)
    assert int(found.provenance["checkpoint_ns"]) > 1_000_000_000
    assert compare(tuned, found).identical
    assert found.energy == tuned.energy
    again = verify(recorded(tmp_path, found, "third.mcap"))
    assert again.passed, again.text()
    assert again.identical


def test_a_knock_and_a_switch_before_the_checkpoint_are_in_its_state(monkeypatch, tmp_path):
    steps = [
        {"step": "knock", "impulse": 0.02, "duration": 0.004},
        {"step": "ramp", "target": "drive.speed", "to": 0.1, "over": 0.3},
        {"step": "set", "target": "dither.enable", "to": 1.0},
        {"step": "hold", "time": 1.0},
    ]
    scene = dataclasses.replace(rig.load("belt_dither"), protocol=STEPS.validate_python(steps))
    kept(monkeypatch, scene, 1.0)
    whole = rig.simulate(scene)
    found = fork(recorded(tmp_path, rig.simulate(scene, 1.0), "run.mcap"), 0.9)
    assert int(found.provenance["checkpoint_ns"]) > 500_000_000
    assert compare(whole, found).identical
    assert told(found) == whole.events


def changed(run, **values):
    return dataclasses.replace(run, **values)


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda run: changed(run, provenance={**run.provenance, "kernel": "0" * 16}),
        lambda run: changed(run, summary={**run.summary, "lost": {"meas/vibrometer to recorder": 1}}),
    ],
    ids=["other_sources", "losses"],
)
def test_without_a_checkpoint_that_can_be_used_it_is_simulated_from_the_begin_on(tuned, tmp_path, spoilt):
    log = recorded(tmp_path, tuned, "second.mcap")
    save(spoilt(rig.open(log)), log)
    found = fork(log, 1.7, duration_ns=300_000_000)
    assert "checkpoint_ns" not in found.provenance
    assert compare(tuned, found).identical
