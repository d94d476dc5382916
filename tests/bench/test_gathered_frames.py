"""Instruments that run over many frames at once publish the samples of a run frame by frame, bit by bit."""

import numpy as np
import pytest

import rig
from rig.bench.run.runner import PlantRunner
from rig.solve.sampling import GATHERED

FRAMES = 10 * GATHERED + 3
SENSORS = {
    "belt": {
        "sensors.vibrometer.rate": 10e3,
        "sensors.laser.rate": 937.0,  # delayed, a mean over uneven intervals
        "sensors.accelerometer.rate": 333.0,
        "sensors.strain.kind": "strain_gauge",
        "sensors.strain.rate": 1000.0,
    },
    "brake_shunt": {"sensors.microphone.kind": "microphone", "sensors.microphone.rate": 44.1e3},  # echoes
    "four_dof": {},
    "plate": {},  # fixed steps, many states
}


def samples(scene, piece):
    runner = PlantRunner(scene, truthful=True)
    fresh = []
    while runner.tick < FRAMES:
        runner.frames(min(piece, FRAMES - runner.tick))
        fresh.append(runner.bank.fresh.copy())
    return runner, runner.measurements.samples(), fresh


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("piece", [7, FRAMES])
def test_samples_do_not_depend_on_how_many_frames_wait(name, piece):
    scene = rig.load(name, SENSORS[name])
    one, alone, each = samples(scene, 1)
    many, gathered, last = samples(scene, piece)
    for sensor, (t_ns, v) in alone.items():
        assert len(v)
        assert gathered[sensor].t_ns.tobytes() == t_ns.tobytes()
        assert gathered[sensor].v.tobytes() == v.tobytes(), sensor
    assert (many.bank.latest == one.bank.latest).all()
    assert (last[-1] == each[-1]).all(), "the samples of the last frame"
    assert many.bank.counters() == one.bank.counters()
    assert np.array_equal(many.motion.x, one.motion.x)
