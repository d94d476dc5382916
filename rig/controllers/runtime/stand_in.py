"""A stand-in for a board: a process that answers the frames of docs/device.md with the law of a shipped controller.

    python -m rig.controllers.runtime.stand_in udp:127.0.0.1:5005      description of the controller (JSON) on stdin
    python -m rig.controllers.runtime.stand_in serial:/tmp/board       a pseudo terminal with a link to it

It tells the process that started it when it answers.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from io import FileIO
from pathlib import Path
from typing import Any

from rig import controllers
from rig.controllers.blocks.base import Controller, State
from rig.errors import DeviceError, ExitCode
from rig.machine.board import ACT, ECHO, ECHOED, START, STEP, UNSTARTED, Address, Frame, SerialPort, UdpPort
from rig.machine.process import Child, as_process, end, no_garbage, tell, with_parent
from rig.machine.scheduling import PLANT, ahead, come_first, locked, stay_on

LOOK_S = 0.1
"""Longest wait for a frame [s]."""
PRIORITY = PLANT + 2
"""Real-time priority: ahead of plant, controllers and their bus threads, because a board does not wait for them."""


class Board:
    """What the program on a board does with frames; the law is that of `controller`."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._state: State = None
        self._started = False
        self._last = Frame(0, 0, -1, ())
        """The last answer."""

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
            self._started = True
        if not self._started:
            return frame._replace(kind=UNSTARTED, values=())
        self._state, commands = self._controller.update(self._state, frame.t_ns, frame.values)
        return frame._replace(kind=ACT, values=tuple(commands))


@contextmanager
def board_end(address: Address) -> Iterator[SerialPort | UdpPort]:
    """The end of a board at an address of this computer, for frames from this computer.

    A serial port is a pseudo terminal, to which its path becomes a link.
    """
    if address.kind == "udp":
        port = UdpPort((address.where, address.number), (address.where, address.number + 1))
        yield port
        port.close()
        return
    board, terminal = os.openpty()
    path = Path(address.where)
    path.unlink(missing_ok=True)
    path.symlink_to(os.ttyname(terminal))
    with FileIO(terminal), FileIO(board, "r+") as file:  # the terminal stays open: the board works when nobody uses it
        yield SerialPort(file)
    path.unlink(missing_ok=True)


@contextmanager
def started(port: str, description: Mapping[str, Any]) -> Iterator[None]:
    """A process of this computer that answers at `port` with a controller by its description, until the block ends.

    Raises DeviceError if it cannot.
    """
    child = Child("the stand-in for the board", [__name__, port], fed=True)
    child.feed(json.dumps(description))
    child.dismiss()
    try:
        while not child.new_words():
            if child.wait(LOOK_S):
                raise DeviceError(f"{port}: {child.ending}")
        yield
    finally:
        end([child], 0.0)


def main() -> int:
    """Serve the controller whose description is on standard input, until this process is ended."""
    board = Board(controllers.restored(json.loads(sys.stdin.readline())))
    come_first()
    with_parent(partial(os._exit, ExitCode.FAILED))
    try:
        with board_end(Address.read(sys.argv[1])) as port, no_garbage(), locked(), ahead(PRIORITY):
            tell("ready")
            while True:
                serve(port, board)
    except OSError as error:
        why = f"it cannot answer there: {error.strerror}"
        if not tell("fault", why):
            sys.stderr.write(f"{why}\n")
        return ExitCode.FAILED


def serve(port: SerialPort | UdpPort, board: Board) -> None:
    """Answer the frames that arrive within `LOOK_S`, on the core of the program that sends them.

    The host of a virtual machine takes single cores for 10 to 30 ms (measured). A board goes on then, and a stand-in on
    another core would not answer a program that waits; on the same core the wait lasts as long for both.
    """
    with suppress(ConnectionError):  # whoever asked has left
        for data in port.receive(LOOK_S):
            if isinstance(port, UdpPort):
                stay_on(port.sender_core)
            answer = board.answer(data)
            if answer:
                port.send(answer)


if __name__ == "__main__":
    as_process(main)
