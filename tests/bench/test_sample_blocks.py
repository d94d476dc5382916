"""Blocks of samples: encoded from the memory of the instruments, and right however late that happens."""

import numpy as np
import pytest

from rig.bench.live.hub import AllSamples
from rig.bus import messages
from rig.sensors.chain.instants import Instants

FRAME_NS = 1_000_000
RATES = (10_000.0, 3_000.0, 100.0, 44_100.0)
ROOM = 300


class Bus:
    """A session whose sender has not sent anything yet."""

    def __init__(self):
        self.waiting = []

    def publisher(self, topic):
        return Late(topic, self.waiting)


class Late:
    def __init__(self, topic, waiting):
        self.topic, self.waiting = topic, waiting

    def put_later(self, t_ns, encode, *given):
        self.waiting.append((self.topic, t_ns, encode, given))


class Memory:
    """Instruments whose samples count up; their memory has room for few of them, and is overwritten."""

    names = tuple(f"s{i}" for i in range(len(RATES)))
    instants = tuple(Instants.of(rate) for rate in RATES)

    def __init__(self):
        self.rows = np.full((len(RATES), ROOM), np.nan)
        self.kept, self.published = [0] * len(RATES), [0] * len(RATES)

    def memory(self, i, number, most):
        first = number - self.published[i] + self.kept[i]
        return memoryview(self.rows[i])[first : min(first + most, self.kept[i])]

    def measure(self, t_ns):
        for i, one in enumerate(self.instants):
            for number in range(self.published[i], one.count(t_ns)):
                self.rows[i, self.kept[i]] = number
                self.kept[i] += 1
                self.published[i] = number + 1

    @property
    def full(self):
        return max(self.kept) + 140 > ROOM

    def drop(self):
        for i, kept in enumerate(self.kept):
            self.rows[i, 0] = self.rows[i, kept - 1]
            self.rows[i, 1:] = np.nan
            self.kept[i] = 1


@pytest.mark.parametrize("sends_every", [1, 7, 1000], ids=["at once", "after seven frames", "at the end"])
@pytest.mark.parametrize("ahead", [1, 3], ids=["frame by frame", "three frames at once"])
def test_every_sample_is_published_once_with_its_time(sends_every, ahead):
    bus, memory = Bus(), Memory()
    samples, blocks = AllSamples(bus, memory), []

    def send():
        blocks.extend(
            (topic, t_ns, messages.decode(topic, encode(*given))) for topic, t_ns, encode, given in bus.waiting
        )
        bus.waiting.clear()

    for tick in range(120):
        if tick % ahead == 0:
            memory.measure((tick + ahead - 1) * FRAME_NS)
        samples.gather(tick, tick * FRAME_NS)
        if tick % ahead == ahead - 1 and memory.full:
            samples.collect(tick, tick * FRAME_NS)
            memory.drop()
        if tick % sends_every == sends_every - 1:
            send()
    samples.collect(119, 119 * FRAME_NS)
    samples.put_rest(119, 119 * FRAME_NS)
    send()
    for name, instants in zip(memory.names, memory.instants):
        own = [(t_ns, block) for topic, t_ns, block in blocks if topic == f"meas/{name}"]
        values = np.concatenate([block.v for _, block in own])
        np.testing.assert_array_equal(values, np.arange(instants.count(119 * FRAME_NS)))
        np.testing.assert_array_equal(
            np.concatenate([messages.times(b) for _, b in own]), instants.at(np.arange(values.size))
        )
        for t_ns, block in own:
            assert t_ns == block.tick * FRAME_NS
            assert 0 <= t_ns - messages.times(block)[-1] < max(FRAME_NS, instants.period_ns)
