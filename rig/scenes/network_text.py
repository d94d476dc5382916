"""Impaired links in one line, as `rig run --net` takes them, and as the keys of [network] that they define.

meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, duplicate 0.1 %, reorder; seed 3
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from rig.errors import UsageError
from rig.scenes.faults import close
from rig.scenes.network import Link

ROOMS = ("meas", "act")
EXAMPLE = "meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, duplicate 0.1 %, reorder; seed 3"
_WORDS = [*Link.model_fields]
_PART = re.compile(r"[^,;]+")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_VALUE = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)")


def keys(texts: Iterable[str], given: Iterable[str] = ()) -> dict[str, str]:
    """Dotted key of a scene -> value, for links in the form above; `given`: keys that the caller sets otherwise.

    Values and names are checked when the scene is loaded. Raises UsageError with all faults of the texts, each with
    its column.
    """
    found: dict[str, str] = {}
    faults: list[str] = []
    for text in texts:
        for column, key, value in _read(text):
            if not key:
                faults.append(f'--net "{text}", column {column}: {value}')
            elif found.get(key, value) != value:
                faults.append(f'--net "{text}", column {column}: {key} is given twice, as {found[key]} and as {value}')
            else:
                found[key] = value
    faults += [f"--net and -p: both give {key}; leave out one of them" for key in given if key in found]
    if faults:
        raise UsageError("\n".join([*faults, f'expected e.g. --net "{EXAMPLE}"']))
    return found


def _read(text: str) -> Iterator[tuple[int, str, str]]:
    """(column, key, value) of each value in a text; a fault has no key, and what is wrong as value."""
    link, colon, rest = text.partition(":")
    room, slash, name = link.strip().partition("/")
    if not colon or not slash or room not in ROOMS or not _NAME.fullmatch(name):
        yield 1, "", _no_link(link.strip(), room, slash, colon)
        if not colon:
            return
    words: dict[str, int] = {}
    for part in _PART.finditer(rest):
        column = len(link) + 2 + part.start() + len(part.group()) - len(part.group().lstrip())
        word, _, value = part.group().strip().partition(" ")
        last = rest[part.start() - 1 : part.start()] == ";"
        if word in words:
            yield column, "", f"{word} is given twice"
        elif word:
            yield column, *_value(room, name, word, value.strip(), last)
        words[word] = column
    if not any(words):
        yield len(text) + 1, "", f"says nothing about the link; known: {', '.join(_WORDS)}"


def _no_link(link: str, room: str, slash: str, colon: str) -> str:
    form = "a link is meas/SENSOR or act/CONTROLLER, then a colon"
    if slash and room not in ROOMS and (likely := close(room, ROOMS)):
        return f"{link}: did you mean {link.replace(room, likely[0], 1)}? {form}"
    return f"{link or 'nothing'}{'' if colon else ' has no colon'}: {form}"


def _value(room: str, name: str, word: str, value: str, last: bool) -> tuple[str, str]:
    if word == "seed":
        if not last:
            return "", 'seed must be at the end, after a semicolon: "...; seed 3"'
        return ("network.seed", value) if value.isdecimal() else ("", f"seed {value}: expected a whole number")
    if word not in Link.model_fields:
        likely = close(word, [*_WORDS, "seed"])
        hint = f"did you mean {' or '.join(likely)}?" if likely else f"known: {', '.join(_WORDS)}, seed"
        return "", f"{word}: unknown; {hint}"
    if last:
        return "", f"{word} is after a semicolon; only the seed may be there, the rest is separated by commas"
    key = f"network.{room}.{name}.{word}"
    if word == "reorder":
        return (key, "true") if not value else ("", f"reorder {value}: reorder takes no value")
    if (number := _VALUE.fullmatch(value)) is None:
        return "", f"{word} {value}: expected a number and a unit".replace(f"{word} :", f"{word}:")
    return key, f"{number[1]} {number[2]}".strip()


def described(link: Mapping[str, object]) -> str:
    """A link in the words of --net. `link`: its values in SI."""
    found = []
    for word in ("delay", "jitter"):
        if link.get(word):
            found.append(f"{word} {float(link[word]) * 1e3:g} ms")  # type: ignore[arg-type]
    for word in ("loss", "duplicate"):
        if link.get(word):
            found.append(f"{word} {float(link[word]) * 1e2:g} %")  # type: ignore[arg-type]
    return ", ".join([*found, *(["reorder"] if link.get("reorder") else [])]) or "perfect"
