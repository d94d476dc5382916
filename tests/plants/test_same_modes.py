"""A run keeps the basis of its structure: a change of a value does not move it, or is refused."""

import json

import numpy as np
import pytest

import rig
from rig import scenes
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.bench.run.runner import PlantRunner
from rig.errors import SceneError
from rig.scenes.scene import Scene
from rig.scenes.sections import with_values

COUNT = 20
END = f"y{COUNT - 1}"
SPRING = "contacts.pad.spring"
HELD = "factors.held"
ALL = [f"{axis}{i}" for axis in "xy" for i in range(COUNT)]


def chain(stiffness):
    """The stiffness matrix of COUNT masses in a row; the first one is held, the last one is free."""
    links = np.diag(np.full(COUNT - 1, -1.0), 1)
    own = links + links.T + np.diag([2.0] * (COUNT - 1) + [1.0])
    return stiffness * own


def text(value):
    """A value as TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {text(entry)}" for key, entry in value.items()) + "}"
    return "[" + ", ".join(map(text, value)) + "]" if isinstance(value, list) else json.dumps(value)


def bars(folder, reduction, film=False, steps=()):
    """The scene of two bars of masses, across and along a belt, coupled; the end of one presses on the belt."""
    K = np.kron(np.diag([1.0, 0.0]), chain(4e6)) + np.kron(np.diag([0.0, 1.0]), chain(9e6))
    K += 2e4 * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(COUNT))
    parts = {
        "M": {"of": "mass", "values": (0.02 * np.eye(2 * COUNT)).tolist()},
        "K": {"of": "stiffness", "values": K.tolist()},
        "held": {"of": "stiffness", "values": (1e4 * np.eye(2 * COUNT)).tolist(), "times": HELD},
    }
    tables = {
        "format": 1,
        "plant": "structure",
        "structure": {"units": "m-kg-s", "coordinates": ALL, "parts": parts, "film": film},
        "factors": {"held": 1.0},
        "reduction": reduction,
        "damping": {"ratio": 0.1, "at": "1 kHz"},
        "contacts": {"pad": {"gap": {END: 1.0}, "along": {f"x{COUNT - 1}": 1.0}, "spring": 1e6}},
        "drive": {"speed": 0.5},
        "load": {"force": 50.0, "at": {"end": {"row": {END: -1.0}}}},
        "friction": {"law": "constant", "mu": 0.3},
        "outputs": {name: {"row": {name: 1.0}} for name in (END, "y3", f"x{COUNT - 1}", "x10")},
        "start": {"velocity": 1e-3},
        "clock": {"frame": "0.1 ms", "rk4_step": "1 us"},
        "protocol": list(steps),
    }
    path = folder / "bars.toml"
    path.write_text("\n".join(f"{key} = {text(value)}" for key, value in tables.items()))
    return scenes.load(path)


MODES = {"kind": "modes", "modes": 12, "up_to": "700 Hz"}
HOLD = {"step": "hold", "time": "5 ms"}


def values(runner):
    """The outputs of the plant at this tick, by name."""
    return dict(zip(runner.outputs, runner.output_values().tolist()))


def runner_of(scene, frames=20):
    """The plant of a scene after some frames."""
    runner = PlantRunner(scene)
    for _ in range(frames):
        runner.frame()
    return runner


@pytest.mark.parametrize("film", [False, True])
@pytest.mark.parametrize("factor", [100.0, 0.01])
def test_a_change_of_a_contact_stiffness_moves_no_point_of_a_reduced_structure(tmp_path, film, factor):
    """With a basis of the new stiffness the same coordinates would be another displacement."""
    runner = runner_of(bars(tmp_path, MODES, film))
    before = values(runner)
    runner.set_parameter(SPRING, 1e6 * factor)
    after = values(runner)
    motions = [name for name in before if name.endswith(("_displacement", "_velocity"))]
    assert {name: after[name] for name in motions} == {name: before[name] for name in motions}
    gap = before[f"{END}_displacement"]
    assert gap < -1e-6
    assert after["normal_force"] == pytest.approx(-1e6 * factor * gap, rel=1e-12)


def errors(run, whole):
    """The largest differences of outputs over the largest value, by output."""
    names = (f"{END}_displacement", f"x{COUNT - 1}_displacement", "normal_force", "y3_velocity")
    return {
        name: np.abs(run.signals[name] - whole.signals[name]).max() / np.abs(whole.signals[name]).max()
        for name in names
    }


def changed(tmp_path, reduction, key, to):
    """A run of the bars in which one value changes."""
    return rig.simulate(bars(tmp_path, reduction, steps=[HOLD, {"step": "set", "target": key, "to": to}, HOLD]))


MORE = MODES | {"modes": 24}


@pytest.mark.parametrize("to", [1e7, 1e5])
def test_closed_modes_follow_another_contact_stiffness_as_well_as_open_modes(tmp_path, to):
    """Open modes never depend on the contact. Both converge to the whole matrices."""
    whole = changed(tmp_path, {"kind": "whole"}, SPRING, to)
    few, many, opened = (
        errors(changed(tmp_path, reduction, SPRING, to), whole)
        for reduction in (MODES, MORE, MORE | {"contact": "open"})
    )
    for name in many:
        assert many[name] < few[name] / 3.0, name
        assert many[name] < 1.25 * opened[name], name


def test_a_part_that_another_number_multiplies_in_a_run_is_that_of_the_whole_matrices_with_enough_modes(tmp_path):
    whole = changed(tmp_path, {"kind": "whole"}, HELD, 100.0)
    few, many = (errors(changed(tmp_path, reduction, HELD, 100.0), whole) for reduction in (MODES, MORE))
    for name in many:
        assert many[name] < 2e-3, name
        assert many[name] < few[name] / 3.0, name


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_the_energy_of_a_reduced_film_closes_over_a_change_and_its_recording_repeats(tmp_path, factor):
    steps = [HOLD, {"step": "set", "target": SPRING, "to": 1e6 * factor}, HOLD]
    run = rig.simulate(bars(tmp_path, MODES, True, steps))
    assert abs(run.energy["error"]) < 1e-5
    assert run.energy["impulses"] * (factor - 1.0) > 0.0
    run.save(tmp_path / "run.mcap")
    verified = verify(tmp_path / "run.mcap")
    assert verified.passed, verified.text()
    assert verified.identical


def test_a_recording_is_continued_with_another_contact_stiffness_as_the_protocol_would(tmp_path):
    rig.simulate(bars(tmp_path, MODES, steps=[HOLD])).save(tmp_path / "run.mcap")
    continued = fork(tmp_path / "run.mcap", changes={SPRING: 1e7}, duration_ns=5_000_000)
    steps = [HOLD, {"step": "set", "target": SPRING, "to": 1e7}, HOLD]
    same = rig.simulate(bars(tmp_path, MODES, steps=steps))
    for name in (f"{END}_displacement", "normal_force"):
        assert np.array_equal(continued.signals[name], same.signals[name]), name


SNAPSHOTS = {
    "kind": "snapshots",
    "over": {json.dumps(HELD): [0.5, 2.0]},
    "up_to": "700 Hz",
    "vectors": 40,
    "error": 1e-2,
}


def test_another_basis_is_refused_in_a_run_and_snapshots_outside_of_their_ranges(tmp_path):
    runner = runner_of(bars(tmp_path, MODES), 3)
    before = values(runner)
    for key, value in {"reduction.modes": 20, "reduction.contact": "open", "reduction.kind": "whole"}.items():
        with pytest.raises(SceneError, match=f"(?s){key}:.* the basis .* make a new run with this value"):
            runner.set_parameter(key, value)
    assert values(runner) == before
    trained = runner_of(bars(tmp_path, SNAPSHOTS), 3)
    trained.set_parameter(HELD, 1.5)
    for key, value in {SPRING: 1.1e6, "friction.mu": 0.4}.items():
        with pytest.raises(SceneError, match=f"(?s){key}:.* one value of .*: make a new run with this value, or put"):
            trained.set_parameter(key, value)


MODAL = [
    (
        "plate",
        ["plate.young", "plate.thickness", "plate.density", "foam.young", "slider.length"],
        "plate.damping_ratio",
    ),
    ("disc_slider", ["disc.thickness", "disc.density", "disc.poisson"], "disc.modulus"),
    ("brake_disc_modes", ["disc_modes.thickness", "disc_modes.density"], "disc_modes.modulus"),
    ("tip_beam", ["beam.thickness", "beam.density", "beam.length"], "beam.modulus"),
]


@pytest.mark.parametrize(("name", "refused", "allowed"), MODAL)
def test_a_plant_keeps_the_shapes_of_its_modes_in_a_run(name, refused, allowed):
    begun = rig.load(name).parameters
    for key in refused:
        changed = with_values(begun, {key: 1.01 * rig.load(name).values()[key][0]})
        with pytest.raises(ValueError, match=f"modes, .* depend on {key}: .* make a new run with this value"):
            changed.continuing(begun)
    changed = with_values(begun, {allowed: 1.01 * rig.load(name).values()[allowed][0]})
    assert changed.continuing(begun) == changed


@pytest.mark.parametrize(("name", "key"), [("disc_slider", "disc.modulus"), ("tip_beam", "beam.modulus")])
def test_a_value_that_changes_frequencies_alone_moves_no_point(name, key):
    runner = runner_of(rig.load(name))
    before = values(runner)
    runner.set_parameter(key, 1.5 * runner.parameter(key))
    after = values(runner)
    for name in ("displacement", "velocity", "height"):
        assert after[name] == pytest.approx(before[name], rel=1e-8), name


def test_the_protocol_is_told_why_modes_cannot_change():
    raw = json.loads(rig.load("disc_slider").to_json())
    step = {"step": "set", "target": "disc.thickness", "to": 0.0125}
    hold = {"step": "hold", "time": 0.01}
    run = rig.simulate(Scene.from_json(json.dumps(raw | {"protocol": [hold, step, hold]})))
    told = [event["text"] for event in run.plant_events if "disc.thickness" in event["text"]]
    assert any("make a new run with this value" in text for text in told), told
