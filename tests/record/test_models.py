"""The reduced model of a structure travels with the recording: the run comes out the same where none can be built."""

import sys

import numpy as np
import pytest

import rig
from rig.bench.again.verify import verify
from rig.plants import plate
from rig.plants.structures import plate_model
from rig.plants.structures.plate_surface import Surface
from rig.record import reader
from rig.record.provenance import provenance
from rig.record.save_run import save
from rig.scenes.scene import Scene
from rig.structure import model_store

SECONDS = 0.01


@pytest.fixture
def forget(monkeypatch):
    """Takes all models from the memory of this process."""

    def take():
        monkeypatch.setattr(model_store, "OFFERED", type(model_store.OFFERED)())
        monkeypatch.setattr(plate, "reduced_model", model_store.cached(plate_model.build))

    return take


@pytest.fixture
def bare(monkeypatch, tmp_path, forget):
    """A machine that has no model and cannot build one."""

    def take():
        monkeypatch.setenv("RIG_MODELS", str(tmp_path / "none"))
        forget()
        monkeypatch.setitem(sys.modules, "skfem", None)

    return take


@pytest.fixture(scope="module")
def run():
    found = rig.simulate("plate", SECONDS)
    found.provenance = provenance(1)
    return found


@pytest.fixture
def log(run, tmp_path):
    save(run, tmp_path / "plate.mcap")
    return tmp_path / "plate.mcap"


def test_the_scene_of_a_run_names_the_model_and_the_recording_holds_it(run, log):
    [digest] = Scene.from_json(run.scene).models.values()
    [model] = reader.open(log).models
    assert model_store.digest(model) == digest
    assert run.models == (model,)


def test_a_run_is_simulated_again_where_no_model_can_be_built(log, bare):
    bare()
    with pytest.raises(ImportError):
        rig.load("plate").assemble()
    found = verify(log)
    assert found.passed
    assert found.identical
    assert Scene.from_json(rig.open(log).scene).assemble().film is not None


def test_a_model_that_was_rounded_elsewhere_is_the_one_that_counts(run, tmp_path):
    ours = Surface.from_bytes(run.models[0])
    shapes = ours.shapes * (1.0 + 1e-13 * np.cos(np.arange(ours.shapes.size)).reshape(ours.shapes.shape))
    theirs = Surface(ours.frequencies, ours.x, ours.y, shapes, ours.compliance, ours.residual).to_bytes()
    [of] = Scene.from_json(run.scene).models
    model_store.offer(theirs)
    other = rig.simulate(rig.load("plate").made_with({of: theirs}), SECONDS)
    assert other.signals["plate_velocity"].tobytes() != run.signals["plate_velocity"].tobytes()
    other.provenance = provenance(1)
    save(other, tmp_path / "other.mcap")
    assert verify(tmp_path / "other.mcap").identical
    fresh = rig.simulate("plate", SECONDS)  # another scene is none the wiser
    assert fresh.signals["plate_velocity"].tobytes() == run.signals["plate_velocity"].tobytes()
