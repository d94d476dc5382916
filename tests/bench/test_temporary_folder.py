"""The folder for temporary files goes while a run goes on: the summary and the code of the run stay."""

import shutil

from rig import scenes
from rig.bench.live import supervise
from rig.bench.live.plant_process import warm


def test_a_run_needs_no_temporary_file_after_its_start(runs, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    scene = scenes.load("belt")
    warm(scene)

    def begun(_):
        for folder in tmp_path.iterdir():
            shutil.rmtree(folder)

    outcome = supervise.run(scene, pace=None, duration=0.1, out=runs / "run.mcap", say=lambda _: None, begun=begun)
    assert outcome.exit_code == 0, outcome.text()
    assert (outcome.summary["ticks"], outcome.summary["ended"]) == (100, "done")
    assert not [*tmp_path.iterdir()]
