"""The plant of the user's own matrices: the same rig written as matrices has the same eigenvalues; faults of scenes."""

import json
import re
from dataclasses import replace
from pathlib import Path

import brake_fe
import disc_with_pads
import numpy as np
import pytest
import scipy.sparse as sp
from matplotlib.image import imread
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu
from scipy.stats import t as student

import rig
from rig import scenes
from rig.analysis import recorded
from rig.analysis.linear import loop_report, mode_shapes
from rig.analysis.linear.control_loop import loop
from rig.analysis.linear.figures import modes_figure
from rig.analysis.linear.modes import at_rest
from rig.analysis.linear.sweep import sweep
from rig.bench.again.verify import verify
from rig.bench.run.before import findings
from rig.errors import SceneError, UsageError
from rig.plants import structure as of_matrices
from rig.record import statistics
from rig.scenes.axis import Axis
from rig.scenes.explain import explain
from rig.stability.linearisation import sliding_key, steady
from rig.structure import model_store
from rig.structure.rows import node_vector
from rig.view import contact, pressure
from rig.view.drawing import Drawing
from rig.view.palette import put


def text(value):
    """A value as TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {text(entry)}" for key, entry in value.items()) + "}"
    return "[" + ", ".join(map(text, value)) + "]" if isinstance(value, list) else json.dumps(value)


def written(folder, tables, name="own"):
    """A scene file of plant structure with these tables."""
    path = folder / f"{name}.toml"
    path.write_text("\n".join(["format = 1", 'plant = "structure"', *(f"{k} = {text(v)}" for k, v in tables.items())]))
    return path


def as_matrices(name, **values):
    """The tables of a shipped rig written as matrices, and the rig itself at steady sliding."""
    scene = scenes.load(name, values)
    _, at = at_rest(scene, {})
    system = at.system
    names = [c.replace(".", "_") for c in system.coordinates]
    count = len(names)

    def row(vector):
        return {name: value for name, value in zip(names, vector.tolist()) if value}

    radius = getattr(getattr(scene.parameters, "linings", None), "radius", None)
    contacts, pressed = {}, []
    friction = system.stiffness.copy()
    for normal in system.normals:
        patch, n = system.patches[normal.patch], normal.direction
        spring = float(-(normal.row[:count] @ n) / (n @ n))
        contacts[normal.name.replace(".", "_")] = {"gap": row(n), "along": row(patch.direction), "spring": spring}
        if radius:
            contacts[normal.name.replace(".", "_")]["radius"] = radius
        friction += spring * np.outer(n + patch.law.mu(1.0) * patch.direction, n)
        pressed.append(-spring * n)
    rest = np.linalg.lstsq(np.array(pressed), np.full(len(pressed), 10.0), rcond=None)[0]
    matrices = {"mass": system.mass, "damping": system.damping, "stiffness": system.stiffness}
    parts = {of: {"of": of, "values": matrix.tolist()} for of, matrix in matrices.items()}
    mu = scene.parameters.friction.mu
    tables = {
        "structure": {"units": "m-kg-s", "coordinates": names, "parts": parts},
        "contacts": contacts,
        "drive": {"speed": scene.parameters.drive.speed or 0.1} | ({"axis": "z"} if radius else {}),
        "load": {"force": 1.0, "at": {"all": {"row": row(friction @ rest)}}},
        "friction": {"law": "constant", "mu": mu},
        "outputs": {"first": {"row": {names[0]: 1.0}}},
    }
    return tables, at


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("two_dof", {}),
        ("four_dof", {}),
        ("tip_beam", {"friction": {"law": "constant", "mu": 0.4}}),
        ("brake", {"friction": {"law": "constant", "mu": 0.4}}),
    ],
)
def test_a_rig_written_as_matrices_has_the_eigenvalues_of_its_own_plant(tmp_path, name, values):
    tables, at = as_matrices(name, **values)
    own = at_rest(scenes.load(written(tmp_path, tables)))[1]
    assert own.exists
    expected, computed = at.eigenvalues(), own.eigenvalues()
    assert len(computed) == len(expected)
    for value in expected:
        assert np.abs(computed - value).min() <= 1e-12 * np.abs(expected).max()


THREE = {
    "structure": {
        "units": "m-kg-s",
        "coordinates": ["x", "y", "u"],
        "parts": {
            "M": {"of": "mass", "values": np.diag([1.0, 1.0, 0.5]).tolist()},
            "K": {"of": "stiffness", "values": [[300.0, -80.0, -100.0], [-80.0, 200.0, 0.0], [-100.0, 0.0, 100.0]]},
            "KR": {"of": "stiffness", "values": np.eye(3, k=1).tolist(), "times": "factors.soft"},
            "G": {"of": "damping", "values": (np.eye(3, k=1) - np.eye(3, k=-1)).tolist(), "times": "drive.speed"},
            "D": {"of": "damping", "values": np.eye(3).tolist(), "times": "1/drive.speed", "factor": 0.01},
            "KG": {"of": "stiffness", "values": np.eye(3).tolist(), "times": "drive.speed^2"},
        },
    },
    "factors": {"soft": 2.0},
    "damping": {"alpha": 0.02},
    "contacts": {"pad": {"gap": {"y": 1.0}, "along": {"x": 1.0}, "spring": 150.0}},
    "drive": {"speed": 0.5},
    "load": {"force": 20.0, "at": {"top": {"row": {"y": -1.0}}}},
    "friction": {"law": "constant", "mu": 0.3},
    "outputs": {"body": {"row": {"u": 1.0}}},
    "start": {"velocity": 1e-3},
}


def test_parts_are_scaled_by_numbers_of_the_scene(tmp_path):
    scene = scenes.load(written(tmp_path, THREE))
    for speed, soft in ((0.5, 2.0), (2.0, -1.0)):
        system = scene.with_values({"drive.speed": speed, "factors.soft": soft}).assemble().system()
        K = np.array(THREE["structure"]["parts"]["K"]["values"]) + soft * np.eye(3, k=1) + speed**2 * np.eye(3)
        D = speed * (np.eye(3, k=1) - np.eye(3, k=-1)) + 0.01 / speed * np.eye(3) + 0.02 * np.diag([1.0, 1.0, 0.5])
        assert np.allclose(system.stiffness, K, rtol=1e-15, atol=0.0)
        assert np.allclose(system.damping, D, rtol=1e-15, atol=1e-18)


def test_a_run_starts_in_steady_sliding_and_keeps_its_energy_balance(tmp_path):
    """The part of an unsymmetric stiffness matrix that has no potential does work as a force."""
    run = rig.simulate(scenes.load(written(tmp_path, THREE)), 1.0)
    assert abs(run.energy["error"]) < 1e-12
    assert np.abs(run.signals["body_velocity"]).max() <= 1.5e-3
    assert run.signals["body_displacement"][0] != 0.0


def test_damping_ratios_of_a_table_and_of_a_frequency(tmp_path):
    for damping, ratio in (
        ({"table": [[1.0, 0.01], [3.0, 0.03]]}, lambda hertz: 0.01 * np.clip(hertz, 1.0, 3.0)),
        ({"ratio": 0.02, "at": 2.0}, lambda hertz: 0.01 * hertz),
    ):
        tables = {
            "structure": THREE["structure"] | {"parts": {k: THREE["structure"]["parts"][k] for k in "MK"}},
            "outputs": THREE["outputs"],
            "damping": damping,
        }
        rates = at_rest(scenes.load(written(tmp_path, tables)))[1].eigenvalues()
        for rate in rates[rates.imag > 0.0]:
            assert -rate.real / abs(rate) == pytest.approx(ratio(abs(rate) / (2.0 * np.pi)), rel=1e-12)


def test_a_number_that_multiplies_matrices_is_an_actuator_that_takes_steps_only(tmp_path):
    scene = scenes.load(written(tmp_path, THREE))
    inputs = scene.assemble().inputs
    assert inputs["drive.speed"].state == inputs["factors.soft"].state == ""
    assert inputs["drive.speed"].low > 0.0  # D is divided by it
    step = {"step": "ramp", "target": "drive.speed", "to": "1 m/s", "over": "1 s"}
    with pytest.raises(SceneError, match=r"drive\.speed cannot run, every value of it makes new matrices"):
        scenes.load(written(tmp_path, THREE | {"protocol": [step]}))


def test_matrices_of_files_can_stay_as_they_are(tmp_path):
    """Like the same matrices typed into the scene; without a kind, files are reduced to modes."""
    matrices = {of: THREE["structure"]["parts"][name] for of, name in (("mass", "M"), ("stiffness", "K"))}
    for of, part in matrices.items():
        sp.save_npz(tmp_path / f"{of}.npz", sp.csr_array(part["values"]))
    files = {of: {"of": of, "file": f"./{of}.npz"} for of in matrices}
    rates = []
    for name, parts, more in (("typed", matrices, {"coordinates": ["x", "y", "u"]}), ("files", files, {})):
        tables = {"structure": {"units": "m-kg-s", "parts": parts} | more, "reduction": {"kind": "whole"}}
        rates.append(at_rest(scenes.load(written(tmp_path, tables, name)))[1].eigenvalues())
    assert np.array_equal(*rates)


def test_every_fault_of_a_scene_is_reported_at_once_with_its_key(tmp_path):
    parts = THREE["structure"]["parts"]
    wrong = THREE | {
        "structure": THREE["structure"]
        | {
            "parts": parts
            | {
                "M": {"of": "mass", "values": [[1.0, 0.0], [0.0, 1.0]]},
                "KR": parts["KR"] | {"times": "factors.sofd"},
            }
        },
        "contacts": {"pad": THREE["contacts"]["pad"] | {"gap": {"w": 1.0}}},
        "drive": {"speed": 0.0},
        "outputs": {"body": {"row": {"u": 0.0}}},
    }
    with pytest.raises(SceneError) as error:
        scenes.load(written(tmp_path, wrong))
    lines = "\n".join(error.value.faults)
    for line in (
        ": has 2 rows; there are 3 coordinates",
        'KR.times = "factors.sofd": factors.sofd is no number of this scene; did you mean factors.soft?',
        "drive.speed = 0.0: structure.parts.D.times divides by it; it must not be zero",
        "contacts.pad.gap: names the coordinate 'w'; known: x, y, u",
        "outputs.body.row: moves nothing: every number is zero",
    ):
        assert line in lines


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"structure": {"coordinates": ["x"], "parts": {}}}, "structure.units: is missing; known: m-kg-s, mm-t-s"),
        ({"friction": None}, "friction: is missing; a structure with [contacts] needs [drive] and [friction]"),
        ({"contacts": {"pad": {"gap": {"y": 1.0}, "spring": 1.0}}}, "contacts.pad.along: is missing beside gap"),
        ({"contacts": {"pad": {"gap": {"y": 1.0}, "along": {"x": 1.0}}}}, "contacts.pad.spring: is missing"),
        ({"outputs": {"a": {"direction": "z"}}}, "outputs.a: give one of node, nodes, set, box or row; there is none"),
        ({"knock": {"at": "b"}}, 'knock.at = "b": no output has this name; known: body'),
        ({"damping": {"ratio": 0.1}}, "damping: ratio and at belong together"),
        (
            {"drive": {"speed": "0.5 m/s", "axis": "z"}},
            'drive.speed = "0.5 m/s": expected a unit that converts to rad/s',
        ),
    ],
)
def test_a_fault_names_its_key_and_what_is_expected(tmp_path, changes, line):
    tables = {key: value for key, value in (THREE | changes).items() if value is not None}
    with pytest.raises(SceneError) as error:
        scenes.load(written(tmp_path, tables))
    assert line in "\n".join(error.value.faults)


@pytest.mark.parametrize(
    "shunt",
    [
        {"shunt": {"kind": "series", "resistance": 2e3, "inductance": 50.0, "delta": -0.3}},
        {"shunt": {"kind": "parallel", "resistance": 1e3, "inductance": 20.0}},
        {"shunt": {"kind": "short"}},
        {"amplifier": {"limit": 10.0}},
        {},
    ],
    ids=["series", "parallel", "short", "amplifier", "open"],
)
def test_a_piezo_stack_and_what_it_is_connected_to_are_those_of_another_plant(tmp_path, shunt):
    stack = {"capacitance": 1e-6, "coupling": 1e-2, "stiffness": 20.0}
    _, at = at_rest(scenes.load("two_dof", {"piezo": stack} | shunt), {})
    tables, _ = as_matrices("two_dof")
    angle = np.radians(150.0)
    path = {"row": {"x": float(np.cos(angle)), "y": float(np.sin(angle))}}
    own = at_rest(scenes.load(written(tmp_path, tables | {"piezo": stack | {"first": path}} | shunt)), {})[1]
    expected, computed = at.eigenvalues(), own.eigenvalues()
    assert len(computed) == len(expected)
    for value in expected:
        assert np.abs(computed - value).min() <= 1e-12 * np.abs(expected).max()


def test_two_contacts_on_one_node_share_its_motion(tmp_path):
    """Two springs of half the stiffness are one contact."""
    pad = THREE["contacts"]["pad"]
    halves = {name: pad | {"spring": 75.0} for name in ("one", "other")}
    single, double = (
        scenes.load(written(tmp_path, THREE | {"contacts": contacts})) for contacts in ({"pad": pad}, halves)
    )
    assert len(double.assemble().patches) == 1
    for left, right in zip(rig.modes(single).sliding.modes, rig.modes(double).sliding.modes):
        assert left.growth == pytest.approx(right.growth, rel=1e-9)
        assert left.frequency == pytest.approx(right.frequency, rel=1e-12)


def test_a_structure_that_nothing_holds_says_so(tmp_path):
    parts = {
        "M": THREE["structure"]["parts"]["M"],
        "K": {"of": "stiffness", "values": np.diag([0.0, 1.0, 1.0]).tolist()},
    }
    free = THREE | {"structure": THREE["structure"] | {"parts": parts}}
    scene = scenes.load(written(tmp_path, free))
    assert "no spring holds x" in rig.modes(scene).text()
    with pytest.raises(SceneError, match="no spring holds x, so forces there find no balance"):
        rig.simulate(scene, 0.01)
    parts["K"] = {"of": "stiffness", "values": np.diag([1.0, 0.0, 1.0]).tolist()}
    pulled = free | {"structure": free["structure"] | {"parts": parts, "film": True}}
    assert rig.simulate(scenes.load(written(tmp_path, pulled)), 0.01).signals["contact_fraction"].all()
    pulled["load"] = {"force": 20.0, "at": {"top": {"row": {"y": 1.0}}}}
    with pytest.raises(SceneError, match="no contact presses, and no spring holds y, so forces there find no balance"):
        rig.simulate(scenes.load(written(tmp_path, pulled)), 0.01)
    run = rig.simulate(scenes.load(written(tmp_path, pulled | {"clock": {"unstable": "run"}})), 0.01)
    assert statistics.contact(run) == "no point closes"


def test_ranges_of_a_training_are_read_and_values_outside_are_named(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_MODELS", str(tmp_path / "models"))
    parts = {}
    for source in brake_fe.SOURCES:
        times = f"1/{source.key}" if source.power < 0 else f"{source.key}^{source.power}"
        part = {"of": source.of, "file": str(source.file), "stored": source.stored, "factor": source.factor}
        parts[source.name] = part | ({"times": times} if source.key else {})
    tables = {
        "structure": {"units": "mm-t-s", "parts": parts},
        "factors": {"friction": 1.5},
        "reduction": {
            "kind": "snapshots",
            "over": {"drive.speed": [6.0, "25 rad/s"], "factors.friction": [0, 3]},
            "up_to": "700 Hz",
            "vectors": 80,
            "error": 1e-3,
        },
        "drive": {"speed": "12.566370614359172 rad/s", "axis": "z"},
    }
    scene = scenes.load(written(tmp_path, tables))
    modes = rig.modes(scene)
    known = -6.27347 + 3337.3213j  # hardly changed by friction
    near = min(modes.sliding.modes, key=lambda mode: abs(complex(mode.growth, 2 * np.pi * mode.frequency) - known))
    assert 2 * np.pi * near.frequency == pytest.approx(known.imag, rel=1e-2)
    assert near.error is not None
    assert modes.notes == ()
    sentence = "factors.friction = 4 lies outside of the range that the basis was trained for, 0 to 3"
    assert sentence in rig.modes(scene.with_values({"factors.friction": 4.0})).text()
    along = sweep(scene, Axis.parse("factors.friction=2:4:3", scene))
    assert [bool(outside) for outside in along.outside] == [False, False, True]
    assert along.outside[2] == sentence
    lines = along.text().splitlines()
    assert f"  warning: {sentence}" in lines
    assert [line.endswith("outside of the trained range") for line in lines[-3:]] == [False, False, True]
    assert np.nanmax(along.errors[2]) > np.nanmax(along.errors[0])
    lightly = np.isfinite(along.growth) & (along.frequency > 0.0)
    assert (
        along.growth[lightly] > -0.5 * 2.0 * np.pi * along.frequency[lightly]
    ).all()  # the reduction holds for these
    study = rig.study(scene, {"factors.friction": [2.0, 4.0]}, "modes.growth", out=tmp_path / "studies", workers=1)
    assert study.names == ["modes.growth", "modes.error", "modes.outside"]
    worst = np.nanmax(along.errors, axis=1)
    assert study.values == pytest.approx(np.array([along.largest, worst, [0, 0, 1]])[:, ::2].T, rel=1e-6)
    assert "warning: 1 of 2 points lie outside of the trained range" in study.text()
    assert study.csv().splitlines()[2].split(",")[-2] == "1"
    assert study.to_xarray()["modes.error"].values == pytest.approx(worst[::2], rel=1e-6)


def test_points_that_would_have_to_pull_are_named_before_a_run(tmp_path):
    contacts = {
        "pad": THREE["contacts"]["pad"],
        "edge": {"gap": {"u": -1.0}, "along": {"y": 1.0}, "spring": 50.0},
    }
    scene = scenes.load(written(tmp_path, THREE | {"contacts": contacts}))
    finding = next(f for f in rig.modes(scene).findings if "do not press" in f.what)
    assert finding.level == "warning"
    assert "1 of 2 contact points do not press at steady sliding: edge (" in finding.what


DOCS = Path(__file__).parents[2] / "docs"
FE = {
    "structure": {"units": "m-kg-s", "format": "calculix", "job": "./disc_matrices", "nodes": "./disc.inp"},
    "reduction": {"modes": 20, "up_to": "3 kHz"},
    "damping": {"ratio": 0.002, "at": "3 kHz"},
    "contacts": {
        f"pad_{side}": {
            "slave": {"set": f"PAD_{side.upper()}"},
            "master": {"set": f"DISC_{side.upper()}"},
            "normal": "z",
            "points": [1, 1],
            "stiffness": "1e11 N/m^3",
        }
        for side in ("up", "down")
    },
    "drive": {"speed": "5 rad/s", "axis": "z"},
    "load": {
        "force": "1 kN",
        "at": {"up": {"set": "BACK_UP", "direction": "-z"}, "down": {"set": "BACK_DOWN", "direction": "z"}},
    },
    "friction": {"law": "constant", "mu": 0.3},
    "outputs": {"pad": {"set": "BACK_UP", "direction": "z"}},
    "start": {"velocity": "1 mm/s"},
}


def test_a_job_of_calculix_with_contacts_slides_and_states_its_errors(disc):
    scene = scenes.load(written(disc, FE))
    modes = rig.modes(scene)
    assert modes.sliding.exists
    assert modes.sliding.equilibrium["normal_force_pad_up"] == pytest.approx(1000.0, rel=3e-2)
    assert max(mode.frequency for mode in modes.sliding.modes) <= 3000.0
    errors = [mode.error for mode in modes.sliding.modes if mode.frequency]
    assert all(error is not None and error < 1e-4 for error in errors)
    assert "  damping    error  " in modes.text()
    files = len(list((disc / "models").iterdir()))
    for mu in (0.0, 0.6):  # the basis holds for every friction
        rig.modes(scene.with_values({"friction.mu": mu, "drive.speed": 1.0, "load.force": 10.0}))
    assert len(list((disc / "models").iterdir())) == files


def test_one_key_moves_the_stiffness_of_several_contacts(disc):
    up, down = (FE["contacts"][f"pad_{side}"] for side in ("up", "down"))
    shared = {key: value for key, value in down.items() if key != "stiffness"} | {"stiffness_of": "pad_up"}
    one = scenes.load(written(disc, FE | {"contacts": {"pad_up": up, "pad_down": shared}}, "shared"))
    two = scenes.load(written(disc, FE)).with_values(
        {f"contacts.pad_{side}.stiffness": 3e10 for side in ("up", "down")}
    )
    along = sweep(one, Axis.parse("contacts.pad_up.stiffness=1e10:3e10:2", one))
    rates = along.rates[-1][np.isfinite(along.rates[-1])]
    for mode in rig.modes(two).sliding.modes:
        rate = complex(mode.growth, 2 * np.pi * mode.frequency)
        assert np.abs(rates - rate).min() <= 1e-9 * abs(rate)
    for other, fault in (("pad", "no such contact has a stiffness of its own; known: pad_up"), ("pad_up", "")):
        tables = {"pad_up": up, "pad_down": shared | {"stiffness_of": other} | ({} if fault else {"shear": 1.0})}
        with pytest.raises(SceneError, match=fault or "does not belong beside stiffness_of"):
            scenes.load(written(disc, FE | {"contacts": tables}, "shared"))


def connected(nodes):
    """The number of bodies."""
    ends = nodes.faces.ravel(), np.roll(nodes.faces, 1, axis=1).ravel()
    return csgraph.connected_components(
        sp.csr_array((np.ones(nodes.faces.size), ends), shape=(len(nodes.xyz),) * 2), False
    )[0]


def test_mode_shapes_move_on_the_faces_of_the_mesh(disc, tmp_path, monkeypatch):
    modes = rig.modes(scenes.load(written(disc, FE)))
    shape = mode_shapes.shapes(modes, 1)[0]
    assert np.abs(shape.moved).max() == pytest.approx(1.0)
    far = modes.nodes.xyz[np.abs(shape.moved).max(axis=1).argmax()]
    assert np.hypot(*far[:2]) > 0.06  # on a pad or the rim, not at the clamped bore
    for suffix in mode_shapes.SUFFIXES:
        mode_shapes.write(modes, tmp_path / f"shapes{suffix}")
        assert (tmp_path / f"shapes{suffix}").stat().st_size > 10_000
    monkeypatch.setattr(of_matrices, "DRAWN", 300)
    whole, thinned = modes.nodes, scenes.load(written(disc, FE)).assemble().nodes()
    assert np.hypot(*whole.xyz[:, :2].T).min() == pytest.approx(0.060)  # the bore is held, and is seen
    assert whole.rows[np.hypot(*whole.xyz[:, :2].T) < 0.061].max() == 0.0
    assert 100 < len(thinned.xyz) <= 300 < len(whole.xyz)
    for nodes in (whole, thinned):
        sides = nodes.xyz[np.roll(nodes.faces, -1, axis=1)] - nodes.xyz[nodes.faces]
        assert np.linalg.norm(sides, axis=2).max() < (0.02 if nodes is whole else 0.06)
        assert set(nodes.faces.ravel()) == set(range(len(nodes.xyz)))
    there, kept = ({*map(bytes, np.column_stack([n.xyz, n.rows.reshape(len(n.xyz), -1)]))} for n in (whole, thinned))
    assert kept <= there
    assert connected(thinned) == connected(whole) == 3  # nodes of a pad and of the disc lie at one place
    cloud = replace(modes, nodes=whole._replace(faces=whole.faces[:0]))
    assert [len(modes_figure(of).findobj(Poly3DCollection)) for of in (modes, cloud)] == [4, 0]
    with pytest.raises(UsageError, match="three has no nodes"):
        mode_shapes.write(rig.modes(scenes.load(written(disc, THREE, "three"))), tmp_path / "other.gif")


def test_a_recording_is_verified_without_the_files_and_the_store(disc, tmp_path, monkeypatch):
    short = FE | {"protocol": [{"step": "hold", "time": "5 ms"}], "reduction": {"modes": 6, "up_to": "1 kHz"}}
    scene, log = scenes.load(written(disc, short, "short")), tmp_path / "run.mcap"
    rig.simulate(scene).save(log)
    away = disc.with_name("away")
    disc.rename(away)
    monkeypatch.setenv("RIG_MODELS", str(tmp_path / "models"))
    model_store.OFFERED.clear()
    try:
        assert verify(log).passed
    finally:
        away.rename(disc)


def test_a_table_without_which_the_basis_is_another_one_is_not_judged_by_states_on_it(disc):
    """The attachment vectors of its places belong to the basis: without the load q1 would be another motion."""
    of_files = rig.simulate(scenes.load(written(disc, FE, "judged")), 0.001)
    typed = rig.simulate("structure", 0.001)
    for run, judged in ((of_files, False), (typed, True)):
        assert ("load" in {line["effect"] for line in run.summary["audit"]}) == judged


def test_faults_of_files_and_nodes_are_reported_together(disc):
    (disc / "half.mtx").write_text("%%MatrixMarket matrix coordinate real general\n14148 14148 1\n1 2 5.0\n")
    wrong = FE | {
        "structure": FE["structure"] | {"parts": {"half": {"of": "stiffness", "file": "./half.mtx"}}},
        "outputs": {"pad": {"set": "BACKUP", "direction": "z"}, "far": {"node": 99999, "direction": "z"}},
        "contacts": {"pad_up": FE["contacts"]["pad_up"] | {"slave": {"set": "PADUP"}}},
    }
    with pytest.raises(SceneError) as error:
        scenes.load(written(disc, wrong, "wrong"))
    lines = "\n".join(error.value.faults)
    for line in (
        "half.mtx (half): has entries in its upper triangle only",
        "contacts.pad_up: slave: the mesh has no node set 'PADUP'; it has: PAD_UP",
        "outputs.pad: the mesh has no node set 'BACKUP'; it has: BACK_UP",
        "outputs.far: the mesh has no node 99999",
    ):
        assert line in lines
    with pytest.raises(SceneError, match=r'begin the path with "\./"'):
        scenes.load(written(disc, FE | {"structure": FE["structure"] | {"job": "disc_matrices"}}, "wrong"))


MANY = FE | {
    "contacts": {name: contact | {"points": [3, 4]} for name, contact in FE["contacts"].items()},
    "reduction": {"modes": 40, "contact": "open", "residual": "spring", "error": 1.0},
    "drive": {"speed": "0.5 rad/s", "axis": "z"},
    "clock": {"rk4_step": "0.5 us"},
}


def test_many_contacts_run_as_a_film_with_outputs_of_each_point(disc, tmp_path):
    scene = scenes.load(written(disc, MANY | {"protocol": [{"step": "hold", "time": "20 ms"}]}, "film"))
    film = scene.assemble().film
    assert film.points == 24
    modes = rig.modes(scene)
    assert not [finding.what for finding in modes.findings if "do not press" in finding.what]
    tables = modes.sliding.equilibrium
    run, log = rig.simulate(scene), tmp_path / "run.mcap"
    points = [f"{pad}_{i}" for pad in ("pad_up", "pad_down") for i in range(1, 13)]
    forces = np.array([run.signals[f"normal_force_of_{point}"] for point in points])
    states = np.array([run.signals[f"state_of_{point}"] for point in points])
    assert np.array_equal(states == 0.0, forces == 0.0)
    assert set(np.unique(states)) == {0.0, 1.0, 2.0}
    assert run.signals["normal_force"] == pytest.approx(forces.sum(axis=0), rel=1e-12)
    assert run.signals["contact_fraction"] == pytest.approx((forces > 0.0).mean(axis=0), rel=1e-12)
    pressed = np.array([tables[f"normal_force_of_{point}"] for point in points])
    assert forces[:, 0] == pytest.approx(pressed, rel=1e-6)
    assert abs(run.energy["error"]) < 1e-5
    assert run.signals["openings"][-1] > 100
    run.save(log)
    assert verify(log).passed


def three(folder, contacts, step=None, **tables):
    """The scene of three masses, unsymmetric in damping and stiffness; its contacts are a film with this step."""
    film = {"structure": THREE["structure"] | {"film": step is not None}, "knock": {"at": "body"}}
    clock = {"clock": {"rk4_step": step}} if step else {}
    return scenes.load(written(folder, THREE | {"contacts": contacts} | film | clock | tables))


def pads(folder, points, step, **tables):
    """The scene of a disc with two pads on points of a film, with two sensors."""
    contacts = {name: contact | {"points": points} for name, contact in FE["contacts"].items()}
    sensors = {
        "laser": {"kind": "laser_vibrometer", "reads": "pad_velocity", "rate": "50 kHz"},
        "force": {"kind": "normal_force", "reads": "normal_force_pad_up", "rate": "10 kHz"},
    }
    film = {"structure": FE["structure"] | {"film": step is not None}, "clock": {"rk4_step": step or "1 us"}}
    return scenes.load(written(folder, MANY | film | {"contacts": contacts, "sensors": sensors} | tables, "pads"))


@pytest.mark.parametrize(("speed", "openings"), [(2.0, 0), (3.0, 2)])
def test_a_film_of_one_point_moves_like_an_exact_contact(tmp_path, speed, openings):
    changes = {"drive": {"speed": speed}, "start": {"velocity": speed}}
    exact, film = (rig.simulate(three(tmp_path, THREE["contacts"], step, **changes), 1.0) for step in (None, "25 us"))
    assert [event["text"] for event in exact.events] == ["pad opens", "pad closes"] * openings
    assert film.signals["openings"][-1] == openings
    for name in ("body_displacement", "body_velocity", "normal_force"):
        assert film.signals[name] == pytest.approx(exact.signals[name], abs=1e-6 * np.abs(exact.signals[name]).max())


def test_a_sensor_reads_the_speed_of_the_surface_past_the_structure_at_a_stuck_point(tmp_path):
    """Its shear spring yields: f' = k_t (V - t . v) while the slip speed is zero."""
    along = {"body": {"row": {"x": 1.0}}}
    contacts = {"pad": THREE["contacts"]["pad"] | {"shear": 150.0}}
    changes = {"drive": {"speed": 0.07}, "start": {"velocity": 0.3}, "outputs": along}
    past = {"past": {"kind": "laser_vibrometer", "reads": "relative_speed_of_pad", "rate": 1000.0}}
    assert "relative_speed_of_pad" not in three(tmp_path, contacts, "25 us", **changes).assemble().outputs
    run = rig.simulate(three(tmp_path, contacts, "25 us", sensors=past, **changes), 2.0)
    stuck = run.signals["state_of_pad"] == 1.0
    assert stuck.sum() > 10
    assert np.all(run.signals["slip_speed_of_pad"][stuck] == pytest.approx(0.0, abs=1e-9))
    relative = run.signals["relative_speed_of_pad"]
    assert relative == pytest.approx(0.07 - run.signals["body_velocity"], abs=1e-15)
    inside = stuck[:-1] & stuck[1:]
    yielded = np.diff(run.signals["friction_force"])[inside]
    passed = 0.5 * (relative[1:] + relative[:-1])[inside] * np.diff(run.time)[inside]
    assert yielded == pytest.approx(150.0 * passed, abs=1e-3 * np.abs(yielded).max())


def test_a_structure_starts_in_steady_sliding_under_a_law_that_its_load_warms(tmp_path):
    warm = {"law": "contact_temperature", "mu_cold": 0.3, "mu_hot": 0.15, "temperature_scale": "20 K"}
    warm |= {"capacity": "0.05 J/K", "cooling": "0.05 W/K"}
    scene = three(tmp_path, THREE_PADS, friction=warm, start={"at": "sliding"})
    system = scene.assemble().system()
    assert system.start[:3] == pytest.approx(steady(system, sliding_key(system)).x[:3], rel=1e-9)


THREE_PADS = THREE["contacts"] | {
    "edge": {"gap": {"y": 1.0, "u": -0.6}, "along": {"x": 1.0, "u": 0.2}, "spring": 200.0},
    "rim": {"gap": {"y": 0.7, "x": 0.2}, "along": {"x": 0.8, "u": -0.3}, "spring": 100.0},
}


@pytest.mark.parametrize(
    ("count", "turn", "film"), [(5, 0.1, False), (6, 0.1, True), (12, 0.0, False), (13, 0.0, True)]
)
def test_contacts_with_many_mode_sets_are_a_film_unless_told_otherwise(tmp_path, count, turn, film):
    """Contacts along one row (turn 0) have one friction force. A run would meet new mode sets all the time."""
    pad = THREE["contacts"]["pad"]
    tables = THREE | {"contacts": {f"pad_{i}": pad | {"along": {"x": 1.0, "u": i * turn}} for i in range(count)}}
    assert (scenes.load(written(tmp_path, tables)).assemble().film is not None) == film
    exact = scenes.load(written(tmp_path, tables | {"structure": THREE["structure"] | {"film": False}}))
    assert any("may be slow" in finding.what for finding in findings(exact)) == film


def test_contacts_have_laws_of_their_own_in_a_film_like_exact_contacts(tmp_path):
    """Against the rows of the matrices too: each closed point adds k (n + mu t) n^T with its own mu at its speed."""
    falling = {"law": "stribeck", "mu_static": 0.5, "mu_dynamic": 0.3, "speed_scale": 0.4}
    pads = THREE_PADS | {"edge": THREE_PADS["edge"] | {"friction": falling}}
    exact, film = (three(tmp_path, pads, step, start={"velocity": 1e-3}) for step in (None, "25 us"))
    n, t = (
        np.array([[*(pad[row].get(name, 0.0) for name in "xyu")] for pad in pads.values()]) for row in ("gap", "along")
    )
    mu, k = np.array([0.3, 0.3 + 0.2 * np.exp(-0.5 / 0.4), 0.3]), np.array([pad["spring"] for pad in pads.values()])
    for scene in (exact, film):
        system = scene.assemble().system()
        stiffness = system.stiffness + (k[:, None] * (n + mu[:, None] * t)).T @ n
        at = np.linalg.solve(stiffness, [0.0, -20.0, 0.0])
        tables = rig.modes(scene).sliding.equilibrium
        pressed = [tables["normal_force_pad"], tables["normal_force_edge"], tables["normal_force_rim"]]
        assert pressed == pytest.approx(-k * (n @ at), rel=1e-9)
        assert tables["friction_force"] == pytest.approx(mu @ pressed, rel=1e-9)
        told = {effect.name: effect.about for effect in explain(scene).effects}
        assert "law stribeck" in told["friction at edge"]
        assert "law constant" in told["friction at rim"]
    runs = [rig.simulate(scene, 0.2) for scene in (exact, film)]
    assert all((runs[1].signals[f"state_of_{pad}"] == 2.0).all() for pad in pads)
    for name in ("body_velocity", "normal_force", "friction_force"):
        v = runs[0].signals[name]
        assert runs[1].signals[name] == pytest.approx(v, abs=1e-3 * np.abs(v).max())


def test_eigenvalues_of_contacts_with_laws_of_their_own_are_those_of_the_full_matrices(disc):
    """The estimate uses the full matrices: with one coefficient for both pads it would tell errors of the growth."""
    pads = {name: contact | {"points": [2, 2]} for name, contact in FE["contacts"].items()}
    own = pads | {"pad_up": pads["pad_up"] | {"friction": {"law": "constant", "mu": 0.6}}}
    scene = scenes.load(written(disc, FE | {"contacts": own}, "own"))
    errors = [rig.modes(scene.with_values({"contacts.pad_up.friction.mu": mu})).sliding for mu in (0.6, 0.3)]
    assert all(max(mode.error for mode in at.modes if mode.frequency < 3000.0) < 1e-4 for at in errors)
    same = rig.modes(scenes.load(written(disc, FE | {"contacts": pads}, "same"))).sliding.modes
    assert [m.growth for m in errors[1].modes] == pytest.approx([m.growth for m in same], rel=1e-9)
    assert errors[0].modes[0].growth > 1.1 * same[0].growth > 50.0


def test_damping_of_points_is_that_of_the_matrices(tmp_path):
    """Each closed point adds d (n + mu t) n^T to D: eigenvalues, and the motion of a run by the matrix exponential."""
    from scipy.linalg import expm

    dampers = (2.0, 0.0, 0.5)
    pads = {name: pad | {"damper": d} for (name, pad), d in zip(THREE_PADS.items(), dampers)}
    scene = three(tmp_path, pads, "25 us", start={"velocity": 1e-3})
    n, t = (
        np.array([[*(pad[row].get(name, 0.0) for name in "xyu")] for pad in pads.values()]) for row in ("gap", "along")
    )
    system, rows = scene.assemble().system(), n + 0.3 * t
    springs = np.array([pad["spring"] for pad in pads.values()])
    K = system.stiffness + (springs[:, None] * rows).T @ n
    D = system.damping + (np.array(dampers)[:, None] * rows).T @ n
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(system.mass, np.hstack([K, D]))]])
    rates = np.linalg.eigvals(A)
    rates = rates[rates.imag > 0.0]
    modes = rig.modes(scene).sliding.modes
    assert sorted(m.growth for m in modes) == pytest.approx(sorted(rates.real), rel=1e-9)
    assert sorted(m.frequency for m in modes) == pytest.approx(sorted(rates.imag / (2.0 * np.pi)), rel=1e-9)
    assert min(abs(rates.real)) > 1.5 * min(
        abs(m.growth) for m in rig.modes(three(tmp_path, THREE_PADS, "25 us")).sliding.modes
    )
    run = rig.simulate(scene, 1.0)
    assert (run.signals["state_of_pad"] == 2.0).all()
    v = np.zeros(6)
    v[5] = 1e-3
    step, expected = expm(A * (run.time[1] - run.time[0])), []
    for _ in run.time:
        expected.append(v[5])
        v = step @ v
    assert run.signals["body_velocity"] == pytest.approx(expected, abs=1e-3 * 1e-3)
    assert abs(run.energy["error"]) < 1e-3 * run.energy["friction"]


def test_only_points_of_a_film_have_damping(tmp_path):
    rigid = three(tmp_path, {"pad": THREE["contacts"]["pad"] | {"damper": 1e9}}, "25 us")
    with pytest.raises(SceneError, match="less stiffness or damping of the points: no rk4_step of 1e-08 s or more"):
        rig.simulate(rigid, 0.01)
    damped = THREE["contacts"]["pad"] | {"damper": 2.0}
    for tables, what in (
        ({"contacts": {"pad": damped}, "structure": THREE["structure"] | {"film": False}}, "make them a film"),
        ({"contacts": {"pad": damped | {"opens": False}}}, "contacts.pad.opens: points of a film open"),
        (
            {"contacts": {"pad": THREE["contacts"]["pad"] | {"damping": 2.0}}},
            "contacts.pad.damping = 2.0: does not belong",
        ),
        (
            {
                "contacts": {
                    "pad": damped,
                    "edge": {"gap": {"y": 1.0}, "along": {"x": 1.0}, "stiffness_of": "pad", "damper": 1},
                }
            },
            "contacts.edge.damper = 1.*: does not belong beside stiffness_of",
        ),
    ):
        with pytest.raises(SceneError, match=what):
            scenes.load(written(tmp_path, THREE | tables)).assemble()


def masses_in_flutter(folder, _):
    return three(folder, THREE_PADS, "200 us", factors={"soft": 20.0}, start={"velocity": 1e-8}), "body_velocity", 70.0


def pads_in_flutter(_, folder):
    turning = {"drive": FE["drive"], "start": {"velocity": 1e-9}}
    return pads(folder, [2, 2], "0.5 us", **turning), "pad_velocity", 0.18


@pytest.mark.parametrize("scene", [masses_in_flutter, pads_in_flutter])
def test_small_motions_of_a_film_grow_as_rig_modes_says(disc, tmp_path, scene):
    """Masses: gyroscopic and circulatory matrices; pads: the flexibility that free modes lack, in series."""
    scene, name, duration = scene(tmp_path, disc)
    expected = rig.modes(scene).sliding.modes[0]
    assert expected.growth > 0.1
    run = rig.simulate(scene, duration)
    assert run.signals["openings"][-1] == 0
    last = slice(2 * len(run.time) // 3, None)  # the other modes have decayed
    t, v = run.time[last], run.signals[name][last]
    weight = np.exp(-expected.growth * t[:-2])
    before = np.stack([v[1:-1], v[:-2]], axis=1) * weight[:, None]
    turn = np.roots([1.0, *-np.linalg.lstsq(before, v[2:] * weight, rcond=None)[0]])
    assert np.log(np.abs(turn[0])) / (t[1] - t[0]) == pytest.approx(expected.growth, rel=1e-3)


def masses_that_open(folder, _, finer):
    rig = {"factors": {"soft": 20.0}, "drive": {"speed": 0.2}, "start": {"velocity": 2.0}}
    return three(folder, THREE_PADS, f"{200 / finer} us", **rig)


def pads_that_open(_, folder, finer):
    return pads(folder, [3, 4], f"{1 / finer} us")


@pytest.mark.parametrize("scene", [masses_that_open, pads_that_open])
def test_the_energy_of_a_film_closes_with_the_square_of_the_step(disc, tmp_path, scene):
    """Of two tenths of a second, relative to the work of friction in each; the masses have an unsymmetric stiffness."""
    errors = []
    for finer in (1, 2):
        before, shares = np.zeros(2), []
        for tenth in (1, 2):
            run = rig.simulate(scene(tmp_path, disc, finer), 0.1 * tenth)
            largest = max(abs(value) for name, value in run.energy.items() if name != "error")
            now = np.array([run.energy["error"] * largest, run.energy["friction"]])
            shares.append(abs(np.divide(*(now - before))))
            before = now
        states = [run.signals[name] for name in run.signals if name.startswith("state_of")]
        assert set(np.unique(states)) == {0.0, 1.0, 2.0}
        errors.append(sum(shares))
    assert errors[0] < 1e-3
    assert 3.0 < errors[0] / errors[1] < 6.0


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_film_vibrates_like_itself_with_half_the_step(disc):
    """The mean of the RMS over the second half of 8 starts of 1 s: within 10 %, or within the interval of both."""
    means, variances = [], []
    for step in ("1 us", "0.5 us"):
        rms = []
        for start in range(8):
            changes = {"drive": FE["drive"], "start": {"velocity": f"{10 + start} mm/s"}}
            run = rig.simulate(pads(disc, [2, 2], step, **changes), 1.0)
            v = run.signals["pad_velocity"]
            rms.append(np.std(v[len(v) // 2 :]))
        means.append(np.mean(rms))
        variances.append(np.var(rms, ddof=1) / len(rms))
    interval = student.ppf(0.975, 7) * np.sqrt(sum(variances))
    assert abs(means[0] - means[1]) < max(0.1 * means[1], interval)
    assert interval < 0.15 * means[1]


@pytest.mark.parametrize("points", [(2, 6), (1, 2)], ids=["film", "mode sets"])
def test_contacts_of_a_mesh_are_shown_as_maps_of_their_pressure(disc, tmp_path, points):
    contacts = {name: contact | {"points": list(points)} for name, contact in FE["contacts"].items()}
    reduction = {"modes": 40, "contact": "open", "residual": "spring"}
    own = {"contacts": contacts, "knock": {"at": "pad"}, "start": {"velocity": "0.3 m/s"}, "reduction": reduction}
    scene = scenes.load(written(disc, FE | own | {"clock": {"rk4_step": "1 us"}}, "maps"))
    run = rig.simulate(scene, 0.01)
    count = points[0] * points[1]
    names = [f"{pad}_{i + 1}" for pad in ("pad_up", "pad_down") for i in range(count)]
    assert {f"{kind}_of_{name}" for kind in ("normal_force", "slip_speed") for name in names} <= run.signals.keys()
    maps = recorded.pressure(run, [0.0, 0.005])
    up, _ = maps.points.surfaces
    assert (up.name, up.axes, up.shape) == ("pad_up", ("x", "y"), (count,))
    x, y = up.corners[:, :, 0], up.corners[:, :, 1]
    cells = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1))
    assert cells.sum() == pytest.approx(up.area.sum(), rel=0.15)
    assert [shown.contact for shown in maps.maps] == ["pad_up", "pad_down"] * 2
    for shown in maps.maps:
        row = int(np.abs(run.time - shown.time).argmin())
        assert shown.force == pytest.approx(run.signals[f"normal_force_{shown.contact}"][row], rel=1e-9, abs=1e-9)
    assert any(shown.fraction < 1.0 for shown in recorded.pressure(run).maps)
    drawing = Drawing(scene.to_json(), run.units, {})
    t_ns = np.round(run.time * 1e9).astype(np.int64)
    columns = drawing.picture.frames(t_ns, run.signals, run.mode, np.arange(len(t_ns)))
    assert {"rig/contacts/map", "rig/contacts/centre", "rig/word/pad_up"} <= {entry.path for entry in columns}
    assert drawing.worded == (count == 2)
    for name, figure in (("run", run.plot()), ("maps", maps.plot())):
        put(figure, tmp_path / f"{name}.png")
        drawn = imread(tmp_path / f"{name}.png")[..., :3]
        assert (np.abs(drawn - np.array(contact.rgb(pressure.OPEN)) / 255.0).max(axis=2) < 0.01).mean() > 1e-4


def test_a_film_refuses_a_law_with_memory(tmp_path):
    asked = {"structure": THREE["structure"] | {"film": True}}
    memory = {"law": "dahl", "mu_kinetic": 0.4, "sigma0": 1e5}
    own_law = THREE | asked | {"contacts": {"pad": THREE["contacts"]["pad"] | {"friction": memory}}}
    with pytest.raises(SceneError, match="points of a film support no law with memory"):
        scenes.load(written(tmp_path, own_law)).assemble()


def test_a_shunt_that_is_switched_is_refused_beside_a_film_and_runs_without(tmp_path):
    stack = {"capacitance": 1e-6, "coupling": 1e-2, "first": {"row": {"x": 1.0}}}
    shunt = {"kind": "series", "resistance": 1e3, "inductance": 20.0, "connected": False}
    steps = [{"step": "set", "target": "shunt.connected", "to": 1.0}, {"step": "hold", "time": "10 ms"}]
    tables = THREE | {"piezo": stack, "shunt": shunt, "protocol": steps}
    path = written(tmp_path, tables | {"structure": THREE["structure"] | {"film": True}})
    with pytest.raises(
        SceneError, match=r"no switch \(shunt.connected moved in a run\).* without a film \(structure.film = false\)"
    ):
        rig.simulate(scenes.load(path))
    run = rig.simulate(scenes.load(path, {"structure.film": False}))
    assert "state_of_pad" not in run.signals
    assert run.signals["shunt_current"].any()


def test_many_contacts_are_refused_before_a_run_with_the_reason(disc):
    scene = scenes.load(written(disc, MANY | {"structure": FE["structure"] | {"film": False}}, "many"))
    with pytest.raises(SceneError, match="24 contacts that stick, slip and open one by one have"):
        rig.simulate(scene, 0.001)
    finding = next(finding for finding in rig.modes(scene).findings if "run is not possible" in finding.what)
    assert finding.level == "warning"


def test_the_disc_squeals_and_is_quiet_with_a_shunt_as_the_page_says(disc):
    page = (DOCS / "structure.md").read_text()
    squeal, quiet = (rig.modes(scenes.load(str(disc / f"disc_{name}.toml"))).sliding for name in ("squeal", "shunted"))
    growing = [mode for mode in squeal.modes if mode.growth > 0.0]
    assert [f"{mode.frequency:.1f} Hz, {mode.growth:.1f} 1/s" for mode in growing] == ["1561.1 Hz, 75.9 1/s"]
    slowest = max(quiet.modes, key=lambda mode: mode.growth)
    assert f"with {-slowest.growth:.1f} 1/s at {slowest.frequency:.0f} Hz" in page
    assert "1561.1 Hz, 75.9 1/s" in page


def test_the_squealing_disc_is_quiet_by_control_of_the_normal_force_as_the_page_says(disc):
    page = (DOCS / "structure.md").read_text()
    scene = scenes.load(str(disc / "disc_controlled.toml"))
    closed = loop(scene, "press")
    ((low, high),) = closed.gain_ranges
    assert f"decays with {-closed.growth:.1f} 1/s" in page
    assert f"gain from {low:.0f} to {high:.0f} N s/m" in page
    assert f"delay margin of {1e6 * closed.margins['delay']:.0f} us" in page
    run = rig.simulate(scene)
    v, t = run.signals["along_velocity"], run.time
    assert t[run.signals["contact_fraction"] < 1.0][-1] < 0.4
    before, after = (np.std(v[(t > begin) & (t < begin + 0.05)]) for begin in (0.25, 0.55))
    assert before == pytest.approx(0.2, rel=0.25)
    assert after < 0.005


@pytest.mark.slow
def test_a_loop_over_a_poor_link_grows_in_runs_as_computed(disc):
    """24 points: the runs begin along the mode that grows, although velocities are 1e4 times the displacements."""
    points = {f"contacts.{pad}.points": [3, 4] for pad in ("pad_up", "pad_down")}
    told = loop_report.report(scenes.load(str(disc / "disc_controlled.toml"), points), "press")
    assert told.checked is not None
    assert told.checked.growth == pytest.approx(told.computed, rel=0.05)


def test_the_numbers_of_the_page_are_those_of_its_scene(disc):
    page, text = (DOCS / "structure.md").read_text(), (DOCS / "disc_with_pads.toml").read_text()
    excerpt = page.split("[disc_with_pads.toml](disc_with_pads.toml):")[1].split("```toml\n")[1].split("```")[0]
    assert set(excerpt.strip().split("\n\n")) <= set(text.strip().split("\n\n")) | {'plant = "structure"'}
    lines = re.findall(r"^  (?:flutter|decays)(.*)$", page, re.MULTILINE)
    printed = [float(x) for line in lines for x in line.split()[:3]]
    report = rig.modes(scenes.load(str(disc / "disc_with_pads.toml")))
    modes = report.sliding.modes[:3]
    computed = [x for mode in modes for x in (mode.growth, mode.frequency, mode.damping)]
    assert printed == pytest.approx(computed, rel=1e-4)
    # The pressures at steady sliding are those of the full matrices, and all points press
    full, mesh = disc_with_pads.disc()
    stiffness, load = full.matrix("stiffness", {}), np.zeros(full.rows)
    sides = disc_with_pads.paired((4, 6))
    for side, name, down in zip(sides, ("BACK_UP", "BACK_DOWN"), (-1.0, 1.0)):
        springs = sp.diags_array(1e11 * side.area)
        stiffness = stiffness + (side.normal + 0.3 * side.along).T @ (springs @ side.normal)
        load += 1000.0 * node_vector(full, mesh.sets[name].tolist(), (0.0, 0.0, down))
    moved = splu(stiffness.tocsc()).solve(load)
    for side, name in zip(sides, ("pad_up", "pad_down")):
        forces = -1e11 * side.area * (side.normal @ moved)
        own = [report.sliding.equilibrium[f"normal_force_of_{name}_{k + 1}"] for k in range(24)]
        assert own == pytest.approx(forces, rel=1e-6)
        assert min(own) > 0.0
    assert not any("do not press" in finding.what for finding in report.findings)
