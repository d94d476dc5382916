"""Summary of the gallery for the page on validation: its numbers counted, and those that differ."""

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from generated import directive, plain, table
from sphinx.application import Sphinx

GALLERY = Path(__file__).parents[1] / "gallery"
_SOURCES = ("paper", "reference", "theory", "coarser")


def counts() -> Iterable[str]:
    """How many numbers there are of each source, for each paper, and how many of them agree."""
    rows: dict[str, Counter[str]] = {}
    for figure in json.loads((GALLERY / "numbers.json").read_text()):
        row = rows.setdefault(figure["name"].partition("-")[0], Counter())
        row["figures"] += 1
        for one in figure["comparisons"]:
            row[one["source"]] += 1
            row["agree"] += one["agrees"]
    cells = [
        (paper, str(row["figures"]), *(str(row[one]) for one in _SOURCES),
         str(sum(row[one] for one in _SOURCES)), str(row["agree"]))
        for paper, row in rows.items()
    ]  # fmt: skip
    return table(("paper", "figures", *_SOURCES, "numbers", "agree"), cells)


def differing() -> Iterable[str]:
    """Every number outside of its bound, from the numbers of the gallery."""
    rows = [
        (f"[{figure['name']}](gallery/README.md#{figure['name']})", plain(one["what"]), _number(one, "ours"),
         _number(one, "expected"), one["source"])
        for figure in json.loads((GALLERY / "numbers.json").read_text())
        for one in figure["comparisons"]
        if not one["agrees"] and one["expected"] is not None
    ]  # fmt: skip
    return table(("figure", "number", "ours", "expected", "source"), rows) or ["No number lies outside of its bound."]


def _number(one: dict[str, object], key: str) -> str:
    value = one[key]
    return "none" if value is None else f"{value:.7g} {plain(str(one['unit']))}".strip()


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives `gallery-counts` and `gallery-differing`."""
    directive(app, "gallery-counts", counts)
    directive(app, "gallery-differing", differing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
