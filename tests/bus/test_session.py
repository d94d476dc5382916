"""Publishing, presence, questions and losses: the same facts over Zenoh and over the twin."""

import threading

import pytest
from twin import Twin

from rig.bus import encode, messages
from rig.errors import BusError


@pytest.mark.parametrize("polled", [False, True])
def test_what_is_put_arrives_in_order_with_number_and_time(wire, gather, polled):
    _, steps = wire.hearing("step", polled=polled)
    step = wire.plant.publisher("step")
    for tick in range(500):
        step.put(encode.act(tick, tick * 1000, [float(tick)]), tick * 1000)
    told = gather(steps, 500)
    assert [(m.topic, m.seq, m.t_ns) for m in told] == [("step", k, 1000 * k) for k in range(500)]
    assert told[7].said.values[:] == [7.0]
    assert (step.sent, steps.received, steps.lost) == (500, 500, 0)


def test_a_pattern_hears_each_topic_and_counts_it_apart_and_nobody_hears_himself(wire, gather):
    own = wire.plant.subscribe("**")
    _, heard = wire.hearing("meas/*")
    for name, count in (("laser", 3), ("gauge", 5)):
        for _ in range(count):
            wire.plant.publisher(f"meas/{name}").put(b"", 0)
    wire.plant.publisher("step").put(b"", 0)
    wire.plant.flush()
    gather(heard, 8)
    assert heard.get(0.05) is None
    assert {topic: c.received for topic, c in heard.counts.items()} == {"meas/laser": 3, "meas/gauge": 5}
    assert own.get() is None


@pytest.mark.parametrize(("depth", "polled"), [(100, False), (64, True)])
def test_overflow_is_counted_equally_at_both_ends(wire, gather, depth, polled):
    one, steps = wire.hearing("step", depth=depth, polled=polled)
    last = one.subscribe("health")  # of a lower priority: it comes after them
    step = wire.plant.publisher("step")
    step.put(b"", 0)
    assert gather(steps, 1)[0].seq == 0  # the receiver has begun
    for _ in range(1000):
        step.put(b"x" * 50, 0)
    wire.plant.publisher("health").put(b"", 0)
    assert last.get(20.0) is not None  # nobody read meanwhile
    kept = steps.drain()
    assert [m.seq for m in kept] == list(range(1001 - depth, 1001))
    assert (steps.received + steps.lost, steps.lost) == (step.sent, 1000 - depth)


def test_totals_tell_what_was_sent_and_heard(wire, gather):
    one, heard = wire.hearing("**")
    for _ in range(3):
        wire.plant.publisher("step").put(b"", 0)
    wire.plant.flush()
    gather(heard, 3)
    wire.plant.publisher("total/plant").put(wire.plant.totals(), 0)
    said = gather(heard, 1)[0].said
    assert dict(zip(said.sent_topic, said.sent)) == {"step": 3, "total/plant": 0}
    own = messages.decode("total/one", one.totals())
    assert dict(zip(own.heard_topic, own.received)) == {"step": 3, "total/plant": 1}
    assert list(own.lost) == [0, 0]


def test_joining_and_leaving_is_seen_also_by_latecomers(wire):
    wire.plant.announce()
    watch = wire.plant.watch("controller/*")
    one = wire.join(name="one")
    theirs = one.watch("plant/*")
    assert watch.poll(0.05) == []  # not before it announces
    one.announce()
    assert watch.wait_for("controller", "one", 20.0)
    assert theirs.wait_for("plant", "plant", 20.0)
    late = wire.join(role="viewer", name="two")
    late.announce()
    assert late.watch().wait_for("controller", "one", 20.0)
    assert late.present("controller/*") == {("controller", "one")}
    assert ("viewer", "two") in wire.join(role="operator", name="tune").present()
    one.close()
    assert [(p.name, p.here) for p in watch.poll(20.0)] == [("one", False)]
    assert watch.present == set()
    wire.plant.close()
    late.present()  # nobody is there to answer: it ends all the same


def test_questions_are_answered_in_the_thread_that_polls(wire):
    asked = []

    def answer(body):
        asked.append((body, threading.current_thread()))
        if "set" in body:
            raise ValueError("gain must be positive, is -1")
        return {"values": {"gain": 2.0}}

    thread = wire.serving("param/plant", answer)
    one = wire.join()
    assert one.ask("param/plant", {"get": ["gain"]}, 20.0, patient=True) == {"values": {"gain": 2.0}}
    thread.join()
    assert asked == [({"get": ["gain"]}, thread)]
    thread = wire.serving("cmd/plant", answer)
    with pytest.raises(BusError, match="gain must be positive, is -1"):
        one.ask("cmd/plant", {"set": {"gain": -1}}, 20.0, patient=True)
    thread.join()


def test_a_description_with_a_large_model_arrives_whole(wire):
    model = "m" * 6_000_000  # the reduced model of a structure; the bus drops other answers of this length
    thread = wire.serving("scene", lambda body: {"models": [model]})
    assert wire.join().ask("scene", {}, 20.0, patient=True) == {"models": [model]}
    thread.join()


def test_nobody_answers_is_said(wire):
    one = wire.join()
    with pytest.raises(BusError, match="no process answered cmd/plant") as told:
        one.ask("cmd/plant", {}, 60.0)
    assert "within" not in str(told.value)  # it did not wait so long
    wire.plant.serve("cmd/plant", lambda body: {})  # is there, but does not poll
    with pytest.raises(BusError, match=r"no process answered cmd/plant .* within 0\.3 s"):
        one.ask("cmd/plant", {}, 0.3, patient=True)


def test_the_last_word_before_closing_arrives_and_closing_may_be_repeated(wire, gather):
    one, heard = wire.hearing("event/*")
    one.serve("param/one", lambda body: {})
    for _ in range(200):
        wire.plant.publisher("event/plant").put(b"x" * 1000, 0)
    wire.plant.close()
    assert len(gather(heard, 200)) == 200
    for session in (one, wire.plant, one):
        session.close()


def test_who_hears_everything_gets_the_loop_once_and_as_it_was_said(wire, gather):
    """Step and command go straight to whom they are for; the plant sends copies of them with its batches."""
    acts, recorder = wire.plant.subscribe("act/*"), wire.join("recorder", "recorder")
    heard = recorder.subscribe("**")
    one, steps = wire.hearing("step")
    for tick in range(3):
        wire.plant.publisher("step").put(encode.act(tick, tick, [1.0]), tick)
        assert gather(steps, 1)
        one.publisher("act/one").put(encode.act(tick, tick, [float(tick)]), tick)
        assert gather(acts, 1)
        wire.plant.publisher("meas/laser").put(encode.block(tick, 0, 1, [2.0]), tick)
    assert steps.get(0.05) is None
    wire.plant.publisher("event/plant").put(messages.event(5, 0, "plant", "mark", "after that"), 5)
    told = gather(heard, 10)
    assert heard.get(0.05) is None
    looped = [(m.topic, m.seq, m.t_ns, m.user) for m in told if m.topic != "event/plant"]
    assert looped == [
        (topic, tick, tick, user)
        for tick in range(3)
        for topic, user in (("step", "plant"), ("act/one", one.user), ("meas/laser", "plant"))
    ]
    assert [m.said.values[:] for m in told if m.topic == "act/one"] == [[0.0], [1.0], [2.0]]
    assert {topic: c.received for topic, c in heard.counts.items()} == {
        "step": 3,
        "act/one": 3,
        "meas/laser": 3,
        "event/plant": 1,
    }


def test_of_a_lost_batch_each_message_is_counted():
    """Two batches come, of three: the numbers of the messages show what was in the other one."""
    twin = Twin("test")
    plant, heard = twin.open("plant", "plant"), twin.open("viewer", "v").subscribe("meas/*", "state", depth=1)
    for _ in range(3):
        for topic in ("meas/a", "meas/a", "state"):
            plant.publisher(topic).put(b"", 0)
        plant.flush()
        if not heard.counts:
            heard.drain()
    heard.drain()
    assert {t: (c.received, c.lost) for t, c in heard.counts.items()} == {"meas/a": (4, 2), "state": (2, 1)}
