"""Signals that ask a process to stop, a fast exit, and runs without garbage collection; for all processes of a run.

And what a process tells the one that started it (`rig.child_process.Child`), over a pipe of its own.
"""

from __future__ import annotations

import atexit
import errno
import gc
import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import IO, NoReturn

from rig.errors import ExitCode

PARENT = "RIG_PARENT"
"""Environment variable with the number of the pipe to the process that started this one."""
_parent: list[IO[str]] = []
_GARBAGE = 100_000  # new objects
_COPY = b"os.fork() has made a copy of this process, which was ended; use subprocess, or end the copy with os._exit()\n"
NO_FILES = (errno.EMFILE, errno.ENFILE)
MORE_FILES = (
    "the system allows this process no more open files; raise the limit, e.g. ulimit -n 1024, or end other programs"
)
_PARENT_S = 0.2  # between two looks at the parent

copies = [0]
"""How often this process was copied by os.fork(), its ancestors included."""
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: copies.__setitem__(0, copies[0] + 1))


def end_copy(before: int) -> None:
    """End this process if a user's code has made it since `copies` was `before`, and returns here from both.

    A copy has the sockets of the bus and the threads of none: two plants would write one recording.
    """
    if copies[0] != before:
        with suppress(OSError):
            os.write(2, _COPY)
        os._exit(ExitCode.FAILED)


@contextmanager
def told_to_stop(take: Callable[[str], object]) -> Iterator[None]:
    """Call `take` with the name of each signal that asks this process to end in an orderly way.

    The signals are SIGINT (Ctrl-C), SIGTERM (kill) and SIGHUP (the terminal was closed), the last one unless it is
    ignored (nohup). Outside the main thread this does nothing.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        closed = getattr(signal, "SIGHUP", None)  # not on every system
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
    """An event that is set when a signal asks this process to stop."""
    stop = threading.Event()

    def heard(_: str) -> None:
        # set from another thread: the main thread may hold the event's lock, if it is entering or leaving a wait
        threading.Thread(target=stop.set).start()

    with told_to_stop(heard):
        yield stop


@contextmanager
def no_garbage() -> Iterator[None]:
    """Collect garbage once, then not until the end of the block: a collection during a run costs milliseconds."""
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def with_parent(end: Callable[[], object]) -> None:
    """Call `end` in another thread when the parent of this process has ended, however long the main thread works."""
    parent = os.getppid()

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_S)
        end()

    threading.Thread(target=look, name="parent", daemon=True).start()


def tell(kind: str, value: object = None) -> bool:
    """Tell the process that started this one something (JSON); "fault": why this one ends.

    Returns False if nobody listens: a user started this process.
    """
    if not _parent:
        return False
    with suppress(OSError):  # the other process has ended
        _parent[0].write(f"{json.dumps([kind, value])}\n")
        _parent[0].flush()
    return True


def _find_parent() -> None:
    """Open the pipe to the parent. No process that this one or a user's code starts inherits it."""
    number = os.environ.pop(PARENT, "")
    if not number.isdecimal():
        return
    with suppress(OSError):
        if sys.platform == "win32":
            import msvcrt

            descriptor = msvcrt.open_osfhandle(int(number), os.O_WRONLY)
        else:
            descriptor = int(number)
            os.set_inheritable(descriptor, False)
        _parent.append(open(descriptor, "w", encoding="utf-8"))


def as_process(main: Callable[[], int | None]) -> NoReturn:
    """Run `main` as the whole process and end the process with its exit code.

    The interpreter does not shut down in the usual way, because nothing it would free is needed again. With rerun or
    numba loaded a shutdown costs 0.3 s of processor time: 14 s of wall time for a viewer of low priority on a busy
    machine (measured). The garbage collector runs rarely: imported objects stay alive, and collecting during imports
    takes a tenth of the start.
    """
    gc.set_threshold(_GARBAGE)
    _open_streams()
    _find_parent()
    asked: list[int] = []

    def interrupt(number: int, _: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    def ignored(fault: sys.UnraisableHookArgs) -> None:  # raised in a callback, e.g. of numba while it compiles
        if isinstance(fault.exc_value, KeyboardInterrupt):
            os._exit(ExitCode.INTERRUPTED)
        sys.__unraisablehook__(fault)

    # a child in a session of its own inherits the ignored SIGINT of a job in the background, but must be stopped by it
    led = hasattr(os, "getsid") and os.getsid(0) == os.getpid()
    heard = signal.getsignal(signal.SIGINT)
    if heard is signal.default_int_handler or (led and heard == signal.SIG_IGN):
        signal.signal(signal.SIGINT, interrupt)
        sys.unraisablehook = ignored
    for name in ("SIGTERM", "SIGHUP"):  # resources are released, as on Ctrl-C
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, interrupt)
    try:
        code = main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int | None) else 1
    except KeyboardInterrupt:
        code = ExitCode.INTERRUPTED
    except Exception as error:
        code = ExitCode.INTERRUPTED if asked else 1  # some libraries turn KeyboardInterrupt into another exception
        if not asked and isinstance(error, OSError) and error.errno in NO_FILES:
            with suppress(OSError):
                sys.stderr.write(f"{MORE_FILES}\n")
        elif not asked:
            traceback.print_exc()
    _leave(code or 0)


def _open_streams() -> None:
    """Open the standard streams that were closed (`rig list >&-`): what is written to them is lost, and no more.

    Python has None in their place; a file that is opened later would get their descriptor, and take what libraries
    print.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            with suppress(OSError):
                nowhere = os.open(os.devnull, os.O_RDWR)
                try:
                    os.fstat(number)
                except OSError:  # nothing else has this descriptor so far
                    os.dup2(nowhere, number)
                setattr(sys, name, open(nowhere, mode))


def _leave(code: int) -> NoReturn:
    with suppress(Exception):
        atexit._run_exitfuncs()  # noqa: SLF001 (there is no public name)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:  # the reader has closed the pipe, e.g. `head`
            pass
        except (OSError, ValueError) as fault:
            code = code or 1
            with suppress(OSError, ValueError):
                sys.stderr.write(f"the output could not be written: {fault}\n")
    os._exit(code)
