"""An overview of a run: one screen of text, without arrays."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from itertools import islice

import numpy as np

from rig.record.even_times import period
from rig.record.film_points import grouped
from rig.record.run_data import Integers, Reals, RunData

LINES = 12
"""Most outputs, and most sensors, that have a line each."""
WIDTH = 120
"""Most characters of a line."""
_LABEL, _NAME = 12, 24


def overview(run: RunData) -> str:
    """Return scene, length, timing verdict, outputs and sensors with their ranges, controllers, events and damage."""
    return "\n".join(line if len(line) <= WIDTH else f"{line[: WIDTH - 4]} ..." for line in _lines(run))


def _lines(run: RunData) -> Iterator[str]:
    times = np.rint(run.time * 1e9).astype(np.int64)
    yield _line("run", f"{_scene(run)}, {run.time[-1] if run.time.size else 0.0:g} s, step {run.step_ns / 1e6:g} ms")
    yield _line("timing", _timing(run))
    yield _line("outputs", f"{run.time.size} rows{_rate(times)}")
    yield from _some(_outputs(run), len(grouped(run.signals)))
    if run.measurements:
        yield _line("sensors", str(len(run.measurements)))
        yield from _some(_sensors(run), len(run.measurements))
    commands = (f"{name}: {found.tick.size} commands" for name, found in run.commands.items())
    yield _line("controllers", ", ".join(commands) or "none")
    kinds = Counter(event["kind"] for event in run.events)
    yield _line("events", ", ".join(f"{kind} {number}" for kind, number in kinds.items()) or "none")
    if "error" in run.energy:
        yield _line("energy", f"residual of the balance: {abs(run.energy['error']):.1e} of its largest term")
    for label, text in (("fault", run.fault), ("recovered", run.recovered), ("restarted", run.untold)):
        if text and text != run.damage:
            yield _line(label, text.partition("\n")[0])
    yield _line("damage", run.damage or "none")


def _line(label: str, text: str) -> str:
    return f"{label:<{_LABEL}}{text}".rstrip()


def _scene(run: RunData) -> str:
    try:
        found = json.loads(run.scene)
    except ValueError:
        return "unknown scene"
    return f"scene {found.get('name') or found.get('plant', '')}" if isinstance(found, dict) else "unknown scene"


def _timing(run: RunData) -> str:
    verdict, reasons = run.summary.get("verdict"), run.summary.get("reasons", ())
    if verdict is None:
        return "simulated without a clock"
    return f"{verdict}: {', '.join(map(str, reasons))}" if reasons else str(verdict)


def _some(lines: Iterator[str], count: int) -> Iterator[str]:
    yield from islice(lines, LINES)
    if count > LINES:
        yield f"  and {count - LINES} more"


def _outputs(run: RunData) -> Iterator[str]:
    for name, members in grouped(run.signals).items():
        unit = run.units.get(members[0], "") + (f" at {len(members)} points" if len(members) > 1 else "")
        yield f"  {name:<{_NAME}} {_range([run.signals[one] for one in members])} {unit}"


def _sensors(run: RunData) -> Iterator[str]:
    for name, (t_ns, v) in run.measurements.items():
        yield f"  {name:<{_NAME}} {_range([v])} {run.units.get(f'meas/{name}', '')}, {v.size} rows{_rate(t_ns)}"


def _range(values: list[Reals]) -> str:
    known = [v[np.isfinite(v)] for v in values]
    ends = [(v.min(), v.max()) for v in known if v.size]
    return f"{min(low for low, _ in ends):.6g} .. {max(high for _, high in ends):.6g}" if ends else "no value"


def _rate(t_ns: Integers) -> str:
    step = period(t_ns)
    return f" at {1e9 / step:.6g} Hz" if step else ""
