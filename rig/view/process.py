"""The viewer process: receives the messages of a run from the bus and sends them to rerun about 12 times per second.

No publisher ever waits for it. A thread gives each batch to rerun; while rerun is slow or hangs, messages are
collected, then dropped and counted (`rig.view.feed`). The process ends when the plant ends, when the window is closed,
or on a signal, within two seconds whatever rerun does. `rig.view.viewer` describes what happens to the window then.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rig import bus
from rig.bus import run_setup
from rig.bus.port import Receiver, Session, Watch
from rig.bus.run_setup import Setup
from rig.errors import BusError
from rig.machine.process import stopping
from rig.machine.scheduling import stand_back
from rig.parts import trust_scene
from rig.printable import counted
from rig.structure import model_store
from rig.view import viewer
from rig.view.base import Columns
from rig.view.drawing import Drawing, send
from rig.view.feed import Feed

if TYPE_CHECKING:
    import rerun as rr


PAUSE_S = 0.08
TOPICS = ("state", "band", "meas/*", "applied/*", "health", "event/*", "total/plant")
DEPTH = 1024
"""Messages that wait for the viewer; those that find no room are lost, counted by topic."""
_NICE = 5
_LAST_WORDS_S = 0.3
_LEAVING_S = 0.5


@dataclass(frozen=True)
class Viewing:
    """The result of viewing a run: why it ended, and counts of messages."""

    run: str
    ended: str
    messages: int
    """Number of messages received."""
    lost: dict[str, int] = field(default_factory=dict)
    """Topic -> number of messages missing between the first and the last one received."""
    dropped: int = 0
    """Messages received, but not shown because rerun took nothing."""
    refused: int = 0
    """Messages that were refused."""
    thinned: int = 0
    """Rows left out because they would not be visible."""

    def __str__(self) -> str:
        missing = sum(self.lost.values()) + self.dropped
        refused = f", {self.refused} refused" if self.refused else ""
        return f"{self.ended}; {counted(self.messages, 'message')} shown, {missing or 'none'} dropped{refused}"


def view(
    run: str | None = None,
    *,
    web: bool = False,
    save: Path | str | None = None,
    wait: float = 10.0,
    trust: bool = False,
    name: str = "viewer",
    ticket: Path | None = None,
    say: Callable[[str], object] = print,
) -> Viewing:
    """Show a live run, by default the only one, until it ends; wait at most `wait` seconds for it to start.

    It is shown in a window, or with `web` on a browser page whose address is printed, with `save` in a file (.rrd).
    `ticket`: of a run on another host. `trust` allows to run the code of parts from files that the run contains. Raises
    rig.errors.Untrusted for such parts without it, BusError without a run, UsageError without a display, OutputError
    for a file that cannot be written.
    """
    stand_back(_NICE)
    with bus.join(run, role="viewer", name=name, wait=wait, ticket=ticket) as session:
        bridge = Bridge(session, wait, trust)
        with viewer.sink(session.run, bridge.drawing, until=None, save=save, web=web) as (rec, shown):
            if shown is not None and shown.page:
                say(f"live at {shown.page}\n{viewer.OPEN_TO}")
            session.announce()
            with stopping() as stop:
                viewing = bridge.run(rec, stop, lambda: shown is None or shown.alive)
    say(str(viewing))
    return viewing


def fetched(session: Session, wait: float, trust: bool) -> Setup:
    """The description of a run, whose models are then at hand; `trust`: and whose parts from files may be run."""
    described = run_setup.fetch(session, wait)
    for model in described.models:
        model_store.offer(model)
    if trust:
        trust_scene(described.scene)
    return described


class Bridge:
    """Transfers messages from a session of the bus to a recording stream of rerun."""

    def __init__(self, session: Session, wait: float = 10.0, trust: bool = False) -> None:
        self._session = session
        self.heard: Receiver = session.subscribe(*TOPICS, depth=DEPTH, polled=True)
        self._plant: Watch = session.watch("plant/*")
        described = fetched(session, wait, trust)
        if not self._plant.wait_for("plant", "plant", wait):
            raise BusError(f"run {session.run} has no plant; it has ended")
        sensors = {name: unit for name, (unit, _) in described.sensors.items()}
        self.drawing = Drawing(described.scene, described.outputs, sensors)
        self.feed = Feed(self.drawing, described)

    def run(
        self, rec: rr.RecordingStream, stop: threading.Event, watched: Callable[[], bool] = lambda: True
    ) -> Viewing:
        """Send to `rec` until the plant leaves, `stop` is set, or `watched()` is false."""
        self.drawing.static(rec)
        sender = Sender(rec)
        # a plant that hangs may come back while the session goes on
        while not stop.is_set() and self._session.goes_on(self._plant) and watched() and not sender.fault:
            self.listen()
            if sender.free:
                sender.offer(self.feed.take(self.heard.lost))
            stop.wait(PAUSE_S)
        stopped = stop.is_set()
        patience = 0.0 if stopped or not watched() else _LAST_WORDS_S
        quiet = time.monotonic() + patience
        while time.monotonic() < quiet:  # presence changes arrive before data: the last messages are on their way
            time.sleep(0.05)
            self.listen()
        sender.finish(self.feed.take(self.heard.lost))
        if stopped:
            ended = "told to stop"
        elif not watched():
            ended = "the window was closed"
        else:
            ended = self._session.gone or "the plant left"
        counts = self.heard.counts
        return Viewing(
            run=self._session.run,
            ended=sender.fault or ended,
            messages=sum(count.received for count in counts.values()),
            lost={topic: count.lost for topic, count in counts.items() if count.lost},
            dropped=self.feed.dropped,
            refused=self._session.inbound.total,
            thinned=self.feed.thinned,
        )

    def listen(self) -> None:
        """Collect the messages that have arrived."""
        arrived = self.heard.drain()
        for message in arrived:
            if message.topic == "total/plant":  # the plant collects the totals of all processes
                self._session.publisher(f"total/{self._session.name}").put(self._session.totals(), message.t_ns)
        self.feed.add(message for message in arrived if not message.topic.startswith("total/"))


class Sender:
    """A thread that gives batches to rerun, since rerun may block for as long as its viewer hangs."""

    def __init__(self, rec: rr.RecordingStream) -> None:
        self._rec = rec
        self._batches: queue.Queue[list[Columns] | None] = queue.Queue(maxsize=1)
        self._idle = threading.Event()
        self._idle.set()
        self.fault = ""
        """Why nothing can be sent any more; "" if it can."""
        self._thread = threading.Thread(target=self._work, name="rerun", daemon=True)
        self._thread.start()

    @property
    def free(self) -> bool:
        """Whether the last batch has been sent."""
        return self._idle.is_set()

    def offer(self, batch: list[Columns]) -> None:
        """Send a batch; only while `free`."""
        self._idle.clear()
        self._batches.put(batch)

    def finish(self, batch: list[Columns]) -> None:
        """Send a last batch and wait at most 0.5 s until everything is sent."""
        deadline = time.monotonic() + _LEAVING_S
        if self._idle.wait(_LEAVING_S):
            self.offer(batch)
            self._batches.put(None)
        self._thread.join(max(deadline - time.monotonic(), 0.0))

    def _work(self) -> None:
        while (batch := self._batches.get()) is not None:
            try:
                send(self._rec, batch)
            except Exception as fault:  # any exception of rerun: the run does not depend on it
                self.fault = f"rerun failed: {fault}"
            self._idle.set()
        with suppress(Exception):
            self._rec.flush(timeout_sec=_LEAVING_S)
