"""The link to a board: frames over a serial port or UDP. docs/device.md documents the frame for a board.

A frame is little-endian: version, kind, number of values, bytes of a value (4 or 8), sequence (uint32), simulated time
[ns] (int64), values. A board answers each frame once and repeats sequence and time; a sequence that comes again gets
the same answer from memory. UDP: a datagram is a frame. Serial: frame and CRC-32, by COBS (consistent overhead byte
stuffing) without a zero byte, then one zero byte.

    line = Line(Address.read("udp:192.168.7.2:5005"), "float64", answers=1)
    line.open()
    answer = line.ask(STEP, t_ns, (0.1,), patience_s=0.0008)
"""

from __future__ import annotations

import errno
import os
import select
import socket
import stat
import struct
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from glob import glob
from math import inf
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from rig.errors import DeviceError
from rig.machine.files import take

try:
    import termios
except ImportError:  # Windows has no terminals of this kind
    termios = None  # type: ignore[assignment]

VERSION = 0x71
STEP = 1
START = 2
"""A step before which the law begins anew: the first one, and the one after a reset of the board."""
ECHO = 3
"""Repeats the values and drives nothing."""
ACT = 0x11
UNSTARTED = 0x12
"""The answer to a step of a board whose law was never started: it was reset."""
ECHOED = 0x13
MEASURED = 0x14
"""The values of a stream, which the board sends on its own."""
HEAD = struct.Struct("<BBBBIq")
CRC = struct.Struct("<I")
WIDTHS = {"float32": 4, "float64": 8}
LETTERS = {4: "f", 8: "d"}
MOST = 24
"""Most values of a frame: with them it is shorter than 254 bytes, up to which COBS needs one byte only."""
MOST_BYTES = 256
"""Longest rest of a frame that is kept until its end arrives."""
BOOT_S = 3.0
"""Longest wait for the first frame after a port was opened [s]. # chosen: this resets an Arduino, which takes 2 s"""
REOPEN_S = 0.2
"""Time between two attempts to open a port that is gone [s]."""
BITS = 10
"""Bits that a UART sends for a byte: start, eight of data, stop."""
# Wait until a frame is sent again when the answer is waited for [s]; doubled each time up to the second value. chosen
AGAIN_S, AGAIN_MOST_S = 0.01, 0.5
COUNTED = ("asked", "again", "missed", "damaged", "other", "unfit", "resets", "opened")
"""Names of the counts of a `Line`."""


class Frame(NamedTuple):
    """A frame, without its version. `t_ns`: simulated time [ns]; `values` in SI units."""

    kind: int
    sequence: int
    t_ns: int
    values: tuple[float, ...]
    width: int = 8

    def to_bytes(self) -> bytes:
        """The frame as bytes."""
        head = HEAD.pack(VERSION, self.kind, len(self.values), self.width, self.sequence, self.t_ns)
        return head + struct.pack(f"<{len(self.values)}{LETTERS[self.width]}", *self.values)

    @classmethod
    def from_bytes(cls, data: bytes) -> Frame | None:
        """The frame that these bytes are; None if they are none."""
        if len(data) < HEAD.size:
            return None
        version, kind, count, width, sequence, t_ns = HEAD.unpack_from(data)
        if version != VERSION or width not in LETTERS or len(data) != HEAD.size + count * width:
            return None
        values = struct.unpack_from(f"<{count}{LETTERS[width]}", data, HEAD.size)
        return cls(kind, sequence, t_ns, values, width)


def stuffed(data: bytes) -> bytes:
    """Frame and CRC-32 as a serial port carries them, with the zero byte at the end; `data`: at most 249 bytes."""
    whole = data + CRC.pack(zlib.crc32(data))
    return b"".join([bytes((len(part) + 1,)) + part for part in whole.split(b"\0")]) + b"\0"


def unstuffed(data: bytes) -> bytes:
    """The frame of `stuffed` without its zero byte; empty if it is damaged."""
    whole = bytearray()
    at = 0
    while at < len(data):
        code = data[at]
        if not code:
            return b""
        whole += data[at + 1 : at + code]
        at += code
        whole += b"\0"
    del whole[-1:]
    if at != len(data) or len(whole) < CRC.size:
        return b""
    frame = bytes(whole[: -CRC.size])
    return frame if CRC.pack(zlib.crc32(frame)) == whole[-CRC.size :] else b""


def line_bytes(values: int, width: int) -> int:
    """Bytes on a serial line for a frame with this number of values: head, values, CRC, COBS, zero."""
    return HEAD.size + values * width + CRC.size + 2


class Address(NamedTuple):
    """Where a board is: kind ("serial" or "udp"), path or host, and for UDP the port number."""

    kind: str
    where: str
    number: int = 0

    @classmethod
    def read(cls, text: str) -> Address:
        """The address that a text states. Raises ValueError."""
        kind, _, where = text.partition(":")
        if kind == "serial" and where.startswith("/"):
            return cls(kind, where)
        host, _, number = where.rpartition(":")
        if kind == "udp" and host and number.isascii() and number.isdigit() and 0 < int(number) < 65535:
            return cls(kind, host, int(number))
        raise ValueError('expected "serial:/dev/ttyACM0" or "udp:HOST:PORT", with a port number from 1 to 65534')

    def __str__(self) -> str:
        return f"{self.kind}:{self.where}" + (f":{self.number}" if self.kind == "udp" else "")

    @property
    def device(self) -> Path:
        """The file of a serial port, with all links followed."""
        return Path(self.where).resolve()

    @property
    def has_rate(self) -> bool:
        """Whether its bytes take the time that the baud rate says; a CDC port ignores it."""
        return self.kind == "serial" and not self.device.name.startswith("ttyACM")

    def check(self) -> None:
        """Raise DeviceError for a serial port that is absent or not allowed, without opening it."""
        if self.kind == "serial":
            device = Path(self.where)
            for number, holds in (
                (errno.ENOENT, device.exists()),
                (errno.EACCES, os.access(device, os.R_OK | os.W_OK)),
            ):
                if not holds:
                    raise DeviceError(f"{self}: {_why_closed(self, OSError(number, ''))}")

    def open(self, baud: int) -> Port:
        """Open the port for this process alone. Raises DeviceError, which says what to do."""
        return SerialPort(self, baud) if self.kind == "serial" else UdpPort(self)


class Port(Protocol):
    """An open port. Its methods raise OSError when the board's end is gone."""

    def send(self, frame: bytes, apart: bool = False) -> None:
        """Send a frame; `apart`: what was sent before may have been cut off."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """The frames that have arrived, waiting at most `timeout_s` for the first bytes; b"" for a damaged one."""

    def close(self) -> None:
        """Close the port."""


class SerialPort:
    """A serial port in raw mode, 8 bits without parity, opened for this process alone."""

    def __init__(self, address: Address, baud: int) -> None:
        if termios is None:
            raise DeviceError(f"{address}: serial ports need Linux or macOS here; use UDP")
        self._rest = b""
        try:
            self._file = os.open(address.where, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise DeviceError(f"{address}: {_why_closed(address, error)}") from None
        try:
            if not take(self._file):
                raise DeviceError(f"{address}: another process has opened it; end this process first")
            _set_raw(self._file, baud)
        except (OSError, termios.error):
            self.close()
            raise DeviceError(f"{address}: is not a serial port; {_known_ports()}") from None
        except DeviceError:
            self.close()
            raise

    def send(self, frame: bytes, apart: bool = False) -> None:
        """See `Port.send`. What does not fit into the buffer of the port is not sent."""
        try:
            os.write(self._file, b"\0" * apart + stuffed(frame))
        except BlockingIOError:  # the board reads nothing
            return

    def receive(self, timeout_s: float) -> list[bytes]:
        """See `Port.receive`."""
        if not select.select([self._file], [], [], max(timeout_s, 0.0))[0]:
            return []
        try:
            got = os.read(self._file, 4096)
        except BlockingIOError:
            return []
        if not got:
            raise OSError(errno.EIO, "the port is gone")
        *ended, rest = (self._rest + got).split(b"\0")
        self._rest = rest[-MOST_BYTES:]
        return [unstuffed(part) for part in ended if part]

    def close(self) -> None:
        """See `Port.close`."""
        os.close(self._file)


def _set_raw(file: int, baud: int) -> None:
    """Set a terminal to plain bytes at this rate. Raises DeviceError for a rate that the system does not know."""
    rate = getattr(termios, f"B{baud}", None)
    if rate is None:
        known = sorted(int(name[1:]) for name in vars(termios) if name[:1] == "B" and name[1:].isdigit())
        raise DeviceError(f"baud = {baud}: the system knows {', '.join(map(str, known[known.index(9600) :]))}")
    settings: list[Any] = termios.tcgetattr(file)
    control = settings[6]
    control[termios.VMIN] = 0
    control[termios.VTIME] = 0
    # without HUPCL the next program that opens the port does not find the board reset by this one
    termios.tcsetattr(
        file, termios.TCSANOW, [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0, rate, rate, control]
    )
    termios.tcflush(file, termios.TCIOFLUSH)


def _why_closed(address: Address, error: OSError) -> str:
    """Why a serial port cannot be opened, and what to do."""
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"there is no such port; {_known_ports()}"
    if error.errno in (errno.EBUSY, errno.EAGAIN):
        return "another program has opened it; end this program first"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"you may not open it; {_right(address.device)}"
    return error.strerror or str(error)


def _right(device: Path) -> str:
    """What gives a user the right to open a port."""
    group = "dialout"
    try:
        import grp

        state = device.stat()
        if state.st_mode & stat.S_IWGRP and state.st_gid:
            group = grp.getgrgid(state.st_gid).gr_name
    except (ImportError, KeyError, OSError):
        pass
    return f"become a member of its group (sudo usermod -aG {group} $USER) and log in again"


def _known_ports() -> str:
    found = sorted([*glob("/dev/ttyACM*"), *glob("/dev/ttyUSB*"), *glob("/dev/cu.usb*")])
    return f"the serial ports here: {', '.join(found) or 'none (is the board connected?)'}"


class UdpPort:
    """A UDP socket that is connected to the board: datagrams of others never arrive. It is bound to the next number.

    Blocks of Simulink and LabVIEW send to a fixed port: that of the board plus one.
    """

    def __init__(self, address: Address) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            host = socket.gethostbyname(address.where)
            self._socket.bind((_own_address(host, address.number), address.number + 1))
            self._socket.connect((host, address.number))
        except OSError as error:
            self.close()
            raise DeviceError(f"{address}: {_why_no_udp(address, error)}") from None

    def send(self, frame: bytes, apart: bool = False) -> None:
        """See `Port.send`."""
        try:
            self._socket.send(frame)
        except OSError as error:
            _nobody_there(error)

    def receive(self, timeout_s: float) -> list[bytes]:
        """See `Port.receive`."""
        if not select.select([self._socket], [], [], max(timeout_s, 0.0))[0]:
            return []
        try:
            return [self._socket.recv(2048)]
        except OSError as error:
            _nobody_there(error)
            return []

    def close(self) -> None:
        """See `Port.close`."""
        self._socket.close()


def _own_address(host: str, number: int) -> str:
    """The address of this computer in the network of the board."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((host, number))
        return str(probe.getsockname()[0])


def _nobody_there(error: OSError) -> None:
    """Pass over what the network tells while the board is away; raise `error` if it is something else."""
    away = errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN, errno.ENETDOWN, errno.ENOBUFS
    if error.errno not in away:
        raise error


def _why_no_udp(address: Address, error: OSError) -> str:
    if isinstance(error, socket.gaierror):
        return f"no computer is called {address.where}"
    if error.errno == errno.EADDRINUSE:
        return f"another process uses the port {address.number + 1} of this computer, at which the answers arrive"
    if error.errno == errno.EACCES:
        return f"you may not use the port {address.number + 1} of this computer; choose one above 1023"
    return error.strerror or str(error)


class Line:
    """The port of one board in one process: asks, and counts what is wrong. `answers`: values of an answer.

    COUNTED   asked      frames that were sent, repeated ones not counted
              again      frames that were sent again
              missed     frames without an answer
              damaged    received: no frame, or CRC, length or version is wrong
              other      received: another sequence or time (late, doubled, foreign)
              unfit      received: another number of values, or of another kind or width
              resets     answers of a board that was never started
              opened     how often the port was opened
    """

    def __init__(self, address: Address, values: str, answers: int, baud: int = 115200) -> None:
        self.address = address
        self.counts: Counter[str] = Counter(dict.fromkeys(COUNTED, 0))
        self.unfit = ""
        """What is wrong with the last answer that does not fit."""
        self._baud = baud
        self._width = WIDTHS[values]
        self._answers = answers
        self._port: Port | None = None
        self._sequence = int.from_bytes(os.urandom(4), "little")
        self._apart = False

    def open(self) -> None:
        """Open the port, if it is not open. Raises DeviceError."""
        if self._port is None:
            self._port = self.address.open(self._baud)
            self.counts["opened"] += 1

    def __del__(self) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def ask(
        self, kind: int, t_ns: int, values: Sequence[float], patience_s: float, again_s: float = inf
    ) -> Frame | None:
        """The answer to a frame; None if none fits within `patience_s`. It is sent again first after `again_s`.

        Raises OSError if the port is closed or its end is gone; it is closed then.
        """
        if self._port is None:
            raise OSError(errno.EIO, "the port is closed")
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        asked = Frame(kind, self._sequence, t_ns, tuple(values), self._width)
        data = asked.to_bytes()
        self.counts["asked"] += 1
        try:
            answer = self._exchanged(self._port, asked, data, patience_s, again_s)
        except OSError:
            self.close()
            self.counts["missed"] += 1
            raise
        if answer is None:
            self.counts["missed"] += 1
        elif answer.kind == UNSTARTED:
            self.counts["resets"] += 1
        self._apart = answer is None
        return answer

    def _exchanged(self, port: Port, asked: Frame, data: bytes, patience_s: float, again_s: float) -> Frame | None:
        now = time.perf_counter()
        end = now + patience_s
        port.send(data, self._apart)
        again = now + again_s
        while now < end:
            if now >= again:
                port.send(data, True)
                self.counts["again"] += 1
                again_s = min(2.0 * again_s, AGAIN_MOST_S)
                again = now + again_s
            fitting = [self._fitting(received, asked) for received in port.receive(min(end, again) - now)]
            answers = [frame for frame in fitting if frame is not None]
            if answers:
                self.counts["other"] += len(answers) - 1
                return answers[0]
            now = time.perf_counter()
        return None

    def _fitting(self, received: bytes, asked: Frame) -> Frame | None:
        """The frame that was received, if it answers what was asked; else it is counted."""
        frame = Frame.from_bytes(received)
        if frame is None:
            self.counts["damaged"] += 1
        elif (frame.sequence, frame.t_ns) != (asked.sequence, asked.t_ns):
            self.counts["other"] += 1
        elif asked.kind == ECHO or frame.kind == UNSTARTED:
            return frame
        elif (frame.kind, frame.width, len(frame.values)) == (ACT, asked.width, self._answers):
            return frame
        else:
            self.counts["unfit"] += 1
            self.unfit = (
                f"an answer is of kind {frame.kind:#x} with {len(frame.values)} values of {frame.width} bytes; "
                f"expected kind {ACT:#x} with {self._answers} of {asked.width} bytes"
            )
        return None
