"""One bus that is Zenoh or its twin within one process."""

import threading
import time
from contextlib import ExitStack

import pytest
from twin import Twin

from rig import bus


class Wire:
    """A plant's session and as many others as a test wants."""

    def __init__(self, stack: ExitStack, twin: bool) -> None:
        self._stack = stack
        self._twin = Twin("test") if twin else None
        self.plant = stack.enter_context(self._twin.open("plant", "plant") if self._twin else bus.host("test"))

    def join(self, role="controller", name="one"):
        return self._stack.enter_context(
            self._twin.open(role, name) if self._twin else bus.join("test", role=role, name=name)
        )

    def hearing(self, *patterns, **how):
        """A controller that has joined and its receiver, which stands: the plant has seen its presence."""
        watch, one = self.plant.watch(), self.join()
        receiver = one.subscribe(*patterns, **how)
        one.announce()
        assert watch.wait_for("controller", "one", 20.0)
        return one, receiver

    def serving(self, topic, answer):
        """The plant answers one query on `topic`, in a thread."""
        server = self.plant.serve(topic, answer)
        thread = threading.Thread(target=lambda: server.poll(20.0), daemon=True)
        thread.start()
        return thread


def gather(receiver, count, timeout=20.0):
    """The next `count` messages."""
    told, deadline = [], time.monotonic() + timeout
    while len(told) < count and time.monotonic() < deadline:
        if (message := receiver.get(0.1)) is not None:
            told.append(message)
    return told


@pytest.fixture(name="gather")
def gather_fixture():
    return gather


@pytest.fixture(params=["twin", "zenoh"])
def wire(request, runs):
    with ExitStack() as stack:
        yield Wire(stack, request.param == "twin")
