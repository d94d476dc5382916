"""What one sees of a run: the line while it goes on, the summary after it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

LABEL = 10


def line(health: Mapping[str, Any]) -> str:
    """One line from the health of a plant, with `t` [s] of simulated time; short enough for a terminal of 120."""
    left = health["eta_s"]
    parts = [
        health["phase"],
        f"t {health['t']:.1f} s",
        f"rt {health['rate']:.3f}" if health["rate"] < 10.0 else f"rt {health['rate']:.0f}",
        f"late p99 {health['lateness_us'] / 1e3:.2f} ms",
        f"overruns {health['overruns']}",
        f"held {health['held']}",
        f"drops {health['drops']}",
        f"energy {health['energy_error']:.0e}",
        f"stick {health['stick_share']:.0%}",
    ]
    return "  ".join([*parts, f"left {left:.0f} s"] if left >= 0.0 else parts)


def summary(found: Mapping[str, Any], log: str = "", following: Iterable[str] = ()) -> str:
    """The summary of a run in lines; `log` says what became of the recording, `following` what to try next."""
    told = [("timing", _timing(found)), ("loop", _loop(found)), ("lost", _lost(found)), ("plant", _plant(found))]
    told += [("note", [*found["faults"], *found["fault"].splitlines()[:1]])]
    told += [("log", [log] if log else []), ("next", [" | ".join(following)])]
    rows = []
    for label, lines in told:
        for i, text in enumerate(line for line in lines if line):
            rows.append(f" {label if i == 0 else '':{LABEL}}{text}")
    return "\n".join(rows)


def _timing(found: Mapping[str, Any]) -> list[str]:
    frames = f"{found['ticks']} frames, {found['seconds']:g} s in {found['wall_seconds']:.3g} s ({found['mode']})"
    lines = [f"{found['verdict']}: {'; '.join(found['reasons'])}", f"{frames}; {found['ended']}"]
    timing = found["timing"]
    if timing:
        late = timing["lateness"]
        lines.append(f"lateness {late['p50']:.0f} / {late['p95']:.0f} / {late['p99']:.0f} / {late['max']:.0f} us "
                     f"(p50, p95, p99, worst), waiting by {_waiting(found)}")  # fmt: skip
        spans = [f"{name} {s['mean']:.0f}/{s['p95']:.0f}/{s['max']:.0f}" for name, s in timing["spans"].items()]
        lines.append(f"frame {', '.join(spans)} us (mean/p95/worst)")
        causes = [f"{count} {cause}" for cause, count in timing["overruns"].items()]
        if causes:
            lines.append(f"overruns by cause: {', '.join(causes)}")
        if timing["given_up"]:
            lines.append(f"{timing['given_up']} frames of the wall clock given up")
    return lines


def _waiting(found: Mapping[str, Any]) -> str:
    waiting = found["waiting"]
    return f"{'sleep and spin' if waiting.get('spin_ns') else 'sleep'} ({waiting.get('why', '')})"


def _loop(found: Mapping[str, Any]) -> list[str]:
    lines = []
    trip = found["round_trip"]
    if trip["max"]:
        lines.append(f"step to command {trip['p50'] / 1e3:.2f} ms p50, {trip['p99'] / 1e3:.2f} p99, "
                     f"{trip['max'] / 1e3:.2f} worst")  # fmt: skip
    for name, counts in found["loop"].items():
        if name == "refused":
            lines += [f"{sender}: {count} commands refused" for sender, count in counts.items()]
            continue
        words = [f"{counts['taken']} commands"]
        words += [f"{counts[kind]} {kind.replace('_', ' ')}" for kind in counts if kind not in ("taken", "oldest")
                  and counts[kind]]  # fmt: skip
        if counts["oldest"]:
            words.append(f"oldest {counts['oldest']} frames")
        lines.append(f"{name}: {', '.join(words)}")
    return lines


def _lost(found: Mapping[str, Any]) -> list[str]:
    return [f"{count} of {topic}" for topic, count in found["lost"].items()]


def _plant(found: Mapping[str, Any]) -> list[str]:
    plant = found["plant"]
    return [
        f"method {plant['method']}, {plant['events']} events, stick {plant['stick_share']:.0%}, "
        f"energy error {found['energy']['error']:.0e}"
    ]
