"""The hash of what compiled code depends on: the statements of the modules that hold it and of those they import.

Comments, docstrings, line numbers and all other modules have no influence: an edit of a plant, an effect, an instrument
or a benchmark recompiles nothing. Each module is parsed once; its summary is stored beside the kernels, separately for
each checkout.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from rig.file_locks import own_bytes, own_file, own_folder, trusted

ROOMS = ("rig/solve",)
"""Folders whose kernels are stored for all processes as long as their sources do not change."""
_DECORATORS = {"kernel", "inner", "inlined", "fused"}


class Module(NamedTuple):
    """The summary of one source file. `stamp`: size and time of modification; `digest`: hash of its statements."""

    stamp: list[int]
    digest: str
    holds: bool
    """Whether the file contains compiled code."""
    imports: list[str]
    """Dotted names of the imported modules of this project."""


def key(root: Path, kept: Path, version: str, instead: str) -> str:
    """Hash (16 hex digits) of `version` and of everything that the kernels of these sources depend on.

    `root`: folder that contains the package `rig`; `kept`: file that stores the summaries, unless another user can have
    written it; `instead`: what the user can then set.
    """
    known: dict[str, Module] = {}
    with suppress(OSError, ValueError, TypeError):  # missing or damaged
        known = {name: Module(*one) for name, one in json.loads(own_bytes(kept, instead)).items()}
    found: dict[str, Module] = {}

    def read(name: str) -> Module:
        path = root / name
        status = path.stat()
        stamp = [status.st_size, status.st_mtime_ns]
        if name not in found:
            old = known.get(str(path))
            found[name] = old if old is not None and old.stamp == stamp else _summary(path.read_bytes(), stamp)
        return found[name]

    rooms = [path.relative_to(root).as_posix() for room in ROOMS for path in (root / room).glob("*.py")]
    todo = [name for name in rooms if read(name).holds]
    needed = {"rig/kernel.py", *todo}
    read("rig/kernel.py")
    while todo:
        for name in _files(root, read(todo.pop()).imports):
            if name not in needed:
                needed.add(name)
                todo.append(name)
    read_here = {str(root / name): one for name, one in found.items()}
    if any(known.get(path) != one for path, one in read_here.items()) and trusted(kept.parent, instead):
        others = {path: one for path, one in known.items() if Path(path).is_file()}  # summaries of other checkouts
        draft = kept.with_suffix(f".{os.getpid()}")
        with suppress(OSError):  # a folder that cannot be written costs only the time of parsing
            own_folder(kept.parent)
            draft.write_text(json.dumps(others | read_here))
            own_file(draft)
            draft.replace(kept)
    text = "".join(f"{name} {found[name].digest}\n" for name in sorted(needed))
    return hashlib.sha256(f"{version}\n{text}".encode()).hexdigest()[:16]


def _summary(source: bytes, stamp: list[int]) -> Module:
    tree = ast.parse(source)
    holds, imports = False, []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body[0] = ast.Pass()  # its docstring
        if isinstance(node, ast.FunctionDef):
            holds = holds or any(isinstance(d, ast.Name) and d.id in _DECORATORS for d in node.decorator_list)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "rig":
            imports += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return Module(stamp, hashlib.sha256(ast.dump(tree).encode()).hexdigest(), holds, imports)


def _files(root: Path, imports: list[str]) -> Iterator[str]:
    """The files of those dotted names that are modules. Packages are skipped; they only collect modules."""
    for name in imports:
        path = f"{name.replace('.', '/')}.py"
        if (root / path).is_file():
            yield path
