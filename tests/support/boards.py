"""Boards for tests: stand-ins in a thread, whose answers may be disturbed, and the scene of a controller on one."""

import os
import random
import shutil
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from ports import own_port

from rig import controllers, design, scenes
from rig.controllers.runtime.stand_in import LOOK_S, Board, board_end
from rig.machine.board import MEASURED, Address, Frame, stuffed

ROOT = Path(__file__).parents[2]
RANDOM = random.Random(66)


def garbage(answer):
    return [RANDOM.randbytes(len(answer))]


def half(answer):
    return [answer[: len(answer) // 2]]


def missing(answer):
    return []


def doubled(answer):
    return [answer, answer]


def late(answer):
    time.sleep(0.025)
    return [answer]


FAULTS = {"garbage": garbage, "half": half, "missing": missing, "doubled": doubled, "late": late}
"""What may happen to the bytes of an answer; "other" changes its sequence."""


def board_port():
    """The address of a UDP port that is free, as is the next one."""
    return f"udp:127.0.0.1:{own_port(2)}"


def on_board(base, port, name="nf", changes=None, **keys):
    """The scene `base` whose controller `name` runs on a board, and that controller without one."""
    given = scenes.load(base, changes)
    section = given.controllers[name]
    whose = f"controllers.{name}."
    rest = {key: value for key, value in (changes or {}).items() if not key.startswith(whose)}
    stated = {key.removeprefix(whose) for key in scenes.load(base).origins if key.startswith(whose)}
    shared = {"kind", "period", "delay"}
    wires = {
        "reads": [*controllers.controller_reads(section).values()],
        "drives": [*controllers.controller_drives(section)],
    }
    table = dict.fromkeys(stated - shared, "none") | {"kind": "device", "port": port} | wires | keys
    made = scenes.load(base, rest | {whose + key: value for key, value in table.items()})
    return made, controllers.restored(design.described(given)[name])


class Disturbed(Board):
    """A board whose answers may have a `fault`, each of number `every`; it answers nothing while `away` is set.

    Its end of the port is gone while `gone` is set. It forgets everything at each frame of number `reset_every`, as
    after a loss of power.
    """

    def __init__(self, controller, fault, every, reset_every):
        super().__init__(controller)
        self.away = threading.Event()
        self.gone = threading.Event()
        self.steps = 0
        """Number of times that the law was called."""
        self.last = 0.0, 0
        """Clock [s] and simulated time [ns] of the last step."""
        self._fault = fault
        self._every = every
        self._reset_every = reset_every
        self._count = 0

    def _stepped(self, frame):
        stepped = super()._stepped(frame)
        self.steps += self._started
        self.last = time.perf_counter(), frame.t_ns
        return stepped

    def sent(self, data, serial):
        """What leaves the board for a frame: bytes of a serial port, or datagrams."""
        if self.away.is_set():
            return []
        self._count += 1
        if self._reset_every and self._count % self._reset_every == 0:
            self._started = False
            self._last = Frame(0, 0, -1, ())
        said = self.answer(data)
        if not said:
            return []
        hit = self._fault is not None and self._count % self._every == 0
        if hit and self._fault == "other":
            frame = Frame.from_bytes(said)
            said = frame._replace(sequence=frame.sequence ^ 1).to_bytes()
        sent = stuffed(said) if serial else said
        return FAULTS[self._fault](sent) if hit and self._fault in FAULTS else [sent]


@contextmanager
def standing_in(port, controller, fault=None, every=50, reset_every=0):
    """A `Disturbed` board at `port` with the law of `controller`, in a thread."""
    board = Disturbed(controller, fault, every, reset_every)
    address = Address.read(port)
    serial = address.kind == "serial"
    ready = threading.Event()
    over = threading.Event()

    def work():
        while not over.is_set():
            with board_end(address) as end:
                ready.set()
                while not (over.is_set() or board.gone.is_set()):
                    with suppress(ConnectionError):  # whoever asked has left
                        for data in end.receive(LOOK_S):
                            for sent in board.sent(data, serial):
                                end.write(sent) if serial else end.send(sent)
            while board.gone.is_set():
                time.sleep(0.001)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(5.0)
    try:
        yield board
    finally:
        over.set()
        thread.join()


def in_c(folder, source="board_on_host.c", law="normal_force.c"):
    """A program of a board in C or C++, compiled for this computer."""
    compiler, standard = ("g++", "gnu++11") if source.endswith(".cpp") else ("gcc", "gnu11")
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed: the program of a board is not tested")
    made = folder / "program"
    shutil.copy(ROOT / "docs" / "device" / "normal_force.c", folder / "normal_force.h")  # as the sketch wants it
    warned = ["-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-ffp-contract=off", "-O2", f"-std={standard}"]
    where = ["-I", str(ROOT / "docs" / "device"), "-I", str(folder), f'-DLAW="{law}"']
    file = str(ROOT / "tests" / "support" / source)
    subprocess.run([compiler, *warned, *where, file, "-o", str(made)], check=True, timeout=60)
    return made


@contextmanager
def program(*command):
    """A program that answers frames, from its "ready" on."""
    child = subprocess.Popen([*map(str, command)], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == "ready\n"
        yield child
    finally:
        child.kill()
        child.wait()
        child.stdout.close()


def in_python(port):
    """The board of docs/device/board.py."""
    return program(sys.executable, ROOT / "docs" / "device" / "board.py", port.rpartition(":")[2])


def measured(sequence, *values, width=8):
    """A frame of measured values, as a board sends it on its own."""
    return Frame(MEASURED, sequence, 0, values, width).to_bytes()


class Sender:
    """The board's end of a stream at a port of this computer."""

    def __init__(self, port):
        self.address = Address.read(port)
        self.away = threading.Event()
        """Set: it sends nothing."""
        if self.address.kind == "udp":
            self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._link.bind(("127.0.0.1", self.address.number))
        else:
            self._board, self._port = os.openpty()
            Path(self.address.where).symlink_to(os.ttyname(self._port))

    def send(self, frame, to=None):
        """Send a frame; `to`: another UDP port of this computer than the one after its own."""
        if self.address.kind == "udp":
            self._link.sendto(frame, ("127.0.0.1", to or self.address.number + 1))
        else:
            os.write(self._board, stuffed(frame))

    def close(self):
        """Leave."""
        if self.address.kind == "udp":
            self._link.close()
        else:
            os.close(self._board)
            os.close(self._port)


@contextmanager
def streaming(port, values, period_s=0.001):
    """A board that sends the frame of `values(number)` every `period_s`, in a thread."""
    sender = Sender(port)
    over = threading.Event()

    def work():
        number = 0
        while not over.wait(period_s):
            number += 1
            if not sender.away.is_set():
                sender.send(measured(number, *values(number)))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield sender
    finally:
        over.set()
        thread.join()
        sender.close()
