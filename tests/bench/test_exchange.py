"""What becomes of commands: held, clamped, refused, counted, replaced by safe values."""

from dataclasses import replace
from math import inf, isfinite, nan
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rig
from rig.bench.run.command_queue import CLAMPED, SAFE
from rig.bench.run.exchange import Exchange, Playback
from rig.bench.run.journal import Journal
from rig.errors import UsageError
from rig.scenes.protocol import STEPS

MS = 1_000_000


def exchange(runner, hold=50, kind=Exchange, **delay):
    made = kind(runner, MS, hold, Journal(MS, lambda: runner.tick))
    made.admit("nf", ["load.force"], MS, **delay)
    return made


def kinds(made):
    return [event.kind for event in made.journal.events]


def test_a_command_is_in_force_at_the_tick_of_its_arrival(runner):
    made = exchange(runner)
    runner.tick = 7
    made.receive("nf", 7, (30.0,))
    assert [line.name for line in made.take_over()] == ["nf"]
    assert runner.done == [(7, "load.force", 30.0)]


def test_the_later_of_two_commands_counts(runner):
    made = exchange(runner)
    runner.tick = 7
    made.receive("nf", 5, (30.0,))
    made.receive("nf", 6, (31.0,))
    made.take_over()
    assert runner.value["load.force"] == 31.0
    assert made.queues["nf"].counts.overtaken == 1


def test_the_delay_of_a_loop_is_a_queue(runner):
    made = exchange(runner, delay_ns=3 * MS)
    for _ in range(10):
        made.receive("nf", runner.tick, (30.0 + runner.tick,))
        made.take_over()
        runner.frame()
    assert runner.done == [(tick, "load.force", 27.0 + tick) for tick in range(3, 10)]
    assert made.queues["nf"].counts.late == 0
    assert made.queues["nf"].counts.oldest == 3


def test_a_late_command_waits_no_longer_than_it_must(runner):
    made = exchange(runner, delay_ns=3 * MS)
    runner.tick = 8
    made.receive("nf", 2, (30.0,))
    made.take_over()
    assert runner.value["load.force"] == 30.0
    assert made.queues["nf"].counts.late == 1


def test_a_missing_command_is_held_then_replaced_by_the_safe_value(runner):
    made = exchange(runner, hold=50)
    made.receive("nf", 0, (90.0,))
    for tick in range(100):
        runner.tick = tick
        made.take_over()
    assert runner.done == [(0, "load.force", 90.0), (51, "load.force", 20.0)]
    counts = made.queues["nf"].counts
    assert (counts.held, counts.safe) == (51, 1)
    runner.tick = 100
    made.receive("nf", 100, (80.0,))
    made.take_over()
    assert runner.value["load.force"] == 80.0
    assert kinds(made) == ["safe", "back"]


def test_a_slow_controller_is_not_silent_between_its_commands(runner):
    made = Exchange(runner, MS, 50, Journal(MS, lambda: runner.tick))
    made.admit("slow", ["load.force"], 100 * MS)
    for tick in range(1000):
        runner.tick = tick
        if tick % 100 == 0:
            made.receive("slow", tick, (30.0 + tick,))
        made.take_over()
    assert (made.queues["slow"].counts.held, made.queues["slow"].counts.safe) == (0, 0)


def test_a_controller_that_never_spoke_took_nothing_over(runner):
    made = exchange(runner)
    made.receive("nf", 0, ())
    runner.tick = 1000
    assert not made.take_over()
    assert (runner.done, kinds(made)) == ([], [])


@pytest.mark.parametrize(("given", "applied"), [(1e9, 100.0), (-5.0, 0.0), (100.0, 100.0)])
def test_out_of_range_is_clamped_and_counted(runner, given, applied):
    made = exchange(runner)
    made.receive("nf", 0, (given,))
    (line,) = made.take_over()
    assert runner.value["load.force"] == applied
    assert (line.counts.clamped, line.status) == ((0, 0) if given == applied else (1, CLAMPED))


def test_a_command_that_waits_is_clamped_to_the_range_of_the_tick_at_which_it_takes_effect(runner):
    """It waits for a rig that is being built; meanwhile somebody makes the range of its actuator smaller."""
    made = exchange(runner)
    made.rebuild = SimpleNamespace(done=False, possible=lambda drives, values: (20.0,))
    made.receive("nf", 0, (90.0,))
    (line,) = made.take_over()
    runner.inputs["load.force"] = replace(runner.inputs["load.force"], high=60.0)
    made.rebuild = SimpleNamespace(done=True, possible=lambda drives, values: values)
    runner.tick = 1
    assert made.take_over() == [line]
    assert runner.done == [(0, "load.force", 20.0), (1, "load.force", 60.0)]
    assert (line.wanted, line.status, line.counts.clamped) == ((), CLAMPED, 1)


def test_safe_values_that_need_another_rig_take_effect_when_it_is_built(runner):
    made = exchange(runner, hold=0)
    made.receive("nf", 0, (90.0,))
    made.take_over()
    made.rebuild = SimpleNamespace(done=False, possible=lambda drives, values: (90.0,))
    runner.tick = 1
    (line,) = made.take_over()
    assert (line.values, line.wanted, line.status) == ((90.0,), (20.0,), SAFE)
    made.rebuild = SimpleNamespace(done=True, possible=lambda drives, values: values)
    runner.tick = 9
    assert made.take_over() == [line]
    assert runner.done == [(0, "load.force", 90.0), (9, "load.force", 20.0)]
    assert (line.wanted, line.status, line.counts.safe) == ((), SAFE, 1)


def test_what_the_protocol_asked_for_comes_back_within_the_range_of_that_tick(runner):
    made = exchange(runner)
    made.ask("load.force", 90.0)
    made.receive("nf", 0, (30.0,))
    made.take_over()
    runner.inputs["load.force"] = replace(runner.inputs["load.force"], high=60.0)
    made.connect("nf", False)
    assert runner.value["load.force"] == 60.0


def test_what_is_not_finite_is_held_and_counted(runner):
    made = Exchange(runner, MS, 50, Journal(MS, lambda: runner.tick))
    made.admit("both", ["load.force", "dither.amplitude"], MS)
    for tick, values in enumerate([(nan, 0.1), (30.0, 0.2), (inf, 0.3), (31.0, -inf)]):
        runner.tick = tick
        made.receive("both", tick, values)
        made.take_over()
    assert made.queues["both"].commands().values.tolist() == [[20.0, 0.1], [30.0, 0.2], [30.0, 0.3], [31.0, 0.3]]
    assert made.queues["both"].counts.not_finite == 3
    assert kinds(made) == ["not finite"]  # the same again within a second is counted, not told


def test_one_actuator_has_one_owner(runner):
    made = exchange(runner)
    with pytest.raises(UsageError, match="driven by nf already"):
        made.admit("other", ["load.force"], MS)
    with pytest.raises(UsageError, match="no such actuator"):
        made.admit("other", ["load.mass"], MS)
    with pytest.raises(UsageError, match="no whole number"):
        made.admit("other", ["drive.speed"], MS + 1)
    for tick in range(3000):
        runner.tick = tick
        made.receive("stranger", tick, (5.0,))
        made.receive("nf", tick, (5.0, 6.0))
        made.take_over()
    assert runner.done == []
    assert made.counters()["refused"] == {"stranger": 3000}
    assert made.queues["nf"].counts.refused == 3000
    assert kinds(made) == ["refused"] * 6  # each once a second


def test_a_controller_from_outside_gives_its_actuator_back(runner):
    made = exchange(runner)
    made.admit("mine", ["drive.speed"], MS)
    made.receive("mine", 0, (0.5,))
    made.take_over()
    made.dismiss("mine")
    assert runner.value["drive.speed"] == 0.06
    made.admit("yours", ["drive.speed"], MS)


def test_the_counts_and_commands_of_a_dismissed_controller_stay(runner):
    made = Exchange(runner, MS, 5, Journal(MS, lambda: runner.tick))
    for begin in (0, 100):
        runner.tick = begin
        made.admit("mine", ["drive.speed"], MS)
        made.receive("mine", begin, (0.5,))
        made.take_over()
        runner.tick = begin + 50
        made.take_over()
        made.dismiss("mine")
        assert made.queues == {}
    made.admit("yours", ["drive.speed"], MS)
    counts = made.counters()
    assert (counts["mine"]["taken"], counts["mine"]["safe"], counts["yours"]["taken"]) == (2, 2, 0)
    assert made.all_queues["mine"].commands().tick.tolist() == [0, 50, 100, 150]


def test_a_controller_that_drives_nothing_is_written_down(runner):
    made = Exchange(runner, MS, 5, Journal(MS, lambda: runner.tick))
    made.admit("watcher", [], MS)
    made.receive("watcher", 0, ())
    made.take_over()
    assert made.queues["watcher"].commands().values.shape == (1, 0)


def test_a_command_is_clamped_to_the_range_as_it_is_now(runner):
    made = exchange(runner)
    runner.inputs["load.force"] = replace(runner.inputs["load.force"], low=15.0, safe=25.0)
    made.receive("nf", 0, (10.0,))
    made.take_over()
    assert (runner.value["load.force"], made.queues["nf"].status) == (15.0, CLAMPED)
    runner.tick = 60
    made.take_over()
    assert (runner.value["load.force"], made.queues["nf"].status) == (25.0, SAFE)


def test_the_protocol_waits_until_the_controller_is_disconnected(runner):
    made = exchange(runner)
    made.ask("load.force", 40.0)
    assert runner.value["load.force"] == 40.0
    made.receive("nf", 0, (50.0,))
    made.take_over()
    made.ask("load.force", 60.0)
    assert runner.value["load.force"] == 50.0
    assert kinds(made) == ["overruled"]
    made.connect("nf", False)
    assert runner.value["load.force"] == 60.0
    made.receive("nf", 0, (70.0,))
    assert not made.take_over()
    made.connect("nf", True)
    made.receive("nf", 0, (70.0,))
    made.take_over()
    assert runner.value["load.force"] == 70.0


def test_a_ramp_goes_on_where_it_would_be(runner):
    made = exchange(runner)
    made.move("load.force", 40.0, 100)
    runner.tick = 10
    made.receive("nf", 10, (50.0,))
    made.take_over()
    runner.tick = 30
    made.connect("nf", False)
    assert runner.done == [
        (0, "load.force", (40.0, 100)),
        (10, "load.force", 50.0),
        (30, "load.force", 26.0),
        (30, "load.force", (40.0, 70)),
    ]


def test_a_ramp_ends_at_the_limit_that_it_reaches():
    """It keeps its slope, and stays there."""
    steps = [{"step": "ramp", "target": "drive.speed", "to": 0.26, "over": 2.0}, {"step": "hold", "time": 0.5}]
    scene = rig.load("belt", {"drive.speed_max": 0.25})
    speed = rig.simulate(replace(scene, protocol=STEPS.validate_python(steps))).signals["surface_speed"]
    t = np.arange(len(speed)) * 1e-3
    np.testing.assert_allclose(speed, np.minimum(0.06 + 0.1 * t, 0.25), rtol=1e-3)
    assert set(speed[1905:]) == {0.25}


def test_giving_up_makes_everything_safe(runner):
    made = exchange(runner)
    made.receive("nf", 0, (50.0,))
    made.take_over()
    made.ask("dither.amplitude", 0.3)
    made.give_up(500)
    made.receive("nf", 0, (60.0,))
    assert not made.take_over()
    assert runner.value["dither.amplitude"] == 0.0
    assert (0, "drive.speed", (0.0, 500)) in runner.done
    assert (0, "load.force", (20.0, 500)) in runner.done


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
