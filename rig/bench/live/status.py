"""Progress line and summary of a run, as text."""

from __future__ import annotations

import queue
import shutil
import sys
import threading
from collections.abc import Iterable, Mapping
from typing import Any, TextIO

from rig.bench.live import machine_load
from rig.model.method import ADAPTIVE
from rig.printable import counted

LABEL = 10
WRONG = {
    "damaged": ("frame", "damaged"),
    "other": ("frame", "late, doubled or foreign"),
    "unfit": ("frame", "with other values"),
}
"""Counts of wrong frames of a board (rig.machine.board): count -> noun, and what is said of so many."""
OF_BOARD = {
    "missed": ("step", "without an answer of the board"),
    "again": ("step", "asked again"),
    **WRONG,
    "resets": ("reset", "of the board"),
}
"""Counts of the board of a controller (rig.machine.board.Line), in the same way."""
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
    refused = health.get("refused")
    words = [health["phase"], f"{health['t']:.1f} s"]
    words.append(f"rt {_short(health['rate'])}")
    words.append(f"late {_short(health['lateness_us'] / 1e3)} ms")
    words.append(f"drops {health['drops']}")
    words.append(f"E {health['energy_error']:.0e}")
    words.append(f"stick {health['stick_share']:.0%}")
    if left >= 0.0:
        words.append(f"{left:.0f} s left")
    words.append(f"overruns {health['overruns']}")
    words.append(f"held {health['held']}")
    if refused:
        words.append(f"refused {refused}")
    return " ".join(words)


def _short(number: float) -> str:
    """A number with two decimals; without them from 10 on."""
    return f"{number:.2f}" if number < 10.0 else f"{number:.0f}"


def summary(outcome: Mapping[str, Any], log: str = "", following: Iterable[str] = ()) -> str:
    """The summary of a run; `log`: state of the recording, `following`: commands to try next."""
    audit = [effect["text"] for effect in outcome.get("audit", ()) if effect["noted"]]
    return _table([*parts(outcome), ("audit", audit), ("log", [log]), ("next", [" | ".join(following)])])


def parts(outcome: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """The summary of a run without its audit: label and lines of each part; a part without lines says nothing."""
    late_share = outcome["timing"].get("late_share", 0.0)
    machine = outcome.get("machine", {})
    network = outcome.get("network", {})
    return [
        ("timing", _timing(outcome)),
        ("busy", [machine_load.advice(outcome["verdict"], late_share, machine)]),
        ("loop", _loop(outcome)),
        ("streams", [stream(port, counts) for port, counts in outcome.get("streams", {}).items()]),
        ("network", [link(topic, counts) for topic, counts in network.items()]),
        ("lost", _lost(outcome)),
        ("refused", _refused(outcome.get("refused", {}))),
        ("plant", [plant(outcome["plant"], outcome["energy"]["error"])] if outcome["plant"] else []),
        ("protocol", _postponed(outcome.get("postponed"))),
        ("note", [*outcome["faults"], *outcome["fault"].splitlines(), *outcome.get("died", ())]),
    ]


def link(topic: str, counts: Mapping[str, int]) -> str:
    """What became of the messages of an impaired link, as a line."""
    (_, sent), *others = counts.items()
    impaired = ", ".join(f"{n} {what}" for what, n in others if n)
    return f"{topic}: {sent} sent, {impaired or 'none of them impaired'}"


def stream(port: str, counts: Mapping[str, int]) -> str:
    """What became of the frames of a stream (rig.bench.live.stream_ports.StreamPort), as a line."""
    words = [f"{counted(counts['frames'], 'frame')} taken in", *_told(WRONG, counts)]
    if counts["lost"]:
        words.append(f"lost {counted(counts['lost'], 'time')}")
    return f"{port}: {', '.join(words)}"


def _told(said: Mapping[str, tuple[str, str]], counts: Mapping[str, int]) -> list[str]:
    """These of the counts that are not 0, in words. `said`: count -> noun, and what is said of so many."""
    return [f"{counted(counts[name], noun)} {text}" for name, (noun, text) in said.items() if counts.get(name)]


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
        waiting = outcome["waiting"]
        how = "sleep and spin" if waiting.get("spin_ns") else "sleep"
        late = _whole(timing["lateness"], ("p50", "p95", "p99", "max"), " / ")
        lines.append(f"lateness {late} us (p50, p95, p99, worst); the plant waits by {how} ({waiting.get('why', '')})")
        spans = [f"{name} {_whole(span, ('mean', 'p95', 'max'), '/')}" for name, span in timing["spans"].items()]
        each = timing.get("each", 1)
        what = "compute time per frame" if each == 1 else f"compute time per piece of {each} frames"
        lines.append(f"{what}: {', '.join(spans)} us (mean/p95/worst)")
        lines.append(f"scheduling {outcome['scheduling'] or 'real-time'}; {outcome['memory'] or 'memory is locked'}")
        if causes := [f"{count} {cause}" for cause, count in timing["overruns"].items()]:
            lines.append(f"overruns by cause: {', '.join(causes)}")
        if timing["given_up"]:
            skipped = "frames" if each == 1 else "pieces"
            lines.append(f"{timing['given_up']} {skipped} of the wall clock skipped")
    return lines


def _whole(values: Mapping[str, float], names: Iterable[str], between: str) -> str:
    """These of the values, rounded to whole numbers."""
    return between.join(f"{values[name]:.0f}" for name in names)


def _lost(outcome: Mapping[str, Any]) -> list[str]:
    lines = [f"{count} of {topic}" for topic, count in outcome["lost"].items()]
    lines += [f"unknown losses on the way to {who}" for who in outcome["unknown"]]
    return lines


def _refused(counts: Mapping[str, int]) -> list[str]:
    senders = sorted(counts.items(), key=lambda sender: -sender[1])
    lines = [f"{count} from {sender}" for sender, count in senders[:REFUSED]]
    if rest := senders[REFUSED:]:
        lines.append(counted(sum(count for _, count in rest), "other"))
    return lines


def _loop(outcome: Mapping[str, Any]) -> list[str]:
    lines = []
    trip = outcome["round_trip"]
    if trip["max"]:
        lines.append(
            f"time from step to command {trip['p50'] / 1e3:.2f} / {trip['p99'] / 1e3:.2f} / "
            f"{trip['max'] / 1e3:.2f} ms (p50, p99, worst)"
        )
    for name, link in outcome.get("links", {}).items():
        times = " / ".join(f"{link[quantile] / 1e3:.2f}" for quantile in ("p50", "p99", "max"))
        lines.append(f"{name} on another host: {times} ms")
    for name, counts in outcome["loop"].items():
        if name == "refused":
            lines += [f"{sender}: {counted(count, 'command')} refused" for sender, count in counts.items()]
        else:
            lines.append(f"{name}: {', '.join(_taken(counts))}")
    for name, counts in outcome.get("controllers", {}).items():
        if words := unanswered(counts):
            lines.append(f"{name}: {', '.join(words)}")
    return lines


def _taken(counts: Mapping[str, int]) -> list[str]:
    """What became of the commands of a controller, in words."""
    words = [counted(counts["taken"], "command")]
    for what, count in counts.items():
        if count and what not in ("taken", "oldest"):
            words.append(f"{count} {what.replace('_', ' ')}")
    if counts["oldest"]:
        words.append(f"oldest {counted(counts['oldest'], 'frame')}")
    return words


def unanswered(counts: Mapping[str, int]) -> list[str]:
    """What a controller with these counters (`Loop.counters`) did not answer, in words."""
    held = counts["held"]
    refused = counts["refused"]
    skipped = counts.get("skipped", 0)
    words = []
    if held:
        words.append(f"{counted(held, 'update')} left out, because a measurement was missing")
    if refused:
        words.append(f"{counted(refused, 'answer')} not finite, and not sent")
    if skipped:
        words.append(f"{counted(skipped, 'step')} skipped, because it was behind")
    return [*words, *_told(OF_BOARD, counts)]


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
