"""Compiled code: where it is kept, what a start says about it."""

import os
import pickle
import shutil
import subprocess
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rig.compiled import kernel, kernel_store
from rig.compiled.kernel_store import CheckedFile

CODE = """
from rig.compiled.kernel import kernel

@kernel
def twice(x):
    return 2 * x

print(twice({}))
"""
TOLD = "compiling kernels, once for each kind of rig\n"


def run(folder, values="1.0", **environment):
    source, code = folder / "made.py", CODE.format(values)
    if not source.exists() or source.read_text() != code:  # a new time of modification would recompile it
        source.write_text(code)
    path = os.pathsep.join([str(folder), *sys.path])
    for note in Path(environment.get("RIG_KERNELS", folder)).rglob("seconds"):
        note.unlink()  # of a compilation of some seconds, on a busy machine: the next message would state it
    return subprocess.run(
        [sys.executable, "-m", "made"],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": path, "RIG_OWN_PROCESS": "1", "PYTHONDONTWRITEBYTECODE": "1", **environment},
    )


def test_compiling_is_told_once_and_only_when_it_happens(tmp_path):
    kept = str(tmp_path / "kept")
    cold, warm = run(tmp_path, "1.0), twice(1", RIG_KERNELS=kept), run(tmp_path, "1.0), twice(1", RIG_KERNELS=kept)
    assert (cold.stdout, cold.stderr) == ("2.0 2\n", TOLD)
    assert (warm.stdout, warm.stderr) == ("2.0 2\n", "")


READ_ONLY = """
import os, sys

def refuse(event, arguments):
    writes = event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
    writes = writes or event in ("os.utime", "os.mkdir", "os.rename", "os.remove")
    if writes and str(arguments[0]).startswith({!r}):
        raise PermissionError(30, "Read-only file system")

sys.addaudithook(refuse)
"""


def test_kernels_in_a_place_that_cannot_be_written_are_loaded(tmp_path):
    """A user without rights, on a disk that is shared: nothing is compiled, nothing written; a new kernel is told."""
    kept = tmp_path / "kept"
    assert run(tmp_path, RIG_KERNELS=str(kept)).stderr == TOLD
    before = {path for path in kept.rglob("*") if path.name != "seconds"}  # `run` removes it
    assert any(path.suffix == ".nbc" for path in before)
    (tmp_path / "sitecustomize.py").write_text(READ_ONLY.format(str(kept)))
    found = run(tmp_path, RIG_KERNELS=str(kept))
    assert (found.stdout, found.stderr) == ("2.0\n", "")
    found = run(tmp_path, "1.0), twice(1", RIG_KERNELS=str(kept))
    assert found.stdout == "2.0 2\n"
    assert f"at every start, because {kept} cannot be written" in found.stderr
    assert {*kept.rglob("*")} == before


def test_kernels_that_many_compile_at_once_are_all_kept(tmp_path):
    def keep(number):
        CheckedFile(str(tmp_path), "one", "stamp").save(("key", number), number)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(keep, range(40)))
    kept = CheckedFile(str(tmp_path), "one", "stamp")
    assert [kept.load(("key", number)) for number in range(40)] == list(range(40))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder with a module and its stored kernel."""
    folder = tmp_path_factory.mktemp("compiled")
    assert run(folder, RIG_KERNELS=str(folder / "kept")).stderr == TOLD
    return folder


def test_a_damaged_kernel_is_compiled_again(compiled, tmp_path):
    kept = shutil.copytree(compiled / "kept", tmp_path / "kept")
    for path in list(kept.rglob("*.nbc")):
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 4
        path.write_bytes(content)
    again, after = (run(compiled, RIG_KERNELS=str(kept)) for _ in range(2))
    assert again.returncode == 0
    assert again.stdout == after.stdout == "2.0\n"
    assert (again.stderr, after.stderr) == (TOLD, "")


class Poison:
    """Makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (self.path,)


@pytest.mark.parametrize(("what", "how", "suffix"), [("the root", 0o777, "nbi"), ("the folder", 0o775, "nbc")])
def test_a_kernel_that_another_user_can_have_written_is_never_unpickled(compiled, tmp_path, what, how, suffix):
    if how != 0o777 and os.geteuid():
        pytest.skip("only an administrator can give files to others")
    kept = shutil.copytree(compiled / "kept", tmp_path / "kept")
    for path in kept.rglob(f"*.{suffix}"):
        poison = pickle.dumps(Poison(str(tmp_path / "executed")))
        path.write_bytes(zlib.crc32(poison).to_bytes(4) + poison)
        at = {"the root": kept, "the folder": path.parent}[what]
    os.chown(at, -1, 12345 if how == 0o775 else -1)
    at.chmod(how)
    found = run(compiled, RIG_KERNELS=str(kept))
    assert found.stdout == "2.0\n", found.stderr
    assert not (tmp_path / "executed").exists()
    why = f"can be written by other users (mode {how:o})"
    assert f"{at} {why}: it is ignored; remove it or its permission, or set RIG_KERNELS" in found.stderr
    assert "compiling kernels" in found.stderr


ROOT = Path(kernel.__file__).parents[2]


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of the sources, and what gives their key."""
    tmp_path = tmp_path_factory.mktemp("checkout")
    for room in ("rig", "sensors", "controllers"):
        shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__"))

    def key():
        return kernel_store.key(tmp_path, tmp_path / "kept" / "sources.json", "0", "")

    return tmp_path, key


@pytest.mark.parametrize(
    ("file", "old", "new", "same"),
    [
        ("rig/plants/belt.py", "", "\nX = 1\n", True),
        ("rig/compiled/kernel_store.py", "LIMIT = ", "LIMIT = 2 * ", True),
        ("rig/solve/advance.py", "def advance_block(", "# prose\ndef advance_block(", True),
        ("rig/solve/advance.py", '"""The compiled', '"""A compiled', True),
        ("rig/solve/advance.py", "_FLUSH = 1e-150", "_FLUSH = 1e-140", False),
        ("rig/solve/records.py", "G_NEXT", "G_NEXT_ONE", False),
        ("rig/model/system.py", "G_NEXT", "G_NEXT_ONE", True),
        ("rig/compiled/records.py", "frombuffer", "fromstring", False),
        ("rig/compiled/kernel.py", '"nogil": True', '"nogil": False', False),
    ],
)
def test_only_what_compiled_code_depends_on_compiles_anew(checkout, file, old, new, same):
    folder, key = checkout
    before, path = key(), folder / file
    assert key() == before
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1) if old else text + new)
    try:
        assert (key() == before) == same
    finally:
        path.write_text(text)


def test_what_was_not_used_for_longest_makes_room(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_KERNELS", str(tmp_path))
    monkeypatch.setattr(kernel_store, "LIMIT", 3500)
    for age, key in enumerate(("new", "old", "older", "oldest")):
        (tmp_path / key).mkdir()
        (tmp_path / key / "kernel.nbc").write_bytes(bytes(1000))
        os.utime(tmp_path / key, (1e9 - age, 1e9 - age))
    folder = kernel_store.Folder("old")  # in use again
    folder.prune()
    assert {one.name for one in tmp_path.iterdir()} == {"old", "new", "older"}
