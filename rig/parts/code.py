"""Source text of parts from elsewhere: read, checked against its hash, and run as a module only if it is trusted.

Trust is a matter of the text, by its SHA-256. A file that a user names is trusted. What comes with a recording or over
the bus is trusted once `trust` was called for it, on the user's word (`--trust`). Processes that this one starts trust
the same texts: they find the hashes in the environment.
"""

from __future__ import annotations

import inspect
import linecache
import os
import re
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import PydanticUserError

from rig.errors import PartError, RigError, Untrusted, kind_and_text
from rig.machine.files import contents
from rig.machine.process import copies, end_copy

_TRUSTED = "RIG_TRUSTED"
SHOWN = 12  # digits of a hash
_FILE = re.compile(r"[^/\\\0]{1,100}\.py")
MOVED = {
    "controllers": "rig.controllers",
    "sensors": "rig.sensors",
    "rig.solve.assembly": "rig.model.assembly",
    "rig.bench.runner": "rig.bench.run.runner",
    "rig.effects.amplifier": "rig.effects.piezo",
    "rig.effects.friction": "rig.laws",
    "rig.effects.moving_contact": "rig.effects.disc_modes",
    "rig.effects.stack": "rig.effects.shunt",
    "rig.kernel": "rig.compiled.kernel",
    "rig.study": "rig.analysis, rig.qualify or rig.papers",
}
"""Modules that parts may import by earlier names -> where they are now."""
MODULES: dict[str, Code] = {}
"""Foreign parts that this process has loaded: module -> its code."""
_PATHS: dict[str, str] = {}
"""Name under which Python knows a text -> the file that the user knows."""


class Hashed:
    """A text or content from elsewhere that may be run if it is trusted; `file`: base name of its file."""

    file: Any

    def data(self) -> bytes:
        """What is hashed."""
        raise NotImplementedError

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the text or content [64 hex digits]."""
        return sha256(self.data()).hexdigest()

    @property
    def short(self) -> str:
        """The first digits of the hash."""
        return self.sha256[:SHOWN]

    @property
    def trusted(self) -> bool:
        """Whether this process may run it."""
        return self.sha256 in known_hashes()


@dataclass(frozen=True)
class Code(Hashed):
    """The source text of a part; `file`: base name of the file that held it."""

    file: str
    text: str

    def data(self) -> bytes:
        """See `Hashed`."""
        return self.text.encode()

    @property
    def called(self) -> str:
        """Name of the module: two versions of a file are two modules."""
        return f"rig_part_{re.sub(r'[^A-Za-z0-9_]', '_', Path(self.file).stem)}_{self.sha256}"

    @classmethod
    def read(cls, path: Path) -> Code:
        """The code in a file. Raises PartError for what cannot be read."""
        if not _FILE.fullmatch(path.name):  # a recording would be refused
            raise PartError(f"{path}: a part is a file NAME.py, its name at most 100 letters and without \\")
        try:
            return cls(path.name, contents(path).decode("utf-8-sig"))
        except FileNotFoundError:
            raise PartError(f"{path}: there is no such file") from None
        except UnicodeDecodeError as error:
            raise PartError(f"{path}: is not text in UTF-8 (byte {error.start})") from None
        except OSError as error:
            raise PartError(f"{path}: cannot be read: {error.strerror}") from None

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Code:
        """The code that `to_json` described. Raises PartError where the text does not have the hash that is stated."""
        file, text, stated = (raw.get(key) for key in ("file", "source", "sha256"))
        if not (isinstance(file, str) and _FILE.fullmatch(file) and isinstance(text, str)):
            raise PartError("the recording describes a part in an unknown form: it was changed or is damaged")
        code = cls(file, text)
        if code.sha256 != stated:
            raise PartError(
                f"part {file}: its source has the SHA-256 {code.short}..., the recording states "
                f"{str(stated)[:SHOWN]}...: it was changed or is damaged, and is not run"
            )
        return code

    def to_json(self) -> dict[str, str]:
        """As plain values, for recordings."""
        return {"file": self.file, "sha256": self.sha256, "source": self.text}

    def module(self, path: Path | None = None) -> ModuleType:
        """The text as a module, run once in a process; `path`: the file it was read from, for messages.

        Raises Untrusted for a text that is not trusted, PartError with line and reason for one that fails.
        """
        name = f"<{self.file} {self.sha256}>"
        if (loaded := sys.modules.get(self.called)) is not None:
            if path is not None:  # of two files with one text, messages name the one that was read last
                _PATHS[name] = str(path)
            return loaded
        require([self])
        _PATHS[name] = str(path or self.file)
        linecache.cache[name] = len(self.text), None, self.text.splitlines(keepends=True), name
        module = ModuleType(self.called)
        module.__file__ = name
        sys.modules[self.called] = module  # pydantic looks for the names of a module there
        before = copies[0]
        try:
            exec(compile(self.text, name, "exec", dont_inherit=True), vars(module))
        except KeyboardInterrupt:
            del sys.modules[self.called]
            raise
        except BaseException as error:  # a part may raise GeneratorExit or a kind of its own
            del sys.modules[self.called]
            raise PartError(foreign_fault(error) or f"{_PATHS[name]}: {kind_and_text(error)}") from error
        finally:
            end_copy(before)
        MODULES[self.called] = self
        return module


def keep(module: ModuleType, code: Code) -> None:
    """Remember that a module that was imported is a foreign part."""
    MODULES[module.__name__] = code
    if module.__file__:
        _PATHS[module.__file__] = module.__file__


def code_of(what: type | ModuleType) -> Code | None:
    """The code of the foreign part that defines a class, or is a module; None for one of this project."""
    return MODULES.get(what.__module__ if isinstance(what, type) else what.__name__)


def file_of(module: ModuleType) -> str:
    """The file of a foreign part, for messages; of a module of this project its name."""
    code = code_of(module)
    return module.__name__ if code is None else code.file


def place_of(function: Any) -> str:
    """The line of a function of a foreign part, as the end of its name in a message; "" if it is not known."""
    code = getattr(inspect.unwrap(function), "__code__", None)
    return f" (line {code.co_firstlineno})" if code is not None and code.co_filename in _PATHS else ""


@contextmanager
def calling(module: ModuleType, *expected: type[Exception]) -> Iterator[None]:
    """Raise what goes wrong in a call of the foreign part `module` as PartError, with file and, if known, line.

    A call that does not fit (a function with too few arguments) fails outside of the part; it is the part's fault too.
    `expected`: what the caller handles.
    """
    passed: tuple[type[BaseException], ...] = (KeyboardInterrupt, RigError, *expected)
    before = copies[0]
    try:
        yield
    except passed:
        raise
    except BaseException as error:
        text = foreign_fault(error)
        if not text and code_of(module) is None:
            raise
        raise PartError(text or f"{file_of(module)}: {kind_and_text(error)}") from error
    finally:
        end_copy(before)


def known_hashes() -> list[str]:
    """SHA-256 of all texts and contents that this process may run."""
    return os.environ.get(_TRUSTED, "").split()


def trust_hashes(hashes: Iterable[str]) -> None:
    """Let this process, and those that it starts, run what has one of these hashes."""
    os.environ[_TRUSTED] = " ".join(dict.fromkeys([*known_hashes(), *hashes]))


def trust(codes: Iterable[Code]) -> None:
    """Let this process, and those that it starts, run these texts."""
    trust_hashes(code.sha256 for code in codes)


def require(codes: Iterable[Hashed]) -> None:
    """Raise Untrusted, with all their names and hashes, if some of these are not trusted."""
    if strange := [code for code in codes if not code.trusted]:
        names = ", ".join(f"{code.file} (SHA-256 {code.short}...)" for code in strange)
        raise Untrusted(
            f"this needs to run code that comes with the recording or the run: {names}. "
            "If you trust its origin, add --trust (in Python trust=True)"
        )


def foreign_fault(error: BaseException) -> str:
    """File, line, kind and text of an error that a foreign part caused; "" if none did."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in _PATHS]
    if isinstance(error, SyntaxError) and error.filename in _PATHS:
        return f"{_PATHS[error.filename]}: {type(error).__name__}: {error.msg} (line {error.lineno})"
    if not frames:
        return ""
    text = f"{_PATHS[frames[-1].filename]}: {_without_type(error) or kind_and_text(error)} (line {frames[-1].lineno})"
    name = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
    now = next((new for old, new in MOVED.items() if f"{name}.".startswith(f"{old}.")), "")
    return f"{text}; it is now {now}" if now else text


def _without_type(error: BaseException) -> str:
    """The fault of a class of values, one of which has no type; "" for any other error."""
    if not isinstance(error, PydanticUserError) or error.code != "model-field-missing-annotation":
        return ""
    name = error.message.partition("`")[2].partition(" =")[0]
    return (
        f"{name} in a class of values has no type. Write {name}: TYPE for a value of the table, {name}: ClassVar for "
        "another attribute; move an import above the class"
    )
