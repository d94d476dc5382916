"""The words for a measure in a figure."""

from __future__ import annotations


def in_words(measure: str, unit: str) -> str:
    """Return a measure in words with its unit: "cycle.stick_share" is "stick share (cycle) [1]"."""
    source, _, rest = measure.partition(".")
    words = (f"{rest} ({source})" if rest else measure).replace("_", " ").replace(".", " ")
    return f"{words} [{unit or '1'}]"
