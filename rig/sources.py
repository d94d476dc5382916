"""What compiled code depends on: the statements of the modules that hold it, and of those that they import.

Comments, docstrings and line numbers do not matter, nor does any other module: an edit of a plant, an effect, an
instrument or a benchmark compiles nothing anew. A module is parsed once and its summary kept beside the kernels, for
each checkout its own.
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

ROOMS = ("rig/solve",)
"""Folders whose kernels are kept for all processes, for as long as their sources stay as they are."""
_DECORATORS = {"kernel", "inner", "inlined", "fused"}


class Module(NamedTuple):
    """What is known of one source file: which (size, time of change), its statements, what it imports."""

    stamp: list[int]
    digest: str
    holds: bool
    """Whether it holds compiled code."""
    imports: list[str]
    """Dotted names of this project's."""


def key(root: Path, kept: Path, version: str) -> str:
    """Hash (16 hex digits) of `version` and of all that the kernels of these sources depend on. `kept`: a file."""
    known: dict[str, Module] = {}
    with suppress(OSError, ValueError, TypeError):  # not there, or damaged
        known = {name: Module(*one) for name, one in json.loads(kept.read_text()).items()}
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
    if any(known.get(path) != one for path, one in read_here.items()):
        others = {path: one for path, one in known.items() if Path(path).is_file()}  # of other checkouts
        draft = kept.with_suffix(f".{os.getpid()}")
        with suppress(OSError):  # a place that cannot be written costs the time of parsing
            kept.parent.mkdir(parents=True, exist_ok=True)
            draft.write_text(json.dumps(others | read_here))
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
    """Those of dotted names that are modules, as files; packages only gather what is in them."""
    for name in imports:
        path = f"{name.replace('.', '/')}.py"
        if (root / path).is_file():
            yield path
