"""Compiled code: where it is kept, what a start says about it."""

import os
import pickle
import re
import shutil
import subprocess
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock

from rig.compiled import kernel, kernel_store
from rig.compiled.kernel_store import CheckedFile
from rig.solve.specialised import UNFILLED, KernelShape, has_products, local, local_square, state_count

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


@kernel.inner
def product_of_row(shape, rows, vector):
    """The product of the first row with a vector, if there are products."""
    total = 0.0
    if has_products(shape):
        for i in range(state_count(shape)):
            total += rows[0, i] * vector[0, i]
    return total


def power_of_rows(shape, rows, count):
    """The sum of a row of rows^count, which calls for each kind of constant that a shape has."""
    vectors, square = local(shape, rows), local_square(shape, rows)
    for i in range(state_count(shape)):
        vectors[0, i] = 1.0
        for j in range(state_count(shape)):
            square[i, j] = rows[i, j]
    for _ in range(count):
        for i in range(state_count(shape)):
            vectors[1, i] = 0.0
            for j in range(state_count(shape)):
                vectors[1, i] += square[i, j] * vectors[0, j]
        for i in range(state_count(shape)):
            vectors[0, i] = vectors[1, i]
    return np.int64(product_of_row(shape, rows, vectors))


SQUARE = types.Array(types.float64, 2, "C")


def compiled_for(function, shape):
    """A kernel compiled for a shape."""
    kinds = shape, SQUARE, types.int64
    function.compile(kinds)
    return function.overloads[kinds]


def machine_code(library, name):
    """The machine code of a kernel as text, without the numbers in names, which count compilations."""
    assert library.get_pointer_to_function(name)
    names: dict[str, str] = {}
    return re.sub(r"_ZN[\w.$]+", lambda found: names.setdefault(found[0], f"name{len(names)}"), library.get_asm_str())


@pytest.mark.parametrize(("states", "products"), [(1, True), (3, True), (3, False), (8, True)])
def test_constants_filled_in_give_the_machine_code_that_numba_makes_for_them(states, products, monkeypatch):
    monkeypatch.setattr(kernel.FOLDER, "keep", lambda *_: None)  # both have one name: the second would be loaded
    shape = KernelShape(states, products, nonlinear=False)
    codes = []
    for decorator in (kernel.by_address, kernel.inner):
        made = compiled_for(decorator(power_of_rows), shape)
        codes.append(machine_code(made.library, made.fndesc.llvm_func_name))
    assert codes[0] == codes[1]
    assert "name0:" in codes[0]


def test_a_stored_kernel_without_its_constants_gives_the_same_machine_code(monkeypatch):
    monkeypatch.setattr(kernel.FOLDER, "keep", lambda *_: None)
    function, shape = kernel.by_address(power_of_rows), KernelShape(4, products=True, nonlinear=True)
    name = compiled_for(function, shape).fndesc.llvm_func_name
    fresh = compiled_for(function, UNFILLED).library
    stored = fresh.codegen.unserialize_library(pickle.loads(pickle.dumps(fresh.serialize_using_object_code())))
    with global_compiler_lock:
        codes = [machine_code(library.filled(shape), name) for library in (fresh, stored)]
    assert codes[0] == codes[1]
