"""Progress line and summary of a run, as text."""

from __future__ import annotations

import queue
import shutil
import sys
import threading
from collections.abc import Iterable, Mapping
from typing import Any, TextIO

from rig.bench.live import pace
from rig.model.method import ADAPTIVE
from rig.printable import counted

LABEL = 10
UNCLOSED = 1e-2  # share of the largest term: a film in contact leaves up to this
REFUSED = 5
"""Number of kinds of refused messages that the summary lists."""


class Live:
    """A progress line that stays in one place of a terminal; without a terminal only the lines of `say` are written.

    A separate thread writes, so that a slow terminal does not delay the plant.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._width = 0
        self._terminal = self._stream.isatty()
        self._queue: queue.SimpleQueue[tuple[str, bool] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="live", daemon=True)
        self._thread.start()

    def show(self, health: Mapping[str, Any]) -> None:
        """Replace the progress line by that of `health`."""
        if self._terminal:
            self._queue.put((line(health), False))

    def say(self, text: str) -> None:
        """Write a line that stays."""
        self._queue.put((text, True))

    def done(self) -> None:
        """Clear the progress line; waits up to one second for the writing thread."""
        self._queue.put(None)
        self._thread.join(1.0)

    def _write(self) -> None:
        while (entry := self._queue.get()) is not None:
            text, stays = entry
            if self._terminal:
                text = text if stays else text[: shutil.get_terminal_size().columns - 1]
                end = "\n" if stays else ""
                self._stream.write(f"\r{text.ljust(self._width)}{end}")
                self._width = 0 if stays else len(text)
            else:
                self._stream.write(f"{text}\n")
            self._stream.flush()
        if self._terminal and self._width:
            self._stream.write(f"\r{' ' * self._width}\r")
            self._stream.flush()


def line(health: Mapping[str, Any]) -> str:
    """The progress line from the health of a plant, with simulated time `t` [s]; 80 columns show all but the end."""
    left = health["eta_s"]
    late = health["lateness_us"] / 1e3
    words = [
        health["phase"],
        f"{health['t']:.1f} s",
        f"rt {health['rate']:.2f}" if health["rate"] < 10.0 else f"rt {health['rate']:.0f}",
        f"late {late:.2f} ms" if late < 10.0 else f"late {late:.0f} ms",
        f"drops {health['drops']}",
        f"E {health['energy_error']:.0e}",
        f"stick {health['stick_share']:.0%}",
        *([f"{left:.0f} s left"] if left >= 0.0 else []),
        f"overruns {health['overruns']}",
        f"held {health['held']}",
        *([f"refused {health['refused']}"] if health.get("refused") else []),
    ]
    return " ".join(words)


def summary(outcome: Mapping[str, Any], log: str = "", following: Iterable[str] = ()) -> str:
    """The summary of a run; `log`: state of the recording, `following`: commands to try next."""
    audit = [effect["text"] for effect in outcome.get("audit", ()) if effect["noted"]]
    return _table([*parts(outcome), ("audit", audit), ("log", [log]), ("next", [" | ".join(following)])])


def parts(outcome: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """The summary of a run without its audit: label and lines of each part; a part without lines says nothing."""
    refused = sorted(outcome.get("refused", {}).items(), key=lambda sender: -sender[1])
    others = [f"{counted(sum(count for _, count in refused[REFUSED:]), 'other')}"] if refused[REFUSED:] else []
    lost = [f"{count} of {topic}" for topic, count in outcome["lost"].items()]
    late_share = outcome["timing"].get("late_share", 0.0)
    machine = outcome.get("machine", {})
    return [
        ("timing", _timing(outcome)),
        ("busy", [pace.advice(outcome["verdict"], late_share, machine)]),
        ("loop", _loop(outcome)),
        ("network", [link(topic, counts) for topic, counts in outcome.get("network", {}).items()]),
        ("lost", [*lost, *(f"unknown losses on the way to {who}" for who in outcome["unknown"])]),
        ("refused", [*(f"{count} from {sender}" for sender, count in refused[:REFUSED]), *others]),
        ("plant", [plant(outcome["plant"], outcome["energy"]["error"])] if outcome["plant"] else []),
        ("protocol", _postponed(outcome.get("postponed"))),
        ("note", [*outcome["faults"], *outcome["fault"].splitlines(), *outcome.get("died", ())]),
    ]


def link(topic: str, counts: Mapping[str, int]) -> str:
    """What became of the messages of an impaired link, as a line."""
    sent, *others = counts.items()
    return f"{topic}: {sent[1]} sent, " + (
        ", ".join(f"{n} {what}" for what, n in others if n) or "none of them impaired"
    )


def _table(labelled: Iterable[tuple[str, Iterable[str]]]) -> str:
    rows = []
    for label, lines in labelled:
        for i, text in enumerate(line for line in lines if line):
            rows.append(f" {label if i == 0 else '':{LABEL}}{text}")
    return "\n".join(rows)


def _timing(outcome: Mapping[str, Any]) -> list[str]:
    wall = f" in {outcome['wall_seconds']:.3g} s" if outcome["wall_seconds"] else ""  # unknown of a plant that died
    frames = f"{counted(outcome['ticks'], 'frame')}, {outcome['seconds']:g} s simulated{wall}"
    lines = [
        f"{outcome['verdict']}: {'; '.join(outcome['reasons'])}",
        f"{frames} ({outcome['mode']}); ended: {outcome['ended']}",
    ]
    timing = outcome["timing"]
    if timing:
        late = timing["lateness"]
        waiting = outcome["waiting"]
        how = f"{'sleep and spin' if waiting.get('spin_ns') else 'sleep'} ({waiting.get('why', '')})"
        lines.append(
            f"lateness {late['p50']:.0f} / {late['p95']:.0f} / {late['p99']:.0f} / {late['max']:.0f} us "
            f"(p50, p95, p99, worst); the plant waits by {how}"
        )
        spans = [f"{name} {s['mean']:.0f}/{s['p95']:.0f}/{s['max']:.0f}" for name, s in timing["spans"].items()]
        each = timing.get("each", 1)
        what = "compute time per frame" if each == 1 else f"compute time per piece of {each} frames"
        lines.append(f"{what}: {', '.join(spans)} us (mean/p95/worst)")
        lines.append(f"scheduling {outcome['scheduling'] or 'real-time'}; {outcome['memory'] or 'memory is locked'}")
        if causes := [f"{count} {cause}" for cause, count in timing["overruns"].items()]:
            lines.append(f"overruns by cause: {', '.join(causes)}")
        if timing["given_up"]:
            lines.append(f"{timing['given_up']} {'frames' if each == 1 else 'pieces'} of the wall clock skipped")
    return lines


def _loop(outcome: Mapping[str, Any]) -> list[str]:
    lines = []
    trip = outcome["round_trip"]
    if trip["max"]:
        lines.append(
            f"time from step to command {trip['p50'] / 1e3:.2f} / {trip['p99'] / 1e3:.2f} / "
            f"{trip['max'] / 1e3:.2f} ms (p50, p99, worst)"
        )
    for name, counts in outcome["loop"].items():
        if name == "refused":
            lines += [f"{sender}: {counted(count, 'command')} refused" for sender, count in counts.items()]
        else:
            others = (
                (what.replace("_", " "), n) for what, n in counts.items() if n and what not in ("taken", "oldest")
            )
            words = [f"{counted(counts['taken'], 'command')}", *(f"{n} {what}" for what, n in others)]
            words += [f"oldest {counted(counts['oldest'], 'frame')}"] if counts["oldest"] else []
            lines.append(f"{name}: {', '.join(words)}")
    for name, counts in outcome.get("controllers", {}).items():
        lines += [f"{name}: {', '.join(words)}"] if (words := unanswered(counts)) else []
    return lines


def unanswered(counts: Mapping[str, int]) -> list[str]:
    """What a controller with these counters (`Loop.counters`) did not answer, in words."""
    held = counts["held"]
    refused = counts["refused"]
    skipped = counts.get("skipped", 0)
    return [
        *([f"{counted(held, 'update')} left out, because a measurement was missing"] if held else []),
        *([f"{counted(refused, 'answer')} not finite, and not sent"] if refused else []),
        *([f"{counted(skipped, 'step')} skipped, because it was behind"] if skipped else []),
    ]


def _postponed(counts: Mapping[str, Any] | None) -> list[str]:
    if not counts:
        return []
    never = f"; {counts['never']} never took effect" if counts["never"] else ""
    waited = counted(counts["waited"], "step")
    longest = f"{counts['longest_s']:.3g} s"
    return [f"{waited} waited for new matrices, the longest {longest}{never}"]


def plant(values: Mapping[str, Any], energy_error: float) -> str:
    """Method, events, stick share and residual of the plant in one line."""
    text = f"method {values['method']}, {counted(values['events'], 'event')}"
    if "stick_share" in values:  # a rig with a friction patch
        text += f", stick {values['stick_share']:.0%}"
    text += f", energy residual {energy_error:.0e}"
    if not abs(energy_error) <= UNCLOSED:
        finer = "clock.tolerance" if values["method"] in ADAPTIVE else "clock.rk4_step"
        text += f": the energy balance does not close, so the motion is not resolved; use a smaller {finer}"
    return text
