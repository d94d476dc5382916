"""Random search over the boxes of the cases; a failure of the default method is simplified and saved as a new case.

Needs hypothesis, a development tool: `pip install hypothesis`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.machine.files import write_file
from rig.qualify.torture.case import FOLDER, Case
from rig.qualify.torture.cells import Cell, cells

EXAMPLES = 30
PLACES = 1000
"""Values along a side of a box, evenly spaced; floats would concentrate near zero. The lowest is the simplest."""


def search(case: Case, examples: int = EXAMPLES, folder: Path = FOLDER) -> tuple[Path, Cell] | None:
    """Search the box of `case` for values with which a cell of the default is not green.

    The simplest one is written to a file in `folder`. Raises UsageError without hypothesis, or without a box.
    """
    try:
        from hypothesis import HealthCheck, Phase, given, settings, strategies
    except ImportError:
        raise UsageError("a random search needs hypothesis: pip install hypothesis") from None
    if not case.box:
        raise UsageError(f"{case.name} has no box to search")
    places = {key: strategies.integers(0, PLACES) for key in case.box}
    last: list[tuple[dict[str, float], Cell]] = []

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )
    @given(strategies.fixed_dictionaries(places))
    def holds(place: dict[str, int]) -> None:
        values = {key: low + (high - low) * place[key] / PLACES for key, (low, high) in case.box.items()}
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


def at(case: Case, values: dict[str, float]) -> Case:
    """Return the case with other values, without the numbers that its source gives for its own values."""
    expect = case.expect.model_copy(update={"events": None, "growth": None})
    return case.model_copy(update={"set": case.set | values, "expect": expect, "steps": case.steps[:1]})


def broken(case: Case) -> Cell | None:
    """Return the first red cell of the default; expensive cells do not count."""
    red = (cell for cell in cells(case, True, ("default",)) if cell.default and cell.result.colour == "red")
    return next((cell for cell in red if cell.result.reason != "refused"), None)


def write(case: Case, values: dict[str, float], cell: Cell, folder: Path) -> Path:
    """Write the counter-example as a separate case, beside the one that it was found in."""
    number = 1
    while (path := folder / f"{case.name}_{number}.toml").exists():
        number += 1
    result = cell.result
    apart = {"name", "box", "expect", "acts", "set", "quick_duration"}
    raw = case.model_dump(mode="json", exclude_defaults=True, exclude=apart)
    raw |= {"title": f"{case.title}, found by random search", "quick": True}
    raw["about"] = f"{result.colour}, {result.reason}: {result.detail}. {case.about}".strip()
    lines = _lines(raw)
    lines += ["", "[set]", *(f"{json.dumps(key)} = {_toml(value)}" for key, value in (case.set | values).items())]
    for act in case.acts:
        lines += ["", "[[act]]", *_lines(act.model_dump(mode="json", exclude_defaults=True))]
    expect = at(case, values).expect.model_dump(mode="json", exclude_defaults=True)
    if expect:
        lines += ["", "[expect]", *_lines(expect)]
    write_file(path, ("\n".join(lines) + "\n").encode())
    return path


def _lines(raw: dict[str, Any]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in raw.items()]


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + " }"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
