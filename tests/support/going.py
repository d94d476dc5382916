"""A supervised run of processes, in a thread of the test."""

import contextlib
import threading
import time

import psutil

from rig.bench.live import supervise
from rig.errors import UsageError


class Going:
    """A supervised run in a thread of its own."""

    def __init__(self, scene, **options):
        self.outcome, self.fault, self.lines = None, None, []
        self.before = {child.pid for child in psutil.Process().children()}
        self.thread = threading.Thread(target=self._run, args=(scene, options), daemon=True)
        self.thread.start()

    def _run(self, scene, options):
        try:
            self.outcome = supervise.run(scene, say=self.lines.append, **options)
        except UsageError as fault:
            self.fault = fault

    def wait(self, seconds):
        self.thread.join(seconds)
        assert not self.thread.is_alive(), self.lines
        return self.outcome

    def process(self, words, seconds=60.0):
        """The process of this run whose command line has all the `words`."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for child in psutil.Process().children():
                with contextlib.suppress(psutil.NoSuchProcess):  # it has ended just now
                    if child.pid not in self.before and set(words.split()) <= set(child.cmdline()):
                        return child
            time.sleep(0.02)
        raise AssertionError(f"no process has {words}: {self.lines}")

    def line(self, text, times=1):
        """Wait until a line with `text` has been said, or several of them."""
        deadline = time.monotonic() + 60.0
        while sum(text in line for line in self.lines) < times:
            assert time.monotonic() < deadline, self.lines
            assert self.thread.is_alive(), self.lines
            time.sleep(0.01)
