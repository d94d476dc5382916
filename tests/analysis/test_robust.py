"""Designs against what is not known of a rig: closed forms, known designs, what is refused and what is said."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from robust_scenes import BELT, LOOPED, SHUNT, STACK, absorber, here, three_pairs
from scipy.signal import cont2discrete

import rig as lab
from rig import controllers
from rig.analysis.linear.all_loops import closed_rates
from rig.analysis.linear.control_loop import plant
from rig.analysis.robust import design, search
from rig.analysis.robust.growth import LOOP, MODES, Growth
from rig.analysis.robust.stated import box, prepared
from rig.analysis.robust.tasks import Computer, Region, whole, worst
from rig.design import numbers
from rig.design.linearised import arithmetic
from rig.errors import SceneError, UsageError

DAMPERS = {"spring_1.damping": "0 N*s/m:0.6 N*s/m", "spring_2.damping": (0.0, 0.6), "spring_1.stiffness": (70.0, 130.0)}
ONE = {"spring_1.damping": "0 N*s/m:0.6 N*s/m"}
LIMIT = ["spring_1.damping + spring_2.damping < 0.6 N*s/m"]
CONTACT = {"friction.mu": "+-20 %", "contact.stiffness": "+-20 %"}


@pytest.fixture(scope="module")
def brake():
    return lab.load("brake_shunt", {"shunt.connected": True})


@pytest.fixture
def small(monkeypatch):
    """Audits of 300 rigs in place of 10,000."""
    monkeypatch.setattr(design, "AUDIT", 300)


def designed(tmp_path, scene, over, measure=MODES, **more):
    return lab.optimise(scene, over, measure, out=tmp_path, workers=1, **more)


def growing(belt_damping, mu_static, mu_dynamic, speed):
    """The growth rate of the belt with a damper: m 5 kg, F0 20 N, speed scale 0.05 m/s."""
    slope = -(mu_static - mu_dynamic) / 0.05 * math.exp(-speed / 0.05)
    return -(belt_damping + 20.0 * slope) / 10.0


def test_the_worst_belt_is_the_corner_of_the_closed_form(tmp_path, small):
    found = designed(tmp_path, "belt", None, against=BELT, overrides={"body.damping": 12.0})
    exact = growing(12.0, 0.55, 0.162, 0.054)
    assert found.worst == pytest.approx(exact, abs=1e-10)
    assert found.to_json()["worst_rig"] == pytest.approx(
        {"friction.mu_static": 0.55, "friction.mu_dynamic": 0.162, "drive.speed": 0.054}
    )
    nominal = found.entries["robust"].nominal[0]
    assert nominal == pytest.approx(growing(12.0, 0.5, 0.18, 0.06), abs=1e-10)


def test_equal_dampers_of_perpendicular_springs():
    over = {"spring_1.angle": "135 deg", "spring_2.angle": "45 deg", "spring_1.damping": 1.0, "spring_2.damping": 1.0}
    scene = lab.load("two_dof", over)
    growth = Growth(scene, box(scene, {}, {"friction.mu": (1.0, 1.4), "contact.stiffness": (40.0, 60.0)}))
    bad = worst(here(growth), np.zeros(0), whole(2))
    kappas = []
    for mu in np.linspace(1.0, 1.4, 81):
        for k in np.linspace(40.0, 60.0, 81):
            kappas.append(np.linalg.eigvals(np.array([[75.0, -25.0 + mu * k], [-25.0, 75.0 + k]])).astype(complex))
    exact = -0.5 + np.sqrt(0.25 - np.array(kappas)).real.max()
    assert bad.growth[0] == pytest.approx(exact, abs=1e-10)


def test_the_nominal_optimum_of_an_absorber_is_known(tmp_path, small):
    (tmp_path / "absorber.toml").write_text(absorber(0.05))
    over = {"factors.f2": (0.25, 2.25), "factors.fz": (0.0, 0.6)}
    found = designed(tmp_path, tmp_path / "absorber.toml", over, against={"factors.k": "+-10 %"})
    optimum = found.job.box.design(found.entries["nominal optimum"].x)
    frequency = math.sqrt(optimum["factors.f2"])
    assert frequency == pytest.approx(1.0 / 1.05, abs=1e-4)
    assert optimum["factors.fz"] / frequency == pytest.approx(math.sqrt(0.05 / 1.05), abs=1e-4)
    assert found.worst == pytest.approx(-0.06239, abs=2e-5)
    assert found.entries["nominal optimum"].worst.growth[0] == pytest.approx(-0.0520, abs=1e-4)


def test_dampers_of_two_springs(tmp_path, small):
    found = designed(tmp_path, "two_dof", DAMPERS, against=CONTACT, limit=LIMIT)
    assert found.worst == pytest.approx(-0.1400, rel=0.01)
    values = found.values
    assert values["spring_1.damping"] + values["spring_2.damping"] <= 0.6 + 1e-9
    assert values["spring_1.stiffness"] == pytest.approx(130.0)
    assert found.entries["nominal optimum"].worst.growth[0] > 0.3
    text = found.text()
    assert "at the end of its range" in text
    assert "0 of 300 random rigs grow" in text


def test_three_flutter_pairs_of_a_scene_of_matrices(tmp_path, small):
    (tmp_path / "three.toml").write_text(three_pairs())
    over = {f"factors.{name}": (0.0, 200.0) for name in ("c1", "c2", "c3", "cd")}
    against = {"friction.mu": "+-10 %", **{f"contacts.pad{i}.spring": "+-5 %" for i in (1, 2, 3)}}
    limit = "factors.c1 + factors.c2 + factors.c3 + factors.cd < 300"
    found = designed(tmp_path, tmp_path / "three.toml", over, against=against, limit=[limit])
    assert found.worst == pytest.approx(66.9, rel=0.01)


def test_a_gain_against_delays_in_whole_frames(tmp_path, small):
    over = {"controllers.nf.gain": (0.0, 900.0), "controllers.nf.compensation": (0.0, 0.02)}
    found = designed(tmp_path, "belt_normal_force", over, LOOP, against=LOOPED)
    assert found.values["controllers.nf.gain"] == pytest.approx(613.0, rel=0.01)
    assert found.worst == pytest.approx(-11.9547, abs=1e-3)
    worst = found.to_json()["rigs"]  # the best design has two worst rigs, at both ends of the delay
    assert [rig["growth"] for rig in worst[:2]] == pytest.approx([found.worst, found.worst], abs=1e-6)
    assert sorted(rig["controllers.nf.delay"] for rig in worst[:2]) == pytest.approx([0.0, 0.02])
    assert "controllers are not told friction.mu_static" in found.text()


def test_controllers_keep_the_belief_of_the_scene():
    scene = lab.load("brake_active")
    growth = Growth(scene, box(scene, {}, {"structure.scale": "+-2 %"}), LOOP)
    rates = [growth.value(np.zeros(0), np.array([share]))[0] for share in (0.0, 0.5, 1.0)]
    assert rates == pytest.approx([33.8, -1.27, 33.8], abs=0.05)
    told = replace(scene, redesign=True)
    redesigned = Growth(told, growth.box, LOOP).value(np.zeros(0), np.array([0.0]))[0]
    assert redesigned == pytest.approx(
        closed_rates(told.with_values({"structure.scale": 0.98 * _scale(scene)}))[0].real
    )
    assert redesigned < -1.0


def _scale(scene):
    return scene.values()["structure.scale"][0]


def test_a_speed_in_the_box_is_not_told_and_a_free_value_is():
    scene = lab.load("belt_normal_force_displacement")
    made = Growth(scene, box(scene, {"body.stiffness": (2000.0, 3000.0)}, {"drive.speed": "+-10 %"}), LOOP)
    rig = made.rig({"body.stiffness": 2200.0}, {"drive.speed": 0.05})
    assert rig.believed == {"drive.speed": 0.06}
    assert rig.values()["body.stiffness"][0] == 2200.0


def test_the_growth_of_all_loops_is_that_of_the_one_loop():
    for name, controller in (("belt_normal_force", "nf"), ("belt_velocity_feedback", "belt"), ("brake_active", "nb")):
        scene = lab.load(name)
        of_one = lab.loop(scene, controller).spectrum.rates
        every = closed_rates(scene)
        assert len(every) == len(of_one)
        assert every[0].real == pytest.approx(of_one[0].real, abs=1e-8)


def test_two_loops_act_together(tmp_path):
    """Both at 1 kHz, without delays and filters: one period is a step with held commands, by scipy."""
    nf = '[controllers.nf]\nkind = "normal_force"\nsensor = "vibrometer"\ngain = ["60 N*s/m", "chosen"]\n'
    (tmp_path / "two.toml").write_text(f'format = 1\nbased_on = "belt_velocity_feedback"\n{nf}')
    scene = lab.load(tmp_path / "two.toml")
    assert set(scene.controllers) == {"belt", "nf"}
    rig = plant(scene)
    values = numbers(scene)
    loops = [controllers.build(section, values[name]) for name, section in scene.controllers.items()]
    drives = [rig.inputs.index(loop.drives[0]) for loop in loops]
    A, B, *_ = cont2discrete((rig.A, rig.B[:, drives], rig.C, rig.D[:, drives]), 1e-3)
    read = rig.outputs.index(scene.sensors["vibrometer"].reads)
    parts = [arithmetic(loop) for loop in loops]
    assert not any(len(xi) for xi, *_ in parts)
    gains = np.array([[d] for *_, d in parts])
    step = A + B @ gains @ rig.C[[read]]
    expected = np.log(np.linalg.eigvals(step).astype(complex)) / 1e-3
    growth = closed_rates(scene)[0].real
    assert growth == pytest.approx(max(rate.real for rate in expected), abs=1e-8)
    alone = [
        closed_rates(lab.load(tmp_path / "two.toml", {f"controllers.{name}": "none"}))[0].real
        for name in ("nf", "belt")
    ]
    assert min(abs(growth - each) for each in alone) > 0.1


def test_loop_growth_is_a_measure_of_studies(tmp_path):
    over = {"controllers.nf.gain": [100.0, 200.0]}
    found = lab.study("belt_normal_force", over, ["loop.growth", "modes.growth"], out=tmp_path, workers=1)
    assert found.values[:, 0] == pytest.approx(
        [closed_rates(lab.load("belt_normal_force", {"controllers.nf.gain": gain}))[0].real for gain in (100.0, 200.0)]
    )
    assert "modes.growth: plant alone" in found.text()
    with pytest.raises(UsageError, match=r"loop\.growth: unknown"):
        lab.study("belt", {"load.force": [10.0, 20.0]}, ["loop.growth"], out=tmp_path, workers=1)


@pytest.mark.parametrize(
    ("scene", "over", "against", "more", "told"),
    [
        ("two_dof", {"friction.mu": (0.1, 0.2)}, CONTACT, {}, "over friction.mu: nobody designs it; --against"),
        ("two_dof", {"start.height": (0.1, 0.2)}, CONTACT, {}, "do not depend on the start"),
        ("two_dof", {}, {"friction.mus": "+-2 %"}, {}, "did you mean friction.mu"),
        ("two_dof", {}, {"friction.mu": "2 %"}, {}, "expected"),
        ("two_dof", {}, {"friction.mu": "0.5:0.4"}, {}, "the range must rise"),
        (
            "two_dof",
            {"spring_1.damping": (0.0, 1.0)},
            {"spring_1.damping": "0 N*s/m:1 N*s/m"},
            {},
            "state its tolerance",
        ),
        ("two_dof", {}, CONTACT, {"band": "5 kHz:2 kHz"}, "it must rise"),
        ("two_dof", {}, CONTACT, {"decay": "1 1/s"}, "belongs to a tolerance"),
        (
            "two_dof",
            {"spring_1.damping": (0.0, 1.0)},
            CONTACT,
            {"limit": ["spring_1.stiffness < 3 N/m"]},
            "is not free",
        ),
        ("two_dof", {"spring_1.damping": (0.0, 1.0)}, CONTACT, {"limit": ["spring_1.damping < -1 N*s/m"]}, "no design"),
        ("two_dof", {"spring_1.damping": (0.0, 1.0)}, {}, {"band": "1 Hz:2 Hz"}, "--against"),
        ("two_dof", {}, CONTACT, {"minimise": "cycle.amplitude"}, "modes.growth or loop.growth to minimise"),
        ("two_dof", {}, CONTACT, {"minimise": LOOP}, "has no controller that closes a loop"),
        ("belt_normal_force", {"controllers.nf.gain": (0.0, 9.0)}, BELT, {}, "changes no mode of the plant alone"),
        ("belt_normal_force", {"controllers.nf.delay": (0.0, 0.02)}, BELT, {"minimise": LOOP}, "--against takes it"),
        ("belt_normal_force", {}, {"controllers.nf.delay": "0 ms:2.5 ms"}, {"minimise": LOOP}, "whole frames of 1 ms"),
        ("belt_normal_force", {}, {"sensors.vibrometer.delay": "+-1 %"}, {}, "value of an instrument"),
    ],
)
def test_what_cannot_be_designed_is_refused_with_what_to_do(scene, over, against, more, told):
    more = {"minimise": MODES, **more}
    with pytest.raises((UsageError, SceneError), match=told):
        prepared(lab.load(scene), over, against, **more)


def test_all_faults_are_told_at_once():
    with pytest.raises(UsageError) as fault:
        prepared(lab.load("two_dof"), {"friction.mu": (0.1, 0.2)}, {"friction.mus": "+-2 %"}, band="5:2")
    for told in ("over friction.mu", "against friction.mus", "state one measure", "band"):
        assert told in str(fault.value)


def test_a_ninth_uncertain_value_is_refused():
    scene = lab.load("brake_shunt")
    springs = [key for key in scene.values() if key.startswith("springs.")][:9]
    with pytest.raises(SceneError, match="9 uncertain values, and at most 8"):
        box(scene, {}, dict.fromkeys(springs, "+-1 %"))


SPRINGS = ("disc_x", "disc_z", "disc_phi", "piston_left", "piston_right", "fingers_left", "fingers_right")
REFUSED = {
    "two_dof: nothing is free and nothing is uncertain": ["two_dof"],
    "has no growth: the surface": ["belt", "--against", "load.force=+-1 %", "-p", "drive.speed=0"],
    "has no mode in it; the nearest are at": ["two_dof", "--against", "friction.mu=+-2 %", "--band", "10 Hz:20 Hz"],
    "whole frames of 1 ms": ["belt_normal_force", "--against", "controllers.nf.delay=0 ms:2.5 ms"],
    "over spring_1.damping: is stated as one value as well": [
        *("two_dof", "--against", "friction.mu=+-2 %", "--over", "spring_1.damping=0 N*s/m:1 N*s/m"),
        *("-p", "spring_1.damping=0.3 N*s/m"),
    ],
    "--write: no scene is written: no value is free": [
        *("two_dof", "--against", "friction.mu=+-2 %", "--write", "mine.toml"),
    ],
    "9 uncertain values, and at most 8": [
        *("brake", "--against", "friction.mu=+-1 %", "--against", "load.force=+-1 %"),
        *(f"--against=springs.{name}.stiffness=+-1 %" for name in SPRINGS),
    ],
}


@pytest.mark.parametrize("told", REFUSED)
def test_the_command_refuses_before_it_searches(tmp_path, monkeypatch, rig, told):
    monkeypatch.chdir(tmp_path)
    code, _, printed = rig("optimise", *REFUSED[told], "--minimise", MODES, "--workers", "1")
    assert code == 2
    assert told in " ".join(printed.split())
    assert list(tmp_path.iterdir()) == []


def test_a_mode_that_limits_every_design_and_moves_with_none_is_named(tmp_path, small):
    """Beside a mass with an absorber, another mass decays with 0.02 1/s at 3 rad/s, whatever is designed."""
    (tmp_path / "aside.toml").write_text(absorber(0.05, 0.02))
    over = {"factors.f2": (0.25, 2.25), "factors.fz": (0.0, 0.6)}
    found = designed(tmp_path, tmp_path / "aside.toml", over, against={"factors.k": "+-10 %"})
    assert found.found.stuck == pytest.approx(3.0 / (2.0 * math.pi), abs=1e-3)
    assert found.worst == pytest.approx(-0.02, abs=1e-9)
    assert "limits every design, and no free value moves it: --band leaves it out" in found.text()


def test_a_band_without_modes_names_those_that_are_near(tmp_path):
    with pytest.raises(UsageError, match=r"has no mode in it; the nearest are at .*1\."):
        designed(tmp_path, "two_dof", None, against=CONTACT, band="10 Hz:20 Hz")


def test_a_rig_that_does_not_slide_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"the nominal rig \(load.force = 20\) has no growth: the surface"):
        designed(tmp_path, "belt", None, against={"load.force": "+-1 %"}, overrides={"drive.speed": 0.0})


def test_a_box_without_width_is_the_nominal_rig(tmp_path, small):
    found = designed(tmp_path, "belt", None, against={"drive.speed": (0.06, 0.06)}, overrides={"body.damping": 12.0})
    assert found.worst == pytest.approx(growing(12.0, 0.5, 0.18, 0.06), abs=1e-10)
    json.dumps(found.to_json(), allow_nan=False)


def test_what_has_no_influence_is_named(tmp_path, small):
    against = {"friction.mu": "+-5 %", "drive.speed": "+-5 %"}
    found = designed(tmp_path, "two_dof", {"spring_1.damping": (0.0, 0.6)}, against=against)
    assert found.found.idle == ("drive.speed",)
    assert "drive.speed has no influence" in found.text()


def test_distributions_state_the_box_by_quantiles_and_the_audit_by_draws():
    scene = lab.load("belt")
    made = box(scene, {}, {"friction.mu_static": lab.normal(0.5, 0.02), "load.force": "uniform(18 N, 22 N)"})
    low, high = made.uncertain[0].axis.values
    assert (low, high) == pytest.approx((0.44, 0.56), abs=1e-4)
    assert made.uncertain[1].axis.values == (18.0, 22.0)
    draws = made.draws(np.random.default_rng(1), 4000)
    values = low + (high - low) * draws[:, 0]
    assert values.std() == pytest.approx(0.02, rel=0.05)
    assert draws.min() >= 0.0
    assert draws.max() <= 1.0


COVARIANCE = {"key": "friction.mu", "unit": "1", "value": 0.4, "log": True, "size": 1.0, "from": 0.1, "to": 1.0}


@pytest.mark.parametrize(
    ("row", "covariance"),
    [
        (COVARIANCE, [[-1.0]]),
        (COVARIANCE, [[1.0, 2.0]]),
        (COVARIANCE, None),
        (COVARIANCE | {"value": "x"}, [[1.0]]),
        (COVARIANCE | {"value": -0.4}, [[1.0]]),
        ({"key": "friction.mu"}, [[1.0]]),
    ],
)
def test_a_damaged_covariance_is_refused(tmp_path, row, covariance):
    file = tmp_path / "damaged.covariance.json"
    file.write_text(json.dumps({"parameters": [row], "covariance": covariance}))
    with pytest.raises(SceneError, match="is no covariance of rig identify"):
        box(lab.load("two_dof"), {}, {"friction.mu": f"identified({file})"})


@pytest.mark.parametrize(
    ("scene", "key", "stated", "ends", "text"),
    [
        ("two_dof", "friction.mu", ("-1 %", "3 %"), (0.396, 0.412), "-1 to 3 %"),
        ("two_dof", "friction.mu", "+-0.01", (0.39, 0.41), "0.39 to 0.41"),
        ("belt", "drive.speed", "54 mm/s:0.066 m/s", (0.054, 0.066), "0.054 m/s to 0.066 m/s"),
        ("brake_shunt", "shunt.delta", "-5 %:10 %", (-0.55, -0.475), "-5 to 10 %"),
        ("belt_normal_force", "controllers.nf.delay", "normal(10 ms, 2 ms)", (0.004, 0.016), "normal(10 ms, 2 ms)"),
    ],
)
def test_ranges_as_they_are_stated(scene, key, stated, ends, text):
    (value,) = box(lab.load(scene), {}, {key: stated}).uncertain
    assert value.axis.values == pytest.approx(ends)
    assert value.text() == text
    assert value.step == (0.001 if key.endswith("delay") else 0.0)


def test_the_tolerance_of_a_free_number_has_no_unit():
    (value,) = box(lab.load("brake_shunt"), {"shunt.delta": "-0.85:-0.2"}, {"shunt.delta": "+-0.01"}).uncertain
    assert value.text() == "+-0.01"


@pytest.mark.slow
def test_a_tolerance_is_the_largest_range_that_is_held(tmp_path, small):
    found = designed(tmp_path, "two_dof", DAMPERS, None, maximise="tolerance.friction.mu", against=CONTACT, limit=LIMIT)
    assert found.worst <= 0.0
    assert found.factor > 1.0  # with 20 % the worst rig decays with 0.14 1/s
    wider = Growth(found.job.scene, found.job.box)
    beyond = 1.03 * found.factor
    region = Region(np.array([0.5 - 0.5 * beyond, 0.0]), np.array([0.5 + 0.5 * beyond, 1.0]))
    again = design.robust(here(wider, found.job.limits), 1, [found.found.design.x], region, audit=False)
    assert again.growth > 0.0
    assert "no rig grows with friction.mu +-" in found.text()


def test_a_tolerance_of_all_ranges_and_a_decay(tmp_path, small):
    """Of one range of the belt in closed form: the friction at which it decays with 0.1 1/s."""
    against = {"friction.mu_static": "+-10 %", "drive.speed": "+-5 %"}
    more = {"against": against, "overrides": {"body.damping": 45.0}}
    found = designed(tmp_path, "belt", None, None, maximise="tolerance.friction.mu_static", decay="0.1 1/s", **more)
    exact = 0.18 + (45.0 - 1.0) * 0.05 / 20.0 * math.exp(0.057 / 0.05)
    share = found.factor * 0.1
    assert 0.985 * (exact / 0.5 - 1.0) < share <= exact / 0.5 - 1.0
    every = designed(tmp_path, "belt", None, None, maximise="tolerance", **more)
    grows = growing(45.0, 0.5 * (1.0 + 0.1 * every.factor), 0.18, 0.06 * (1.0 - 0.05 * every.factor))
    assert -0.01 < grows <= 0.0


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_workers(tmp_path, small):
    results = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        found = lab.optimise("two_dof", ONE, MODES, against=CONTACT, out=folder, workers=workers)
        facts = found.to_json() | {"folder": ""}
        results.append((json.dumps(facts), found.csv()))
    assert results[0] == results[1]


def test_an_interrupted_design_goes_on_from_its_folder(tmp_path, small, monkeypatch):
    job = prepared(lab.load("two_dof"), ONE, CONTACT, MODES)
    whole = search.find(job, tmp_path / "whole", 1)[0]
    calls = []
    compute = Computer.__call__

    def counted(computer, unit, *given):
        calls.append(given)
        if len(calls) == 20:
            raise KeyboardInterrupt
        return compute(computer, unit, *given)

    monkeypatch.setattr(Computer, "__call__", counted)
    with pytest.raises(KeyboardInterrupt):
        search.find(job, tmp_path / "parts", 1)
    before = len(calls)
    resumed = search.find(job, tmp_path / "parts", 1)[0]
    assert resumed.design.growth == whole.design.growth
    again = len(calls) - before
    search.find(job, tmp_path / "parts", 1)
    assert len(calls) == before + again


def test_the_command_writes_table_figure_and_scene(tmp_path, small, monkeypatch, rig):
    monkeypatch.chdir(tmp_path)
    words = ["optimise", "two_dof", "--limit", LIMIT[0], "--minimise", MODES, "--workers", "1", "--write", "mine.toml"]
    words += ["--over", "spring_1.damping=0 N*s/m:0.6 N*s/m", "--over", "spring_2.damping=0 N*s/m:0.6 N*s/m"]
    words += ["--against", "friction.mu=+-5 %", "--against", "spring_1.damping=+-1 %", "-p", "contact.stiffness=45 N/m"]
    code, printed, told = rig(*words)
    assert code == 0, told
    assert "growth of the worst rig" in printed
    (folder,) = (tmp_path / "searches").iterdir()
    assert {path.name for path in folder.iterdir()} >= {"robust.csv", "robust.png"}
    assert len((folder / "robust.csv").read_text().splitlines()) == 301
    scene = lab.load("mine.toml")
    assert scene.origins["spring_1.damping"].origin == "designed"
    assert "tolerance +-1 %" in scene.origins["spring_1.damping"].note
    assert scene.values()["contact.stiffness"][0] == 45.0
    note = scene.origins["spring_2.damping"].note
    facts = json.loads(rig(*words, "--force", "--json")[1])
    nominal = facts["designs"][0]["growth of the nominal rig"]
    assert (
        f"nominal rig {nominal:.5g} 1/s, of the worst one {facts['worst']:.5g} 1/s; 0 of 300 random rigs grow" in note
    )
    code, explained, told = rig("explain", "mine.toml")
    assert code == 0, told
    assert " ".join(note.split()) in " ".join(explained.split())
    assert lab.modes(scene).sliding.modes[0].growth < 0.0


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_shunt_of_the_brake(brake, tmp_path):
    found = lab.optimise(brake, SHUNT, MODES, against=STACK, band="2 kHz:5 kHz", out=tmp_path)
    assert found.worst <= -5.8
    assert found.found.audit.growth.max() <= found.worst + 0.01 * abs(found.worst)
    assert len(found.found.audit.growth) == 10_000
    assert found.entries["nominal optimum"].nominal[0] < -21.0
    assert found.entries["nominal optimum"].worst.growth[0] > 20.0
    assert found.entries["scene"].worst.growth[0] > 30.0
    values = {**found.values, **found.to_json()["worst_rig"]}
    modes = lab.modes(brake.with_values(values)).sliding.modes
    assert max(mode.growth for mode in modes if 2000.0 < mode.frequency < 5000.0) == pytest.approx(found.worst)
    assert json.dumps(found.to_json(), allow_nan=False)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_friction_that_the_shunt_of_the_brake_tolerates(brake, tmp_path):
    maximise = "tolerance.friction.mu"
    found = lab.optimise(brake, SHUNT, maximise=maximise, against=STACK, band="2 kHz:5 kHz", out=tmp_path)
    assert 0.02 < 0.02 * found.factor < 0.05
    assert found.worst <= 0.0
