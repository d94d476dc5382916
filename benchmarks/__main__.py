"""`make bench`: measures every number of docs/benchmarks.md on this machine.

What is measured is said on stderr. Then a summary says how far each case is from its limit, the nearest first, and the
results follow. Exit code 1: a limit is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.cases import GROUPS, Asked, Group, versions
from rig.errors import RigError, UsageError
from rig.printable import columns, counted
from rig.record.provenance import provenance


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and return 1 if a limit was missed."""
    given = _parser().parse_args(arguments)
    asked = Asked(given.quick, given.loop or (10.0 if given.quick else 60.0), given.megabytes)
    wanted = {name: group for name, group in GROUPS.items() if getattr(given, name)} or GROUPS
    try:
        groups = {"against": versions(given.against)} if given.against else wanted
    except UsageError as error:
        _say(str(error), sys.stderr)
        return 2
    results: dict[str, Any] = {}
    for name, group in groups.items():
        _say(f"{name}: {group.title}", sys.stderr)
        try:
            results[name] = group.measure(asked)
        except RigError as error:
            results[name] = {"fault": str(error)}
    machine = provenance(0, tuple(sys.argv))
    if given.json:
        given.json.write_text(json.dumps({"machine": machine, **results}, indent=1, default=str))
    missed, lines = summary(groups, results)
    _say("\n".join(lines))
    for name, group in groups.items():
        _say(f"\n{name}: {group.title}")
        _say("\n".join(f"  {key:40} {_number(value)}" for key, value in _flat(results[name])))
    _say("\n" + ", ".join(f"{key} {value}" for key, value in machine.items()))
    return 1 if missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", metavar="FILE", type=Path, help="keep the results")
    parser.add_argument("--quick", action="store_true", help="fewer rounds and shorter runs")
    parser.add_argument("--against", metavar="COMMIT", help="compare the speed with that of another version, no more")
    parser.add_argument("--loop", metavar="SECONDS", type=float, help="the loop over the bus, a paced run this long")
    parser.add_argument(
        "--megabytes", metavar="MB", type=int, default=250, help="the CSV to import; 2000 for the limit"
    )
    for name, group in GROUPS.items():
        if name != "loop":
            parser.add_argument(f"--{name}", action="store_true", help=group.title)
    return parser


def summary(groups: dict[str, Group], results: dict[str, Any]) -> tuple[int, list[str]]:
    """Return the number of missed cases, and each case with its limit as lines, the nearest to its limit first."""
    rows, counts = [], {"MISSED": 0, "ok": 0, "not measured": 0}
    for name, group in groups.items():
        for case in group.cases:
            value = case.value(results[name])
            if value is None:
                word, margin = ("MISSED", 0.0) if "fault" in results[name] else ("not measured", float("inf"))
            else:
                word, margin = ("ok" if case.kept(value) else "MISSED"), case.margin(value)
            counts[word] += 1
            limit = f"at {'most' if case.at_most else 'least'} {case.limit:g}" if case.limit or case.at_most else ""
            shown = "" if margin in (0.0, float("inf")) else f"{margin:.2f}"
            rows.append(
                (margin, (word, shown, name, case.what, "" if value is None else _number(value), limit, case.unit))
            )
    head = ("", "margin", "group", "case", "value", "limit", "unit")
    table = columns([head, *(row for _, row in sorted(rows, key=lambda entry: entry[0]))], "<><<><<")
    shares = ", ".join(f"{count} {word}" for word, count in counts.items())
    return counts["MISSED"], [
        f"{counted(len(rows), 'case')}: {shares}; margin: how many times better than the limit",
        "",
        *table,
    ]


def _flat(results: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Results with the keys joined by dots; a row of a table is one of them."""
    if isinstance(results, dict):
        for key, value in results.items():
            yield from _flat(value, f"{name}.{key}" if name else key)
    elif isinstance(results, list) and results and isinstance(results[0], dict):
        for row in results:
            yield name, ", ".join(f"{key} {_number(value)}" for key, value in row.items())
    else:
        yield name, results


def _number(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_number, value))
    return (
        f"{value:.4g}"
        if isinstance(value, float) and value < 1e4
        else f"{value:.0f}"
        if isinstance(value, float)
        else str(value)
    )


def _say(text: str, stream: Any = None) -> None:
    (stream or sys.stdout).write(text + "\n")
    (stream or sys.stdout).flush()


if __name__ == "__main__":
    sys.exit(main())
