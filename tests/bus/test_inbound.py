"""What is let in from other processes: owners of topics, numbers, JSON, signs of life."""

import random

import numpy as np
import pytest
from strange_messages import MS, meaningless
from twin import Twin

from rig.bus import encode, messages
from rig.bus.inbound import InboundCheck, read_json
from rig.bus.topics import HEADER, Arrived, Refused


@pytest.mark.parametrize(
    ("text", "kind"),
    [(b"{nope", "not JSON"), (b"[" * 70_000, "too long"), (b'{"a": NaN}', "not finite"), (b"[1]", "not JSON"),
     (b'{"a": "\\ud800"}', "not JSON")],
)  # fmt: skip
def test_json_that_is_no_question_is_refused_with_its_reason(text, kind):
    with pytest.raises(Refused) as refused:
        read_json(text)
    assert refused.value.kind == kind


def arrived(topic, payload, seq, t_ns=0, user="plant", **more):
    return Arrived(user, topic, payload, HEADER.pack(seq, t_ns), encoding=messages.encoding(topic), **more)


@pytest.mark.parametrize(
    ("totals", "kind"),
    [({"sent_topic": ["step"], "sent": [1]}, "not its own topic"), ({"sent": [1]}, "wrong length"),
     ({"sent_topic": ["act/nf"], "sent": [2**62]}, "implausible number")],
)  # fmt: skip
def test_totals_that_cannot_be_are_refused(totals, kind):
    door = InboundCheck(frozenset({"plant"}))
    payload = messages.TYPES["Totals"](**totals).SerializeToString()
    with pytest.raises(Refused) as refused:
        door.message(arrived("total/nf", payload, 0, user="nf"), {})
    assert refused.value.kind == kind


def test_the_short_way_in_lets_in_and_counts_what_the_door_would():
    """Most messages are the next of their row and take the short way; the others are left to the door."""
    rng = random.Random(0)
    strict, short, counts, others = InboundCheck(frozenset({"plant"})), InboundCheck(frozenset({"plant"})), {}, {}
    seq, tick, passed = {"step": 0, "act/nf": 0}, 0, 0
    for _ in range(2000):
        topic, user = rng.choice((("step", "plant"), ("act/nf", "nf")))
        tick += 1
        payload = (
            encode.step(tick, tick * MS, [0.0], np.ones(1, np.int64)) if topic == "step" else meaningless(rng, topic)
        )
        wrong = rng.random()
        number = seq[topic] if wrong < 0.9 else rng.choice((0, seq[topic] + 2, 2**64 - 1))
        header = HEADER.pack(number, 0 if wrong < 0.97 else 2**64 - 1) if wrong < 0.99 else b"abc"
        payload = payload if rng.random() < 0.97 else payload[: rng.randrange(len(payload) + 1)] + b"\xff"
        told = Arrived(user, topic, payload, header, True, messages.encoding(topic))
        judged = strict.let_in(lambda given: strict.message(given, counts), told)
        row = short.row(user, topic, others)
        message = None if row is None else short.usual(row, header + payload, 0)
        passed += message is not None
        if message is None:
            message = short.let_in(lambda given: short.message(given, others), told)
        assert message == judged or (message[:5] == judged[:5] and repr(message.said) == repr(judged.said))
        if judged is not None:
            seq[topic] = number + 1
    assert 500 < passed < 2000
    assert strict.refused == short.refused
    told = [{t: (c.received, c.lost, c.first, c.last) for t, c in each.items()} for each in (counts, others)]
    assert told[0] == told[1]


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
    ("user", "topic"), [("nf", "act/other"), ("nf", "step"), ("guest-1", "act/nf"), ("recorder", "total/nf"),
                        ("", "state")]
)  # fmt: skip
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
