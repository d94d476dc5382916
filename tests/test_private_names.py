"""Tests ask for behaviour: none uses a name of the rig that begins with an underscore.

ruff finds such attributes (rule SLF); what it does not look at is searched here: imports, and names in strings.
"""

import ast
import re
from pathlib import Path

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
