"""Lockstep over the twin of the bus: what the compiled loop asks of controllers in other processes."""

import math
import threading
from itertools import groupby

from patience import PATIENCE_S
from plant_in_thread import Bench, ran, same_bits

from rig.bench.run.simulate import simulate
from rig.bus import encode, messages


class Played:
    """A controller nf that answers the step of each tick with `values(tick)`; it is silent for None."""

    def __init__(self, bench, values):
        self.session = bench.twin.open("controller", "nf")
        self.steps, self.act = self.session.subscribe("step"), self.session.publisher("act/nf")
        self.values, self.gone = values, threading.Event()
        self.seen = []
        self.session.announce()
        bench.thread(self.answer)

    def answer(self):
        while not self.gone.is_set():
            message = self.steps.get(0.02)
            if message is None:
                continue
            step = messages.decode("step", message.payload)
            self.seen.append(step.tick)
            if (values := self.values(step.tick)) is not None:
                self.act.put(encode.act(step.tick, step.t_ns, values), step.t_ns)
        self.session.close()


def once(ticks):
    """`ticks` without those of repeated steps: a busy machine may take longer than 10 ms for an answer."""
    return [tick for tick, _ in groupby(ticks)]


def asked(heard):
    """The ticks of the steps."""
    return once(each.tick for each in heard["step"])


def played(scene, values, duration=0.4):
    """The bench after a run in lockstep with such a controller, and what was heard."""
    with Bench(scene, pace=None, duration=duration, expect=(("controller", "nf"),)) as bench:
        controller = Played(bench, values)
        plant = bench.begin()
        plant.join(PATIENCE_S)
        controller.gone.set()
        return bench, bench.finish()


def test_the_states_of_all_ticks_are_those_of_a_run_in_one_process(scene):
    bench, heard = ran(scene, pace=None, duration=0.5)
    run = simulate(scene, duration_ns=5 * 10**8)
    kind = messages.state_type(bench.plant.runner.outputs)
    states = [kind.FromString(payload) for payload in heard["state"]]
    assert [state.tick for state in states] == list(range(0, 501, 5))
    each = scene.frame_ns // scene.step_ns
    for name in ("displacement", "velocity"):
        assert [getattr(state, name) for state in states] == run.signals[name][:: 5 * each].tolist()
    assert asked(heard) == list(range(500))
    same_bits(heard, run)
    assert (bench.summary["verdict"], bench.summary["exit_code"]) == ("VALID", 0)
    assert 0.0 < bench.summary["round_trip"]["p50"] <= bench.summary["round_trip"]["max"]


def test_unusual_answers_are_handled_at_their_ticks(scene):
    odd = {100: (math.nan,), 150: (), 160: (1.0, 2.0), 170: (1e9,), 171: (-math.inf,)}
    bench, heard = played(scene, lambda tick: odd.get(tick, (20.0 + tick % 5,)))
    applied = {a.tick: a for a in heard["applied/nf"]}
    highest = bench.plant.runner.inputs["load.force"].high
    assert applied.keys() == {*range(400)} - {150, 160}
    expected = [20.0 + tick % 5 for tick in range(400)]
    expected[100], expected[170], expected[171] = expected[99], highest, highest
    assert [list(a.values) for a in applied.values()] == [[expected[tick]] for tick in applied]
    assert [tick for tick, a in applied.items() if a.status] == [170]
    counts = bench.summary["loop"]["nf"]
    assert (counts["not_finite"], counts["refused"], counts["clamped"], counts["held"]) == (2, 1, 1, 2)
    assert {event.tick for event in heard["event/plant"] if event.kind == "refused"} == {160}


def test_a_controller_that_leaves_is_missed_from_that_tick_on(scene):
    with Bench(scene, pace=None, duration=0.5, expect=(("controller", "nf"),)) as bench:

        def values(tick):
            if tick == 303:
                controller.gone.set()
                return None
            return (20.0,)

        controller = Played(bench, values)
        bench.begin().join(PATIENCE_S)
        heard = bench.finish()
    events = {event.kind: event.tick for event in heard["event/plant"]}
    assert events["left"] == 303
    assert events["safe"] == 302 + 1 + scene.clock.hold_frames
    assert bench.summary["ticks"] == 500


def test_an_operator_is_heard_while_controllers_answer(scene):
    with Bench(scene, pace=None, expect=(("controller", "nf"),)) as bench:
        bench.controller()
        bench.begin()

        def ask(do, **more):
            return bench.me.ask("cmd/plant", {"do": do, **more}, 20.0)["tick"]

        while ask("status") < 50:
            pass
        knocked, paused = ask("knock", impulse=0.1), ask("pause")
        assert all(ask("status") - paused in (0, 1) for _ in range(5)), "only the frame that had begun is finished"
        ask("stop")
        heard = bench.finish()
    ticks = {event.kind: event.tick for event in heard["event/plant"]}
    assert (ticks["knock"], ticks["paused"]) == (knocked, paused)
    assert ticks["stop"] - paused in (0, 1)
