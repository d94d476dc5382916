"""The words for a measure in a figure."""

from __future__ import annotations


def in_words(measure: str, unit: str) -> str:
    """Return a measure in words with its unit: "cycle.stick_share" is "stick share (cycle) [1]"."""
    source, _, rest = measure.partition(".")
    words = (f"{rest} ({source})" if rest else measure).replace("_", " ").replace(".", " ")
    return f"{words} [{unit or '1'}]"


def with_unit(name: str, unit: str) -> str:
    """Return the head of a column: a name with its unit, if it has one."""
    return name if unit in ("", "1") else f"{name} [{unit}]"
