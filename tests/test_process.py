"""How a process ends: at once, with its code, and with all it had to say."""

import os
import signal
import subprocess
import sys

import pytest

CODE = """
import atexit, sys, threading, time
from rig.machine.process import as_process
atexit.register(lambda: print("closed"))
class Slow:
    def __del__(self): time.sleep(60)
kept = Slow()
kept.again = kept
def main():
    threading.Thread(target=time.sleep, args=(60,)).start()
    print("done")
    {end}
as_process(main)
"""


ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


def run(end, **options):
    code = CODE.format(end=end)
    return subprocess.run(
        [sys.executable, "-c", code], text=True, timeout=20, stderr=subprocess.PIPE, env=ENVIRONMENT, **options
    )


@pytest.mark.parametrize(("end", "code"), [("return 3", 3), ("return None", 0), ("raise KeyboardInterrupt", 130)])
def test_it_leaves_at_once_with_its_code_and_its_last_words(end, code):
    found = run(end, stdout=subprocess.PIPE)
    assert (found.returncode, found.stdout, found.stderr) == (code, "done\nclosed\n", "")


def test_a_fault_is_not_hidden():
    found = run("raise ValueError('wrong')", stdout=subprocess.PIPE)
    assert found.returncode == 1
    assert found.stderr.endswith("ValueError: wrong\n")


def test_a_reader_that_has_seen_enough_is_no_fault():
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing) as closed:
        found = run("return 0", stdout=closed)
    assert (found.returncode, found.stderr) == (0, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")
def test_output_that_cannot_be_written_is_told():
    with open("/dev/full", "w") as full:
        found = run("return 0", stdout=full)
    assert found.returncode == 1
    assert found.stderr == "the output could not be written: [Errno 28] No space left on device\n"


HEARS = """
from rig.machine.process import stopping
with stopping() as stop:
    print("ready", flush=True)
    print(stop.wait({wait}))
"""


@pytest.mark.parametrize(
    ("number", "first", "heard"),
    [
        (signal.SIGTERM, "", True),
        (signal.SIGHUP, "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL)\n", True),  # also under nohup
        (signal.SIGHUP, "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n", False),  # as nohup does
    ],
)
def test_signals_to_stop_are_heard(number, first, heard):
    code = first + HEARS.format(wait=20.0 if heard else 1.0)
    process = subprocess.Popen([sys.executable, "-c", code], text=True, stdout=subprocess.PIPE)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    assert process.communicate(timeout=20)[0] == f"{heard}\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_is_told_to_end_at_its_start_clears_away(tmp_path, number):
    code = """
import signal, sys, time
from pathlib import Path
from rig.machine.process import as_process
signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever runs the tests may ignore it
def main():
    try:
        Path(sys.argv[1]).touch()
        print("begun", flush=True)
        time.sleep(30.0)
    finally:
        Path(sys.argv[1]).unlink()
as_process(main)
"""
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "file")], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    assert process.wait(10.0) == 130
    process.stdout.close()
    assert not (tmp_path / "file").exists()
