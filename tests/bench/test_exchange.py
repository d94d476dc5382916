"""What becomes of commands: held, clamped, refused, counted, replaced by safe values."""

from dataclasses import replace
from math import isfinite
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rig.bench.run.command_queue import CLAMPED, SAFE
from rig.bench.run.exchange import Exchange, Playback
from rig.bench.run.journal import Journal
from rig.bus.impaired_link import ImpairedLink
from rig.errors import UsageError

MS = 1_000_000


class Loop:
    """The exchange of a stand; `nf` drives its load."""

    def __init__(self, runner, hold=50, **delay):
        self.runner = runner
        self.exchange = Exchange(runner, MS, hold, Journal(MS, lambda: runner.tick))
        self.exchange.admit("nf", ["load.force"], MS, **delay)
        self.queue = self.exchange.queues["nf"]

    def at(self, tick, *commands, name="nf"):
        """Receive (answered tick, value, ...) of `name` at `tick`, and put into force what is due."""
        self.runner.tick = tick
        for answered, *values in commands:
            self.exchange.receive(name, answered, tuple(values))
        return self.exchange.take_over()

    @property
    def load(self):
        return self.runner.value["load.force"]

    def kinds(self):
        return [event.kind for event in self.exchange.journal.events]

    def builds(self, done, *held):
        """A rig that the values need is built (`done`) or is being built: meanwhile the values `held` stay."""
        self.exchange.rebuild = SimpleNamespace(done=done, possible=lambda drives, values: held or values)

    def range(self, **limits):
        self.runner.inputs["load.force"] = replace(self.runner.inputs["load.force"], **limits)


@pytest.fixture
def loop(runner):
    return Loop(runner)


def test_the_delay_of_a_loop_is_a_queue_and_a_late_command_waits_no_longer_than_it_must(runner):
    loop = Loop(runner, delay_ns=3 * MS)
    for tick in range(10):
        loop.at(tick, (tick, 30.0 + tick))
    assert runner.done == [(tick, "load.force", 27.0 + tick) for tick in range(3, 10)]
    assert (loop.queue.counts.late, loop.queue.counts.oldest) == (0, 3)
    loop.at(20, (14, 50.0))
    assert (loop.load, loop.queue.counts.late) == (50.0, 1)


def test_a_command_that_is_too_old_when_it_would_take_effect_is_discarded_and_counted(runner):
    loop = Loop(runner, hold=5, delay_ns=3 * MS)
    assert loop.queue.oldest == 3 + 1 + 5
    loop.at(3, (0, 30.0))
    loop.at(30, (20, 40.0), (10, 41.0), (19, 42.0))
    assert (loop.load, loop.queue.status) == (20.0, SAFE)
    loop.at(31, (20, 40.0), (22, 43.0), (21, 44.0))  # the last one that may take effect does
    assert (loop.load, loop.queue.answered) == (43.0, 22)
    counts = loop.queue.counts
    assert (counts.outdated, counts.overtaken, counts.taken, counts.oldest) == (5, 0, 2, 9)
    assert [event.text for event in loop.exchange.journal.events if event.kind == "outdated"] == [
        "commands of nf are older than 9 ms and are discarded"
    ]


def test_the_longest_delay_of_its_link_does_not_make_a_command_too_old(runner):
    link = ImpairedLink("act/nf", 1, MS, delay_ns=20 * MS, jitter_ns=10 * MS)
    runner.tick = 0
    exchange = Exchange(runner, MS, 5, Journal(MS, lambda: runner.tick), {"nf": link})
    exchange.admit("nf", ["load.force"], MS)
    loop = exchange.queues["nf"]
    assert loop.oldest == 30 + 1 + 5
    for tick in range(200):
        runner.tick = tick
        exchange.receive("nf", tick, (30.0,))
        exchange.take_over()
    assert loop.counts.outdated == 0
    assert 25 < loop.counts.oldest <= 30
    exchange.receive("nf", 199 - 30, (40.0,))  # in time without its link
    for runner.tick in range(200, 231):
        exchange.take_over()
    assert loop.counts.outdated == 1
    assert {value for _, _, value in runner.done} == {30.0, 20.0}  # 20 N: the safe value


def test_a_command_that_waits_too_long_for_its_rig_is_discarded(runner):
    loop = Loop(runner, hold=5)
    loop.builds(False, 20.0)
    loop.at(5, (0, 90.0))
    for tick in (6, 7):
        loop.at(tick)
    loop.builds(True)
    loop.at(8)
    assert (loop.load, loop.queue.wanted, loop.queue.counts.outdated) == (20.0, (), 1)


def test_a_missing_command_is_held_then_replaced_by_the_safe_value(loop):
    loop.at(0, (0, 90.0))
    for tick in range(1, 100):
        loop.at(tick)
    assert loop.runner.done == [(0, "load.force", 90.0), (51, "load.force", 20.0)]
    assert (loop.queue.counts.held, loop.queue.counts.safe) == (51, 1)
    loop.at(100, (100, 80.0))
    assert loop.load == 80.0
    assert loop.kinds() == ["safe", "back"]


def test_a_command_that_waits_is_clamped_to_the_range_of_the_tick_at_which_it_takes_effect(loop):
    """It waits for a rig that is being built; meanwhile somebody makes the range of its actuator smaller."""
    loop.builds(False, 20.0)
    loop.at(0, (0, 90.0))
    loop.range(high=60.0)
    loop.builds(True)
    loop.at(1)
    assert loop.runner.done == [(0, "load.force", 20.0), (1, "load.force", 60.0)]
    assert (loop.queue.wanted, loop.queue.status, loop.queue.counts.clamped) == ((), CLAMPED, 1)


def test_one_actuator_has_one_owner(loop):
    for drives, period, told in (
        ("load.force", MS, "driven by nf already"),
        ("load.mass", MS, "no such actuator"),
        ("drive.speed", MS + 1, "no whole number"),
    ):
        with pytest.raises(UsageError, match=told):
            loop.exchange.admit("other", [drives], period)
    for tick in range(3000):
        loop.exchange.receive("stranger", tick, (5.0,))
        loop.at(tick, (tick, 5.0, 6.0))
    assert loop.runner.done == []
    assert loop.exchange.counters()["refused"] == {"stranger": 3000}
    assert loop.queue.counts.refused == 3000
    assert loop.kinds() == ["refused"] * 6  # each once a second


def test_a_controller_from_outside_gives_its_actuator_back_and_its_counts_and_commands_stay(runner):
    loop = Loop(runner, hold=5)
    for begin in (0, 100):
        loop.at(begin)
        loop.exchange.admit("mine", ["drive.speed"], MS)
        loop.at(begin, (begin, 0.5), name="mine")
        assert runner.value["drive.speed"] == 0.5
        loop.at(begin + 50)
        loop.exchange.dismiss("mine")
        assert runner.value["drive.speed"] == 0.06
    loop.exchange.admit("yours", ["drive.speed"], MS)
    counts = loop.exchange.counters()
    assert (counts["mine"]["taken"], counts["mine"]["safe"], counts["yours"]["taken"]) == (2, 2, 0)
    assert loop.exchange.all_queues["mine"].commands().tick.tolist() == [0, 50, 100, 150]


def test_the_protocol_waits_until_the_controller_is_disconnected(loop):
    loop.exchange.ask("load.force", 40.0)
    assert loop.load == 40.0
    loop.at(0, (0, 50.0))
    loop.exchange.ask("load.force", 60.0)
    assert loop.load == 50.0
    assert loop.kinds() == ["overruled"]
    loop.exchange.connect("nf", False)
    assert loop.load == 60.0
    assert not loop.at(0, (0, 70.0))
    loop.exchange.connect("nf", True)
    loop.at(0, (0, 70.0))
    assert loop.load == 70.0


def test_a_ramp_goes_on_where_it_would_be(loop):
    loop.exchange.move("load.force", 40.0, 100)
    loop.at(10, (10, 50.0))
    loop.runner.tick = 30
    loop.exchange.connect("nf", False)
    moves = [(0, (40.0, 100)), (10, 50.0), (30, 26.0), (30, (40.0, 70))]
    assert loop.runner.done == [(tick, "load.force", value) for tick, value in moves]


REAL = st.floats(allow_nan=True, allow_infinity=True)
ARRIVALS = st.lists(st.tuples(st.integers(0, 120), st.integers(0, 5), st.tuples(REAL, REAL)), max_size=60)


def run(runner, kind, arrivals, switches, recorded=None):
    made = kind(runner, MS, 20, Journal(MS, lambda: runner.tick))
    made.admit("both", ["load.force", "dither.amplitude"], MS, 2 * MS)
    if recorded is not None:
        made.play({"both": recorded})
    for tick in range(150):
        runner.tick = tick
        if tick in switches:
            made.connect("both", switches[tick])
        for at, age, values in arrivals:
            if at == tick:
                made.receive("both", max(tick - age, 0), values)
        made.take_over()
    return made


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrivals=ARRIVALS, switches=st.dictionaries(st.integers(0, 140), st.booleans(), max_size=4))
def test_what_is_applied_is_finite_and_within_limits_and_can_be_played_again(fake, arrivals, switches):
    first, second = fake(), fake()
    made = run(first, Exchange, arrivals, switches)
    for _, name, value in first.done:
        assert isfinite(value)
        assert first.inputs[name].low <= value <= first.inputs[name].high
    commands = made.queues["both"].commands()
    assert np.all(np.isfinite(commands.values))
    assert np.all((commands.answered >= 0) | (commands.status == SAFE))
    again = run(second, Playback, [], switches, commands)
    assert second.done == first.done
    assert all(np.array_equal(a, b) for a, b in zip(again.queues["both"].commands(), commands))
