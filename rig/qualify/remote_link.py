"""Measures the link from this host to the plant of a ticket: how long an answer takes, and which period it holds.

The plant's bus answers, and neither its loop nor a controller: a run goes on undisturbed. A step and its command take
as long, plus the time in which the controller computes.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig import bus
from rig.bus import tickets
from rig.errors import BusError
from rig.qualify.round_trips import in_words, period_of, quantiles

_ASKED = 2000  # questions: the 99 % quantile is then exceeded by twenty. # chosen
_PAUSE_S = 0.001  # between two of them, as between the frames of a paced run
_PATIENCE_S = 1.0


@dataclass(frozen=True)
class RemoteLink:
    """The link to the plant at `endpoint`. Round trips: median, 99 % and worst [ms].

    `period_ms`: the least usual period of a controller for which 99 % of the answers come within its patience; None if
    there is none.
    """

    run: str
    endpoint: str
    asked: int
    missed: int
    p50: float
    p99: float
    worst: float
    period_ms: float | None

    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON."""
        return asdict(self)

    def text(self) -> str:
        """The result as text."""
        times = f"{self.p50:.2f} / {self.p99:.2f} / {self.worst:.2f} ms (p50, p99, worst)"
        asked = f"run {self.run} at {self.endpoint}: round trip {times}, {self.missed} of {self.asked} missed"
        return f"{asked}\n{in_words(self.period_ms)}"


def measure(path: Path, asked: int = _ASKED) -> RemoteLink:
    """Measure the link to the plant of the ticket in file `path` with `asked` questions. Raises BusError."""
    ticket = tickets.read(path)
    role = ticket.seat if ticket.seat in tickets.SEATS else "controller"
    trips = []
    missed = 0
    with bus.join(role=role, name=ticket.seat, ticket=path) as session:
        session.present("plant/*")  # the first question waits until both sides know each other
        for _ in range(asked):
            time.sleep(_PAUSE_S)
            begun = time.perf_counter()
            if session.present("plant/*", _PATIENCE_S):
                trips.append(1e3 * (time.perf_counter() - begun))
            else:
                missed += 1
                if session.ended:
                    raise BusError(session.gone or f"run {ticket.run} has ended")
    p50, p99, worst = quantiles(trips, 1e3 * _PATIENCE_S)
    period = period_of(p99, missed / asked)
    return RemoteLink(ticket.run, ticket.endpoint, asked, missed, p50, p99, worst, period)
