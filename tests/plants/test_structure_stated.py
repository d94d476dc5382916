"""Mass, contacts and bodies of a meshed structure, where the commands state them: modes, explain, the report."""

import json
import shutil
from pathlib import Path

import disc_with_pads
import pytest

import rig as laboratory
from rig import scenes
from rig.analysis.linear.sweep import sweep
from rig.analysis.report.page import page
from rig.plants import structure as of_matrices
from rig.scenes.axis import Axis
from rig.scenes.explain import explain

DOCS = Path(__file__).parents[2] / "docs"
MET = "24 of 24 points; 45 of 45 nodes meet; area met 0.003146 m^2 of 0.003146 m^2 offered; largest gap 0 m"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of the disc with two pads, and scenes with few modes: as it is, and with a chamfer of the upper pad."""
    folder = tmp_path_factory.mktemp("stated")
    disc_with_pads.unpacked(folder)
    shutil.copy(DOCS / "disc_with_pads.toml", folder)
    few = 'format = 1\ntitle = "a"\nbased_on = "./disc_with_pads.toml"\n[reduction]\nmodes_up_to = "none"\nmodes = 20\n'
    (folder / "disc.toml").write_text(few)
    (folder / "worn.toml").write_text(few + '[structure]\nnodes = "./worn.inp"\n[clock]\nunstable = "run"\n')
    lines = []
    for line in (folder / "disc.inp").read_text().splitlines():
        words = line.split(",")
        if words[0].isdigit() and len(words) == 4 and in_chamfer(*map(float, words)):
            line = ",".join([*words[:3], repr(float(words[3]) + 1.5e-3)])
        lines.append(line)
    (folder / "worn.inp").write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_MODELS", str(folder / "models"))
        yield folder
    of_matrices._estimator.cache_clear()  # noqa: SLF001 (factorisations of 0.2 GB)


def in_chamfer(number, x, y, z):
    """Whether a node belongs to the outer part of the face of the upper pad; nodes of the disc have lower numbers."""
    return number > 1440 and abs(z - 0.006) < 1e-9 and x * x + y * y > 0.1**2


def test_modes_state_mass_contacts_and_bodies(folder):
    modes = laboratory.modes(scenes.load(folder / "disc.toml"))
    text = modes.text()
    assert "total mass: 3.3413 kg" in text
    assert f"contact pad_up: {MET}" in text
    assert f"contact pad_down: {MET}" in text
    assert "of its slave take no part" not in text
    content = modes.to_json()
    assert content["structure"]["total_mass"] == pytest.approx(3.3413, rel=1e-5)
    assert content["structure"]["contacts"]["pad_up"]["pairs"] == 45
    json.dumps(content)
    assert "q1" not in text
    first = content["modes"][0]
    assert set(first["regions"]) == {"IRON", "body of PAD_UP", "body of PAD_DOWN"}
    assert sum(first["regions"].values()) == pytest.approx(1.0, abs=1e-4)
    largest = max(first["regions"], key=first["regions"].get)
    assert first["share of the energy"].startswith(largest)


def test_critical_values_name_bodies(folder):
    scene = scenes.load(folder / "disc.toml")
    swept = sweep(scene, Axis.parse("friction.mu=0:0.1:3", scene))
    assert swept.critical
    for critical in swept.critical:
        assert set(critical.regions) == {"IRON", "body of PAD_UP", "body of PAD_DOWN"}
    assert "body of PAD_UP" in swept.text()
    assert "q1" not in swept.text()


def test_a_face_beyond_the_search_is_told_wherever_contacts_are_stated(folder, rig):
    scene = scenes.load(folder / "worn.toml")
    modes = laboratory.modes(scene)
    assert "contact pad_up: 19 of 24 points; 27 of 45 nodes meet" in modes.text()
    [warning] = [finding for finding in modes.findings if "of its slave take no part" in finding.what]
    assert warning.level == "warning"
    assert warning.what.startswith("contacts.pad_up: 0.00136 m^2")
    stated = explain(scene).stated
    assert [what for what, _ in stated.lines()] == ["total mass", "contact pad_up", "contact pad_down"]
    [(_, told)] = stated.warnings()
    assert "beyond search = 0.001 m; raise contacts.pad_up.search" in told
    code, out, _ = rig("explain", str(folder / "worn.toml"))
    assert code == 0
    out = " ".join(out.split())
    assert "27 of 45 nodes meet" in out
    assert "of its slave take no part" in out
    code, out, _ = rig("explain", str(folder / "worn.toml"), "--json")
    content = json.loads(out)["structure"]
    assert content["contacts"]["pad_up"]["pairs"] == 27
    assert content["contacts"]["pad_up"]["points"] == 19
    assert content["doubts"] == [warning.what]


def test_the_report_of_a_recording_states_them_without_the_files(folder, tmp_path):
    moved = tmp_path / "files"
    moved.mkdir()
    for file in folder.iterdir():
        if file.is_file():
            shutil.copy(file, moved)
    log = tmp_path / "run.mcap"
    laboratory.simulate(scenes.load(moved / "worn.toml"), duration=2e-3).save(log)
    shutil.rmtree(moved)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_MODELS", str(tmp_path / "none"))
        text = page(laboratory.open(log), log)
    assert "Mass and contacts" in text
    assert "27 of 45 nodes meet" in text
    assert "of its slave take no part" in text


def test_other_rigs_state_nothing():
    assert laboratory.modes("belt").stated is None
    assert "structure" not in laboratory.modes("structure").to_json()
    assert explain(scenes.load("structure")).stated is None


def test_pictures_of_shapes_name_the_body_that_moves_most(folder, tmp_path):
    modes = laboratory.modes(scenes.load(folder / "disc.toml"))
    figure = modes.plot()
    figure.savefig(tmp_path / "modes.png")  # the rules of figures: no text overlaps another
    first = modes.sliding.modes[0]
    [title] = [axes.get_title() for axes in figure.axes if axes.get_title().startswith(f"{first.frequency:.5g} Hz")]
    region = next(iter(first.regions))
    assert title.endswith(f"\n{region} {100.0 * first.regions[region]:.2g} % of the energy")
