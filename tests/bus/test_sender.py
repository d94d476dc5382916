"""The sender thread: in order, never silent about a fault, and it goes on after one."""

import threading

import pytest

from rig.bus.messages import LONGEST, Batch
from rig.bus.session import Sender
from rig.errors import BusError


def test_everything_is_sent_in_order_before_it_closes():
    sender, sent = Sender(), []
    for k in range(200):
        sender.post(lambda k=k: sent.append((k, threading.current_thread().name)))
    sender.close()
    assert sent == [(k, "sender") for k in range(200)]


@pytest.mark.parametrize("fault", [BusError("could not be sent"), ValueError("could not be sent")])
def test_a_fault_reaches_the_next_who_posts_and_ends_nothing(fault):
    posted, sent, sender = threading.Event(), threading.Event(), Sender()

    def fail():
        posted.wait(5.0)
        raise fault

    sender.post(fail)
    sender.post(sent.set)
    posted.set()
    assert sent.wait(5.0)
    with pytest.raises(BusError, match="could not be sent"):
        sender.post(sent.set)
    sender.close()


def test_a_batch_is_not_flushed_for_a_message_that_has_left_it():
    flushed = []
    batch = Batch(lambda rows: flushed.append(len(rows)))
    for _ in range(16):  # the age of the batch sends the last one
        batch.add("plant", "state", bytes(16), bytes(LONGEST // 20))
    batch.add("plant", "state", bytes(16), bytes(LONGEST - LONGEST // 20))
    assert flushed == [16]
