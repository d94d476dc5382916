"""Processes: what every process of this project does at its begin and end, and child processes.

Every process: signals that ask it to stop, a fast exit, runs without garbage collection. Child processes are started,
observed, and ended by process id, in steps of bounded duration. What a child prints may come from a user's code: it is
text to show and nothing else. What the child itself has to tell (`tell`) comes over a pipe of its own.
"""

from __future__ import annotations

import atexit
import errno
import gc
import json
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn

from rig.errors import ExitCode

PARENT = "RIG_PARENT"  # environment variable with the number of the pipe to the process that started this one
_parent: list[IO[str]] = []
_GARBAGE = 250_000  # new objects
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

_ROOT = Path(__file__).resolve().parents[2]
_KEPT = 50
"""Lines of output that are kept at the end; of more, the oldest are left out."""
_WAITING = 1000
"""Lines of output that wait to be shown; of more, the oldest are left out."""
LONGEST = 2000
"""Longest line of output [characters]; longer ones, such as dots without an end of line, are several lines."""
STEPS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 2.0), (getattr(signal, "SIGKILL", signal.SIGTERM), 2.0))
"""Signals that end a process, in order, and how long to wait after each [s]."""


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
    """Collect garbage once, then not until the end of the block: a collection during a run costs milliseconds.

    In a process of ours that has only started so far nothing is collected, which takes 70 ms: its objects stay alive.
    """
    enabled = gc.isenabled()
    if gc.get_threshold()[0] == _GARBAGE and not gc.get_freeze_count():
        gc.freeze()
    else:
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


def listened() -> bool:
    """Whether the process that started this one hears what `tell` tells."""
    return bool(_parent)


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
        if not asked:
            no_files = isinstance(error, OSError) and error.errno in NO_FILES
            with suppress(OSError):
                sys.stderr.write(f"{MORE_FILES}\n" if no_files else traceback.format_exc())
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
        except (OSError, ValueError) as fault:
            if not isinstance(fault, BrokenPipeError):  # the reader has closed the pipe, e.g. `head`
                code = code or 1
                with suppress(OSError, ValueError):
                    sys.stderr.write(f"the output could not be written: {fault}\n")
    os._exit(code)


class Child:
    """A process `python -P -m ...` in a session of its own, so that Ctrl-C in the terminal reaches only its parent.

    Linear algebra has one thread, unless the environment says otherwise: eigenvalues of a hundred rows take twice as
    long with two (measured), and the processes of a run or a pool need the cores themselves.

    A file of the working folder does not hide a module of this name (-P): there may be a rig.py or a queue.py.

    Its output on stdout and stderr is kept line by line: new lines for `new_lines`, the last ones in `tail`. What it
    tells with `rig.machine.process.tell` waits for `new_words`; `fault` is why it ends, if it told that. `heard` is set
    with each line or word and when they end. With `fed` the process reads what `feed` writes. `folder`: where it works,
    by default that of its parent.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        heard: threading.Event | None = None,
        fed: bool = False,
        folder: Path | None = None,
    ) -> None:
        self.name = name
        self._heard = heard or threading.Event()
        self._lines: deque[str] = deque()
        self._left_out = 0
        self._words: deque[tuple[str, Any]] = deque()
        self.tail: list[str] = []
        self.fault = ""
        path = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH", ""))))
        words, theirs = os.pipe()
        try:
            number, inherited = _inherited(theirs)
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", *arguments],
                stdin=subprocess.PIPE if fed else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,
                cwd=folder,
                env={"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONPATH": path, PARENT: str(number)},
                **inherited,
            )
        except BaseException:
            os.close(words)
            raise
        finally:
            os.close(theirs)
        self._readers = [
            threading.Thread(target=self._read, name=f"read-{name}", daemon=True),
            threading.Thread(target=self._listen, args=(words,), name=f"words-{name}", daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    def _read(self) -> None:
        with self.process.stdout as stream:  # type: ignore[union-attr]
            for line in iter(lambda: stream.readline(LONGEST), ""):
                self._keep(line.rstrip())
        self._heard.set()

    def _keep(self, line: str) -> None:
        self.tail = [*self.tail[-_KEPT:], line]
        self._lines.append(line)
        while len(self._lines) > _WAITING:
            self._lines.popleft()
            self._left_out += 1
        self._heard.set()

    def _listen(self, words: int) -> None:
        with open(words, encoding="utf-8") as stream:
            for line in stream:
                with suppress(ValueError):  # of a process that was killed while it told something
                    kind, value = json.loads(line)
                    if kind == "fault":
                        self.fault = value
                    else:
                        self._words.append((kind, value))
                    self._heard.set()
        self._heard.set()

    def feed(self, line: str) -> None:
        """Write a line to the standard input of the process, unless it has ended."""
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.write(f"{line}\n")
            self.process.stdin.flush()

    def dismiss(self) -> None:
        """Close the standard input of the process: nothing more will come."""
        if self.process.stdin is not None:
            with suppress(OSError):
                self.process.stdin.close()

    def new_lines(self, most: int = _WAITING) -> list[str]:
        """Lines of output since the last call: the latest `most`, before them a line that counts those left out."""
        lines = [self._lines.popleft() for _ in range(len(self._lines))]
        left_out = self._left_out + max(len(lines) - most, 0)
        self._left_out = 0
        return [f"({left_out} lines left out)", *lines[-most:]] if left_out else lines

    def new_words(self) -> list[tuple[str, Any]]:
        """What the process has told since the last call: kind, value."""
        return [self._words.popleft() for _ in range(len(self._words))]

    @property
    def code(self) -> int | None:
        """Exit code; None while the process runs; minus the signal number if a signal killed it."""
        return self.process.poll()

    @property
    def ending(self) -> str:
        """How the process ended, as a sentence with the fault that it told, else with its last line of output."""
        code = self.code
        if code is not None and code < 0:
            return f"{self.name} was killed by {signal.Signals(-code).name}"
        why = self.fault or next((text for text in reversed(self.tail) if text), "")
        return f"{self.name} ended with code {code}{f': {why}' if why else ''}"

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process if it still runs."""
        if self.code is None:
            self.process.send_signal(number)

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds`; whether the process has ended."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        self.dismiss()
        for reader in self._readers:  # what it has started may keep its output open
            reader.join(1.0)
        return True


def _inherited(descriptor: int) -> tuple[int, dict[str, Any]]:
    """The number under which a new process finds an open file, and the options of `Popen` that give it to it."""
    if sys.platform != "win32":
        return descriptor, {"pass_fds": [descriptor]}
    import msvcrt

    handle = msvcrt.get_osfhandle(descriptor)
    os.set_handle_inheritable(handle, True)
    return handle, {"close_fds": False}


def end(children: Iterable[Child], patience: float) -> list[str]:
    """Wait `patience` [s] for the children to end, then end them by `STEPS`.

    Returns the names of those that needed the last signal.
    """
    left = list(children)
    for number, span in ((None, patience), *STEPS):
        for child in left:
            if number is not None:
                child.send(number)
        deadline = time.monotonic() + span
        left = [child for child in left if not child.wait(max(deadline - time.monotonic(), 0.0))]
        if not left:
            return []
        killed = [child.name for child in left]
    return killed
