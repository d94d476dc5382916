"""Who operates the run that a class watches: the page of the user who started `rig web`, or one watcher.

The watcher has asked, and the page of the user has handed the operation over. Both can give it back at any time.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping
from typing import Any

from rig.errors import UsageError

ASKING = 40
"""Most watchers that ask at a time: a class. # chosen"""
LONGEST_NAME = 40
"""Longest name under which a watcher asks [characters]. # chosen"""
ALWAYS = ("stop", "emergency")
"""Commands that the page of the user carries out whoever operates."""
KEPT = ("stop", "knock")
"""Commands that are never handed over: the end of the run, and a blow that the page of a watcher has no button for."""


def public(watcher: str) -> str:
    """The name under which the pages know a watcher, whose own name is secret."""
    return hashlib.sha256(watcher.encode()).hexdigest()[:12]


def of_a_class(state: Mapping[str, Any]) -> dict[str, Any]:
    """The state of a run without what belongs to its user: command line, lines of output, names of files."""
    shown = {key: value for key, value in state.items() if key not in ("lines", "command", "log")}
    if shown.get("outcome"):
        shown["outcome"] = {**shown["outcome"], "text": ""}
    return {**shown, "lines": []}


class Seat:
    """The seat of the one operator. `changed()` is called after each change; the methods are called by any thread."""

    def __init__(self, changed: Callable[[], object] = lambda: None) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._asking: dict[str, str] = {}  # public name -> name, in the order in which they have asked
        self._holder = ""  # public name; "": the page of the user
        self._name = ""

    @property
    def state(self) -> dict[str, Any]:
        """`holder`, `name`: public name and name of the watcher who operates, "" for the page of the user; `asking`."""
        with self._lock:
            asking = [{"id": who, "name": name} for who, name in self._asking.items()]
            return {"holder": self._holder, "name": self._name, "asking": asking}

    def ask(self, watcher: str, name: Any) -> None:
        """A watcher asks to operate. Raises UsageError for a name that cannot be shown, and when too many ask."""
        shown = " ".join(name.split()) if isinstance(name, str) else ""
        if not (0 < len(shown) <= LONGEST_NAME and shown.isprintable()):
            raise UsageError(f"the name {name!r:.80} is not 1 to {LONGEST_NAME} printable characters; give another one")
        who = public(watcher)
        with self._lock:
            if who not in self._asking and len(self._asking) >= ASKING:
                raise UsageError(f"{ASKING} watchers ask already; try again later")
            if who != self._holder:
                self._asking[who] = shown
        self._changed()

    def hand(self, who: Any) -> None:
        """The page of the user hands the operation over. Raises UsageError for a watcher who does not ask."""
        with self._lock:
            if not isinstance(who, str) or who not in self._asking:
                raise UsageError("this watcher does not ask to operate any more; choose one who does")
            self._name = self._asking.pop(who)
            self._holder = who
        self._changed()

    def back(self, watcher: str | None = None) -> None:
        """The operation returns to the page of the user; None: that page takes it. Who asks no longer does."""
        with self._lock:
            who = self._holder if watcher is None else public(watcher)
            self._asking.pop(who, None)
            if who == self._holder:
                self._holder = self._name = ""
        self._changed()

    def check(self, watcher: str, command: Any = None) -> None:
        """Raise UsageError if this watcher does not operate the run, or for a command that is never handed over."""
        with self._lock:
            if public(watcher) != self._holder:
                raise UsageError("only who operates can do this; ask for the operation, and wait until it is yours")
        if command in KEPT:
            raise UsageError(f"{command}: only the private page can do this")

    def check_user(self, command: Any) -> None:
        """Raise UsageError if a watcher operates, and the page of the user may not do this meanwhile."""
        with self._lock:
            if self._holder and command not in ALWAYS:
                raise UsageError(f"{self._name} operates the run; take the operation back first")
