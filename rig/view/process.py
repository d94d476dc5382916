"""The viewer's bridge as a process: listens on the bus of a run and feeds rerun, a dozen times per second.

It only listens: no publisher ever waits for it. A thread hands each batch to rerun; while rerun is slow or hangs,
messages are collected, then dropped, and counted. It ends when the plant goes, when the window is closed, or with
a signal to stop, within a second or two whatever rerun does. What becomes of the window: `rig.view.viewer`.
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
from rig.errors import BusError
from rig.parts import trust_scene
from rig.plants.structures import model_store
from rig.process import stopping
from rig.scheduling import stand_back
from rig.view import viewer
from rig.view.drawing import Drawing, send
from rig.view.feed import Feed
from rig.view.shapes import Columns

if TYPE_CHECKING:
    import rerun as rr

PAUSE_S = 0.08
TOPICS = ("state", "meas/*", "applied/*", "health", "event/*", "total/plant")
_DEPTH = 1024
_NICE = 5
_LAST_WORDS_S = 0.3
_LEAVING_S = 0.5


@dataclass(frozen=True)
class Viewing:
    """What became of it."""

    run: str
    ended: str
    messages: int
    """Received."""
    lost: dict[str, int] = field(default_factory=dict)
    """By topic: missing between the first message received and the last."""
    dropped: int = 0
    """Received, but not shown because rerun took nothing."""
    refused: int = 0
    """Messages that were not let in."""
    thinned: int = 0
    """Rows that were left out because nobody could see them."""

    def __str__(self) -> str:
        missing = sum(self.lost.values()) + self.dropped
        refused = f", {self.refused} refused" if self.refused else ""
        return f"{self.ended}; {self.messages} messages shown, {missing or 'none'} dropped{refused}"


def view(
    run: str | None = None,
    *,
    web: bool = False,
    connect: str | None = None,
    save: Path | str | None = None,
    headless: bool = False,
    wait: float = 10.0,
    trust: bool = False,
    name: str = "viewer",
    say: Callable[[str], object] = print,
) -> Viewing:
    """Show a live run, the newest by default, until it ends; waits at most `wait` seconds for it.

    In a window; `web`: in a browser page whose address is said; `connect`: in a viewer that runs already, by its
    address; `save`: in a file (.rrd); `headless`: off screen. `trust`: run the code of parts from files that the run
    carries. Raises rig.errors.Untrusted for such parts without it, BusError without a run, UsageError without a
    display, LogError for a file that cannot be written.
    """
    stand_back(_NICE)
    with bus.join(run, role="viewer", name=name, wait=wait) as session:
        bridge = Bridge(session, wait, trust)
        target = viewer.sink(
            session.run, bridge.drawing, live=True, save=save, web=web, connect=connect, headless=headless
        )
        with target as (rec, shown):
            if shown is not None and shown.page:
                say(f"live at {shown.page}\n{viewer.OPEN_TO}")
            session.announce()
            with stopping() as stop:
                viewing = bridge.run(rec, stop, lambda: shown is None or shown.alive)
    say(str(viewing))
    return viewing


class Bridge:
    """Between a session on the bus and a stream of rerun."""

    def __init__(self, session: Session, wait: float = 10.0, trust: bool = False) -> None:
        self._session = session
        self.heard: Receiver = session.subscribe(*TOPICS, depth=_DEPTH, polled=True)
        self._plant: Watch = session.watch("plant/*")
        described = run_setup.fetch(session, wait)
        if not self._plant.wait_for("plant", "plant", wait):
            raise BusError(f"run {session.run} has no plant; it has ended")
        for model in described.models:
            model_store.offer(model)
        if trust:
            trust_scene(described.scene)
        sensors = {name: unit for name, (unit, _) in described.sensors.items()}
        self.drawing = Drawing(described.scene, described.outputs, sensors)
        self.feed = Feed(self.drawing, described)

    @property
    def lost(self) -> int:
        """Messages that did not arrive."""
        return self.heard.lost

    def run(
        self, rec: rr.RecordingStream, stop: threading.Event, watched: Callable[[], bool] = lambda: True
    ) -> Viewing:
        """Feed `rec` until the plant leaves, `stop` is set, or nobody is watching any more."""
        self.drawing.static(rec)
        sender = Sender(rec)
        while not stop.is_set() and self._goes_on() and watched() and not sender.fault:
            self.listen()
            if sender.free:
                sender.offer(self.feed.take(self.lost))
            stop.wait(PAUSE_S)
            self._plant.poll()
        told = stop.is_set()
        quiet = time.monotonic() + (0.0 if told or not watched() else _LAST_WORDS_S)
        while time.monotonic() < quiet:  # presence is told faster than data: the last words are on their way
            time.sleep(0.05)
            self.listen()
        sender.finish(self.feed.take(self.lost))
        ended = "told to stop" if told else "the window was closed" if not watched() else "the plant left"
        counts = self.heard.counts
        return Viewing(
            run=self._session.run,
            ended=sender.fault or ended,
            messages=sum(count.received for count in counts.values()),
            lost={topic: count.lost for topic, count in counts.items() if count.lost},
            dropped=self.feed.dropped,
            refused=self._session.door.total,
            thinned=self.feed.thinned,
        )

    def _goes_on(self) -> bool:
        """Whether the plant is here, or hangs and may come back."""
        return ("plant", "plant") in self._plant.present or not self._session.ended

    def listen(self) -> None:
        """Take in what has arrived."""
        arrived = self.heard.drain()
        for message in arrived:
            if message.topic == "total/plant":  # the plant accounts for what everybody got
                own = f"total/{self._session.name}"
                self._session.publisher(own).put(self._session.totals(), message.t_ns)
        self.feed.add(message for message in arrived if not message.topic.startswith("total/"))


class Sender:
    """The thread that hands batches to rerun, which may block for as long as its viewer hangs."""

    def __init__(self, rec: rr.RecordingStream) -> None:
        self._rec = rec
        self._batches: queue.Queue[list[Columns] | None] = queue.Queue(maxsize=1)
        self._idle = threading.Event()
        self._idle.set()
        self.fault = ""
        """Why nothing can be sent any more."""
        self._thread = threading.Thread(target=self._work, name="rerun", daemon=True)
        self._thread.start()

    @property
    def free(self) -> bool:
        """Whether the last batch has gone out."""
        return self._idle.is_set()

    def offer(self, batch: list[Columns]) -> None:
        """Send a batch; only while `free`."""
        self._idle.clear()
        self._batches.put(batch)

    def finish(self, batch: list[Columns]) -> None:
        """Send a last batch, and wait a moment for all to arrive."""
        deadline = time.monotonic() + _LEAVING_S
        if self._idle.wait(_LEAVING_S):
            self.offer(batch)
            self._batches.put(None)
        self._thread.join(max(deadline - time.monotonic(), 0.0))

    def _work(self) -> None:
        while (batch := self._batches.get()) is not None:
            try:
                send(self._rec, batch)
            except Exception as fault:  # whatever rerun raises: the run does not need it
                self.fault = f"rerun failed: {fault}"
            self._idle.set()
        with suppress(Exception):
            self._rec.flush(timeout_sec=_LEAVING_S)
