"""Controllers inside the compiled loop: calls the controllers that are due and puts their commands into force.

Nearly every command takes this path (rig.bench.exchange): it arrives at its tick, has finite values, and comes into
force after the stated delay of its loop, as a state of the rig. All other cases are left to the caller. In that case
nothing has been put into force at that tick, and the answers already given are kept.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rig.kernel import inner

LINE = np.dtype(
    [
        ("answer", np.int64),  # address of the function `answer`, see `Controls`; 0: all commands wait already
        ("period", np.int64),  # frames
        ("delay", np.int64),  # frames
        ("hears", np.int64),  # its sensors are columns[hears : deaf]
        ("deaf", np.int64),
        ("drives", np.int64),  # its actuators are drives .. driven - 1
        ("driven", np.int64),
        ("heard_at", np.int64),  # addresses of its parts of `heard` and `command`, and of its memory
        ("command_at", np.int64),
        ("memory_at", np.int64),
        ("due", np.int64),  # tick of the next answer
        ("given", np.int64),  # tick of the answer in `command`
        ("updates", np.int64),  # answers given since the record was lent
        ("last", np.int64),  # tick at which its last command came into force
        ("oldest", np.int64),  # row of the next waiting command in the queue
        ("waiting", np.int64),  # number of waiting commands
        ("kept", np.int64),  # commands that came into force, kept in `rows` and `values`
        ("clamped", np.int64),
    ],
    align=True,
)
NOW, COUNT, UNUSUAL = range(3)  # of Controls.clock
DUE, ANSWERED, AS = range(3)  # of Controls.queue: in force from this tick on | tick of the measurement | status
TICK, FOR, STATUS = range(3)  # of Controls.rows
ROWS = 1 << 12
"""Capacity per controller for commands in force not read yet, and for waiting commands."""


class Controls(NamedTuple):
    """Controllers inside the compiled loop, in the order in which they are asked.

    answer(line, t_ns, heard, command, memory) -> 1, or 0 if the caller has to act first. The last three are addresses.
    """

    lines: NDArray[Any]  # LINE [line]
    clock: NDArray[
        np.int64
    ]  # NOW: tick; COUNT: lines in use; UNUSUAL: 1 if `control` returned False: the caller has to act
    columns: NDArray[np.int64]  # [read] index of the sensor
    heard: NDArray[np.float64]  # [read]
    command: NDArray[np.float64]  # [drive] the last answer
    place: NDArray[np.int64]  # [drive] index of the state that holds the command
    slope: NDArray[np.int64]  # [drive] index of the state that is its slope, -1: none
    low: NDArray[np.float64]  # [drive]
    high: NDArray[np.float64]  # [drive]
    force: NDArray[np.float64]  # [drive] the command in force
    queue: NDArray[np.int64]  # [line, waiting, 3]
    queued: NDArray[np.float64]  # [waiting, drive]
    rows: NDArray[np.int64]  # [line, row, 3]
    values: NDArray[np.float64]  # [row, drive]
    frame: int  # ns


def controls(lines: int = 0, reads: int = 0, drives: int = 0, frame: int = 1) -> Controls:
    """Empty tables for `lines` controllers, `reads` sensor inputs and `drives` actuators. `frame` in ns."""
    rows = ROWS if lines else 1
    whole, real = np.int64, np.float64
    return Controls(
        lines=np.zeros(lines, dtype=LINE),
        clock=np.zeros(3, dtype=whole),
        columns=np.zeros(reads, dtype=whole),
        heard=np.zeros(reads, dtype=real),
        command=np.zeros(drives, dtype=real),
        place=np.zeros(drives, dtype=whole),
        slope=np.zeros(drives, dtype=whole),
        low=np.zeros(drives, dtype=real),
        high=np.zeros(drives, dtype=real),
        force=np.zeros(drives, dtype=real),
        queue=np.zeros((lines, rows, 3), dtype=whole),
        queued=np.zeros((rows, drives), dtype=real),
        rows=np.zeros((lines, rows, 3), dtype=whole),
        values=np.zeros((rows, drives), dtype=real),
        frame=frame,
    )


def _ask(typing: Any, address: Any, line: Any, t_ns: Any, heard: Any, command: Any, memory: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        code = builder.inttoptr(arguments[0], ir.FunctionType(word, [word] * 5).as_pointer())
        return builder.call(code, arguments[1:])

    return types.int64(*[types.int64] * 6), codegen


ask: Any = intrinsic(_ask)


@inner
def control(c: Any, latest: Any, x: Any) -> bool:
    """Ask the controllers that are due at the current tick and put commands into force.

    Returns False if the caller has to act first; then nothing has been put into force. `latest` [sensor]: latest
    measurements. `x`: the state to which commands are written.
    """
    lines, now, usual = c.lines, c.clock[NOW], True
    for i in range(c.clock[COUNT]):
        line = lines[i]
        if line.due == now:
            for k in range(line.hears, line.deaf):
                c.heard[k] = latest[c.columns[k]]
            if ask(line.answer, i, now * c.frame, line.heard_at, line.command_at, line.memory_at) == 1:
                line.given = now
                line.due += line.period
                line.updates += 1
            else:
                usual = False
        comes = line.given == now and line.delay == 0
        came = line.waiting > 0 and c.queue[i, line.oldest, DUE] <= now
        if not (comes or came) and now - line.last >= line.period:
            usual = False  # a command is missing
        if line.kept + line.waiting >= c.rows.shape[1] and line.answer != 0:
            usual = False  # there is no more room
    if not usual:
        c.clock[UNUSUAL] = 1
        return False
    for i in range(c.clock[COUNT]):
        line = lines[i]
        room = c.queue.shape[1]
        if line.given == now:
            at = (line.oldest + line.waiting) % room
            c.queue[i, at, DUE], c.queue[i, at, ANSWERED], c.queue[i, at, AS] = now + line.delay, now, 0
            for k in range(line.drives, line.driven):
                c.queued[at, k] = c.command[k]
            line.waiting += 1
        while line.waiting > 0 and c.queue[i, line.oldest, DUE] <= now:
            take(c, line, i, now, x)
            line.oldest = (line.oldest + 1) % room
            line.waiting -= 1
    return True


@inner
def take(c: Any, line: Any, i: int, now: int, x: Any) -> None:
    """Put the oldest waiting command of controller `i` into force, clamped to the range of its actuators."""
    row, clamped, entry = line.kept, 0, c.queue[i, line.oldest]
    for k in range(line.drives, line.driven):
        value = c.queued[line.oldest, k]
        if value < c.low[k]:
            value, clamped = c.low[k], 1
        elif value > c.high[k]:
            value, clamped = c.high[k], 1
        c.values[row, k] = value
        if value != c.force[k]:
            c.force[k] = value
            if c.slope[k] >= 0:
                x[c.slope[k]] = 0.0
            x[c.place[k]] = value
    c.rows[i, row, TICK], c.rows[i, row, FOR], c.rows[i, row, STATUS] = now, entry[ANSWERED], max(entry[AS], clamped)
    line.clamped += clamped
    line.last, line.kept = now, row + 1
