"""One bus that is Zenoh or its twin within one process."""

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


@pytest.fixture(params=["twin", "zenoh"])
def wire(request, runs):
    with ExitStack() as stack:
        yield Wire(stack, request.param == "twin")
