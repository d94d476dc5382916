"""A stand-in for a board: a process that answers the frames of docs/device.md with the law of a shipped controller.

    python -m rig.controllers.runtime.stand_in udp:127.0.0.1:5005      description of the controller (JSON) on stdin
    python -m rig.controllers.runtime.stand_in serial:/tmp/board       a pseudo terminal with a link to it

It prints "ready" when it answers.
"""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rig import controllers
from rig.controllers.blocks.base import Controller, State
from rig.errors import DeviceError
from rig.machine.board import ACT, ECHO, ECHOED, MOST_BYTES, START, STEP, UNSTARTED, Address, Frame, stuffed, unstuffed
from rig.machine.scheduling import CONTROLLER, ahead, come_first

READY = "ready\n"
"""What it prints when it answers."""


class Board:
    """What the program on a board does with frames; the law is that of `controller`."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._state: State = None
        self.started = False
        self.steps = 0
        """Number of times that the law was called."""
        self._last = Frame(0, 0, -1, ())
        """The last answer."""

    def reset(self) -> None:
        """Forget everything, as after a loss of power."""
        self.started = False
        self._last = Frame(0, 0, -1, ())

    def answer(self, data: bytes) -> bytes:
        """The frame that answers a frame; empty for one that cannot be answered."""
        frame = Frame.from_bytes(data)
        if frame is None:
            return b""
        if frame.kind == ECHO:
            return frame._replace(kind=ECHOED).to_bytes()
        if frame.kind not in (STEP, START) or len(frame.values) != len(self._controller.reads):
            return b""
        if (frame.sequence, frame.t_ns) != self._last[1:3]:
            self._last = self._stepped(frame)
        return self._last.to_bytes()

    def _stepped(self, frame: Frame) -> Frame:
        if frame.kind == START:
            self._state = self._controller.start()
            self.started = True
        if not self.started:
            return frame._replace(kind=UNSTARTED, values=())
        self._state, commands = self._controller.update(self._state, frame.t_ns, frame.values)
        self.steps += 1
        return frame._replace(kind=ACT, values=tuple(commands))


Answer = Callable[[bytes], list[bytes]]
"""Returns what a board sends for a frame: each is a datagram, or bytes of a serial port."""


def serve_udp(number: int, answer: Answer, stopped: Callable[[], bool], host: str = "127.0.0.1") -> None:
    """Answer datagrams at a port of this computer until `stopped()`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind((host, number))
        _ready()
        while not stopped():
            if not select.select([link], [], [], 0.1)[0]:
                continue
            with suppress(ConnectionError):  # whoever asked has left
                data, who = link.recvfrom(2048)
                for frame in answer(data):
                    link.sendto(frame, who)


def serve_serial(path: Path, answer: Answer, stopped: Callable[[], bool]) -> None:
    """Answer frames at a pseudo terminal, to which `path` becomes a link, until `stopped()`."""
    board, port = os.openpty()  # `port` stays open here, so that this end stays in operation when nobody uses it
    path.unlink(missing_ok=True)
    path.symlink_to(os.ttyname(port))
    rest = b""
    try:
        _ready()
        while not stopped():
            if not select.select([board], [], [], 0.1)[0]:
                continue
            *ended, rest = (rest + os.read(board, 4096)).split(b"\0")
            rest = rest[-MOST_BYTES:]
            for part in filter(None, ended):
                for sent in answer(unstuffed(part)):
                    os.write(board, sent)
    finally:
        os.close(board)
        os.close(port)
        path.unlink(missing_ok=True)


def _ready() -> None:
    sys.stdout.write(READY)
    sys.stdout.flush()


@contextmanager
def started(port: str, description: Mapping[str, Any]) -> Iterator[None]:
    """A process of this computer that answers at `port` with a controller by its description, until the block ends.

    Raises DeviceError if it cannot.
    """
    command = [sys.executable, "-m", __name__, port]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(json.dumps(description))
        child.stdin.close()
        try:
            if child.stdout.readline() != READY:
                raise DeviceError(f"{port}: the stand-in for the board cannot answer there")
            yield
        finally:
            child.terminate()


def main() -> None:
    """Serve the controller whose description is on standard input, until this process is ended."""
    address = Address.read(sys.argv[1])
    board = Board(controllers.restored(json.load(sys.stdin)))

    def answer(data: bytes) -> list[bytes]:
        frame = board.answer(data)
        if not frame:
            return []
        return [frame if address.kind == "udp" else stuffed(frame)]

    come_first()
    with ahead(CONTROLLER), suppress(KeyboardInterrupt):
        if address.kind == "udp":
            serve_udp(address.number, answer, lambda: False, address.where)
        else:
            serve_serial(Path(address.where), answer, lambda: False)


if __name__ == "__main__":
    main()
