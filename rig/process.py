"""How the processes of the laboratory behave beside each other: when to stop, and how to leave at once."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

from rig.errors import Interrupted

_GARBAGE = 100_000  # new objects


@contextmanager
def told_to_stop(take: Callable[[str], object]) -> Iterator[None]:
    """Have `take` called with the name of each signal that asks this process to end as it should end.

    These are Ctrl-C, kill, and a terminal that is closed, unless that is ignored (nohup). Only the main thread hears.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        closed = getattr(signal, "SIGHUP", None)  # not every system has it
        for number in filter(None, (signal.SIGINT, signal.SIGTERM, closed)):
            if number != closed or signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, lambda n, _: take(signal.Signals(n).name))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def stopping() -> Iterator[threading.Event]:
    """An event that is set when this process is told to stop."""
    stop = threading.Event()

    def heard(_: str) -> None:
        # set by another thread: the main one may hold the event's lock, on its way into or out of a wait
        threading.Thread(target=stop.set).start()

    with told_to_stop(heard):
        yield stop


def as_process(main: Callable[[], int | None]) -> NoReturn:
    """Be the process that carries out `main`: end with the code it returns, or leaves with.

    The interpreter is not taken apart. That costs 0.3 s of processor time once rerun or numba are loaded: 14 s for a
    viewer that stands back on a machine whose cores are busy (measured), and nobody needs what it holds any more.
    Garbage is looked for rarely: what is imported stays, and to look through it takes a tenth of the start.
    """
    gc.set_threshold(_GARBAGE)
    asked: list[int] = []

    def interrupt(number: int, _: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    def ignored(fault: sys.UnraisableHookArgs) -> None:  # of a callback, as numba has them while it compiles
        if isinstance(fault.exc_value, KeyboardInterrupt):
            os._exit(Interrupted.exit_code)
        sys.__unraisablehook__(fault)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
        sys.unraisablehook = ignored
    for name in ("SIGTERM", "SIGHUP"):  # what was reserved is cleared away, as on Ctrl-C
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, interrupt)
    try:
        code = main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int | None) else 1
    except KeyboardInterrupt:
        code = Interrupted.exit_code
    except Exception:
        code = Interrupted.exit_code if asked else 1  # some turn an interrupt into a fault of their own
        if not asked:
            traceback.print_exc()
    _leave(code or 0)


def _leave(code: int) -> NoReturn:
    with suppress(Exception):
        atexit._run_exitfuncs()  # noqa: SLF001 (there is no public name)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:  # whoever read has seen enough
            pass
        except (OSError, ValueError) as fault:
            code = code or 1
            with suppress(OSError, ValueError):
                sys.stderr.write(f"the output could not be written: {fault}\n")
    os._exit(code)
