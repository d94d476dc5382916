"""Publishing, presence, questions and losses: the same facts over Zenoh and over the twin."""

import threading
import time

import numpy as np
import pytest
from twin import Twin

from rig.bus import encode, messages
from rig.bus.messages import EVERY, LONGEST
from rig.bus.run_setup import Setup, fetch
from rig.bus.topics import Arrived, Count
from rig.errors import BusError


def gather(receiver, count, timeout=3.0):
    found, deadline = [], time.monotonic() + timeout
    while len(found) < count and time.monotonic() < deadline:
        if (one := receiver.get(0.1)) is not None:
            found.append(one)
    return found


def ready(wire, name="one"):
    """A joined session whose presence the plant has seen, so that its receivers are known to stand."""
    watch = wire.plant.watch()
    return lambda: watch.wait_for("controller", name, 3.0)


@pytest.mark.parametrize("polled", [False, True])
def test_what_is_put_arrives_in_order_with_number_and_time(wire, polled):
    seen = ready(wire)
    one = wire.join()
    steps = one.subscribe("step", polled=polled)
    one.announce()
    assert seen()
    step = wire.plant.publisher("step")
    for tick in range(500):
        step.put(encode.act(tick, tick * 1000, [float(tick)]), tick * 1000)
    found = gather(steps, 500)
    assert [m.seq for m in found] == list(range(500))
    assert all(m.topic == "step" and m.t_ns == 1000 * m.seq for m in found)
    assert messages.decode("step", found[7].payload).values[:] == [7.0]
    assert (step.sent, steps.received, steps.lost) == (500, 500, 0)


def test_a_pattern_hears_each_topic_and_counts_it_apart(wire):
    seen = ready(wire)
    one = wire.join()
    heard = one.subscribe("meas/*")
    one.announce()
    assert seen()
    for name, count in (("laser", 3), ("gauge", 5)):
        for _ in range(count):
            wire.plant.publisher(f"meas/{name}").put(b"", 0)
    wire.plant.publisher("step").put(b"", 0)
    wire.plant.flush()
    gather(heard, 8)
    assert heard.get(0.05) is None
    assert {topic: c.received for topic, c in heard.counts.items()} == {"meas/laser": 3, "meas/gauge": 5}


def test_nobody_hears_himself(wire):
    seen = ready(wire)
    own, one = wire.plant.subscribe("**"), wire.join()
    heard = one.subscribe("**")
    one.announce()
    assert seen()
    wire.plant.publisher("step").put(b"", 0)
    wire.plant.flush()
    assert gather(heard, 1)
    assert own.get(0.05) is None


def test_answers_travel_back_and_are_stamped(wire):
    acts = wire.plant.subscribe("act/*", stamped=True)
    one = wire.join()
    before = time.monotonic_ns()
    deadline = time.monotonic() + 3.0
    while (said := acts.get(0.05)) is None and time.monotonic() < deadline:
        one.publisher("act/one").put(encode.act(1, 2, [3.0]), 2)
    assert said.topic == "act/one"
    assert before < said.arrived_ns <= time.monotonic_ns()


def test_overflow_is_counted_equally_at_both_ends(wire):
    seen = ready(wire)
    one = wire.join()
    steps = one.subscribe("step", depth=100)
    one.announce()
    assert seen()
    step = wire.plant.publisher("step")
    step.put(b"", 0)
    first = steps.get(2.0)  # the receiver has begun
    for _ in range(1000):
        step.put(b"x" * 50, 0)
    time.sleep(0.3)  # nobody reads meanwhile
    kept = gather(steps, 100)
    step.put(b"", 0)
    assert first.seq == 0
    assert [m.seq for m in kept] == list(range(901, 1001))
    assert gather(steps, 1)[0].seq == 1001
    assert steps.lost == 900
    assert steps.received + steps.lost == step.sent


def test_polled_overflow_is_counted_too(wire):
    seen = ready(wire)
    one = wire.join()
    steps = one.subscribe("step", depth=64, polled=True)
    one.announce()
    assert seen()
    step = wire.plant.publisher("step")
    step.put(b"", 0)
    gather(steps, 1)
    for _ in range(1000):
        step.put(b"x" * 50, 0)
    time.sleep(0.3)
    steps.drain()
    assert steps.counts["step"].last == 1000
    assert steps.received == 65
    assert steps.received + steps.lost == step.sent


def test_what_is_lost_at_the_end_shows_in_the_totals():
    count = Count()
    for seq in (3, 4, 6):
        count.see(seq, 0.0)
    assert (count.first, count.received, count.lost, count.tail(10)) == (3, 3, 1, 3)


def test_a_publisher_that_starts_anew_is_not_a_loss():
    count = Count()
    for seq in (0, 1, 2, 0, 1):
        count.see(seq, 0.0)
    assert (count.received, count.lost) == (5, 0)
    count.see(3, 0.0)
    assert count.lost == 1
    count.see(2, 0.0)  # it starts anew, and its first two messages are lost
    assert count.lost == 3


def test_totals_tell_what_was_sent_and_heard(wire):
    seen = ready(wire)
    one = wire.join()
    heard = one.subscribe("**")
    one.announce()
    assert seen()
    for _ in range(3):
        wire.plant.publisher("step").put(b"", 0)
    wire.plant.flush()
    gather(heard, 3)
    wire.plant.publisher("total/plant").put(wire.plant.totals(), 0)
    said = messages.decode("total/plant", gather(heard, 1)[0].payload)
    assert dict(zip(said.sent_topic, said.sent)) == {"step": 3, "total/plant": 0}
    own = messages.decode("total/one", one.totals())
    assert dict(zip(own.heard_topic, own.received)) == {"step": 3, "total/plant": 1}
    assert list(own.lost) == [0, 0]


def test_joining_and_leaving_is_seen(wire):
    wire.plant.announce()
    watch = wire.plant.watch("controller/*")
    one = wire.join(name="one")
    theirs = one.watch("plant/*")
    assert watch.poll(0.05) == []  # not before it announces
    one.announce()
    assert watch.wait_for("controller", "one", 3.0)
    assert theirs.wait_for("plant", "plant", 3.0)
    wire.join(role="viewer", name="two").announce()
    one.close()
    assert [(p.name, p.here) for p in watch.poll(3.0)] == [("one", False)]
    assert watch.present == set()


def test_a_latecomer_sees_who_is_here(wire):
    one = wire.join()
    one.announce()
    assert wire.plant.watch().wait_for("controller", "one", 3.0)
    assert wire.join(name="two").watch().wait_for("controller", "one", 3.0)


def test_who_is_present_is_told_at_once_and_whole(wire):
    assert wire.plant.present() == set()
    names = [f"c{i}" for i in range(8)]
    for name in names:
        wire.join(name=name).announce()
    viewer = wire.join(role="viewer", name="eye")
    viewer.announce()
    watch = wire.plant.watch()
    assert all(watch.wait_for("controller", name, 3.0) for name in names)
    assert watch.wait_for("viewer", "eye", 3.0)
    late, begun = wire.join(role="operator", name="tune"), time.monotonic()
    assert late.present("controller/*") == {("controller", name) for name in names}
    assert ("viewer", "eye") in late.present()
    assert time.monotonic() - begun < 2.0  # it waits for answers, not for a time
    wire.plant.close()
    late.present()  # nobody is there to answer: it ends all the same


def serving(server, seconds=3.0):
    thread = threading.Thread(target=lambda: server.poll(seconds))
    thread.start()
    return thread


def test_questions_are_answered_in_the_thread_that_polls(wire):
    asked = []

    def answer(body):
        asked.append((body, threading.current_thread()))
        return {"values": {"gain": 2.0}}

    server = wire.plant.serve("param/plant", answer)
    one = wire.join()
    thread = serving(server)
    assert one.ask("param/plant", {"get": ["gain"]}, 3.0, patient=True) == {"values": {"gain": 2.0}}
    thread.join()
    assert asked == [({"get": ["gain"]}, thread)]


def test_a_refusal_reaches_the_asker_with_its_reason(wire):
    def answer(body):
        raise ValueError("gain must be positive, is -1")

    server = wire.plant.serve("param/plant", answer)
    one = wire.join()
    thread = serving(server)
    with pytest.raises(BusError, match="gain must be positive, is -1"):
        one.ask("param/plant", {"set": {"gain": -1}}, 3.0, patient=True)
    thread.join()


def test_a_question_that_nobody_has_read_is_refused_at_the_end(wire):
    server = wire.plant.serve("param/plant", lambda body: {})

    def end():
        time.sleep(0.5)  # the question is waiting by then
        server.give_up("the run ended before it was done")

    thread = threading.Thread(target=end)
    one = wire.join()
    thread.start()
    with pytest.raises(BusError, match="the run ended before it was done"):
        one.ask("param/plant", {}, 3.0, patient=True)
    thread.join()


def test_nobody_answers_is_said_within_the_time(wire):
    one = wire.join()
    begun = time.monotonic()
    with pytest.raises(BusError, match="no process answered cmd/plant") as told:
        one.ask("cmd/plant", {}, 10.0)
    assert "within" not in str(told.value)  # it did not wait so long
    wire.plant.serve("cmd/plant", lambda body: {})  # is there, but does not poll
    with pytest.raises(BusError, match=r"no process answered cmd/plant .* within 0\.3 s"):
        one.ask("cmd/plant", {}, 0.3, patient=True)
    assert time.monotonic() - begun < 1.5


def test_a_latecomer_learns_the_setup(wire):
    told = Setup("test", '{"plant": "belt"}', 1_000_000, 100_000, {"velocity": "m/s"}, {"laser": ("m/s", 100_000)})
    thread = serving(wire.plant.serve("scene", lambda body: told.to_json()))
    assert fetch(wire.join()) == told
    thread.join()


def test_the_last_word_before_closing_arrives(wire):
    seen = ready(wire)
    one = wire.join()
    heard = one.subscribe("event/*")
    one.announce()
    assert seen()
    for _ in range(200):
        wire.plant.publisher("event/plant").put(b"x" * 1000, 0)
    wire.plant.close()
    assert len(gather(heard, 200)) == 200


def test_closing_is_quick_and_may_be_repeated(wire):
    one = wire.join()
    one.subscribe("**", polled=True)
    one.serve("param/one", lambda body: {})
    one.announce()
    begun = time.monotonic()
    for session in (one, wire.plant, one, wire.plant):
        session.close()
    assert time.monotonic() - begun < 1.0


def test_a_value_of_numpy_can_be_put_as_block(wire):
    seen = ready(wire)
    one = wire.join()
    heard = one.subscribe("meas/laser")
    one.announce()
    assert seen()
    wire.plant.publisher("meas/laser").put(encode.block(1, 2, 3, np.arange(4.0)), 2)
    wire.plant.flush()
    assert messages.decode("meas/laser", gather(heard, 1)[0].payload).v[:] == [0.0, 1.0, 2.0, 3.0]


def test_who_hears_everything_gets_the_loop_once_and_as_it_was_said(wire):
    """Step and command go straight to whom they are for; the plant sends copies of them with its batches."""
    seen = ready(wire)
    one, acts, recorder = wire.join(), wire.plant.subscribe("act/*"), wire.join("recorder", "recorder")
    steps, heard = one.subscribe("step"), recorder.subscribe("**")
    one.announce()
    assert seen()
    for tick in range(3):
        wire.plant.publisher("step").put(encode.act(tick, tick, [1.0]), tick)
        assert gather(steps, 1)
        one.publisher("act/one").put(encode.act(tick, tick, [float(tick)]), tick)
        assert gather(acts, 1)
        wire.plant.publisher("meas/laser").put(encode.block(tick, 0, 1, [2.0]), tick)
    assert steps.get(0.05) is None
    assert heard.get() is None  # nobody has waited long enough for a batch to be sent
    wire.plant.publisher("event/plant").put(messages.event(5, 0, "plant", "mark", "after that"), 5)
    found = gather(heard, 10)
    assert heard.get(0.05) is None
    looped = [(m.topic, m.seq, m.t_ns, m.user) for m in found if m.topic != "event/plant"]
    assert looped == [
        (topic, tick, tick, user)
        for tick in range(3)
        for topic, user in (("step", "plant"), ("act/one", one.user), ("meas/laser", "plant"))
    ]
    assert [m.said.values[:] for m in found if m.topic == "act/one"] == [[0.0], [1.0], [2.0]]
    assert {topic: c.received for topic, c in heard.counts.items()} == {
        "step": 3, "act/one": 3, "meas/laser": 3, "event/plant": 1,
    }  # fmt: skip


def test_a_batch_is_sent_when_it_is_flushed_or_old(wire):
    seen = ready(wire)
    one = wire.join()
    heard = one.subscribe("meas/*")
    one.announce()
    assert seen()
    laser = wire.plant.publisher("meas/laser")
    laser.put(b"", 0)
    laser.put(b"", 1)
    assert heard.get(0.02) is None
    wire.plant.flush()
    assert [m.seq for m in gather(heard, 2)] == [0, 1]
    time.sleep(0.03)
    for k in range(2, EVERY + 2):
        laser.put(b"", k)
    assert [m.seq for m in gather(heard, EVERY)] == list(range(2, EVERY + 2))


def test_a_long_batch_is_sent_in_pieces_with_what_was_collected_for_it(wire):
    seen = ready(wire)
    one = wire.join()
    heard = one.subscribe("meas/*", "applied/*")
    one.announce()
    assert seen()
    laser, collected = wire.plant.publisher("meas/laser"), wire.plant.publisher("applied/one")
    wire.plant.before_batches(lambda: collected.put(b"", 7))
    laser.put(b"", 0)
    assert heard.get(0.02) is None
    block = encode.block(0, 0, 1, np.zeros(LONGEST // 8))
    for k in (1, 2, 3):
        laser.put_later(k, bytes, block)
    wire.plant.publisher("event/plant").put(messages.event(5, 0, "plant", "mark", "after that"), 5)
    found = gather(heard, 5)
    assert [(m.topic, m.seq) for m in found] == [*(("meas/laser", k) for k in range(4)), ("applied/one", 0)]
    assert [len(m.payload) for m in found] == [0, *3 * [len(block)], 0]


def test_of_a_lost_batch_each_message_is_counted(runs):
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


def test_only_the_plant_sends_batches(runs):
    twin = Twin("test")
    heard, two = twin.open("recorder", "recorder").subscribe("**"), twin.open("controller", "two")
    with pytest.raises(BusError, match="belongs to plant"):
        two.publisher("batch")
    batch = messages.TYPES["Batch"](user=["plant"], topic=["step"], place=[0], header=[bytes(16)], said=[b""])
    good = Arrived("plant", "batch", batch.SerializeToString(), bytes(16), True, messages.encoding("batch"))
    for wrong in (
        good._replace(user="two"), good._replace(payload=b"nonsense"), good._replace(encoding="another"),
        good._replace(payload=messages.TYPES["Batch"](place=[0], said=[b""]).SerializeToString()),
        good._replace(payload=messages.TYPES["Batch"](place=[0], header=[b""], said=[b""]).SerializeToString()),
    ):  # fmt: skip
        heard.queue.put(wrong)
    assert heard.get() is None
    assert heard.inbound.total == 5
    heard.queue.put(good)
    assert heard.get().topic == "step"
