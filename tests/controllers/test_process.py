"""A controller as a process: against the twin of the bus."""

import contextlib
import json
import math
import threading
import time

import pytest
from controlled_plant import FRAME, Plant, described, section
from twin import Twin

from rig import controllers
from rig.bus import messages
from rig.controllers.runtime import process
from rig.controllers.runtime.loop import Loop


@contextlib.contextmanager
def at_work(**given):
    """A plant and a worker in a thread, over the twin; the worker must end by itself."""
    hub = Twin()
    plant = Plant(hub.open("plant", "plant"))
    plant.session.announce()
    mine = hub.open("controller", "feedback")
    setup = described(**given)
    worker = process.Worker(mine, setup, process.made(setup, "feedback"))
    thread = threading.Thread(target=worker.follow, args=(lambda: False,), daemon=True)
    thread.start()
    assert plant.watch.wait_for("controller", "feedback", 5.0)
    plant.worker = worker
    yield plant
    plant.session.close()
    thread.join(3.0)
    assert not thread.is_alive()


def test_each_step_is_answered_with_its_tick_and_the_very_numbers_of_a_run_in_one_process():
    loop = Loop(controllers.build(section(filter=80.0), {}))
    with at_work(filter=80.0) as plant:
        for tick in range(200):
            v = 0.05 * math.sin(0.022 * tick)
            plant.send(tick, v)
            act = plant.answer()
            assert act.tick == tick
            assert tuple(act.values) == loop.answer(tick * FRAME, (v,))


def test_the_same_step_again_gets_the_same_answer_and_no_second_update():
    with at_work(filter=10.0) as plant:
        plant.send(0, 0.0)
        plant.answer()
        plant.send(1, 0.05)
        first = plant.answer()
        plant.send(1, 0.05)
        assert plant.answer() == first
        assert plant.worker.loop.updates == 2


def test_only_steps_that_are_due_are_answered():
    with at_work(period="4 ms") as plant:
        for tick in range(9):
            plant.send(tick, 0.01)
        assert [plant.answer().tick for _ in range(3)] == [0, 4, 8]
        assert plant.answer(0.1) is None


def caught_up(ticks, **given):
    """A plant that has sent the steps of all `ticks`, and the worker that found them and has answered."""
    hub = Twin()
    plant = Plant(hub.open("plant", "plant"))
    setup = described(**given)
    worker = process.Worker(hub.open("controller", "feedback"), setup, process.made(setup, "feedback"))
    for tick in ticks:
        plant.send(tick, 0.01 * tick)
    while (step := worker.next_step()) is not None:
        worker.answer_step(step)
    return plant, worker


def answers(plant):
    return [message.said.tick for message in plant.acts.drain()]


def test_a_controller_that_is_behind_by_no_more_than_the_hold_answers_every_step():
    plant, worker = caught_up(range(51))
    assert answers(plant) == [*range(51)]
    assert (worker.loop.skipped, plant.events.get()) == (0, None)


def test_a_controller_that_is_behind_by_more_skips_to_the_newest_step_that_is_due_and_says_so():
    plant, worker = caught_up(range(3, 70), period="4 ms")
    assert answers(plant) == [68]
    assert worker.loop.counters() == {"updates": 1, "held": 0, "refused": 0, "skipped": 16}
    event = plant.event()
    assert (event.kind, event.tick) == ("skipped", 68)
    assert json.loads(event.data) == {"first": 4, "last": 64, "arrived": [[4, 64]]}


def test_a_step_that_did_not_arrive_is_told_with_the_next_one():
    plant, worker = caught_up([0, 1, 4, 5])
    assert answers(plant) == [0, 1, 4, 5]
    assert worker.loop.skipped == 0
    assert json.loads(plant.event().data) == {"first": 2, "last": 3, "arrived": []}


def test_parameters_are_read_and_set_while_it_works():
    with at_work() as plant:
        asked = plant.session.ask("param/feedback", {"get": ["gain", "lowest"]}, 5.0)
        assert asked["values"] == {"gain": 200.0, "lowest": 0.0}
        plant.send(7, 0.05)
        plant.answer()
        changed = plant.session.ask("param/feedback", {"set": {"gain": "0.3 N*s/mm", "lowest": "1 N"}}, 5.0)
        assert changed["values"]["gain"] == pytest.approx(300.0)
        plant.send(8, 0.05)
        assert list(plant.answer().values) == pytest.approx([5.0])
        event = plant.event()
        assert (event.kind, event.source, event.tick) == ("parameter", "feedback", 7)
        assert json.loads(event.data)["set"] == {"gain": pytest.approx(300.0), "lowest": "1 N"}


def test_it_leaves_when_the_plant_leaves_and_says_what_it_did():
    with at_work() as plant:
        plant.send(0, 0.05)
        plant.answer()
        totals = plant.session.subscribe("total/*")
        began = time.monotonic()
        plant.session.leave()
        assert plant.event().kind == "left"
        assert time.monotonic() - began < 1.0
        said = messages.decode("total/feedback", totals.get(1.0).payload)
        assert dict(zip(said.heard_topic, said.received))["step"] == 1
        assert dict(zip(said.sent_topic, said.sent))["act/feedback"] == 1
