"""A strict reader for JSON from other processes: limited length and depth, no duplicate keys, finite numbers."""

from __future__ import annotations

import json
import math
import re
from typing import Any, NoReturn

from rig.bus.arrivals import Refused

QUESTION = 1 << 16
"""Longest query [bytes]."""
DEPTH = 32
"""Deepest nesting of JSON."""
_STRINGS = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)


def read_json(data: bytes, limit: int = QUESTION, *, finite: bool = True) -> dict[str, Any]:
    """Read the JSON object in `data`.

    Raises Refused if it is longer than `limit` bytes, nested deeper than `DEPTH`, not a JSON object, or has a duplicate
    key or (with `finite`) a number that is not finite.
    """
    if len(data) > limit:
        raise Refused("too long", f"{len(data)} bytes; at most {limit} are read")
    try:
        text = data.decode()
        depth = deepest = 0
        for mark in re.findall(r"[\[\]{}]", _STRINGS.sub("", text)):
            depth += 1 if mark in "[{" else -1
            deepest = max(deepest, depth)
        if deepest > DEPTH:
            raise Refused("too deep", f"nested {deepest} levels deep; at most {DEPTH} are read")
        found = json.loads(
            text,
            object_pairs_hook=_unambiguous,
            parse_constant=_not_finite if finite else None,
            parse_float=_finite if finite else None,
        )
        json.dumps(found, ensure_ascii=False).encode()  # raises for half a surrogate pair
    except Refused:
        raise
    except (ValueError, RecursionError) as fault:
        raise Refused("not JSON", f"{_shown(data)} is not JSON: {fault}") from None
    if not isinstance(found, dict):
        raise Refused("not JSON", f"{_shown(data)} is not a JSON object")
    return found


def _unambiguous(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise Refused("not JSON", f"{next(key for key in keys if keys.count(key) > 1)!r} is given twice")
    return found


def _finite(text: str) -> float:
    number = float(text)
    return number if math.isfinite(number) else _not_finite(text)


def _not_finite(text: str) -> NoReturn:
    raise Refused("not finite", f"{text[:40]} is not a finite number")


def _shown(data: bytes) -> str:
    return repr(data[:40]) + ("..." if len(data) > 40 else "")
