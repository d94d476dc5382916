"""Measures of one's own: Python functions of a Run, which worker processes run from the source text of their file."""

from __future__ import annotations

import ast
import hashlib
import inspect
import math
import secrets
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from importlib.util import decode_source
from pathlib import Path
from types import ModuleType
from typing import Any

from rig.errors import UsageError, kind_and_text
from rig.machine.files import contents
from rig.record.run import Run
from rig.scenes.faults import shortened

_OWN: dict[str, Callable[[Run], Any]] = {}
"""Functions of this process that no file holds, by a random text: what else they use (globals, closures) may differ
although their code is the same, so that no other process finds results of theirs."""
_LOADING: list[str] = []  # files that this process runs at the moment, because they define a measure


@dataclass(frozen=True)
class Function:
    """A function `name` of the file `file` with the source `text`; `beside`: hash of what it imports from its folder.

    Without a file it exists in this process only, and `text` is a random one.
    """

    name: str
    file: str = ""
    text: str = ""
    beside: str = ""

    @property
    def portable(self) -> bool:
        """Whether other processes can run it."""
        return bool(self.file)

    def value(self, run: Run) -> tuple[float, str, str]:
        """Return its value, the unit and, for a value that is missing, the reason."""
        try:
            returned = (self._loaded() if self.portable else _OWN[self.text])(run)
        except UsageError as fault:
            return math.nan, "", str(fault)
        except KeyboardInterrupt:
            raise
        except BaseException as fault:
            return math.nan, "", f"{self.name}: {kind_and_text(fault)}{self._line(fault)}"
        value, unit = returned if isinstance(returned, tuple) and len(returned) == 2 else (returned, "")
        number = None if isinstance(value, str) or not isinstance(unit, str) else _as_number(value)
        if number is None:
            return math.nan, "", f"{self.name} returned {_shown(returned)}: expected a number, or number and unit"
        return (number, unit, "") if math.isfinite(number) else (math.nan, unit, f"{self.name} is {number}")

    def _line(self, fault: BaseException) -> str:
        """The last line of the function's own file that led to a fault."""
        frames = traceback.extract_tb(fault.__traceback__)[1:]  # without the call above
        in_file = [frame for frame in frames if frame.filename == (self.file or frames[0].filename)]
        return f" (line {in_file[-1].lineno})" if in_file else ""

    def _loaded(self) -> Callable[[Run], Any]:
        module = _module(self.file, self.text)
        function: Callable[[Run], Any] | None = getattr(module, self.name, None)
        if not callable(function):
            raise UsageError(f"{self.file}: defines no function {self.name}")
        return function


def _as_number(value: Any) -> float | None:
    """A value as a float; None for one that is no number."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except Exception:  # of a class of the user
        return None


def _shown(returned: Any) -> str:
    try:
        return shortened(" ".join(repr(returned).split()))
    except Exception:  # of a class of the user
        return f"a {type(returned).__name__}"


def function_of(given: str | Callable[[Run], Any]) -> Function:
    """Return a measure of a Python function, or of "FILE.py:NAME". Raises UsageError."""
    if isinstance(given, str):
        file, _, name = given.rpartition(":")
        try:
            function = Function(name, str(Path(file).resolve()), decode_source(contents(Path(file))))
        except (OSError, SyntaxError, UnicodeDecodeError) as fault:
            raise UsageError(f"{given}: {getattr(fault, 'strerror', None) or fault}") from None
        function._loaded()  # noqa: SLF001 (its own kind)
        return replace(function, beside=_beside(function.file, function.text))
    name = getattr(given, "__name__", type(given).__name__)
    try:
        file = inspect.getsourcefile(given) or ""
        text = decode_source(contents(Path(file)))
        at_top = getattr(given, "__qualname__", "") == name  # a local function may also have a global name, in a loop
        global_name = at_top and getattr(inspect.getmodule(given), name, None) is given
    except (OSError, SyntaxError, TypeError, UnicodeDecodeError):
        global_name = False
    if global_name:
        function = Function(name, str(Path(file).resolve()), text)
        module = _module(function.file, text)  # as worker processes load it: not under if __name__ == "__main__"
        if hasattr(module, name):
            return replace(function, beside=_beside(file, text))
    for random_text, known in _OWN.items():
        if known is given:
            return Function(name, text=random_text)
    random_text = secrets.token_hex(8)
    _OWN[random_text] = given
    return Function(name, text=random_text)


def _beside(file: str, text: str) -> str:
    """Hash of the modules that a file imports from its folder, and of those that these import; "" if there are none."""
    folder = Path(file).resolve().parent
    texts: dict[str, str] = {}
    todo = [text]
    while todo:
        for name in _imports(todo.pop()):
            whole = folder.joinpath(*name.split("."))
            for path in (whole.with_suffix(".py"), whole / "__init__.py"):
                if str(path) not in texts and path.is_file():
                    texts[str(path)] = path.read_bytes().decode(errors="replace")
                    todo.append(texts[str(path)])
    if not texts:
        return ""
    return hashlib.sha256(repr(sorted(texts.items())).encode()).hexdigest()[:12]


def _imports(text: str) -> Iterator[str]:
    """The names of all modules that a source text may import, but for those of this project."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):  # of a module that may never be imported
        return
    for node in ast.walk(tree):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        names = [alias.name for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            head = [node.module] if node.module else []
            names = [*head, *(".".join([*head, name]) for name in names)]
        yield from (name for name in names if name.partition(".")[0] != "rig" and "*" not in name)


def check_not_loading() -> None:
    """Raise UsageError if a file that defines a measure begins a study while it is loaded for that measure."""
    if _LOADING:
        raise UsageError(
            f"{_LOADING[-1]} starts a study when it is loaded for its measure; "
            'write the call under if __name__ == "__main__":'
        )


def _module(file: str, text: str) -> ModuleType:
    """The module of a source text, run once in this process. Raises UsageError for one that fails."""
    name = f"rig_measures_{hashlib.sha256(f'{file}{text}'.encode()).hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = file
    sys.modules[name] = module
    folder = str(Path(file).parent)
    if folder not in sys.path:
        sys.path.append(folder)
    _LOADING.append(file)
    try:
        with redirect_stdout(sys.stderr):  # standard output may be a report in JSON
            exec(compile(text, file, "exec"), module.__dict__)
    except BaseException as fault:
        del sys.modules[name]
        if isinstance(fault, UsageError | KeyboardInterrupt):
            raise
        raise UsageError(f"{file}: {kind_and_text(fault)}") from None
    finally:
        _LOADING.pop()
    return module
