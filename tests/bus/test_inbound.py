"""What is let in from other processes: owners of topics, numbers, JSON, signs of life."""

import numpy as np
import pytest
from twin import Twin

from rig.bus import encode, messages
from rig.bus.inbound import InboundCheck
from rig.bus.topics import HEADER, Arrived, Refused


def arrived(topic, payload, seq, t_ns=0, user="plant", **more):
    return Arrived(user, topic, payload, HEADER.pack(seq, t_ns), encoding=messages.encoding(topic), **more)


def test_a_backlog_that_is_read_at_one_instant_is_let_in(monkeypatch):
    """A process was stopped for 12 s: some of what was sent meanwhile arrives, more is dropped, then comes the rest."""
    door, counts, now = InboundCheck(frozenset({"plant"})), {}, 1000.0
    monkeypatch.setattr("rig.bus.inbound.time.monotonic", lambda: now)

    def step(seq):
        door.message(arrived("step", encode.step(seq, 0, [0.0], np.ones(1, np.int64)), seq), counts)

    step(0)
    now += 12.0
    for seq in (*range(1, 500), *range(6_000, 6_100), *range(11_990, 12_000)):
        step(seq)
    assert counts["step"].lost == 12_000 - 610
    with pytest.raises(Refused, match="number"):
        door.message(arrived("step", b"", 10**9), counts)
    step(12_000)


@pytest.mark.parametrize(
    ("user", "topic"),
    [("nf", "act/other"), ("nf", "step"), ("guest-1", "act/nf"), ("recorder", "total/nf"), ("", "state")],
)
def test_nobody_speaks_for_another(user, topic):
    door = InboundCheck(frozenset({"plant", "nf", "recorder", "viewer", "operator"}))
    with pytest.raises(Refused, match="belongs to"):
        door.message(arrived(topic, b"", 0, user=user), {})


@pytest.mark.parametrize("key", ["alive/king/nf", "alive/plant/nf", "act/nf"])
def test_signs_of_life_of_another_form_are_refused(key):
    watch = Twin("tokens").open("plant", "plant").watch()
    watch.queue.put(Arrived("nf", key))
    watch.queue.put(Arrived("nf", "alive/controller/nf"))
    assert [(p.role, p.name) for p in watch.poll()] == [("controller", "nf")]
    assert watch.inbound.total == 1


DEEP = '{"x": ' + "[" * 32 + "]" * 32 + "}"


@pytest.mark.parametrize(
    "data", ['{"x": NaN}', '{"x": [-Infinity]}', '{"x": 1e999}', '{"x": 1' + "0" * 400 + "}", DEEP, "[1]", "1"]
)
def test_an_event_with_data_that_are_no_json_object_is_refused(data):
    door, counts = InboundCheck(frozenset({"plant"})), {}
    event = messages.TYPES["Event"](source="me", kind="parameter", data=data).SerializeToString()
    assert door.let_in(lambda a: door.message(a, counts), arrived("event/me", event, 0, user="guest-1")) is None
    assert door.total == 1
    assert not counts


def test_the_plant_may_tell_what_diverged():
    door, counts = InboundCheck(frozenset({"plant"})), {}
    event = messages.event(0, 0, "plant", "diverged", "it grew", {"state": [float("inf"), float("nan")]})
    assert door.message(arrived("event/plant", event, 0), counts).said.kind == "diverged"
