"""A controller as a process: against the twin of the bus."""

import contextlib
import json
import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from controlled_plant import FRAME, ROOT, Plant, described, section
from twin import Twin

from rig import controllers
from rig.bus import encode, messages
from rig.controllers.runtime import process
from rig.controllers.runtime.loop import Loop
from rig.controllers.squeal_switch import SquealSwitch
from rig.errors import BusError


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


def test_a_controller_that_wants_every_sample_gets_those_of_its_sensor():
    hub = Twin()
    hub.open("plant", "plant")
    watch = SquealSwitch(kind="squeal_switch", sensor="vibrometer", frequency=3400.0)
    setup = replace(described(), controllers={"shunt": controllers.described(watch, {"sample_period": 20e-6})})
    worker = process.Worker(hub.open("controller", "shunt"), setup, process.made(setup, "shunt"))
    loop = Loop(controllers.build(watch, {"sample_period": 20e-6}))
    for tick in range(20):
        fresh, v = np.array([3, 50]), np.sin(np.arange(50.0) + tick)
        step = encode.step(tick, tick * FRAME, [0.3, v[-1]], fresh, {0: np.zeros(3), 1: v})
        worker.answer_step(messages.decode("step", step))
        loop.answer(tick * FRAME, (v.tolist(),))
        assert worker.loop.state == loop.state
    worker.answer_step(messages.decode("step", encode.step(20, 20 * FRAME, [0.3, 0.0], np.ones(2, dtype=np.int64))))
    assert worker.loop.held == 1  # a step that does not bring them


def test_only_steps_that_are_due_are_answered():
    with at_work(period="4 ms") as plant:
        for tick in range(9):
            plant.send(tick, 0.01)
        assert [plant.answer().tick for _ in range(3)] == [0, 4, 8]
        assert plant.answer(0.1) is None


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


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ({"set": {"gain": "3 kg", "lowest": "1 N"}}, "gain: is '3 kg'"),
        ({"set": {"period": "2 ms"}}, "is fixed"),
        ({"get": ["gian"]}, "no parameter is called gian"),
        ({"sett": {"gain": 1.0}}, 'has \'sett\'; it can have "get" and "set", or "list" alone'),
    ],
)
def test_a_faulty_question_is_refused_and_changes_nothing(body, fault):
    with at_work() as plant:
        with pytest.raises(BusError, match=fault):
            plant.session.ask("param/feedback", body, 5.0)
        plant.send(0, 0.05)
        assert list(plant.answer().values) == [10.0]


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


def test_a_file_asks_the_plant_to_be_let_in():
    hub = Twin()
    plant = hub.open("plant", "plant")
    asked = []
    server = plant.serve("cmd/plant", lambda body: asked.append(body) or {})
    answering = threading.Thread(target=lambda: server.poll(5.0), daemon=True)
    answering.start()
    controller = process.made(described(), "example_controller", ROOT / "docs" / "example_controller.py")
    process.Worker(hub.open("controller", "example_controller"), described(), controller)
    answering.join(5.0)
    wanted = {"reads": ["vibrometer"], "drives": ["load.force"], "period_ns": FRAME, "hears": False}
    assert asked == [{"do": "admit", "controller": "example_controller", **wanted}]
