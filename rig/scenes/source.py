"""Readers for scene files and changes by the caller: plain values as one tree, and the origin of each value."""

from __future__ import annotations

import errno
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rig.errors import SceneError
from rig.machine.files import contents
from rig.quantities import ORIGINS
from rig.scenes import places
from rig.scenes.faults import TAGS, close, shown, unknown_choice
from rig.units import brief

FIXED = ("format", "based_on", "title", "plant", "about", "protocol")
FORMAT = 1
"""Format of scene files: `format = 1` at the top of a file, and of one that states none."""
_POSITION = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")
_BARE = re.compile(r"[^=#\"']*=\s*[-+\u2212]?\d[\d.]*(?:[eE][-+]?\d+)?+(?:(,)\d|\s*[A-Za-z%\u00b5])")
"""A number with a decimal comma, or one with a unit, which is not in quotes."""
_NUMBER = re.compile(r"[+-]?(\d|\.\d)")
KIND = (*(tag for tag in TAGS if tag != "step"), "effect")
"""Keys that state the kind of a table."""
Fault = tuple[str, str]
"""Dotted key, and its fault in one line."""
_DEEPEST = 20  # levels of tables and lists: far more than a scene has. chosen
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:\\.|[^"\\\n])*+"|'[^'\n]*+')"""
_TOKEN = re.compile(
    r"""#[^\n]*+|"{3}(?:\\.|[^\\])*?"{3,5}|'{3}.*?'{3,5}|"""
    rf"(?P<deep>{_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_DEEPEST},}})|{_PART}",
    re.DOTALL,
)
_MCAP = b"\x89MCAP"
_DIGITS = 18  # of a whole number: 64 bits hold them


def tree(path: Path) -> dict[str, Any]:
    """The tables of a TOML file. Raises SceneError with line and column of a syntax error."""
    return parsed(path, text(path))


def check_format(stated: object) -> None:
    """Raise ValueError for a format that this version does not know."""
    if stated is True or stated != FORMAT:
        newer = "; install a newer version" if isinstance(stated, int) and stated > FORMAT else ""
        raise ValueError(
            f"format = {brief(stated)}: this version of friction-rig reads scene files of format {FORMAT}{newer}"
        )


def text(path: Path) -> str:
    """The text of a file. Raises SceneError if it cannot be read."""
    try:
        return contents(path).decode("utf-8-sig")  # some editors begin a file with a mark
    except FileNotFoundError:
        raise SceneError(str(path), ["there is no such file"]) from None
    except UnicodeDecodeError as error:
        raise SceneError(str(path), [_recording(path) or f"is not text in UTF-8 (byte {error.start})"]) from None
    except OSError as error:
        what = _recording(path) if error.errno == errno.EFBIG else ""
        raise SceneError(str(path), [what or f"cannot be read: {error.strerror}"]) from None


def _recording(path: Path) -> str:
    """What to do with a file that is a recording; "" for another one."""
    with path.open("rb") as file:
        begin = file.read(len(_MCAP))
    return "is a recording (MCAP) and no scene; rig simulate --from LOG continues it" if begin == _MCAP else ""


def toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises what `tomllib.loads` does.

    And RecursionError for a key of more parts than a scene has tables in tables: tomllib takes 1.7 GB for one of 40 kB.
    """
    if any(token["deep"] for token in _TOKEN.finditer(text)):
        raise RecursionError
    return tomllib.loads(text)


def parsed(path: Path, text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises SceneError with line and column of a syntax error."""
    try:
        tables = toml(text)
    except RecursionError:
        raise SceneError(str(path), [f"tables or lists are nested more than {_DEEPEST} deep"]) from None
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        place = _POSITION.search(message)
        line, column = place.groups() if place else (None, None)
        if line is None:
            lines = text.rstrip().split("\n")
            line = str(len(lines))
            column = str(len(lines[-1]) + 1)
        what = _POSITION.sub("", message)
        if bare := _BARE.match(text.split("\n")[int(line) - 1]):
            what += "; a number has a decimal point" if bare[1] else '; a value with a unit is in quotes, "2 rpm"'
        raise SceneError(str(path), [f"line {line}, column {column}: {what[:1].lower()}{what[1:]}"]) from None
    except ValueError:  # of Python, which reads no whole number of more than 4300 digits
        raise SceneError(str(path), [f"holds a whole number of more than {_DIGITS} digits"]) from None
    if faults := list(beyond(tables)):
        raise SceneError(str(path), faults)
    return tables


def beyond(raw: Any, key: str = "") -> Iterator[str]:
    """Faults of values that are deeper or longer than in any scene; other checks need a tree without them."""
    inside = [(key, raw, 0)]
    while inside:
        key, value, depth = inside.pop()
        if isinstance(value, int) and abs(value) >= 10**_DIGITS:
            yield f"{key}: a whole number has at most {_DIGITS} digits"
        elif depth > _DEEPEST:
            yield f"{shown(key)}: tables or lists are nested more than {_DEEPEST} deep"
            return
        elif isinstance(value, Mapping):
            inside += [(f"{key}.{name}" if key else str(name), inner, depth + 1) for name, inner in value.items()]
        elif isinstance(value, list | tuple):
            inside += [(f"{key}[{i}]", inner, depth + 1) for i, inner in enumerate(value, 1)]


def dotted(raw: Mapping[str, Any], key: str = "") -> Iterator[tuple[str, Any]]:
    """The values of tables of changes by their dotted keys, which may be quoted (`"body.mass"`) or tables in tables."""
    for name, value in raw.items():
        here = f"{key}.{name}" if key else name
        if isinstance(value, Mapping):
            yield from dotted(value, here)
        else:
            yield here, value


def stripped(raw: Any, origins: dict[str, places.Origin], faults: list[Fault], key: str = "") -> Any:
    """`raw` without its origins, which are added to `origins` by dotted key. Faults are added to `faults`."""
    if isinstance(raw, Mapping):
        return {name: stripped(value, origins, faults, f"{key}.{name}" if key else name) for name, value in raw.items()}
    if not isinstance(raw, list):
        return raw
    if _has_origin(raw):
        if raw[1] not in ORIGINS:
            faults.append((key, unknown_choice(f"{key}: origin", raw[1], ORIGINS)))
        origins[key] = places.Origin(raw[1], raw[2] if len(raw) == 3 else "")
        return raw[0]
    return [stripped(value, origins, faults, f"{key}[{i}]") for i, value in enumerate(raw, 1)]


def _has_origin(raw: list[Any]) -> bool:
    """Whether a list is [value, origin] or [value, origin, note] and not a list of values."""
    if len(raw) not in (2, 3) or isinstance(raw[0], Mapping):
        return False
    if not all(isinstance(part, str) for part in raw[1:]):
        return False
    if raw[1] in ORIGINS:
        return True
    value = not isinstance(raw[0], str) or _NUMBER.match(raw[0]) is not None
    return value and _NUMBER.match(raw[1]) is None


def change(
    raw: dict[str, Any], overrides: Mapping[str, object], origins: dict[str, places.Origin], faults: list[Fault]
) -> dict[str, tuple[str, Any]]:
    """Lay `overrides` over `raw`. Return the tables whose kind changed -> key of the kind, former kind.

    Faults are added to `faults`.
    A text that is a TOML value is read as one ("5", "true", "[1, 2]"); "none" removes a key or a table.
    """
    recast: dict[str, tuple[str, Any]] = {}
    for key, value in overrides.items():
        *parents, last = key.split(".")
        first = key.split(".")[0].partition("[")[0]
        value = _read(value)
        if not all((*parents, last)) or len(parents) >= _DEEPEST:
            faults.append((key, f"{brief(key)}: is not a dotted key such as drive.speed"))
        elif first in FIXED:
            what = f"{key}: only a scene file can change {first}"
            faults.append((key, f"{what}; write one with rig new and change it there"))
        elif too_much := list(beyond(value, key)):
            faults += [(key, line) for line in too_much]
        elif at(raw, parents) is None:
            faults.append((key, f"{key} = {shown(value)}: {'.'.join(parents)} is a value, not a table"))
        else:
            own: dict[str, places.Origin] = {}
            tables = {last: stripped(value, own, faults, key)}
            if isinstance(tables[last], int | float | str) and last not in KIND:
                own.setdefault(key, places.Origin("user"))
            for name in reversed(parents):
                tables = {name: tables}
            faults += lay(tables, raw, origins, own, recast, "scene")
    return recast


def lay(
    over: Mapping[str, Any],
    raw: dict[str, Any],
    origins: dict[str, places.Origin],
    own: dict[str, places.Origin],
    recast: dict[str, tuple[str, Any]],
    below: str = "base",
    key: str = "",
) -> Iterator[Fault]:
    """Merge the tables `over` into those below them, `raw`, which messages call `below`. Yield the faults.

    `origins` are those of `raw`; `own`, those of `over`, replace them in the end. `recast` receives the tables whose
    kind changed -> key of the kind, former kind.
    """
    for name, value in over.items():
        here = f"{key}.{name}" if key else name
        before = raw.get(name)
        if value == "none":
            if name not in raw:
                hint = " or ".join(f"{key}.{similar}" if key else similar for similar in close(name, raw))
                hint = f"; did you mean {hint}?" if hint else ""
                yield here, f"{here}: is not in the {below}, so it cannot be removed{hint}"
            raw.pop(name, None)
            forget(origins, here)
            forget(own, here)
        elif isinstance(value, Mapping):
            table = before if isinstance(before, dict) else {}
            if table is not before:
                forget(origins, here)
            raw[name] = table
            yield from lay(value, table, origins, own, recast, below, here)
        else:
            if key and name in KIND and name in raw and before != value:
                recast[key] = name, before
            if here not in own or isinstance(before, dict | list):
                forget(origins, here)
            raw[name] = value
    if not key:
        origins |= own


def _read(value: object) -> Any:
    if value is None:
        return "none"
    if not isinstance(value, str):
        plain = getattr(value, "tolist", None)  # numbers and arrays of numpy
        return plain() if callable(plain) else value
    text = value.strip()
    try:
        literal = toml(f"value = {text}")["value"]
    except (ValueError, RecursionError, KeyError):  # no value of TOML, or none that can be read
        return text
    return literal if isinstance(literal, bool | int | float | str | list) else text


def at(raw: dict[str, Any], parents: list[str]) -> dict[str, Any] | None:
    """The table to change, which is made if it does not exist; None if there is a value in its place."""
    table: Any = raw
    for name in parents:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            return None
    return table  # type: ignore[no-any-return]


def forget(origins: dict[str, places.Origin], key: str) -> None:
    """Remove the origins of a value or of a whole table."""
    for old in [o for o in origins if o == key or o.startswith((f"{key}.", f"{key}["))]:
        del origins[old]
