"""Text of unknown origin, made safe to print.

File names, notes and messages of recordings may contain control characters, which a terminal would obey, and bytes that
are not UTF-8, which Python keeps as lone surrogates and cannot write.
"""

from __future__ import annotations

import re

_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
"""Control characters except tab and end of line, and lone surrogates."""


def unprintable(text: str) -> list[str]:
    """Return the characters of `text` that `printable` replaces, each once."""
    return list(dict.fromkeys(_UNPRINTABLE.findall(text)))


def printable(text: str) -> str:
    r"""Return `text` with each such character as its escape, e.g. `\u001b`, which means the same in JSON."""
    return _UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
