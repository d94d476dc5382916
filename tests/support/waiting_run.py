"""A run in lockstep over Zenoh, its plant in a thread of the test. It begins when the expected controller is there."""

import threading
from contextlib import contextmanager

import rig
from rig import bus, scenes
from rig.bench.live.outcome import Job
from rig.bench.live.plant import Plant

RUN, SCENE, SECONDS = "wire", "belt", 0.3


class WaitingRun:
    """The run of a plant in a thread. `summary`: what it ends with; `end()` stops it."""

    def __init__(self, session, expected, seconds, pace):
        self.session, self.summary, self._why = session, None, ""
        expect = (("controller", expected),) if expected else ()
        job = Job(scenes.load(SCENE).to_json(), run=RUN, pace=pace, duration=seconds, expect=expect, wait=20.0)
        self._plant = Plant(session, job, lambda: self._why)
        session.announce()
        self.thread = threading.Thread(target=self._go, daemon=True)
        self.thread.start()

    def _go(self):
        self._plant.gather(lambda _: None)
        self.summary = self._plant.run(lambda _: None)
        self.session.close()

    def end(self):
        self._why = "by the test"
        self.thread.join(20.0)
        assert not self.thread.is_alive()


@contextmanager
def waiting_run(expected, seconds=SECONDS, pace=None):
    """A run that waits for the controller `expected`; in lockstep without a `pace`."""
    with bus.host(RUN, scene=SCENE) as session:
        run = WaitingRun(session, expected, seconds, pace)
        try:
            yield run
        finally:
            run.end()


class Law:
    """The control law of the examples in docs."""

    reads, drives, period_ns = ("vibrometer",), ("load.force",), 1_000_000

    def start(self):
        return None

    def update(self, state, t_ns, values):
        return None, (min(max(20.0 - 200.0 * values[0], 0.0), 100.0),)


def in_process(name):
    """The same run in one process."""
    return rig.simulate(SCENE, SECONDS, controllers={name: Law()})
