"""The link to a board: frames through damage, ports that cannot be opened, datagrams of others."""

import os
import random
import socket
import struct
import sys
import threading
import time
import tracemalloc
import tty
from math import inf, nan
from types import SimpleNamespace

import pytest
from boards import board_port
from hypothesis import given
from hypothesis import strategies as st

from rig.controllers.runtime.stand_in import board_end
from rig.errors import DeviceError
from rig.machine import board
from rig.machine.board import ACT, STEP, Address, Frame, Line, UdpPort, stuffed, unstuffed

VALUES = st.lists(st.floats(allow_nan=False), max_size=24).map(tuple)


@given(st.integers(0, 255), st.integers(0, 2**32 - 1), st.integers(-(2**63), 2**63 - 1), VALUES)
def test_a_frame_arrives_as_it_was_sent(kind, sequence, t_ns, values):
    frame = Frame(kind, sequence, t_ns, values)
    sent = stuffed(frame.to_bytes())
    assert sent.count(0) == 1
    assert len(sent) == board.line_bytes(len(values), 8)
    assert Frame.from_bytes(unstuffed(sent[:-1])) == frame


def test_values_that_are_not_finite_arrive_too():
    sent = Frame(STEP, 1, 2, (inf, -inf, nan), 4).to_bytes()
    assert str(Frame.from_bytes(sent).values) == "(inf, -inf, nan)"


@given(st.binary(max_size=300))
def test_bytes_that_are_no_frame_are_none(data):
    assert Frame.from_bytes(unstuffed(data)) is None


@given(st.integers(0, 30), st.integers(1, 255))
def test_a_damaged_byte_is_noticed(place, change):
    sent = bytearray(stuffed(Frame(ACT, 7, 9, (1.5,)).to_bytes())[:-1])
    sent[place % len(sent)] ^= change
    assert not unstuffed(bytes(sent))


class Noise:
    """The board's end of a pseudo terminal that sends whatever it is given, in a thread."""

    def __init__(self, path, sent):
        self._board, self._port = os.openpty()
        tty.setraw(self._port)
        os.set_blocking(self._board, False)
        path.symlink_to(os.ttyname(self._port))
        self._sent = sent
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._send)

    def __enter__(self):
        self._thread.start()
        return self

    def _send(self):
        for block in self._sent:
            while block and not self._over.is_set():
                try:
                    block = block[os.write(self._board, block) :]
                except BlockingIOError:
                    time.sleep(0.001)

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()
        os.close(self._board)
        os.close(self._port)


def test_a_million_random_and_damaged_bytes_give_no_value(tmp_path):
    chance = random.Random(1)

    def blocks():
        for i in range(2000):
            frame = bytearray(stuffed(Frame(ACT, i, 0, (666.0,)).to_bytes()))
            frame[chance.randrange(len(frame) - 1)] ^= chance.randrange(1, 255)
            yield chance.randbytes(470) + bytes(frame)

    line = Line(Address("serial", str(tmp_path / "board")), "float64", 1)
    with Noise(tmp_path / "board", blocks()):
        line.open()
        line.ask(STEP, 0, (0.0,), 0.05)
        tracemalloc.start()
        before = tracemalloc.get_traced_memory()[0]
        asked = 0
        while line.counts["damaged"] < 3500 and asked < 3000:
            assert line.ask(STEP, 0, (0.0,), 0.01) is None
            asked += 1
        grown = tracemalloc.get_traced_memory()[0] - before
        tracemalloc.stop()
        line.close()
    assert line.counts["damaged"] >= 3500
    assert grown < 20_000


def test_datagrams_of_others_never_arrive():
    port = Address.read(board_port())
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign,
    ):
        here.bind((port.where, port.number))
        line = Line(port, "float64", 1)
        line.open()
        for i in range(10_000):
            foreign.sendto(Frame(ACT, i, 0, (666.0,)).to_bytes(), (port.where, port.number + 1))
        assert line.ask(STEP, 0, (0.0,), 0.05) is None
        assert line.counts["other"] == line.counts["damaged"] == 0
        here.settimeout(1.0)
        asked = Frame.from_bytes(here.recv(100))
        reply = threading.Timer(0.02, lambda: _reply(here, port))
        reply.start()
        assert line.ask(STEP, 5, (0.0,), 2.0).values == (3.0,)
        reply.join()
        line.close()
    assert asked.kind == STEP


def _reply(here, port):
    asked = Frame.from_bytes(here.recv(100))
    here.sendto(asked._replace(kind=ACT, values=(3.0,)).to_bytes(), (port.where, port.number + 1))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell where a datagram was sent")
def test_a_stand_in_is_on_the_core_of_the_program_that_asks_it():
    address = Address.read(board_port())
    with board_end(address) as end:
        assert end.sender_core == -1
        line = address.open(115200)
        for core in os.sched_getaffinity(0):
            asking = threading.Thread(target=sent_from, args=(line, core))
            asking.start()
            asking.join()
            assert end.receive(1.0)
            assert end.sender_core == core
        line.close()


def sent_from(line, core):
    os.sched_setaffinity(0, {core})
    line.send(b"frame")


@pytest.mark.skipif(sys.platform != "linux", reason="this computer has one address of its own there")
def test_boards_of_two_computers_may_have_one_port_number_and_each_has_one_run():
    first = Address.read(board_port())
    second = Address("udp", "127.0.0.2", first.number)
    ends = [UdpPort((board.where, board.number), ("127.0.0.1", first.number + 1)) for board in (first, second)]
    lines = [board.open(0) for board in (first, second)]
    with pytest.raises(DeviceError, match=r"localhost:.* another process has opened it"):
        Address("udp", "localhost", first.number).open(0)
    for number, (end, line) in enumerate(zip(ends, lines)):
        line.send(b"asked")
        assert end.receive(1.0) == [b"asked"]
        end.send(bytes([number]))
    assert [line.receive(1.0) for line in lines] == [[b"\0"], [b"\1"]]
    for port in (*ends, *lines):
        port.close()
    first.open(0).close()


def test_a_board_that_is_away_costs_the_patience_and_no_more():
    line = Line(Address.read(board_port()), "float64", 1)
    line.open()
    begun = time.perf_counter()
    for _ in range(10):
        assert line.ask(STEP, 0, (0.0,), 0.01) is None
    assert 0.1 <= time.perf_counter() - begun < 0.5
    assert line.counts["missed"] == 10
    line.close()


def test_a_port_that_cannot_be_opened_says_why(tmp_path, monkeypatch):
    absent = Address("serial", str(tmp_path / "ttyACM0"))
    with pytest.raises(DeviceError, match=r"ttyACM0: there is no such port; the serial ports here: "):
        absent.open(115200)
    (tmp_path / "file").touch()
    with pytest.raises(DeviceError, match="is not a serial port"):
        Address("serial", str(tmp_path / "file")).open(115200)
    with Noise(tmp_path / "board", ()):
        address = Address("serial", str(tmp_path / "board"))
        port = address.open(115200)
        with pytest.raises(DeviceError, match="another process has opened it"):
            address.open(115200)
        port.close()
        with pytest.raises(DeviceError, match=r"board: baud is 123; the system knows 9600, "):
            address.open(123)
        with pytest.raises(DeviceError, match="baud is 0"):  # this rate hangs up
            address.open(0)
    with pytest.raises(DeviceError, match="there is no such port"):
        Address("serial", str(tmp_path)).open(115200)
    here = Address.read(board_port())
    other = UdpPort(("127.0.0.1", here.number + 1), ("127.0.0.1", 9))
    with pytest.raises(DeviceError, match=f"uses the port {here.number + 1} of this computer"):
        here.open(0)
    other.close()
    with pytest.raises(DeviceError, match=r"no computer is called no\.such\.invalid"):
        Address("udp", "no.such.invalid", 5005).open(0)

    def forbidden(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", forbidden)
    with pytest.raises(DeviceError, match=r"you may not open it; .*usermod -aG dialout"):
        absent.open(115200)


@pytest.mark.parametrize("text", ["ttyACM0", "serial:COM3", "udp:5005", "udp:host:0", "udp:host:x", "tcp:host:1", ""])
def test_an_address_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="expected"):
        Address.read(text)


def test_the_layout_is_that_of_the_page():
    sent = Frame(STEP, 0x01020304, 5_000_000, (0.25,)).to_bytes()
    assert sent == bytes([0x71, 1, 1, 8, 4, 3, 2, 1]) + struct.pack("<q", 5_000_000) + struct.pack("<d", 0.25)


def test_a_wait_in_which_this_process_was_stopped_begins_anew(monkeypatch):
    clock = [0.0]

    class Stopped(Line):
        """The first wait takes 10 s instead of 1 s; the answer is there after the second one."""

        def send(self, frame, apart=False):
            self.asked = Frame.from_bytes(frame)

        def frames(self, timeout_s):
            clock[0] += timeout_s if clock[0] else 10.0
            return [self.asked._replace(kind=ACT)] if clock[0] > 10.0 else []

    line = Stopped(Address("udp", "127.0.0.1", 5005), "float64", 1)
    monkeypatch.setattr(board, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    assert line.ask(STEP, 5, (3.0,), 1.0).values == (3.0,)
    assert clock[0] == 11.0
