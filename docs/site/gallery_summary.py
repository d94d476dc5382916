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
    cells = []
    for paper, row in rows.items():
        by_source = [row[source] for source in _SOURCES]
        numbers = (row["figures"], *by_source, sum(by_source), row["agree"])
        cells.append((paper, *map(str, numbers)))
    return table(("paper", "figures", *_SOURCES, "numbers", "agree"), cells)


def differing() -> Iterable[str]:
    """Every number outside of its bound, from the numbers of the gallery."""
    rows = []
    for figure in json.loads((GALLERY / "numbers.json").read_text()):
        link = f"[{figure['name']}](gallery/README.md#{figure['name']})"
        for one in figure["comparisons"]:
            if not one["agrees"] and one["expected"] is not None:
                ours = _number(one, "ours")
                expected = _number(one, "expected")
                rows.append((link, plain(one["what"]), ours, expected, one["source"]))
    return table(("figure", "number", "ours", "expected", "source"), rows) or ["No number lies outside of its bound."]


def _number(one: dict[str, object], key: str) -> str:
    value = one[key]
    return "none" if value is None else f"{value:.7g} {plain(str(one['unit']))}".strip()


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives `gallery-counts` and `gallery-differing`."""
    directive(app, "gallery-counts", counts)
    directive(app, "gallery-differing", differing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
