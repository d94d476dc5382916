"""The newest state for every connected page. A slow page loses frames; it delays neither the run nor other pages.

Every page has a slot, not a queue: when it is ready, it gets what is newest then. It is ready when it has acknowledged
all but `AHEAD` of the messages sent to it, so that no late messages wait in the buffers of the connection either.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from rig.view.spans import Spans
from rig.web import plain_json
from rig.web.frames import Frame, missed

KEPT = 6
"""Frames that a page which was busy gets as they are: 0.3 s. So it gets older ones with events; others become one."""
HISTORY = 240
"""Frames for a page that connects, so that it shows what others show already: 12 s."""
COARSE = 2400
"""Frames of which the extremes are kept, for a page that was busy or hidden for so long: 2 min."""
AHEAD = 2
"""Messages that may be on their way to a page. # chosen"""


class Broadcast:
    """The newest message of each kind, and the latest frames; all methods are called in the thread of the loop.

    `history`: frames that a page gets when it connects; `spaced_s`: least time between two messages with frames [s]. A
    message is made once for all pages that have got the same before.
    """

    def __init__(self, history: int = HISTORY, spaced_s: float = 0.0) -> None:
        self._spaced_s = spaced_s
        self._waking = False
        self._released = 0  # version of the newest frame that pages may get
        self._made: dict[int, list[str]] = {}  # version of a page -> messages of the frames since
        self._newest: dict[str, tuple[int, str]] = {}
        self._frames: deque[tuple[int, Frame]] = deque(maxlen=history)
        self._spans: deque[tuple[int, Mapping[str, Spans]]] = deque(maxlen=COARSE)
        self._version = 0
        self._pages: set[Page] = set()

    def connect(self) -> Page:
        """A new page; `disconnect` it at the end."""
        page = Page(self)
        self._pages.add(page)
        return page

    def disconnect(self, page: Page) -> None:
        """A page has gone."""
        self._pages.discard(page)

    def put(self, kind: str, content: Any) -> None:
        """Replace the message of a kind; every page gets the newest one."""
        self._next()
        self._newest[kind] = (self._version, plain_json.text({"kind": kind, kind: content}))
        if kind == "setup":  # frames of another run
            self._frames.clear()
            self._spans.clear()
        self._wake()

    def frame(self, frame: Frame) -> None:
        """Add a frame."""
        self._next()
        self._frames.append((self._version, frame))
        self._spans.append((self._version, frame.spans))
        if not self._spaced_s:
            self._wake()
        elif not self._waking:
            self._waking = True
            asyncio.get_running_loop().call_later(self._spaced_s, self._wake_late)

    def _next(self) -> None:
        self._version += 1
        self._made.clear()

    def since(self, version: int) -> tuple[int, list[str]]:
        """The present version, and the messages other than frames that are newer than `version`."""
        return self._version, [text for number, text in sorted(self._newest.values()) if number > version]

    def frames(self, version: int) -> list[str]:
        """The message of the frames that are newer than `version`, 0 for a new page, if there are any.

        A page that was too slow gets the latest `KEPT` frames and those with events, and coarse ones for the others.
        """
        if version >= self._released:  # an acknowledgement, and not the time for the next message
            return []
        if version not in self._made:
            self._made[version] = self._frames_since(version)
        return self._made[version]

    def _frames_since(self, version: int) -> list[str]:
        new = [(number, frame) for number, frame in self._frames if number > version]
        old = len(new) - KEPT if version else 0
        texts = []
        before = version
        for place, (number, frame) in enumerate(new):
            if place < old and not frame.events:
                continue
            left_out = [spans for of, spans in self._spans if before < of < number] if version else []
            if left_out:
                texts.append(missed(left_out))
            texts.append(frame.text)
            before = number
        return [f'{{"kind": "frames", "frames": [{", ".join(texts)}]}}'] if texts else []

    def _wake_late(self) -> None:
        self._waking = False
        self._wake()

    def _wake(self) -> None:
        self._released = self._version
        for page in self._pages:
            page.kick.set()


class Page:
    """One connected page."""

    def __init__(self, broadcast: Broadcast) -> None:
        self.kick = asyncio.Event()
        self.kick.set()
        self._broadcast = broadcast
        self._version = self._drawn = 0
        self._sent = self._acknowledged = 0
        self._hidden = False

    def heard(self, text: str) -> None:
        """A message of the page: {"ack": number of messages received} or {"hidden": whether it is}; others: ignored."""
        with suppress(ValueError, RecursionError):
            said = json.loads(text)
            if isinstance(said, dict):
                ack = said.get("ack")
                if isinstance(ack, int):
                    self._acknowledged = min(ack, self._sent)
                self._hidden = bool(said.get("hidden", self._hidden))
                self.kick.set()

    async def next(self) -> list[str]:
        """The messages that the page shall get now; waits until there are some and the page is ready."""
        while True:
            await self.kick.wait()
            self.kick.clear()
            if self._sent - self._acknowledged < AHEAD:
                self._version, newer = self._broadcast.since(self._version)
                if not self._hidden:
                    frames = self._broadcast.frames(self._drawn)
                    newer += frames
                    self._drawn = self._version if frames else self._drawn
                if newer:
                    self._sent += len(newer)
                    return newer
