"""A controller on a board: its law runs there, and each step is one frame to the board and one frame back.

docs/device.md documents the frame and has examples for boards. The process of the controller opens the port and no
other one does: in a live run a process of its own, in `rig simulate` that of the simulation. The law on the board has a
memory that nobody else can see, so it advances exactly once a step: it takes part in no rehearsal, trial or study.

In lockstep and in `rig simulate` a step without an answer is asked again for up to `ANSWER_S`; then the run ends. In a
paced run such a step has no answer: the plant holds the last command, then takes safe values.
"""

from __future__ import annotations

import time
from math import inf
from typing import Any, ClassVar, Literal

from pydantic import field_validator, model_validator

from rig.controllers.blocks.base import ControllerSection, Numbers, OptionalSecond, Values
from rig.errors import DeviceError
from rig.machine.board import (
    ACT,
    AGAIN_S,
    BAUD,
    BITS,
    COUNTED,
    MOST,
    START,
    STEP,
    UNSTARTED,
    WIDTHS,
    Address,
    Baud,
    Line,
    PortName,
    line_bytes,
)

ANSWER_S = 2.0
"""Longest wait for an answer in lockstep and in `rig simulate` [s]."""
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
    port: PortName
    baud: Baud = BAUD
    values: Literal["float64", "float32"] = "float64"
    reads: tuple[str, ...] = ()
    drives: tuple[str, ...]
    patience: OptionalSecond = None

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
        f"a period of {1e3 * period_s:g} ms; needed: {size * BITS / period_s:.0f} baud, or a period of at least "
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
        self._line = Line(section.address, section.values, len(section.drives), section.baud)
        self._events: list[tuple[str, str]] = []
        self._answered_ns = -1
        self._lost = False

    @property
    def counts(self) -> dict[str, int]:
        """The counts of the line to the board (`Line`)."""
        return dict(self._line.counts)

    def close(self) -> None:
        """Close the port at the end of a run."""
        self._line.close()

    def take_events(self) -> list[tuple[str, str]]:
        """Kind and text of the events since the last call."""
        events = self._events
        self._events = []
        return events

    def start(self) -> bool:
        """The state before the first sample: not started. Raises DeviceError if the board cannot be reached."""
        if not self.run:
            raise DeviceError(
                f"{self.section.port}: a board takes part in rig simulate and rig run only, because its law advances "
                "with every step that it answers; give the controller another kind here"
            )
        if not self._line.is_open:
            self._line.wait(len(self.reads))
        return False

    def update(self, state: bool, t_ns: int, values: Values) -> tuple[bool, Values]:
        """Whether the law is started, and the commands; () without an answer in a paced run.

        Raises DeviceError without an answer in all other runs.
        """
        line = self._line
        waits = self.run == "waits"
        patience, again = (ANSWER_S, AGAIN_S) if waits else (self.section.patience_s, inf)
        end = time.perf_counter() + patience
        answer = line.ask(STEP if state else START, t_ns, values, patience, again)
        if answer is not None and answer.kind == UNSTARTED:
            if state:
                self._events.append((RESET, f"{line.address} was reset: its law starts again"))
            state = False
            answer = line.ask(START, t_ns, values, end - time.perf_counter(), again)
        answered = answer is not None and answer.kind == ACT
        if waits and not answered:
            raise DeviceError(f"{line.address}: no answer within {ANSWER_S:g} s{line.received}")
        self._watch(t_ns, answered)
        return (True, answer.values) if answer is not None and answered else (state, ())

    def _watch(self, t_ns: int, answered: bool) -> None:
        """Tell when the board is lost and when it is back."""
        if answered or self._answered_ns < 0:
            self._answered_ns = t_ns
        silent_ns = t_ns - self._answered_ns
        long = silent_ns >= max(LOST_NS, 2 * self.period_ns)
        lost = not answered and (self._lost or long or not self._line.is_open)
        if lost is not self._lost:
            self._lost = lost
            lacks = f"no answer for {1e-6 * silent_ns:g} ms{self._line.received}"
            self._events.append(
                (LOST, f"{self._line.address}: {lacks}") if lost else (BACK, f"{self._line.address} answers again")
            )
