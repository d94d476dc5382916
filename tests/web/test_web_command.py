"""The command `rig web`: its address, Ctrl-C, its sudden end, and what it says without its packages."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import httpx
import psutil
import pytest
from patience import PATIENCE_S, wait_for

import rig as package
from rig import scenes
from rig.bench.live.plant_process import warm

ROOT = Path(__file__).parents[2]


def rig_web(folder, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "rig", "web", "--no-open"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        **options,
    )


@pytest.fixture
def serving(runs, tmp_path):
    """`rig web` as a process with a run of the belt that is going on."""
    warm(scenes.load("belt"))
    process = rig_web(tmp_path)
    try:
        address = re.search(r"http://\S+", process.stdout.readline())[0]
        with httpx.Client(base_url=address.partition("/?")[0], follow_redirects=True, timeout=PATIENCE_S) as http:
            http.get(address)
            body = {"scene": "belt", "changes": {"load.force": 21}, "duration": 600.0}
            assert http.post("/api/run", json=body).status_code == 200
            wait_for(lambda: http.get("/api/run").json()["phase"] == "running")
            started = psutil.Process(process.pid).children(recursive=True)
            assert len(started) == 2  # plant and recorder
            runs = tmp_path / "recordings" / "runs"
            yield SimpleNamespace(process=process, started=started, folder=runs, http=http)
    finally:
        process.kill()
        process.communicate()


def test_ctrl_c_ends_the_run_closes_the_recording_and_prints_the_summary(serving):
    serving.process.send_signal(signal.SIGINT)
    said, _ = serving.process.communicate(timeout=PATIENCE_S)
    assert serving.process.returncode == 0, said
    assert "Traceback" not in said
    assert "ending the run; press Ctrl-C again to end at once" in said
    assert "frames, " in said
    assert "rig verify recordings/runs/" in said
    assert not psutil.wait_procs(serving.started, PATIENCE_S)[1]
    (log,) = serving.folder.glob("*.mcap")
    run = package.open(log)
    assert run.time.size
    assert not run.damage
    assert run.provenance["command"] == "rig run belt -p load.force=21 --duration 600.0"


def test_a_server_that_is_killed_leaves_no_process_and_a_recording(serving):
    """Nor a view, which would stay open for ever."""
    shutil.copy(ROOT / "recordings" / "golden" / "belt.mcap", serving.folder)
    assert serving.http.post("/api/recordings/work", json={"what": "view", "name": "belt.mcap"}).status_code == 200
    wait_for(lambda: any("http://127.0.0.1:" in line for line in serving.http.get("/api/jobs").json()[0]["lines"]))
    everything = psutil.Process(serving.process.pid).children(recursive=True)
    assert len(everything) >= 4  # and the view and its viewer
    serving.process.kill()
    assert not psutil.wait_procs(everything, PATIENCE_S)[1]
    (log,) = serving.folder.glob("belt-*.mcap")
    assert package.open(log).time.size


@pytest.mark.parametrize(
    ("lacking", "extra", "command"),
    [
        ("uvicorn", "web", ("web", "--no-open")),
        ("rerun", "view", ("view", ROOT / "recordings" / "golden" / "belt.mcap")),
        ("rerun", "view", ("run", "belt", "--view", "--duration", "0.1")),
        ("cryptography", "remote", ("web", "--no-open", "--share", "127.0.0.1:8443")),
        ("cryptography", "remote", ("run", "belt", "--listen", "tls/127.0.0.1:7450", "--tickets", "operator")),
    ],
)
def test_without_its_packages_it_says_how_to_install_them(rig, monkeypatch, lacking, extra, command):
    """By the project's folder or wheel: there is no package of its name in an index."""
    for name in [name for name in sys.modules if name.partition(".")[0] == lacking or name.startswith("rig.web")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, lacking, None)
    code, _, err = rig(*command)
    assert code == 2
    assert f"needs {lacking}, which is not installed; to install it: python -m pip install -e '.[{extra}]'" in err
