"""What docs/wire.md promises: its example takes part in a run without friction-rig, with the bits of one process."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from waiting_run import in_process, waiting_run

import rig.bus

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "wire_controller.py"


@pytest.fixture
def example(runs, tmp_path):
    """Starts the example in a folder that has the generated messages and no friction-rig."""
    shutil.copy(EXAMPLE, tmp_path)
    shutil.copy(Path(rig.bus.__file__).parent / "rig_pb2.py", tmp_path)
    without = "import sys; sys.modules['rig'] = None; import runpy; sys.argv = sys.argv[1:]; "
    started = []

    def start(run):
        code = without + "sys.path.insert(0, '.'); runpy.run_path(sys.argv[0], run_name='__main__')"
        command = [sys.executable, "-c", code, EXAMPLE.name, run]
        process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def test_the_example_has_the_bits_of_a_run_in_one_process(example):
    with waiting_run("plain") as run:
        process = example("wire")
        run.thread.join(30.0)
        assert run.summary is not None, process.communicate(timeout=5.0)
        said, _ = process.communicate(timeout=10.0)  # it notices the end of the run
        assert (process.returncode, said) == (0, "")
    here = in_process("plain")
    assert run.summary["loop"]["plain"] == here.summary["exchange"]["plain"]
    assert run.summary["loop"]["plain"]["taken"] == 300
    assert run.summary["energy"] == here.energy
    assert run.summary["refused"] == {}
