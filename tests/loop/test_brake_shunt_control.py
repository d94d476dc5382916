"""Controllers of the brake's shunt: squeal is heard and silenced, the coil finds its tuning."""

import math

import numpy as np
import pytest

import rig
from rig.bench.run.simulate import Recorded, simulate
from rig.errors import SceneError
from rig.scenes import shipped

TUNED = 0.5 / (30e-9 * (2 * math.pi * 3402.10) ** 2)  # H, at the squeal of the open stack


def loudest(run, begin, end):
    t, v = run.measurements["vibrometer"]
    return np.abs(v[(t >= begin * 1e9) & (t < end * 1e9)]).max()


def test_the_shunt_is_connected_within_twenty_milliseconds_of_the_onset_and_silences_the_brake():
    run = rig.simulate(rig.load("brake_shunt_listener"), duration=0.5)
    t, v = run.measurements["vibrometer"]
    onset = 1e-9 * t[np.argmax(np.abs(v) > 0.02)]
    told = run.commands["listener"]
    connected = 1e-3 * told.tick[np.argmax(told.values[:, 0] > 0.5)]
    assert onset < connected < onset + 0.02
    assert loudest(run, connected + 0.1, connected + 0.2) < 0.1 * loudest(run, connected - 0.01, connected + 0.01)


def test_noisy_sliding_connects_nothing():
    scene = rig.load(
        "brake_shunt_listener",
        {
            "friction.mu": 0.6,
            "sensors.vibrometer.noise": "1e-4 m/s/Hz^0.5",
            "sensors.vibrometer.dropout_rate": "50 1/s",
        },
    )
    run = rig.simulate(scene, duration=2.0)
    assert loudest(run, 1.0, 2.0) > 0.02  # the noise alone passes the threshold, sample by sample
    assert run.commands["listener"].values.max() == 0.0


def test_the_coil_is_tuned_to_the_squeal_and_silences_it():
    run = rig.simulate(rig.load("brake_shunt_tuned"), duration=0.8)
    inductance = run.commands["tuner"].values[:, 0]
    assert inductance[0] == pytest.approx(0.7 * TUNED, rel=1e-4)
    assert inductance[-1] == pytest.approx(TUNED, rel=0.05)
    assert loudest(run, 0.7, 0.8) < 0.05 * loudest(run, 0.2, 0.3)


BANK = [24e-3, 30e-3, 36e-3, 42e-3, 48e-3]


def scene_with(tmp_path, steps, bank=False, **changes):
    """brake_shunt with another protocol, and with a bank of coils."""
    text = shipped.path("brake_shunt").read_text().partition("[[protocol]]")[0]
    if bank:
        head, _, rest = text.partition("inductance = [")
        text = f"{head}inductance = {BANK[0]}\nbank = {BANK}\n{rest.partition(chr(10))[2]}"
    path = tmp_path / "ours.toml"
    path.write_text(text + "".join(f"[[protocol]]\n{step}\n" for step in steps))
    return rig.load(str(path), {f"shunt.{name}": value for name, value in changes.items()})


def test_a_protocol_runs_through_the_coils_of_a_bank(tmp_path):
    """A ramp of the inductance throws the switch where the next coil is nearer; simulated again, to the same bits."""
    steps = [
        'step = "set"\ntarget = "shunt.connected"\nto = true',
        'step = "ramp"\ntarget = "shunt.inductance"\nto = "48 mH"\nover = "24 ms"',
        'step = "hold"\ntime = "4 ms"',
    ]
    scene = scene_with(tmp_path, steps, bank=True)
    run = rig.simulate(scene)
    system = scene.assemble().system()
    coil = np.array([system.modes(int(key))[4][0] for key in run.mode])
    assert coil[1:].tolist() == sorted(coil[1:].tolist())
    changes = run.time[1:][np.diff(coil) > 0]
    assert changes[-4:] == pytest.approx([4e-3, 10e-3, 16e-3, 22e-3], abs=1.1e-3)
    assert coil[-1] == 5
    assert abs(run.energy["error"]) < 1e-9
    again = simulate(scene, {}, scene.duration_ns, Recorded(run.commands, run.events))
    assert again.signals["velocity"].tobytes() == run.signals["velocity"].tobytes()


def test_what_the_shunt_cannot_take_is_told_before_the_run(tmp_path):
    steps = [
        'step = "set"\ntarget = "shunt.connected"\nto = 3',
        'step = "set"\ntarget = "shunt.inductance"\nto = "-3 mH"',
        'step = "ramp"\ntarget = "shunt.inductance"\nto = "30 mH"\nover = "0.1 s"',
        'step = "repeat"\ntimes = 2\nsteps = [{step = "ramp", target = "shunt.delta", to = -0.6, over = "0.1 s"}]',
    ]
    with pytest.raises(SceneError) as caught:
        scene_with(tmp_path, steps)
    connected, negative, coil, delta = caught.value.faults
    assert connected == "protocol[1].set: shunt.connected takes 0 to 1, not 3 (ours.toml, line 36)"
    assert negative.startswith("protocol[2].set: shunt.inductance takes 0 to 10000 H, not -0.003 H (")
    assert coil.startswith("protocol[3].ramp: shunt.inductance cannot run, ")
    assert coil.endswith("a bank of coils for it to run through (shunt.bank) (ours.toml, line 44)")
    assert delta.startswith("protocol[4].ramp: shunt.delta cannot run, ")


def test_a_protocol_sets_switch_and_tuning(tmp_path):
    """Connected, retuned in R, L and delta, disconnected: the current is that of the circuit, energy closes."""
    steps = [
        'step = "set"\ntarget = "shunt.connected"\nto = 1',
        'step = "set"\ntarget = "shunt.inductance"\nto = "14.59 mH"',
        'step = "set"\ntarget = "shunt.resistance"\nto = "25 ohm"',
        'step = "set"\ntarget = "shunt.delta"\nto = -0.8',
        'step = "hold"\ntime = "20 ms"',
        'step = "set"\ntarget = "shunt.connected"\nto = 0',
        'step = "hold"\ntime = "5 ms"',
    ]
    run = rig.simulate(scene_with(tmp_path, steps))
    alike = rig.simulate(scene_with(tmp_path, [steps[0], *steps[4:]], inductance=14.59e-3, resistance=25.0, delta=-0.8))
    assert run.signals["velocity"] == pytest.approx(alike.signals["velocity"], rel=1e-9, abs=1e-15)
    current = np.abs(run.signals["shunt_current"])
    assert current[(run.time > 0.001) & (run.time < 0.02)].max() > 1e-6
    assert not current[run.time > 0.0201].any()
    assert run.energy["resistor"] > 0.0
    assert run.energy["switch"] > 0.0
    assert abs(run.energy["error"]) < 1e-9
