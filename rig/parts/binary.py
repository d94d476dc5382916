"""Files that a scene names and a recording contains: compiled parts (a library, an FMU) and data that a plant reads.

Trust is a matter of the content, as with source text (rig.parts.code): a file that a user names is trusted, what comes
with a recording or over the bus is trusted on the user's word. Data are not run, and need no trust.
"""

from __future__ import annotations

import base64
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from rig.errors import PartError
from rig.machine.files import contents
from rig.parts.code import SHOWN, Hashed, require, trust_hashes

LARGEST = 16 << 20
"""Largest file of a compiled part [bytes]. # chosen: every recording of a run contains it"""
_NAME = re.compile(r"[^/\\\0]{1,100}")


class Binary(str, Hashed):
    """A compiled part as the value of a scene: its text is the base name of the file.

    `content`: the bytes of the file. `about`: what the part says of itself (sizes, parameters), as plain JSON values.
    """

    __slots__ = ("__dict__",)
    content: bytes
    about: dict[str, Any]

    @classmethod
    def of(cls, file: str, content: bytes, about: dict[str, Any] | None = None) -> Self:
        """A part with this name, content and description."""
        if not _NAME.fullmatch(file):
            raise PartError(
                f"{file:.120}: the name of a compiled part has at most 100 characters, none of them / or \\"
            )
        binary = cls(file)
        binary.content = content
        binary.about = about or {}
        return binary

    @classmethod
    def read(cls, path: str | Path, describe: Callable[[Binary], dict[str, Any]]) -> Self:
        """The part in a file, which is then trusted. `describe` returns its `about`. Raises PartError."""
        binary = cls._in_file(Path(path))
        trust_hashes([binary.sha256])
        binary.about = describe(binary)
        return binary

    @classmethod
    def _in_file(cls, path: Path) -> Self:
        try:
            return cls.of(path.name, contents(path, LARGEST))
        except FileNotFoundError:
            raise PartError(f"{path}: there is no such file") from None
        except OSError as error:
            raise PartError(f"{path}: cannot be read: {error.strerror}") from None

    def data(self) -> bytes:
        """See `Hashed`."""
        return self.content

    @property
    def file(self) -> str:  # type: ignore[override]
        """Base name of the file."""
        return str(self)

    @contextmanager
    def unpacked(self) -> Iterator[Path]:
        """A file with the content, as long as it is needed. Raises Untrusted for a part that is not trusted.

        It is never the user's own file: that may be compiled again while it is in use.
        """
        if not self.trusted:
            require([self])
        with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
            path = Path(folder) / self.file
            path.write_bytes(self.content)
            yield path

    def to_json(self) -> dict[str, Any]:
        """As plain values, for recordings."""
        content = base64.b64encode(self.content).decode()
        return {"file": self.file, "sha256": self.sha256, "about": self.about, "content": content}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        """The part that `to_json` described. Raises PartError where the content does not have the stated hash."""
        try:
            content = base64.b64decode(raw["content"], validate=True)
            binary = cls.of(str(raw["file"]), content, dict(raw["about"]))
        except (KeyError, TypeError, ValueError):
            raise PartError("the recording describes a compiled part in an unknown form: it is damaged") from None
        if binary.sha256 != raw.get("sha256"):
            raise PartError(
                f"{binary.file}: its content has the SHA-256 {binary.short}..., the recording states "
                f"{str(raw.get('sha256'))[:SHOWN]}...: it was changed or is damaged, and is not run"
            )
        return binary

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        to_json = core_schema.plain_serializer_function_ser_schema(cls.to_json, when_used="json")
        return core_schema.no_info_plain_validator_function(cls._from, serialization=to_json)

    @classmethod
    def _from(cls, value: Any) -> Self:
        if isinstance(value, cls):
            return value
        if isinstance(value, Mapping):
            return cls.from_json(value)
        raise ValueError("expected the name of a file")


class DataFile(Binary):
    """A file of data that a plant of one's own reads, as the type of a value in its Parameters.

        class Parameters(Section):
            profile: DataFile                               # in the scene: profile = "./profile.csv"

    A path in a scene file is relative to that file. The plant reads `content` [bytes], or the file that `unpacked()`
    makes of it, never the path: so the recording, which contains the content, can be simulated again elsewhere.
    """

    @property
    def trusted(self) -> bool:
        """True: data are not run."""
        return True

    @classmethod
    def _from(cls, value: Any) -> Self:
        if not isinstance(value, str) or isinstance(value, cls):
            return super()._from(value)
        if not Path(value).is_absolute():  # `rig.scenes.rooms.anchor` has made one of "./NAME"
            raise ValueError('expected the path of a file, relative to the scene: "./NAME"')
        try:
            return cls._in_file(Path(value))
        except PartError as fault:
            raise ValueError(str(fault)) from None


def is_binary(value: Any) -> bool:
    """Whether a value in the JSON of a scene is a compiled part."""
    return isinstance(value, Mapping) and {"file", "sha256", "content"} <= value.keys()


def binaries(controllers: Any) -> Iterator[Binary]:
    """The compiled parts in the JSON of a scene's controllers. Raises PartError for a damaged one."""
    for table in controllers.values() if isinstance(controllers, Mapping) else ():
        for value in table.values() if isinstance(table, Mapping) else ():
            if is_binary(value):
                yield Binary.from_json(value)
