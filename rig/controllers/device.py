"""A controller on a board: its law runs there, and each step is one frame to the board and one frame back.

docs/device.md documents the frame and has examples for boards. The process of the controller opens the port and no
other one does: in a live run a process of its own, in `rig simulate` that of the simulation. The law on the board has a
memory that nobody else can see, so it advances exactly once a step: it takes part in no rehearsal, trial or study.

In lockstep and in `rig simulate` a step without an answer is asked again for up to `ANSWER_S`; then the run ends. In a
paced run such a step has no answer: the plant holds the last command, then takes safe values.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import field_validator, model_validator

from rig.controllers.blocks.base import ControllerSection, Numbers, OptionalSecond, Values
from rig.errors import DeviceError
from rig.machine.board import (
    AGAIN_S,
    BITS,
    BOOT_S,
    COUNTED,
    ECHO,
    MOST,
    REOPEN_S,
    START,
    STEP,
    UNSTARTED,
    WIDTHS,
    Address,
    Frame,
    Line,
    line_bytes,
)

ANSWER_S = 2.0
"""Longest wait for an answer in lockstep and in `rig simulate` [s]."""
BOOT_AGAIN_S = 0.05
"""Time until the board is asked again while it starts [s]."""
LOST_NS = 50_000_000
"""Time without an answer after which a board counts as lost [ns]. # chosen: the hold of most scenes"""
PATIENCE = 0.8
"""Share of the period that a paced run waits for an answer by default: the rest carries it to the plant. # chosen"""
LOST, BACK, RESET = "device lost", "device back", "device reset"
"""Kinds of events."""


class Device(ControllerSection):
    """A controller on a board.

    port       "serial:/dev/ttyACM0" or "udp:192.168.7.2:5005"; by UDP the board answers to its port number plus one
    baud       rate of a serial port [chosen]
    values     float64 or float32, of measurements and commands
    reads      sensors in the order of the values of a step
    drives     actuators in the order of the values of an answer
    patience   longest wait for an answer in a paced run, by default 0.8 of the period
    """

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {
        "port",
        "baud",
        "values",
        "reads",
        "drives",
        "patience",
    }

    kind: Literal["device"]
    port: str
    baud: int = 115200
    values: Literal["float64", "float32"] = "float64"
    reads: tuple[str, ...] = ()
    drives: tuple[str, ...]
    patience: OptionalSecond = None

    @field_validator("port")
    @classmethod
    def _is_address(cls, given: str) -> str:
        return str(Address.read(given))

    @field_validator("reads", "drives", mode="before")
    @classmethod
    def _listed(cls, given: Any) -> Any:
        """A single name, or several with commas between them, as a list."""
        return [name.strip() for name in given.split(",")] if isinstance(given, str) else given

    @model_validator(mode="after")
    def _fits(self) -> Device:
        faults = []
        if self.where == "plant":
            faults.append("where: a board is asked by a process of its own; leave where = plant out")
        if not self.drives:
            faults.append("drives: names no actuator")
        for key, names in (("reads", self.reads), ("drives", self.drives)):
            if len({*names}) != len(names):
                faults.append(f"{key}: names one twice: {', '.join(names)}")
            if len(names) > MOST:
                faults.append(f"{key}: names {len(names)}; a frame has at most {MOST} values")
        if self.patience is not None and self.patience >= 1e-9 * self.period:
            faults.append(f"patience: is {1e3 * self.patience:g} ms, not below the period of {self.period / 1e6:g} ms")
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @property
    def address(self) -> Address:
        """Where the board is."""
        return Address.read(self.port)

    @property
    def patience_s(self) -> float:
        """Longest wait for an answer in a paced run [s]."""
        return 1e-9 * PATIENCE * self.period if self.patience is None else float(self.patience)


class Event(NamedTuple):
    """Something that happened to the board, for the run."""

    kind: str
    text: str


def too_slow(section: Device, pace: float) -> str:
    """Why its serial line cannot carry a step and its answer within a period at `pace`; "" if it can."""
    width = WIDTHS[section.values]
    size = line_bytes(len(section.reads), width) + line_bytes(len(section.drives), width)
    period_s = 1e-9 * section.period / pace
    carries = section.baud * period_s / BITS
    if section.address.kind == "udp" or size <= carries:
        return ""
    least = size * BITS / section.baud
    return (
        f"{section.port}: a step and its answer are {size} bytes, and {section.baud} baud carry {carries:.4g} bytes in "
        f"a period of {1e3 * period_s:g} ms; needed: {size * BITS / period_s:.4g} baud, or a period of at least "
        f"{1e3 * least:.3g} ms" + ('; values = "float32" has shorter frames' if width == WIDTHS["float64"] else "")
    )


class DeviceController:
    """The controller; its state says whether the law on the board was started.

    `run`: the kind of run that it takes part in. Only `rig simulate` and `rig run` set it; nobody else may start it.
    """

    elsewhere = True
    """The law advances on other hardware: nobody may call this controller for a trial."""
    COUNTED = COUNTED
    """Names of `counts`."""

    def __init__(self, section: Device, numbers: Numbers) -> None:
        self.section = section
        self.numbers = numbers
        self.reads = section.reads
        self.drives = section.drives
        self.period_ns = section.period
        self.run: Literal["", "waits", "paced"] = ""
        self._line: Line | None = None
        self._counts: dict[str, int] = {}
        self._events: list[Event] = []
        self._answered_ns = -1
        self._lost = False
        self._reopen = 0.0

    @property
    def counts(self) -> dict[str, int]:
        """The counts of the line to the board (`Line`)."""
        return self._counts if self._line is None else dict(self._line.counts)

    def close(self) -> None:
        """Close the port at the end of a run."""
        if self._line is not None:
            self._counts = self.counts
            self._line.close()
            self._line = None

    def take_events(self) -> list[Event]:
        """The events since the last call."""
        events = self._events
        self._events = []
        return events

    def start(self) -> bool:
        """The state before the first sample: not started. Raises DeviceError if the board cannot be reached."""
        section = self.section
        if not self.run:
            raise DeviceError(
                f"{section.port}: a board takes part in rig simulate and rig run only, because its law advances with "
                "every step that it answers; give the controller another kind here"
            )
        if self._line is None:
            line = Line(section.address, section.values, len(section.drives), section.baud)
            line.open()
            self._wait_for_board(line)
            self._line = line
        return False

    def _wait_for_board(self, line: Line) -> None:
        try:
            answer = line.ask(ECHO, 0, (0.0,) * len(self.reads), BOOT_S, BOOT_AGAIN_S)
        except OSError as error:
            raise DeviceError(f"{line.address}: {error.strerror or error}") from None
        if answer is None:
            line.close()
            rate = f" at {self.section.baud} baud" if line.address.kind == "serial" else ""
            raise DeviceError(
                f"{line.address}: no answer within {BOOT_S:g} s{rate}{_received(line)}; is the board on, and does its "
                "program answer the frames of docs/device.md?"
            )

    def update(self, state: bool, t_ns: int, values: Values) -> tuple[bool, Values]:
        """Whether the law is started, and the commands; () without an answer in a paced run.

        Raises DeviceError without an answer in all other runs.
        """
        line = self._line
        assert line is not None
        if self.run == "waits":
            return True, self._waited(line, state, t_ns, values)
        answer = self._asked_once(line, state, t_ns, values)
        if answer is None:
            self._miss(line, t_ns)
            return state, ()
        self._answered_ns = t_ns
        if self._lost:
            self._lost = False
            self._events.append(Event(BACK, f"{line.address} answers again"))
        return True, answer.values

    def _waited(self, line: Line, started: bool, t_ns: int, values: Values) -> Values:
        """The commands, asked for until they come."""
        end = time.perf_counter() + ANSWER_S
        while (left := end - time.perf_counter()) > 0.0:
            try:
                line.open()
                answer = line.ask(STEP if started else START, t_ns, values, left, AGAIN_S)
            except (OSError, DeviceError):
                time.sleep(min(left, REOPEN_S))
                continue
            if answer is not None and answer.kind != UNSTARTED:
                return answer.values
            started = self._starts_again(line, answer, started)
        raise DeviceError(f"{line.address}: no answer within {ANSWER_S:g} s{_received(line)}")

    def _asked_once(self, line: Line, started: bool, t_ns: int, values: Values) -> Frame | None:
        """The answer within the patience; None without one."""
        begun = time.perf_counter()
        patience = self.section.patience_s
        try:
            if self._reopened(line, begun):
                answer = line.ask(STEP if started else START, t_ns, values, patience)
                if answer is None or answer.kind != UNSTARTED:
                    return answer
                self._starts_again(line, answer, started)
                left = patience - (time.perf_counter() - begun)
                answer = line.ask(START, t_ns, values, left)
                return None if answer is None or answer.kind == UNSTARTED else answer
        except OSError as error:
            self._lose(line, error.strerror or str(error))
        return None

    def _reopened(self, line: Line, now: float) -> bool:
        """Whether the port is open; one that is gone is opened again every `REOPEN_S`."""
        if line.is_open:
            return True
        if now < self._reopen:
            line.counts["missed"] += 1
            return False
        self._reopen = now + REOPEN_S
        try:
            line.open()
        except DeviceError:
            line.counts["missed"] += 1
            return False
        return True

    def _starts_again(self, line: Line, answer: Frame | None, started: bool) -> bool:
        """Take in that the board was reset, if its answer says so; whether its law is started."""
        if answer is None or answer.kind != UNSTARTED:
            return started
        if started:
            self._events.append(Event(RESET, f"{line.address} was reset: its law starts again"))
        return False

    def _miss(self, line: Line, t_ns: int) -> None:
        if self._answered_ns < 0:
            self._answered_ns = t_ns
        if t_ns - self._answered_ns >= max(LOST_NS, 2 * self.period_ns):
            self._lose(line, f"no answer for {1e-6 * (t_ns - self._answered_ns):g} ms{_received(line)}")

    def _lose(self, line: Line, why: str) -> None:
        if not self._lost:
            self._lost = True
            self._events.append(Event(LOST, f"{line.address}: {why}"))


def _received(line: Line) -> str:
    """What arrived instead of an answer, as the end of a sentence."""
    return "".join(_wrong(line)) + (f"; {line.unfit}" if line.unfit else "")


def _wrong(line: Line) -> Iterator[str]:
    for name, words in (("damaged", "damaged frames"), ("other", "answers to other steps")):
        if line.counts[name]:
            yield f", {line.counts[name]} {words} so far"
