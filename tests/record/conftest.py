"""A made-up run to record, and recordings of it."""

import numpy as np
import pytest
from recorded_loop import write_loops
from small_recording import record

from rig.record.run import Commands, Run, Samples
from rig.record.save_run import save


@pytest.fixture(scope="session")
def run():
    """A run of 0.7 s: truth at 10 kHz, sensors at 10 kHz, 1 kHz and 25 Hz, one controller with two drives."""
    draw = np.random.default_rng(1)
    frames, steps = 700, 7001
    ticks = np.arange(frames, dtype=np.int64)

    def sampled(period_ns, count):
        values = draw.standard_normal(count)
        values[1] = np.nan  # a drop-out
        return Samples(np.arange(count, dtype=np.int64) * period_ns, values)

    return Run(
        scene='{"plant": "belt"}',
        step_ns=100_000,
        frame_ns=1_000_000,
        time=np.arange(steps) * 100_000 * 1e-9,
        signals={"displacement": draw.standard_normal(steps), "velocity": draw.standard_normal(steps)},
        units={"displacement": "m", "velocity": "m/s", "meas/laser": "m/s", "meas/gauge": "N", "meas/slow": "m"},
        measurements={
            "laser": sampled(100_000, steps),
            "gauge": sampled(1_000_000, 701),
            "slow": sampled(40_000_000, 18),
        },
        commands={
            "feedback": Commands(ticks + 1, ticks, (ticks % 3 == 0).astype(np.int64), draw.standard_normal((frames, 2)))
        },
        events=[
            {"t_ns": 5_000_000, "tick": 5, "source": "plant", "kind": "mark", "text": "begin", "data": {"a": [1, 2]}},
            {"t_ns": 700_000_000, "tick": 700, "source": "plant", "kind": "mark", "text": "end", "data": {}},
        ],
        energy={"supplied": 1.5, "error": -1e-12},
        summary={"verdict": "VALID", "late": 0},
        mode=draw.integers(-1, 2, steps),
        provenance={"seed": "1", "commit": "none"},
    )


@pytest.fixture(scope="module")
def logs(run, tmp_path_factory):
    """A saved run, and a recorded one whose recorder was killed."""
    folder = tmp_path_factory.mktemp("logs")
    save(run, folder / "saved.mcap")
    record(folder / "killed.mcap", 400, finished=False)
    return folder


@pytest.fixture(scope="module")
def loops(tmp_path_factory):
    """A recorded control loop: see `write_loops`."""
    folder = tmp_path_factory.mktemp("loops")
    write_loops(folder)
    return folder
