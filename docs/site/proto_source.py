"""Reads a .proto file that contains messages of plain fields only: names, types and comments."""

import re
from typing import NamedTuple

_MESSAGE = re.compile(r"^((?:// .*\n)*)message (\w+) \{\n((?:  .*\n)*)\}$", re.MULTILINE)
_FIELD = re.compile(r"  (repeated )?(\w+) (\w+) = (\d+);(?: +// (.*))?")


class Field(NamedTuple):
    """A field of a message; `about`: the comment behind it."""

    number: int
    name: str
    type: str
    repeated: bool
    about: str


class Message(NamedTuple):
    """A message; `about`: the comment above it."""

    name: str
    about: str
    fields: tuple[Field, ...]


def package(text: str) -> str:
    """Syntax and package, such as "proto3 rig"."""
    return " ".join(re.findall(r'^(?:syntax = "|package )(\w+)"?;$', text, re.MULTILINE))


def messages(text: str) -> list[Message]:
    """The messages of a .proto file, in order. Raises ValueError for a line that cannot be read."""
    left = re.sub(r'^(//.*|syntax = "proto3";|package \w+;|)\n', "", _MESSAGE.sub("", text), flags=re.MULTILINE)
    if left.strip():
        raise ValueError(f"cannot be read: {left.strip()[:80]}")
    return [
        Message(name, _words(about), tuple(map(_field, body.splitlines())))
        for about, name, body in _MESSAGE.findall(text)
    ]


def _words(comment: str) -> str:
    return " ".join(line.removeprefix("// ") for line in comment.splitlines())


def _field(line: str) -> Field:
    found = _FIELD.fullmatch(line)
    if found is None:
        raise ValueError(f"cannot be read: {line.strip()}")
    repeated, kind, name, number, about = found.groups()
    return Field(int(number), name, kind, repeated is not None, about or "")
