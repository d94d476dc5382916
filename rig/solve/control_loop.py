"""Controllers inside the compiled loop: calls the controllers that are due and puts their commands into force.

Nearly every command takes this path (rig.bench.run.exchange): it arrives at its tick, has finite values, and comes into
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

from rig.compiled.kernel import Emission, inner

CONTROLLER = np.dtype(
    [
        ("answer", np.int64),  # address of the function `answer`, see `ControllerTables`; 0: all commands wait already
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
CLOCK = np.dtype(
    [
        ("tick", np.int64),
        ("count", np.int64),  # number of controllers in use
        ("unusual", np.int64),  # 1: `run_controllers` returned False, the caller has to act
    ],
    align=True,
)
COMMAND = np.dtype(
    [
        ("tick", np.int64),  # from which on it is in force
        ("answered", np.int64),  # tick of the measurement
        ("status", np.int64),
    ],
    align=True,
)
ROWS = 1 << 12
"""Capacity per controller for commands in force not read yet, and for waiting commands."""


class ControllerTables(NamedTuple):
    """Controllers inside the compiled loop, in the order in which they are asked.

    answer(controller, t_ns, heard, command, memory) -> 1, or 0 if the caller has to act first. The last three are
    addresses.
    """

    controllers: NDArray[Any]  # CONTROLLER [controller]
    clock: NDArray[Any]  # CLOCK [1]
    columns: NDArray[np.int64]  # [read] index of the sensor
    heard: NDArray[np.float64]  # [read]
    command: NDArray[np.float64]  # [drive] the last answer
    place: NDArray[np.int64]  # [drive] index of the state that holds the command
    slope: NDArray[np.int64]  # [drive] index of the state that is its slope, -1: none
    low: NDArray[np.float64]  # [drive]
    high: NDArray[np.float64]  # [drive]
    force: NDArray[np.float64]  # [drive] the command in force
    queue: NDArray[Any]  # COMMAND [controller, waiting]
    queued: NDArray[np.float64]  # [waiting, drive]
    rows: NDArray[Any]  # COMMAND [controller, row]
    values: NDArray[np.float64]  # [row, drive]
    frame: int  # ns


def controller_tables(controllers: int = 0, reads: int = 0, drives: int = 0, frame: int = 1) -> ControllerTables:
    """Empty tables for `controllers` controllers, `reads` sensor inputs and `drives` actuators. `frame` in ns."""
    rows = ROWS if controllers else 1
    whole = np.int64
    real = np.float64
    return ControllerTables(
        controllers=np.zeros(controllers, dtype=CONTROLLER),
        clock=np.zeros(1, dtype=CLOCK),
        columns=np.zeros(reads, dtype=whole),
        heard=np.zeros(reads, dtype=real),
        command=np.zeros(drives, dtype=real),
        place=np.zeros(drives, dtype=whole),
        slope=np.zeros(drives, dtype=whole),
        low=np.zeros(drives, dtype=real),
        high=np.zeros(drives, dtype=real),
        force=np.zeros(drives, dtype=real),
        queue=np.zeros((controllers, rows), dtype=COMMAND),
        queued=np.zeros((rows, drives), dtype=real),
        rows=np.zeros((controllers, rows), dtype=COMMAND),
        values=np.zeros((rows, drives), dtype=real),
        frame=frame,
    )


def _call_controller(
    typing: Any, address: Any, controller: Any, t_ns: Any, heard: Any, command: Any, memory: Any
) -> Emission:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        word = ir.IntType(64)
        code = builder.inttoptr(arguments[0], ir.FunctionType(word, [word] * 5).as_pointer())
        return builder.call(code, arguments[1:])

    return types.int64(*[types.int64] * 6), codegen


call_controller: Any = intrinsic(_call_controller)


@inner
def run_controllers(c: Any, latest: Any, x: Any) -> bool:
    """Ask the controllers that are due at the current tick and put commands into force.

    Returns False if the caller has to act first; then nothing has been put into force. `latest` [sensor]: latest
    measurements. `x`: the state to which commands are written.
    """
    controllers, clock, usual = c.controllers, c.clock[0], True
    now = clock.tick
    for i in range(clock.count):
        controller = controllers[i]
        if controller.due == now:
            for k in range(controller.hears, controller.deaf):
                c.heard[k] = latest[c.columns[k]]
            if (
                call_controller(
                    controller.answer,
                    i,
                    now * c.frame,
                    controller.heard_at,
                    controller.command_at,
                    controller.memory_at,
                )
                == 1
            ):
                controller.given = now
                controller.due += controller.period
                controller.updates += 1
            else:
                usual = False
        comes = controller.given == now and controller.delay == 0
        came = controller.waiting > 0 and c.queue[i, controller.oldest].tick <= now
        if not (comes or came) and now - controller.last >= controller.period:
            usual = False  # a command is missing
        if controller.kept + controller.waiting >= c.rows.shape[1] and controller.answer != 0:
            usual = False  # there is no more room
    if not usual:
        clock.unusual = 1
        return False
    for i in range(clock.count):
        controller = controllers[i]
        room = c.queue.shape[1]
        if controller.given == now:
            at = (controller.oldest + controller.waiting) % room
            answer = c.queue[i, at]
            answer.tick, answer.answered, answer.status = now + controller.delay, now, 0
            for k in range(controller.drives, controller.driven):
                c.queued[at, k] = c.command[k]
            controller.waiting += 1
        while controller.waiting > 0 and c.queue[i, controller.oldest].tick <= now:
            put_into_force(c, controller, i, now, x)
            controller.oldest = (controller.oldest + 1) % room
            controller.waiting -= 1
    return True


@inner
def put_into_force(c: Any, controller: Any, i: int, now: int, x: Any) -> None:
    """Put the oldest waiting command of controller `i` into force, clamped to the range of its actuators."""
    row, clamped, waiting = controller.kept, 0, c.queue[i, controller.oldest]
    for k in range(controller.drives, controller.driven):
        value = c.queued[controller.oldest, k]
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
    kept = c.rows[i, row]
    kept.tick, kept.answered, kept.status = now, waiting.answered, max(waiting.status, clamped)
    controller.clamped += clamped
    controller.last, controller.kept = now, row + 1
