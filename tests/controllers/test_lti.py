"""Linear controllers: from files and python-control, discretised, kept from winding up, and working like all others."""

import json
import math
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

import rig as package
from rig import controllers
from rig.analysis.linear.control_loop import loop
from rig.bench.again.verify import verify
from rig.bench.run.local_controllers import placed
from rig.controllers.blocks import discretise, system_file
from rig.controllers.blocks.base import retune, tunable
from rig.controllers.lti import LTI, of_python_control
from rig.errors import SceneError, UsageError
from rig.record.save_run import save

ROOT = Path(__file__).parents[2]
SCENE = """
format = 1
based_on = "belt_normal_force"
title = "a linear controller"

[controllers.nf]
kind = "lti"
reads = "vibrometer"
drives = "load.force"
nominal = "20 N"
lowest = "0 N"
highest = "0.1 kN"
"""


def section(**keys):
    return LTI.model_validate({"kind": "lti", "reads": "y", "drives": "u", **keys})


def system(found, **keys):
    """The system at 1 ms."""
    made = section(A=found.A.tolist(), B=found.B.tolist(), C=found.C.tolist(), D=found.D.tolist(), **keys)
    return controllers.build(made, {})


@pytest.mark.parametrize("method", discretise.METHODS)
def test_a_continuous_system_is_discretised_as_python_control_does(method):
    given = control.ss([[-3.0, 2.0], [-50.0, -1.0]], [[0.1], [1.0]], [[7.0, -2.0]], [[0.0]])
    expected = control.c2d(given, 1e-3, method)
    made = of_python_control(given, reads="y", drives="u", method=method)
    for name in "ABCD":
        np.testing.assert_allclose(getattr(made, name), getattr(expected, name), rtol=1e-13, atol=1e-16)


def test_prewarping_makes_one_frequency_exact():
    given = control.tf([1.0, 5.0], [1.0, 2.0, 4e4])
    made = of_python_control(given, reads="y", drives="u", method="tustin", prewarp="31 Hz")
    turn = 2.0 * math.pi * 31.0
    found = control.ss(made.A, made.B, made.C, made.D, 1e-3)
    assert found(np.exp(1e-3j * turn)) == pytest.approx(given(1j * turn), rel=1e-12)


def test_a_transfer_function_of_several_inputs_and_outputs_keeps_its_response():
    num = [[[1.0], [2.0, 1.0], [0.5]], [[3.0], [1.0, 0.0], [-1.0]]]
    den = [[[1.0, -0.5], [1.0, 0.2, 0.1], [1.0]], [[2.0, 1.0], [1.0, -0.9], [4.0, 0.1, 0.3]]]
    given = control.tf(num, den, 1e-3)
    made = of_python_control(given, reads="a, b, c", drives="u, v")
    found = control.ss(made.A, made.B, made.C, made.D, 1e-3)
    for z in (1.0, 1j, np.exp(0.3j)):
        np.testing.assert_allclose(found(z), given(z), rtol=1e-12)


def test_all_files_and_python_control_give_the_same_controller(tmp_path):
    found = {"A": [[0.9, 0.1], [0.0, 0.5]], "B": [[0.0], [1.0]], "C": [[1.0, 2.0]], "D": [[0.25]], "dt": 2e-3}
    names = {"inputs": ["vibrometer"], "outputs": ["load.force"]}
    (tmp_path / "k.json").write_text(json.dumps({**found, **names}))
    np.savez(tmp_path / "k.npz", **found, **names)
    cells = {key: np.array(one, dtype=object).reshape(1, -1) for key, one in names.items()}
    savemat(tmp_path / "k.mat", {**found, **cells})
    matrices = [found[name] for name in "ABCD"]
    expected = of_python_control(control.ss(*matrices, 2e-3, inputs="vibrometer", outputs="load_force"))
    assert (expected.period, expected.reads, expected.drives) == (2_000_000, ("vibrometer",), ("load.force",))
    for suffix in system_file.READERS:
        read = LTI.model_validate({"kind": "lti", "file": str(tmp_path / f"k{suffix}")})
        assert read == expected.model_copy(update={"file": f"k{suffix}"})


FAULTS = {
    "dt is missing": {"D": 1.0},
    "period: is 0.001 s, but the system is discrete with dt = 0.002 s": {"D": 1.0, "dt": 0.002},
    "D contains a number that is not finite": {"D": math.nan, "dt": 0.001},
    "improper: num has degree 2, den 1": {"num": [1, 2, 3], "den": [1, 1], "dt": 0.001},
    r"A is 1 x 2, expected 1 x 1; B is 1 x 1, expected 1 x 2 \(D is 1 x 2\)": {
        "A": [[1, 2]],
        "B": [[1]],
        "C": [[1]],
        "D": [[0, 1]],
        "dt": 0.001,
    },
    "has no effect on the outputs": {
        "A": [[1, 0], [0, 1]],
        "B": [[1], [0]],
        "C": [[1, 0]],
        "D": [[0]],
        "dt": 0.001,
    },
}


@pytest.mark.parametrize("told", FAULTS)
def test_a_system_that_cannot_work_is_refused(tmp_path, told):
    (tmp_path / "k.json").write_text(json.dumps(FAULTS[told]))
    (tmp_path / "mine.toml").write_text(SCENE + 'file = "k.json"\nperiod = "1 ms"\n')
    with pytest.raises(SceneError, match=told) as refused:
        package.load(tmp_path / "mine.toml")
    assert "controllers.nf" in refused.value.faults[0]


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"reads": "laser"}, r"controllers.nf.reads\[1\] = \"laser\": unknown sensor"),
        ({"reads": "vibrometer, normal_force"}, "reads: names vibrometer, normal_force; expected 1 different"),
        ({"file": "none.json"}, "there is no such file"),
    ],
)
def test_keys_that_do_not_fit_are_refused(tmp_path, monkeypatch, keys, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "k.json").write_text('{"D": 1.0, "dt": 0.001}')
    (tmp_path / "mine.toml").write_text(SCENE + 'file = "k.json"\n')
    with pytest.raises(SceneError, match=told):
        package.load(tmp_path / "mine.toml", {f"controllers.nf.{key}": value for key, value in keys.items()})


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"lowest": "5 V"}, "controllers.nf.lowest: is '5 V'; expected a unit that converts to N"),
        ({"nominal": -3.0}, "controllers.nf.nominal: is -3 for load.force, outside 0 to 100"),
    ],
)
def test_limits_that_the_actuator_does_not_have_are_refused_before_the_run(tmp_path, keys, told):
    (tmp_path / "mine.toml").write_text(SCENE + "D = [[-200.0]]\n")
    scene = package.load(tmp_path / "mine.toml", {f"controllers.nf.{key}": value for key, value in keys.items()})
    with pytest.raises(SceneError, match=told):
        package.simulate(scene, 0.01)


def test_within_its_limits_it_is_the_linear_system():
    given = control.drss(3, 1, 1, strictly_proper=False, dt=1e-3)
    given.A = 0.9 * given.A / abs(np.linalg.eigvals(given.A)).max()
    controller = system(given, gain=2.0, nominal=0.5)
    y = np.random.default_rng(4).normal(size=200)
    expected = control.forced_response(given, inputs=y).outputs
    state, commands = controller.start(), []
    for k, value in enumerate(y):
        state, command = controller.update(state, k * 1_000_000, (float(value),))
        commands += command
    np.testing.assert_allclose(commands, 0.5 + 2.0 * expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_the_gain_against_windup_of_a_pi_controller_is_that_of_hanus():
    pi = control.ss(1.0, 0.002, 1.0, 0.5, 1e-3)
    assert section(A=pi.A.tolist(), B=pi.B.tolist(), C=pi.C.tolist(), D=pi.D.tolist()).L[0][0] == pytest.approx(
        0.002 / 0.5, rel=1e-3
    )
    integrator = section(A=[[1.0]], B=[[0.01]], C=[[1.0]], D=[[0.0]])
    assert integrator.L[0][0] == pytest.approx(1.0, rel=2e-4)  # the state follows the command in force


@settings(max_examples=20)
@given(st.floats(0.01, 10.0), st.floats(0.1, 100.0), st.integers(10, 3000))
def test_a_pi_controller_leaves_its_limit_at_once(gain, rate, ticks):
    """However long it was at the limit. Without the correction it needs as long as it was wound up."""
    h = 1e-3
    controller = system(control.ss(1.0, gain * rate * h, 1.0, gain, h), lowest=-1.0, highest=1.0)
    state = controller.start()
    for k in range(ticks):
        state, (command,) = controller.update(state, k, (5.0 / gain,))
    assert command == 1.0
    assert abs(state[0]) < 10.0
    for k in range(3):
        state, (command,) = controller.update(state, k, (-5.0 / gain,))
    assert command < 0.0


def test_gain_and_limits_are_tuned_and_the_matrices_are_not():
    controller = system(control.ss(0.5, 1.0, 1.0, 0.0, 1e-3))
    assert set(tunable(controller)) == {"gain", "nominal", "lowest", "highest"}
    new = retune(controller, {"gain": 3.0, "highest": 2.0})
    assert new.update((1.0,), 0, (0.0,))[1] == (2.0,)
    with pytest.raises(UsageError, match="A: is fixed while the rig runs"):
        retune(controller, {"A": [[0.1]]})
    with pytest.raises(UsageError, match="state a number in SI"):  # no plant has told the units
        retune(controller, {"highest": "2 N"})


@pytest.fixture
def scenes(tmp_path):
    """A feedback of the velocity as a linear controller of a file, and the same as normal-force feedback."""
    (tmp_path / "k.json").write_text('{"D": -200.0, "dt": 0.001}')
    (tmp_path / "mine.toml").write_text(SCENE + 'file = "k.json"\n')
    return package.load(tmp_path / "mine.toml"), package.load("belt_normal_force", {"controllers.nf.enable_at": "0 s"})


def test_a_constant_gain_is_normal_force_feedback_to_the_bit(scenes):
    mine, theirs = (package.simulate(one, 0.5) for one in scenes)
    for name, values in mine.signals.items():
        assert values.tobytes() == theirs.signals[name].tobytes(), name
    mine, theirs = (loop(one, "nf") for one in scenes)
    np.testing.assert_allclose(mine.spectrum.rates, theirs.spectrum.rates, rtol=1e-12)
    np.testing.assert_allclose(mine.gain_range, np.array(theirs.gain_range) / 200.0, rtol=1e-6)


def test_a_recording_needs_the_file_no_more(scenes, tmp_path):
    run = package.simulate(scenes[0], 0.2)
    save(run, tmp_path / "run.mcap")
    (tmp_path / "k.json").unlink()
    assert verify(tmp_path / "run.mcap").passed


def test_the_json_of_the_page_closes_a_loop_as_the_page_says(rig, tmp_path, monkeypatch):
    """Every command that takes --controller takes it as it is: discretised by tustin."""
    page = (ROOT / "docs" / "controllers_from_elsewhere.md").read_text()
    (tmp_path / "nf.json").write_text(page.partition("```json\n")[2].partition("```")[0])
    monkeypatch.chdir(tmp_path)
    code, out, err = rig("modes", "belt_normal_force", "--controller", "nf=nf.json", "--json")
    assert code == 0, err
    found = json.loads(out)
    press = control.c2d(control.tf([-200.0], [0.002, 1.0], inputs="vibrometer", outputs="load_force"), 1e-3, "tustin")
    scene, _ = placed(package.load("belt_normal_force"), {"nf": press})
    theirs = loop(scene, "nf")
    np.testing.assert_allclose(found["gain_range"], theirs.gain_range, rtol=1e-9)
    code, out, err = rig("loop", "belt_normal_force", "--controller", "nf.json", "--json")
    assert code == 0, err
    assert json.loads(out)["loop"]["gain_range"] == found["gain_range"]
    assert rig("simulate", "belt_normal_force", "--duration", "0.02", "--controller", "nf.json")[0] == 0
    code, _, err = rig("simulate", "belt_normal_force", "--controller", "fn")
    assert (code, "fn" in err, "nf" in err) == (2, True, True), err


def test_a_transfer_function_of_matlab_is_read(tmp_path):
    savemat(tmp_path / "k.mat", {"num": [[0.0, 2.0]], "den": [[1.0, -0.5]], "Ts": 1e-3})
    read = section(file=str(tmp_path / "k.mat"))
    assert (read.A, read.B, read.C, read.D) == (((0.5,),), ((1.0,),), ((2.0,),), ((0.0,),))
