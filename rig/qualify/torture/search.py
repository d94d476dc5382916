"""Random search over the boxes of the cases; what breaks the default method is shrunk to a file that joins the set.

Needs hypothesis, which is a tool of development: `pip install hypothesis`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.qualify.torture.case import FOLDER, Case
from rig.qualify.torture.cells import Cell, cells

EXAMPLES = 30
PLACES = 1000
"""Values along a side of a box, evenly spread; floats would be drawn from about zero. The simplest is the lowest."""


def search(case: Case, examples: int = EXAMPLES, folder: Path = FOLDER) -> tuple[Path, Cell] | None:
    """Look for values in the box of `case` with which a cell of the default is not green.

    The simplest that is found goes to a file in `folder`. Raises UsageError without hypothesis, or without a box.
    """
    try:
        from hypothesis import HealthCheck, Phase, given, settings, strategies
    except ImportError:
        raise UsageError("a random search needs hypothesis: pip install hypothesis") from None
    if not case.box:
        raise UsageError(f"{case.name} has no box to search")
    ranges = {key: strategies.integers(0, PLACES).map(_between(*ends)) for key, ends in case.box.items()}
    last: list[tuple[dict[str, float], Cell]] = []

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )
    @given(strategies.fixed_dictionaries(ranges))
    def holds(values: dict[str, float]) -> None:
        bad = broken(at(case, values))
        if bad is not None:
            last.append((values, bad))
        assert bad is None

    try:
        holds()
    except AssertionError:
        values, cell = last[-1]
        return write(case, values, cell, folder), cell
    return None


def _between(low: float, high: float) -> Callable[[int], float]:
    return lambda place: low + (high - low) * place / PLACES


def at(case: Case, values: dict[str, float]) -> Case:
    """The case with other values; what its sources say of its own is not asked then."""
    expect = case.expect.model_copy(update={"events": None, "growth": None})
    return case.model_copy(update={"set": case.set | values, "expect": expect, "steps": case.steps[:1]})


def broken(case: Case) -> Cell | None:
    """The first cell of the default that is red; dear ones are none."""
    for cell in cells(case, True, ("default",)):
        if cell.default and cell.result.colour == "red" and cell.result.reason != "refused":
            return cell
    return None


def write(case: Case, values: dict[str, float], cell: Cell, folder: Path) -> Path:
    """The counter-example as a case of its own, beside the one that it was found in."""
    number = 1
    while (path := folder / f"{case.name}_{number}.toml").exists():
        number += 1
    told = cell.result
    apart = {"name", "box", "expect", "acts", "set", "quick_duration"}
    raw = case.model_dump(mode="json", exclude_defaults=True, exclude=apart)
    raw |= {"title": f"{case.title}, found by random search", "quick": True}
    raw["about"] = f"{told.colour}, {told.reason}: {told.told}. {case.about}".strip()
    lines = _lines(raw)
    lines += ["", "[set]", *(f"{json.dumps(key)} = {_toml(value)}" for key, value in (case.set | values).items())]
    for act in case.acts:
        lines += ["", "[[act]]", *_lines(act.model_dump(mode="json", exclude_defaults=True))]
    expect = at(case, values).expect.model_dump(mode="json", exclude_defaults=True)
    if expect:
        lines += ["", "[expect]", *_lines(expect)]
    path.write_text("\n".join(lines) + "\n")
    return path


def _lines(raw: dict[str, Any]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in raw.items()]


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + " }"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
