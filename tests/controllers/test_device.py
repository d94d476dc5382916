"""A controller on a board: the bits of the shipped controller, whatever happens to its answers, and what is refused."""

import numpy as np
import pytest
from boards import FAULTS, free_port, in_c, in_python, on_board, program, standing_in

from rig import scenes
from rig.bench.run.simulate import simulate

TWO = {
    "controllers.nf.kind": "lti",
    "controllers.nf.reads": ["vibrometer", "laser"],
    "controllers.nf.drives": ["load.force", "drive.speed"],
    "controllers.nf.A": [[0.9, 0.1], [0.0, 0.8]],
    "controllers.nf.B": [[1.0, 0.3], [0.2, 0.1]],
    "controllers.nf.C": [[-30.0, 5.0], [0.01, 0.02]],
    "controllers.nf.D": [[-100.0, 10.0], [0.05, 0.1]],
}
"""A controller with two inputs and two outputs."""
LONG = {"belt_normal_force": (20, None), "pendulum": (21, None), "belt": (20, TWO)}


def same(run, other):
    """Two runs have the same measurements and commands, to the last bit."""
    assert run.failure is None
    assert run.measurements.keys() == other.measurements.keys()
    for name, samples in run.measurements.items():
        assert samples.v.tobytes() == other.measurements[name].v.tobytes(), name
    for name, commands in run.commands.items():
        assert np.array_equal(commands.tick, other.commands[name].tick)
        assert commands.values.tobytes() == other.commands[name].values.tobytes()


def port_of(kind, tmp_path):
    return free_port() if kind == "udp" else f"serial:{tmp_path / 'board'}"


@pytest.fixture(scope="module")
def shipped():
    """base -> the run with the controller in this process, for a number of seconds."""
    made = {}

    def run(base, seconds, changes=None):
        key = base, seconds
        if key not in made:
            made[key] = simulate(scenes.load(base, changes), duration_ns=round(seconds * 1e9))
        return made[key]

    return run


@pytest.mark.parametrize("kind", ["udp", "serial"])
@pytest.mark.parametrize("base", LONG)
def test_a_board_gives_the_bits_of_the_shipped_controller(base, kind, shipped, tmp_path):
    seconds, changes = LONG[base]
    scene, law = on_board(base, port_of(kind, tmp_path), changes=changes)
    with standing_in(scene.controllers["nf"].port, law) as board:
        run = simulate(scene, duration_ns=seconds * 10**9)
    same(run, shipped(base, seconds, changes))
    assert board.steps == run.commands["nf"].tick.size if base != "pendulum" else board.steps == 21000
    assert np.ptp(run.commands["nf"].values, axis=0).min() > 0.0


@pytest.mark.parametrize("kind", ["udp", "serial"])
@pytest.mark.parametrize("fault", [*FAULTS, "other"])
def test_a_disturbed_answer_changes_no_bit(fault, kind, shipped, tmp_path):
    scene, law = on_board("belt_normal_force", port_of(kind, tmp_path))
    with standing_in(scene.controllers["nf"].port, law, fault) as board:
        run = simulate(scene, duration_ns=5 * 10**9)
    same(run, shipped("belt_normal_force", 5))
    assert board.steps == 5000  # the law never advances twice in a step
    counts = run.summary["controllers"]["nf"]
    seen = {"garbage": "damaged", "half": "damaged", "missing": "again", "late": "again"}.get(fault, "other")
    assert counts[seen] >= 90
    assert counts["missed"] == 0


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_the_program_in_c_gives_the_same_bits(kind, shipped, tmp_path):
    port = port_of(kind, tmp_path)
    scene, _ = on_board("belt_normal_force", port)
    with program(in_c(tmp_path), kind, port.rpartition(":")[2]):
        same(simulate(scene, duration_ns=20 * 10**9), shipped("belt_normal_force", 20))


def test_the_program_in_python_gives_the_same_bits(shipped):
    port = free_port()
    scene, _ = on_board("belt_normal_force", port)
    with in_python(port):
        same(simulate(scene, duration_ns=20 * 10**9), shipped("belt_normal_force", 20))
