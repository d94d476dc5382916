"""FMUs as controllers (FMI 2.0 and 3.0): built from C here, and compared with the same controller in Python."""

import builtins
import json
import zipfile

import pytest

from rig import controllers, design, scenes
from rig.bench.run.simulate import Recorded, simulate
from rig.controllers.blocks.base import tunable
from rig.controllers.runtime.loop import Loop
from rig.errors import SceneError, UsageError
from rig.scenes.scene import Scene

pytest.importorskip("fmpy", reason="fmpy is not installed")
from compile_c import InPython, each_once, same
from compile_fmu import UNITS, unit

LATE = "if (t > 0.0495) "


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """Builds variants of the FMU, each once."""
    return each_once(unit, tmp_path_factory.mktemp("units"), ".fmu")


def scene(file, base="belt", **more):
    given = {"kind": "fmu", "file": str(file), "reads": ["vibrometer"], "drives": ["load.force"]} | more
    return scenes.load(base, {f"controllers.nf.{key}": value for key, value in given.items()})


def made(scene):
    return controllers.restored(json.loads(json.dumps(design.described(scene)["nf"])))


@pytest.mark.parametrize("version", [2, 3])
def test_a_run_has_the_bits_of_the_same_controller_in_python(units, version):
    one = scene(units(version=version), gain="0.3 N*s/mm")
    run = simulate(one, duration_ns=200_000_000)
    same(run, simulate(one, {"nf": InPython()}, duration_ns=200_000_000))
    same(run, simulate(one, duration_ns=200_000_000))


@pytest.mark.parametrize("version", [2, 3])
def test_units_are_converted_by_exponents_factor_and_offset_whatever_they_are_called(units, version):
    one = scene(units(version=version, v="mm per s", gain="N.s/mm", start="0.2", most="1"))
    assert one.controllers["nf"].gain == pytest.approx(200.0)
    assert tunable(made(one)) == {"gain": "N*s/m"}
    loop = Loop(made(one))
    # the FMU of this test multiplies numbers: 0.2 N.s/mm by 0.5 * 0.01 m/s in mm/s
    assert loop.answer(0, (0.01,)) == (pytest.approx(20.0 - 0.2 * 5.0),)
    with pytest.raises(SceneError, match=r'nf.reads = "laser": the sensor is in m, .* has it as v in m/s'):
        scene(units(version=version), reads=["laser"])


@pytest.mark.parametrize("version", [2, 3])
def test_tuning_tries_the_new_parameters_and_leaves_the_state_as_it_was(units, version):
    file = units(version=version)
    tuned, plain = Loop(made(scene(file))), Loop(made(scene(file)))
    for k in range(5):
        assert tuned.answer(k * 1_000_000, (0.01,)) == plain.answer(k * 1_000_000, (0.01,))
    tuned.retune({"gain": 100.0})
    tuned.retune({"gain": 200.0})
    with pytest.raises(UsageError, match="nominal: is fixed while the rig runs"):
        tuned.retune({"nominal": 30.0})
    for k in range(5, 10):
        assert tuned.answer(k * 1_000_000, (0.02,)) == plain.answer(k * 1_000_000, (0.02,))
    tuned.retune({"gain": 0.0})
    assert tuned.answer(10_000_000, (0.02,)) == (20.0,)


def test_steps_that_had_no_measurement_are_done_with_the_last_inputs(units):
    file = units()
    gap, whole = Loop(made(scene(file))), Loop(made(scene(file)))
    for loop in (gap, whole):
        loop.answer(0, (0.01,))
    for k in (1, 2):
        assert gap.answer(k * 1_000_000, (float("nan"),)) == gap.command
        whole.answer(k * 1_000_000, (0.01,))
    assert gap.answer(3_000_000, (0.02,)) == whole.answer(3_000_000, (0.02,))


def test_a_recording_is_verified_without_fmpy_and_without_the_fmu(units, monkeypatch):
    one = scene(units())
    run = simulate(one, duration_ns=50_000_000)
    real = builtins.__import__

    def without(name, *more):
        if name.partition(".")[0] == "fmpy":
            raise AssertionError("fmpy was imported")
        return real(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    same(simulate(Scene.from_json(run.scene), {}, 50_000_000, Recorded(run.commands, run.events)), run)


@pytest.mark.parametrize("version", [2, 3])
def test_an_error_of_the_fmu_ends_its_controller_and_is_passed_on_with_its_log(units, version):
    step = LATE + '{ SAY(3, "no fuel"); status = 3; }'
    run = simulate(scene(units(version=version, step=step, more="")), duration_ns=100_000_000)
    (lost,) = [event for event in run.events if event["kind"] == "lost"]
    assert "its log: error: no fuel" in lost["text"]
    assert lost["t_ns"] == 50_000_000
    assert run.time[-1] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"platform": "win64"}, "has code for win64; this machine needs linux64"),
        (
            {"variable": "false", "step": None, "described_step": "0.0007"},
            "not a multiple of 0.0007 s, the fixed step of",
        ),
        ({"more": "x[2] = 0.0 / 0.0;"}, "commands (nan,) when all measurements are zero"),
        ({"start": "2000"}, "gain: its value 2000 is not within 0 to 1000"),
    ],
)
def test_an_fmu_that_cannot_be_used_is_named_before_the_run(units, tmp_path, changes, told):
    changes = dict(changes)
    if "described_step" in changes:
        file = unit(tmp_path / "nf.fmu", **{"variable": "false"})
        _rewrite(file, lambda xml: xml.replace('stepSize="0.001"', f'stepSize="{changes["described_step"]}"'))
    else:
        file = units(**changes)
    with pytest.raises(SceneError) as refused:
        scene(file)
    assert told in str(refused.value)


def _rewrite(file, change):
    with zipfile.ZipFile(file) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    content["modelDescription.xml"] = change(content["modelDescription.xml"].decode()).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)


def test_an_algebraic_loop_is_named_and_a_delay_or_a_declared_dependency_breaks_it(units):
    force = UNITS.replace(
        '<Unit name="meter/sec"><BaseUnit m="1" s="-1"/></Unit>',
        '<Unit name="meter/sec"><BaseUnit kg="1" m="1" s="-2"/></Unit>',
    )
    sensor = {"sensors.cell.kind": "normal_force", "sensors.cell.ideal": True}
    keys = {"kind": "fmu", "file": str(units(units=force)), "reads": ["cell"], "drives": ["load.force"]}
    given = sensor | {f"controllers.nf.{key}": value for key, value in keys.items()}
    with pytest.raises(SceneError, match=r"nf.delay: load.force -> cell -> nf -> load.force: .* an algebraic loop"):
        scenes.load("belt", given)
    scenes.load("belt", given | {"controllers.nf.delay": "1 ms"})
    scenes.load("belt", given | {"controllers.nf.file": str(units(units=force, depends=' dependencies=""'))})
    scenes.load("belt", given | {"sensors.cell.ideal": False})


def test_what_is_no_fmu_is_named(tmp_path):
    file = tmp_path / "some.fmu"
    file.write_bytes(b"no zip")
    with pytest.raises(SceneError, match=r"controllers\.nf\.file: some\.fmu: is not an FMU: it is not a zip file"):
        scene(file)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", "")
    with pytest.raises(SceneError, match=r"some\.fmu: is not a usable FMU"):
        scene(file)
