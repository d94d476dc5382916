"""Friction laws from files: with and without memory, what is wrong with them, recordings, live tuning."""

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import rig as lab
from rig import laws
from rig.errors import SceneError, Untrusted
from rig.laws import LAWS
from rig.model.friction_law import smoothed
from rig.scenes.scene import Scene

DOCS = Path(__file__).parents[2] / "docs"
VALUES = {"mu_slow": 0.2, "rise": 0.3, "peak": 0.02}


@pytest.fixture
def own(tmp_path):
    """A folder with the laws of the documentation, and scenes `example_law.toml`, `bristles.toml`."""
    for name in ("example_law.py", "example_law.toml"):
        shutil.copy(DOCS / name, tmp_path)
    shutil.copy(DOCS / "example_bristles.py", tmp_path / "bristles.py")
    (tmp_path / "bristles.toml").write_text(
        'based_on = "belt"\n[friction]\nlaw = "bristles.py"\nlimit = 0.4\nstiffness = "1e4 1/m"\n'
    )
    return tmp_path


def faults(scene, overrides=None):
    with pytest.raises(SceneError) as told:
        lab.load(scene, overrides)
    return [line for line in told.value.faults if "dropped" not in line]


def changed(file, *changes):
    text = file.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)


def test_a_law_from_a_file_is_its_formula(own):
    scene = lab.load(own / "example_law.toml")
    assert scene.parameters.friction.law == "example_law.py"
    law = scene.parameters.friction.friction()
    assert law.static == 0.2
    for v in (0.0, 1e-3, 0.02, 0.5):
        u = v / 0.02
        assert law.mu(v) == pytest.approx(0.2 + 0.3 * u * math.exp(1.0 - u), rel=1e-14)
        assert law.slope(v) == pytest.approx(15.0 * (1.0 - u) * math.exp(1.0 - u), rel=1e-14)
        assert smoothed(law, 1e-3).mu(v) == pytest.approx(math.tanh(v / 1e-3) * law.mu(v), rel=1e-14)
    assert scene.assemble().patches[0][3] is law  # the same values are compiled and checked once


def test_the_same_formula_from_a_file_gives_the_run_of_the_shipped_law(own):
    """Stribeck's law as a formula: called by address, and to rounding the motion of the compiled law."""
    changed(
        own / "example_law.py",
        ("p.mu_slow + p.rise * bump(w / p.peak)", "p.mu_slow + p.rise * math.exp(-w / p.peak)"),
        ("p.rise * (1.0 - u) * math.exp(1.0 - u) / p.peak", "-p.rise * math.exp(-u) / p.peak"),
    )
    shipped = {
        "friction.law": "stribeck",
        "friction.mu_static": 0.5,
        "friction.mu_dynamic": 0.2,
        "friction.speed_scale": 0.02,
    }
    mine, other = (
        lab.simulate(scene, 2.0) for scene in (lab.load(own / "example_law.toml"), lab.load("belt", shipped))
    )
    assert mine.signals["displacement"] == pytest.approx(other.signals["displacement"], abs=1e-8)
    assert len(mine.events) == len(other.events)


COPIED = {
    "stribeck_viscous": {"mu_static": 0.5, "mu_dynamic": 0.2, "speed_scale": 0.02, "viscous": 0.1},
    "lugre": {"mu_static": 0.5, "mu_kinetic": 0.3, "speed_scale": 0.02, "sigma0": 1e4, "sigma1": 3.0},
}


def twice(name, own):
    """Belts with a shipped law and with a copy of its file."""
    shutil.copy(Path(laws.__path__[0]) / f"{name}.py", own / "mine.py")
    values = {f"friction.{key}": value for key, value in COPIED[name].items()}
    return [lab.load("belt", {"friction.law": law, **values}) for law in (name, str(own / "mine.py"))]


@pytest.mark.parametrize("name", COPIED)
def test_a_shipped_law_copied_into_a_file_gives_the_same_bits(own, name):
    shipped, mine = (lab.simulate(scene, 1.0) for scene in twice(name, own))
    assert np.array_equal(shipped.signals["displacement"], mine.signals["displacement"])


def test_a_law_with_memory_from_a_file(own):
    scene = lab.load(own / "bristles.toml")
    law = scene.parameters.friction.friction()
    assert [state.name for state in law.states] == ["deflection"]
    assert (law.sticks, law.mu(0.1, 20.0)) == (False, pytest.approx(0.4, rel=1e-12))
    values, slopes = law.formula.evaluate(law.numbers, 0.1, 20.0, np.array([1e-5]))
    assert values == pytest.approx([0.1, 0.075, 1e-5], rel=1e-14)
    assert slopes == pytest.approx(np.array([[0.0, 0.0, 1e4], [0.75, 0.0, -2500.0]]), rel=1e-14)


@pytest.mark.parametrize("name", ["example_law", "bristles"])
def test_a_recording_carries_the_law_and_is_verified_to_the_bit(rig, own, tmp_path, strangers, name):
    scene = lab.load(own / f"{name}.toml")
    text = scene.to_json()
    assert [(part["part"], part["name"]) for part in json.loads(text)["parts"]] == [("laws", f"{name}.py")]
    assert Scene.from_json(text) == scene
    log, more = tmp_path / "run.mcap", tmp_path / "more.mcap"
    lab.simulate(scene, 0.5).save(log)
    for file in own.glob("*.py"):
        file.unlink()
    strangers()
    with pytest.raises(Untrusted, match=rf"{name}\.py"):
        Scene.from_json(text)
    assert rig("verify", log)[0] == 2
    code, out, err = rig("verify", log, "--trust")
    assert (code, err) == (0, ""), out
    assert "bit by bit" in out
    code, out, err = rig("simulate", "--from", f"{log}@0.3s", "--trust", "--duration", "0.1", "--out", more)
    assert code == 0, out + err
    assert rig("verify", more, "--trust")[0] == 0


def test_the_law_is_explained_with_its_source(rig, own):
    code, out, err = rig("explain", own / "example_law.toml")
    assert code == 0, err
    assert re.search(r"friction at contact .* law example_law\.py \(SHA-256 [0-9a-f]{12}\.\.\.\); stick and slip", out)
    assert re.search(r"friction\.peak +0\.02 +m/s", out)


def test_values_are_changed_by_option_and_while_the_rig_runs(own):
    assert (
        lab.load(own / "example_law.toml", {"friction.rise": 0.1}).parameters.friction.friction().mu(0.02) == 0.2 + 0.1
    )
    scene = lab.load(
        "belt", {"friction.law": str(own / "example_law.py"), **{f"friction.{k}": v for k, v in VALUES.items()}}
    )
    assert scene.parameters.friction.law == "example_law.py"
    (own / "tuned.toml").write_text(
        'based_on = "example_law.toml"\n[[protocol]]\nstep = "hold"\ntime = "0.2 s"\n[[protocol]]\nstep = "set"\n'
        'target = "friction.mu_slow"\nto = 0.4\n[[protocol]]\nstep = "hold"\ntime = "0.2 s"\n'
    )
    run = lab.simulate(lab.load(own / "tuned.toml"))
    at = run.time > 0.35
    assert run.signals["friction_force"][at].max() > 20.0 * 0.39
    assert abs(run.energy["error"]) < 1e-6


MU, SLOPE, FIRST = "p.mu_slow + p.rise", "* math.exp(1.0 - u) / p.peak", "    mu_slow:"
WRONG = [
    ("def mu(p, w):", "def mew(p, w):", r"friction\.law: example_law\.py: Rubber defines no mu\(p, w\): the coeff"),
    ("def mu(p, w):", "def mu(p, w, N, z):", r"Rubber\.mu takes other arguments; .* without .* mu\(p, w\)"),
    (MU, "p.raise_ * w + p.rise", r"example_law\.py: AttributeError: .*raise_.* \(line \d+\)"),
    (MU, f"-{MU}", r"mu is -0\.2 at w = .*: friction would drive the slip"),
    (SLOPE, "* math.exp(1.0 - u)", r"slope gives .* s/m at w = .*, differences of mu .*; correct"),
    (MU, "p.mu_slow * (0.5 if w > 0.1 else 1.0) + p.rise", r"mu jumps at w = 0\.1 m/s; make it continuous"),
    (FIRST, f"    def static(self):\n        return 0.1\n\n{FIRST}", r"static coefficient is 0\.1, below mu = 0\.2 in"),
    (MU, "(math.nan if 0.03 < w < 0.0301 else p.mu_slow) + p.rise", r"mu is nan at w = 0\.03 m/s; it must be finite"),
    ("(FrictionLaw)", "(object)", r"defines no class derived from rig\.laws\.FrictionLaw"),
]


@pytest.mark.parametrize(("old", "new", "told"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_with_a_law_is_told(own, old, new, told):
    changed(own / "example_law.py", (old, new))
    lines = faults(own / "example_law.toml")
    assert re.search(told, "\n".join(lines)), lines
    assert "example_law.py" in lines[0]


SPRING = "return p.stiffness * z[0]\n"
LESS_SPRING = "return p.stiffness * z[0] - 100.0 * w * (1.0 - share(p, z))\n"
MEMORY = [
    ("def slopes(p, w, N, z, d):", "def slope(p, w):", r"defines no slopes\(p, w, N, z, d\): .* implicit steps need"),
    ("dz[0] = w * (1.0 - share(p, z))", "dz[0] = w", r"there is no steady slip at w = .*, N = .* N: deflection' = "),
    (SPRING, f"return -{SPRING[7:]}", r"mu is -0\.4 in steady slip at w = .*friction would drive"),
    (
        "d[1, 0] = 1.0 -",
        "d[1, 0] = 2.0 -",
        r"slopes: d\[1, 0\], the derivative of the rate of deflection with .* to w, is",
    ),
    (SPRING, LESS_SPRING, r"a closed loop of slip, .* gives"),
]


@pytest.mark.parametrize(("old", "new", "told"), MEMORY, ids=range(len(MEMORY)))
def test_what_is_wrong_with_a_law_with_memory_is_told(own, old, new, told):
    changed(own / "bristles.py", (old, new))
    if new == LESS_SPRING:
        changed(
            own / "bristles.py",
            (
                "d[0, 2] = p.stiffness\n",
                "d[0, 0] = -100.0 * (1.0 - share(p, z))\n        d[0, 2] = p.stiffness * (1.0 + 100.0 * w / p.limit)\n",
            ),
        )
    lines = faults(own / "bristles.toml")
    assert re.search(told, "\n".join(lines)), lines


STATE = 'InternalState("deflection", "m", along=True)'
DECLARED = [
    ('"m", along', '"mm", along', "contains 'deflection', whose unit 'mm' is not SI"),
    ('"deflection"', '"de/flection"', "contains a state whose name 'de/flection' cannot be recorded; expected 1 to 64"),
    (STATE, f"{STATE}, {STATE}", "contains two states 'deflection'; give each a name of its own"),
]


@pytest.mark.parametrize(("old", "new", "told"), DECLARED, ids=range(len(DECLARED)))
def test_what_is_wrong_with_internal_states_is_told_before_the_rig_moves(own, old, new, told):
    changed(own / "bristles.py", (old, new))
    lines = faults(own / "bristles.toml")
    assert f"bristles.py: Bristles.states {told}" in "\n".join(lines), lines


BAND = "0.05999 < w < 0.06001"
NARROW = [
    ("example_law", MU, f"(math.nan if {BAND} else p.mu_slow) + p.rise", r"mu \(line \d+\) is nan at w = 0\.06 m/s"),
    (
        "bristles",
        "d[0, 2] =",
        f"d[0, 2] = math.nan if {BAND} else",
        r"slopes \(line \d+\) is nan at w = 0\.06 m/s, N = 20 N",
    ),
]


@pytest.mark.parametrize(("name", "old", "new", "told"), NARROW, ids=range(len(NARROW)))
def test_a_law_that_fails_only_at_the_operating_point_is_told(rig, own, name, old, new, told):
    file = own / f"{name}.py"
    file.write_text(f"import math\n{file.read_text()}")
    changed(file, (old, new))
    for command in ("modes", "simulate"):
        code, _, err = rig(command, own / f"{name}.toml")
        assert (code, bool(re.search(rf"{name}\.py: friction law {name}\.py \(.*\): {told}", err))) == (2, True), err


def test_a_law_that_fails_while_the_rig_moves_is_told_and_the_recording_is_whole(rig, own, tmp_path):
    """Where the law fails no step ends: the run stops there, at the deflection that the law cannot take."""
    changed(own / "bristles.py", (SPRING, "return math.nan if 2.0e-5 < z[0] < 2.1e-5 else p.stiffness * z[0]\n"))
    (own / "bristles.py").write_text(f"import math\n{(own / 'bristles.py').read_text()}")
    log = tmp_path / "run.mcap"
    code, _, err = rig("simulate", own / "bristles.toml", "--duration", "1", "--out", log)
    assert (code, "mu (line 19) is nan at" in err, "deflection = 2e-05" in err) == (4, True, True), err
    run = lab.open(log, trust=True)
    assert 0.0 < run.time[-1] < 1.0
    assert run.summary["ended"] == "stopped by the numerics"


def test_a_jump_that_is_declared_is_allowed(own):
    changed(
        own / "example_law.py",
        ("p.mu_slow + p.rise * bump(w / p.peak)", "p.mu_slow * (0.5 if w > 0.1 else 1.0)"),
        ("p.rise * (1.0 - u) * math.exp(1.0 - u) / p.peak", "0.0 * u"),
        ("    mu_slow:", "    jumps = (0.1,)\n\n    mu_slow:"),
    )
    run = lab.simulate(lab.load(own / "example_law.toml"), 1.0)
    assert np.ptp(run.signals["slip_speed"]) > 0.1  # both sides of the jump
    assert abs(run.energy["error"]) < 1e-6


def test_wrong_values_are_told_with_key_and_unit(own):
    assert "friction.peak" in faults(own / "example_law.toml", {"friction.peak": "-1 m/s"})[0]
    assert "did you mean friction.peak?" in faults(own / "example_law.toml", {"friction.peek": 1.0})[0]
    peak = faults("belt", {"friction.law": str(own / "example_law.py"), "friction.mu_slow": 0.2, "friction.rise": 0.1})
    assert peak[0].startswith("friction.peak: is missing; expected a value in m/s")
    line = faults("belt", {"friction.law": "stribek"})[0]
    assert line.startswith('friction.law = "stribek": unknown; did you mean stribeck? known: ')
    assert all(name in line for name in LAWS.shipped)
    assert "there is no such file" in faults("belt", {"friction.law": "./nowhere.py"})[0]


def test_the_law_of_a_sector_comes_from_a_file_too(own):
    values = {f"sector.friction.{key}": value for key, value in VALUES.items()}
    scene = lab.load("lever_sector", {"sector.friction.law": str(own / "example_law.py"), **values})
    assert scene.parameters.sector.friction.law == "example_law.py"
    assert Scene.from_json(scene.to_json()) == scene
