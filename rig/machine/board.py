"""The link to a board: frames over a serial port or UDP. docs/device.md documents the frame for a board.

A frame is little-endian: version, kind, number of values, bytes of a value (4 or 8), sequence (uint32), simulated time
[ns] (int64), values. A board answers each frame once and repeats sequence and time; a sequence that comes again gets
the same answer from memory. UDP: a datagram is a frame. Serial: frame and CRC-32, by COBS (consistent overhead byte
stuffing) without a zero byte, then one zero byte.

    line = Line(Address.read("udp:192.168.7.2:5005"), "float64", answers=1)
    line.open()
    answer = line.ask(STEP, t_ns, (0.1,), patience_s=0.0008)

`Link` opens the port of a board, and again when it is gone, and counts what arrives damaged. A `Line` asks the board of
a controller; rig.bench.live.stream_ports has the link to a board that sends its values on its own.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
import sys
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from glob import glob
from io import FileIO
from math import inf
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol

from pydantic import AfterValidator, Field

from rig.errors import DeviceError
from rig.machine.files import take
from rig.printable import counted

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
CRC = 4
"""Bytes of the checksum on a serial line."""
WIDTHS = {"float32": 4, "float64": 8}
LETTERS = {4: "f", 8: "d"}
MOST = 24
"""Most values of a frame: with them it is shorter than 254 bytes, up to which COBS needs one byte only."""
MOST_BYTES = 256
"""Longest rest of a frame that is kept until its end arrives."""
BOOT_S = 3.0
"""Longest wait for the first frame after a port was opened [s]. # chosen: this resets an Arduino, which takes 2 s"""
BOOT_AGAIN_S = 0.05
"""Time until the board is asked again while it starts [s]."""
REOPEN_S = 0.2
"""Time between two attempts to open a port that is gone [s]."""
BITS = 10
"""Bits that a UART sends for a byte: start, eight of data, stop."""
# Wait until a frame is sent again when the answer is waited for [s]; doubled each time up to the second value. chosen
AGAIN_S, AGAIN_MOST_S = 0.01, 0.5
TAKEN = "another process has opened it, a run or a serial monitor; end this process first"
COUNTED = ("asked", "again", "missed", "damaged", "other", "unfit", "resets", "opened")
"""Names of the counts of a `Line`."""
# Most datagrams that are read at once. # chosen: a flood cannot stop its reader, and a backlog is soon over
MOST_AT_ONCE = 64
AWAY = {
    errno.ECONNREFUSED,
    errno.EHOSTUNREACH,
    errno.ENETUNREACH,
    errno.EHOSTDOWN,
    errno.ENETDOWN,
    errno.ENOBUFS,
}
"""What a network tells while a board is away; the port stays open."""


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
    return b"".join([bytes((len(part) + 1,)) + part for part in (data + _crc(data)).split(b"\0")]) + b"\0"


def unstuffed(data: bytes) -> bytes:
    """The frame of `stuffed` without its zero byte; empty if it is damaged."""
    parts = []
    at = 0
    while at < len(data) and data[at]:
        parts.append(data[at + 1 : at + data[at]])
        at += data[at]
    whole = b"\0".join(parts)
    frame = whole[:-CRC]
    return frame if at == len(data) and whole[-CRC:] == _crc(frame) else b""


def _crc(data: bytes) -> bytes:
    return zlib.crc32(data).to_bytes(CRC, "little")


def line_bytes(values: int, width: int) -> int:
    """Bytes on a serial line for a frame with this number of values: head, values, CRC, COBS, zero."""
    return HEAD.size + values * width + CRC + 2


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
        if self.kind == "serial" and not os.access(self.where, os.R_OK | os.W_OK):
            number = errno.EACCES if self.device.exists() else errno.ENOENT
            raise DeviceError(f"{self}: {_why_closed(self, OSError(number, ''))}")

    def open(self, baud: int) -> Port:
        """Open the port for this process alone. Raises DeviceError, which says what to do."""
        return _opened_serial(self, baud) if self.kind == "serial" else _opened_udp(self)


PortName = Annotated[str, AfterValidator(lambda text: str(Address.read(text)))]
"""The key of a scene that states an address."""
Baud = Annotated[int, Field(gt=0)]
"""The key of a scene that states the rate of a serial port [1/s]."""
BAUD = 115200
"""Its default. # chosen: that of most boards"""


class Port(Protocol):
    """An open port. Its methods raise OSError when the board's end is gone."""

    def send(self, frame: bytes, apart: bool = False) -> None:
        """Send a frame; `apart`: what was sent before may have been cut off."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """The frames that have arrived, waiting at most `timeout_s` for the first bytes; b"" for a damaged one."""

    def close(self) -> None:
        """Close the port."""


class SerialPort:
    """Frames through an open serial port, or one end of a pseudo terminal."""

    def __init__(self, file: FileIO) -> None:
        self._file = file
        self._rest = b""

    def write(self, data: bytes) -> None:
        """Send bytes as they are. Those that do not fit into the buffer of the port are not sent."""
        self._file.write(data)

    def send(self, frame: bytes, apart: bool = False) -> None:
        """See `Port.send`."""
        self.write(b"\0" * apart + stuffed(frame))

    def receive(self, timeout_s: float) -> list[bytes]:
        """See `Port.receive`."""
        if not select.select([self._file], [], [], max(timeout_s, 0.0))[0]:
            return []
        got = self._file.read(4096)
        if got == b"":
            raise OSError(errno.EIO, "the port is gone")
        *ended, rest = (self._rest + (got or b"")).split(b"\0")
        self._rest = rest[-MOST_BYTES:]
        return [unstuffed(part) for part in ended if part]

    def close(self) -> None:
        """See `Port.close`."""
        self._file.close()


def _opened_serial(address: Address, baud: int) -> SerialPort:
    """The port in raw mode, 8 bits without parity, for this process alone. Raises DeviceError."""
    if termios is None:
        raise DeviceError(f"{address}: serial ports need Linux or macOS here; use UDP")
    try:
        with ExitStack() as opened:
            file = opened.enter_context(FileIO(address.where, "r+", opener=_without_waiting))
            if not take(file):
                raise OSError(errno.EBUSY, "")
            _set_raw(file, address, baud)
            opened.pop_all()
    except termios.error:
        raise DeviceError(f"{address}: is not a serial port; {_known_ports()}") from None
    except OSError as error:
        raise DeviceError(f"{address}: {_why_closed(address, error)}") from None
    return SerialPort(file)


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOCTTY | os.O_NONBLOCK)


def _set_raw(file: FileIO, address: Address, baud: int) -> None:
    """Set a terminal to plain bytes at this rate. Raises DeviceError for a rate that the system does not know."""
    rate = getattr(termios, f"B{baud}", None)
    if not rate:  # B0 hangs up
        known = sorted(int(name[1:]) for name in vars(termios) if name[:1] == "B" and name[1:].isdigit())
        raise DeviceError(
            f"{address}: baud is {baud}; the system knows {', '.join(map(str, known[known.index(9600) :]))}"
        )
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
    absent = f"there is no such port; {_known_ports()}"
    forbidden = f"you may not open it; become a member of its group (sudo usermod -aG {_group(address)} $USER) and log "
    forbidden += "in again"
    told = {errno.EACCES: forbidden, errno.EPERM: forbidden, errno.EBUSY: TAKEN, errno.EAGAIN: TAKEN}
    told |= dict.fromkeys((errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EISDIR), absent)
    return told.get(error.errno or 0) or error.strerror or str(error)


def _group(address: Address) -> str:
    """The group whose members may open a serial port."""
    group = "root"
    with suppress(KeyError, OSError, NotImplementedError):
        group = address.device.group()
    return "dialout" if group == "root" else group


def _known_ports() -> str:
    found = sorted([*glob("/dev/ttyACM*"), *glob("/dev/ttyUSB*"), *glob("/dev/cu.usb*")])
    return f"the serial ports here: {', '.join(found) or 'none (is the board connected?)'}"


class UdpPort:
    """A UDP socket from an address of this computer to another one: datagrams of others never arrive.

    `shared`: other sockets of this kind may have the same address here, each for another one there.
    """

    def __init__(self, here: tuple[str, int], there: tuple[str, int], shared: bool = False) -> None:
        with ExitStack() as opened:
            self._socket = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            if shared and sys.platform == "linux":
                opened.enter_context(_alone(there))
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind(here)
            self._socket.connect(there)
            self._socket.setblocking(False)
            self._opened = opened.pop_all()

    def send(self, frame: bytes, apart: bool = False) -> None:
        """See `Port.send`."""
        self._socket.send(frame)

    def receive(self, timeout_s: float) -> list[bytes]:
        """See `Port.receive`."""
        received: list[bytes] = []
        if select.select([self._socket], [], [], max(timeout_s, 0.0))[0]:
            with suppress(BlockingIOError):
                while len(received) < MOST_AT_ONCE:
                    received.append(self._socket.recv(2048))
        return received

    @property
    def sender_core(self) -> int:
        """The core on which a program of this computer sent the last frame (Linux); -1 if that is not known."""
        with suppress(AttributeError, OSError):
            return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_INCOMING_CPU)
        return -1

    def close(self) -> None:
        """See `Port.close`."""
        self._opened.close()


def _alone(there: tuple[str, int]) -> socket.socket:
    """What one process of this computer can have at a time, until it ends: the name of a board. Raises OSError."""
    name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        name.bind(f"\0friction-rig board {there[0]}:{there[1]}")
    except OSError:
        name.close()
        raise OSError(errno.EBUSY, "") from None
    return name


def _opened_udp(address: Address) -> UdpPort:
    """A port that is bound to the number after that of the board. Raises DeviceError.

    Blocks of Simulink and LabVIEW send to a fixed port number.
    """
    number = address.number + 1
    try:
        host = socket.gethostbyname(address.where)
        return UdpPort((_own_address(host), number), (host, address.number), shared=True)
    except (socket.gaierror, UnicodeError):
        raise DeviceError(f"{address}: no computer is called {address.where}") from None
    except OSError as error:
        told = {
            errno.EBUSY: TAKEN,
            errno.EADDRINUSE: f"another process uses the port {number} of this computer, at which the answers arrive",
            errno.EACCES: f"you may not use the port {number} of this computer; choose one above 1023",
        }
        raise DeviceError(f"{address}: {told.get(error.errno or 0) or error.strerror}") from None


def _own_address(host: str) -> str:
    """The address of this computer in the network of the board."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((host, 9))
        return str(probe.getsockname()[0])


class Link:
    """The port of one board in one process. `counted`: names of its `counts`.

    `unfit`: what is wrong with the last frame that is whole and cannot be used.
    """

    def __init__(self, address: Address, baud: int, counted: Sequence[str]) -> None:
        self.address = address
        self.counts: Counter[str] = Counter(dict.fromkeys(counted, 0))
        self.unfit = ""
        self._baud = baud
        self._port: Port | None = None
        self._tried = -inf

    def __del__(self) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def open(self) -> None:
        """Open the port. Raises DeviceError."""
        self._tried = time.perf_counter()
        self._port = self.address.open(self._baud)

    def close(self) -> None:
        """Close the port, if it is open."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def send(self, frame: bytes, apart: bool = False) -> None:
        """Send a frame, if the port is open; see `Port.send`."""
        try:
            if self._port is not None:
                self._port.send(frame, apart)
        except OSError as error:
            self._fail(error)

    def frames(self, timeout_s: float) -> list[Frame]:
        """The frames that have arrived, waiting at most `timeout_s`. A port that is gone is opened again."""
        received = []
        if self._port is None and time.perf_counter() - self._tried >= REOPEN_S:
            with suppress(DeviceError):
                self.open()
        try:
            if self._port is None:
                time.sleep(min(timeout_s, AGAIN_S))
            else:
                received = self._port.receive(timeout_s)
        except OSError as error:
            self._fail(error)
        frames = [frame for frame in map(Frame.from_bytes, received) if frame is not None]
        self.counts["damaged"] += len(received) - len(frames)
        return frames

    def _fail(self, error: OSError) -> None:
        if error.errno not in AWAY:
            self.close()

    @property
    def received(self) -> str:
        """What arrived in vain, as the end of a sentence."""
        nouns = {"damaged": "damaged frame", "other": "late, doubled or foreign frame", "unfit": "unfit frame"}
        said = [counted(self.counts[name], noun) for name, noun in nouns.items() if self.counts[name]]
        gone = "" if self.is_open else ", the port is gone"
        return (
            gone
            + (f"; received so far: {', '.join(said)}" if said else "")
            + (f" ({self.unfit})" if self.unfit else "")
        )


class Line(Link):
    """Asks the board of a controller. `answers`: number of values of an answer.

    COUNTED   asked      frames to which an answer was wanted
              again      frames that were sent again
              missed     frames without an answer
              damaged    received: no frame, or CRC, length or version is wrong
              other      received: another sequence or time (late, doubled, foreign)
              unfit      received: another number of values, or of another kind or width
              resets     answers of a board that was never started
              opened     how often the port was opened
    """

    def __init__(self, address: Address, values: str, answers: int, baud: int = BAUD) -> None:
        super().__init__(address, baud, COUNTED)
        self._width = WIDTHS[values]
        self._answers = answers
        self._sequence = int.from_bytes(os.urandom(4), "little")
        self._apart = False

    def open(self) -> None:
        """See `Link.open`."""
        super().open()
        self.counts["opened"] += 1

    def wait(self, values: int) -> None:
        """Open the port and wait for the echo of so many values. Raises DeviceError without one within `BOOT_S`."""
        self.open()
        if self.ask(ECHO, 0, (0.0,) * values, BOOT_S, BOOT_AGAIN_S) is None:
            rate = f" at {self._baud} baud" if self.address.kind == "serial" else ""
            said = self.received
            self.close()
            raise DeviceError(
                f"{self.address}: no answer within {BOOT_S:g} s{rate}{said}; is the board on, and does its program "
                "answer the frames of docs/device.md?"
            )

    def ask(
        self, kind: int, t_ns: int, values: Sequence[float], patience_s: float, again_s: float = inf
    ) -> Frame | None:
        """The answer to a frame; None if none fits within `patience_s`. It is sent again first after `again_s`.

        The wait begins anew if this process was stopped for longer than `patience_s`: in a virtual machine the board's
        program then was, too.
        """
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        asked = Frame(kind, self._sequence, t_ns, tuple(values), self._width)
        data = asked.to_bytes()
        answers: list[Frame] = []
        now = again = time.perf_counter()
        end = now + patience_s
        sent = 0
        while now < end and not answers:
            if now >= again:
                self.send(data, self._apart)
                self._apart = True  # until an answer shows that the board reads whole frames
                sent += 1
                again = now + again_s
                again_s = min(2.0 * again_s, AGAIN_MOST_S)
            answers = [frame for frame in self.frames(min(end, again) - now) if self._fits(frame, asked)]
            now = time.perf_counter()
            if now > end + patience_s:
                end = now + patience_s
        counts = self.counts
        counts["asked"] += 1
        counts["again"] += max(sent - 1, 0)
        counts["other"] += max(len(answers) - 1, 0)
        if not answers:
            counts["missed"] += 1
            return None
        self._apart = False
        counts["resets"] += answers[0].kind == UNSTARTED
        return answers[0]

    def _fits(self, frame: Frame, asked: Frame) -> bool:
        """Whether a frame answers what was asked; else it is counted."""
        if (frame.sequence, frame.t_ns) != (asked.sequence, asked.t_ns):
            self.counts["other"] += 1
            return False
        expected = ACT, asked.width, self._answers
        if asked.kind == ECHO or frame.kind == UNSTARTED or (frame.kind, frame.width, len(frame.values)) == expected:
            return True
        self.counts["unfit"] += 1
        self.unfit = (
            f"an answer is of kind {frame.kind:#x} with {counted(len(frame.values), 'value')} of {frame.width} bytes; "
            f"expected kind {ACT:#x} with {self._answers} of {asked.width}: the keys drives and values"
        )
        return False
