"""Tests ask for behaviour: none uses a name of the rig that begins with an underscore.

ruff finds such attributes (rule SLF); what it does not look at is searched here: imports, and names in strings.
"""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted(path for path in (ROOT / "tests").rglob("*.py") if path != Path(__file__))
MODULES = "|".join(sorted({path.stem for path in (ROOT / "rig").rglob("[a-z]*.py")} | {"rig"}))
IN_TEXT = re.compile(rf"\b(?:{MODULES})\._[a-zA-Z]\w*|\bfrom rig\b[\w.]* import [^\n]*\b_[a-zA-Z]\w*")
BY_NAME = {"setattr", "getattr", "hasattr", "delattr", "object"}
"""Functions whose second argument is the name of an attribute; `object` is that of unittest.mock.patch."""


def private(name):
    return name.startswith("_") and not name.endswith("__")


def found(code):
    """(line, name) of each private name of the rig in the text of a module."""
    for node in ast.walk(ast.parse(code)):
        match node:
            case ast.ImportFrom(module=str(module), names=names) if module.split(".")[0] == "rig":
                given = [part for one in names for part in (*module.split("."), one.name)]
                yield from ((node.lineno, part) for part in given if private(part))
            case ast.Import(names=names):
                yield from ((node.lineno, one.name) for one in names if re.match(r"rig\..*\b_[a-zA-Z]", one.name))
            case ast.Call(func=ast.Attribute(attr=called) | ast.Name(id=called), args=[_, ast.Constant(str(name)), *_]):
                if called in BY_NAME and private(name):
                    yield node.lineno, name
            case ast.Constant(str(text)):
                yield from ((node.lineno, one) for one in IN_TEXT.findall(text))


def test_no_test_imports_or_replaces_a_private_name():
    told = [f"{path.relative_to(ROOT)}:{line}: {name}" for path in FILES for line, name in found(path.read_text())]
    assert len(FILES) > 200
    assert told == []


@pytest.mark.parametrize(
    "line",
    [
        "from rig.scenes import _loader",
        "from rig.scenes._loader import load",
        "from rig.scenes.loader import load, _read as read",
        "import rig.scenes._loader as loader",
        "monkeypatch.setattr(loader, '_read', None)",
        "monkeypatch.setattr('rig.scenes.loader._read', None)",
        "mock.patch.object(loader, '_read')",
        "getattr(scene, '_read')()",
        "run(f'from rig.compiled import kernel\\nkernel._rooms = {rooms}')",
        "run('from rig.scenes.loader import load, _read')",
    ],
)
def test_a_private_name_is_found(line):
    assert list(found(line))


@pytest.mark.parametrize(
    "line",
    [
        "from rig.scenes import loader as _loader",
        "from helpers import _read",
        "getattr(scene, '__name__')",
        "setattr(scene, name, '_read')",
        "run('import os; os._exit(0)')",
        "from rig.bus.rig_pb2 import Step",
    ],
)
def test_other_names_are_not_found(line):
    assert not list(found(line))


@pytest.mark.parametrize(
    ("line", "told"), [("scene._read()", True), ("self._read()", False), ("row._replace(a=1)", False)]
)
def test_ruff_finds_private_attributes_in_tests(line, told):
    command = [sys.executable, "-m", "ruff", "check", "--stdin-filename", "tests/test_it.py", "-"]
    code = f"def test_it(self, scene, row):\n    {line}\n"
    checked = subprocess.run(command, input=code, cwd=ROOT, capture_output=True, text=True)
    assert ("SLF001" in checked.stdout) == told, checked.stdout + checked.stderr
