"""Finds or compiles the parts of compiled code that a rig needs (rig.solve.specialised), with a process for each core.

Each process takes the next part of the list that no other one compiles or has compiled
(rig.compiled.kernel_store.Folder.claimed). The list begins with the parts that take longest, so that all processes end
at about the same time; it also holds the kernels that a run calls first from Python.
"""

from __future__ import annotations

import base64
import importlib
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from rig.compiled.kernel import FOLDER, announce_parts
from rig.machine import scheduling
from rig.machine.process import Child, end
from rig.solve.specialised import KernelShape

_ADDRESSES: dict[tuple[Any, KernelShape], int] = {}
_HUNG = 120.0  # s, longest time that another process may need for one part
_PATIENCE = 5.0  # s, for the other processes to end


class Task(NamedTuple):
    """A function to compile for arguments of the types `kinds`. `name`: its name among the stored kernels."""

    name: str
    function: Any
    kinds: tuple[Any, ...]


@contextmanager
def _beside(tasks: Sequence[Task]) -> Iterator[None]:
    """Run further processes that compile the same tasks, one for each further core; they end with this context."""
    # A thread other than the main one compiles during a run: it must not take the cores of that run.
    apart = threading.current_thread() is not threading.main_thread() or "RIG_OWN_PROCESS" not in os.environ
    count = 0 if apart or not FOLDER.keeps else min(scheduling.cores(), len(tasks)) - 1
    sent = [(name, function.__module__, function.__name__, kinds) for name, function, kinds in tasks]
    line = ["rig.motion.compiled_parts", base64.b64encode(pickle.dumps(sent)).decode()]
    fellows = [Child(f"compiler {number}", line) for number in range(1, count + 1)]
    try:
        yield
    finally:
        for fellow in fellows:
            fellow.send(signal.SIGTERM)  # everything is compiled, or no longer needed
        end(fellows, _PATIENCE)


def addresses(
    wanted: Mapping[str, tuple[Any, KernelShape]],
    kinds: Callable[[], Sequence[Any]],
    more: Callable[[Sequence[Any]], Sequence[tuple[Any, tuple[Any, ...]]]],
) -> dict[str, int]:
    """The address of each of `wanted`, a specialised kernel or a part with its shape, by name.

    part(shape, t, w, state, log, seg, plan, ticks) -> int. `kinds`: the types of t .. ticks. Missing parts are
    compiled, by several processes if this process belongs to a command. `more`: functions that the run then calls, with
    their types.
    """
    missing = [part for part in wanted.values() if part not in _ADDRESSES]
    if missing:
        common = tuple(kinds())
        parts = [Task(_name(*part), part[0], (part[1], *common)) for part in missing]
        further = [Task(f"{function.__module__}.{function.__name__}", function, of) for function, of in more(common)]
        others = [task for task in further if not FOLDER.noted(task.name)]
        new = [task for task in (*parts, *others) if not FOLDER.noted(task.name)]
        announce_parts([task.name for task in new])
        with _beside(new):
            compiled([*parts, *others])
        for part, task in zip(missing, parts):
            code = task.function.overloads[task.kinds]
            _ADDRESSES[part] = code.library.get_pointer_to_function(code.fndesc.llvm_func_name)
    return {name: _ADDRESSES[part] for name, part in wanted.items()}


def compiled(tasks: Sequence[Task]) -> None:
    """Compile these tasks or load them from the store. Tasks that another process is compiling come last."""
    done = set()
    for longest in (0.0, _HUNG):
        for name, function, kinds in tasks:
            if name in done:
                continue
            with FOLDER.claimed(name, longest) as mine:
                if mine:
                    function.compile(kinds)
                    done.add(name)


def _name(part: Any, shape: KernelShape) -> str:
    return f"{part.__module__}.{part.__name__}.{shape.states}.{shape.products:d}.{shape.nonlinear:d}"


def main() -> None:
    """Compile those of the tasks given on the command line that no other process compiles or has compiled.

    `python -m rig.motion.compiled_parts TASKS`
    """
    for name, module, function, kinds in pickle.loads(base64.b64decode(sys.argv[1])):
        with FOLDER.claimed(name) as mine:
            if mine and not FOLDER.noted(name):
                getattr(importlib.import_module(module), function).compile(kinds)


if __name__ == "__main__":
    main()
