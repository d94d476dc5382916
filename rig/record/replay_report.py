"""The report of a replay: what was published, how far its commands agree with the recorded ones, how late it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from rig.printable import counted


@dataclass(frozen=True)
class Divergence:
    """The first command that differs from the recorded one."""

    topic: str
    tick: int
    time: float
    """s"""
    recorded: tuple[float, ...]
    answered: tuple[float, ...]

    def __str__(self) -> str:
        recorded, answered = (", ".join(map(repr, v)) or "no command" for v in (self.recorded, self.answered))
        return (
            f"{self.topic} differs at tick {self.tick}, t = {self.time:.9g} s: recorded {recorded}; answered {answered}"
        )


@dataclass(frozen=True)
class TimingError:
    """How much later than the clock demands the steps of a replay were published [s]."""

    mean: float
    p50: float
    p99: float
    worst: float

    @classmethod
    def of(cls, late: Sequence[float]) -> TimingError:
        """Return the timing error of steps that were `late` by these times [s]; at least one."""
        p50, p99, worst = np.quantile(late, (0.5, 0.99, 1.0)).tolist()
        return cls(float(np.mean(late)), p50, p99, worst)

    def __str__(self) -> str:
        words = []
        for name, value in vars(self).items():
            words.append(f"{name} {value:.3g} s" if value >= 1.0 else f"{name} {1e3 * value:.3g} ms")
        return ", ".join(words)


@dataclass
class Replayed:
    """The result of a replay."""

    messages: int = 0
    """Number of recorded messages that were published."""
    steps: int = 0
    seconds: float = 0.0
    """Simulated time at the end [s]."""
    compared: dict[str, int] = field(default_factory=dict)
    """Number of commands compared with recorded ones, for each controller."""
    unanswered: int = 0
    """Number of recorded commands that no controller sent again."""
    silent: dict[str, int] = field(default_factory=dict)
    """Controller -> number of steps that it answered now, but not in the recording while it took part."""
    unknown_memory: tuple[str, ...] = ()
    """Controllers that worked before the recording began: what they remembered then is unknown."""
    not_finite: tuple[str, ...] = ()
    """First answers of controllers that were not finite, in words: the last command was sent again in their place."""
    divergence: Divergence | None = None
    timing: TimingError | None = None
    """Timing error of the steps; None without a pace."""
    fault: str = ""
    """Why only a part of the recording could be replayed."""

    @property
    def passed(self) -> bool:
        """Whether everything was replayed, and every recorded command was sent again with the same bits."""
        return not (self.divergence or self.unanswered or self.fault)

    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON; times in s."""
        return {**asdict(self), "passed": self.passed}

    def text(self) -> str:
        """The result as text."""
        messages = counted(self.messages, "message")
        steps = counted(self.steps, "step")
        lines = [f"{messages}, {steps}, {self.seconds:.3f} s of simulated time"]
        if self.timing is not None:
            lines.append(f"timing error of the steps: {self.timing}")
        for name, count in self.compared.items():
            lines.append(
                f"{name}: {counted(count, 'command')} compared"
                if count
                else f"{name}: the recording has no command of {name}, so nothing was compared"
            )
            if name in self.unknown_memory:
                lines.append(f"  {name} ran before the recording began: its state at the beginning is unknown")
            if silent := self.silent.get(name):
                lines.append(
                    f"  {silent} steps have no recorded command of {name}: it did not receive them, or its commands "
                    "were not recorded; a controller with internal state may differ from there on"
                )
        if self.unanswered:
            lines.append(f"{self.unanswered} recorded commands were not answered again")
        lines += self.not_finite
        if self.divergence is not None:
            lines.append(str(self.divergence))
        elif any(self.compared.values()):
            lines.append("no command differs")
        return "\n".join(lines)
