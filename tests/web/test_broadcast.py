"""What a slow and a late page get."""

import asyncio
import json

import numpy as np
from patience import PATIENCE_S

from rig.view.spans import Spans
from rig.web.broadcast import AHEAD, KEPT, Broadcast
from rig.web.frames import OUTPUTS, Frame


def run(test):
    asyncio.run(asyncio.wait_for(test(), PATIENCE_S))


async def taken(page):
    return [json.loads(text) for text in await page.next()]


async def nothing(page):
    try:
        await asyncio.wait_for(page.next(), 0.05)
    except TimeoutError:
        return True
    return False


def frame(n, events=False):
    """Frame number n, of the second before n, in which the one output goes from n - 1 to n."""
    low, high = np.array([[n - 1.0]]), np.array([[1.0 * n]])
    rows = Spans((n - 1) * 10**9, np.array([n * 10**9]), low, high, np.array([[n % 2]]))
    return Frame(json.dumps({"n": n}), events, {OUTPUTS: rows})


def frames(messages):
    return [frame for message in messages for frame in message.get("frames", [])]


def numbers(messages):
    return [frame["n"] for frame in frames(messages) if not frame.get("missed")]


def missed(messages):
    """Begin, end, lowest and highest value of what stands for frames that were left out."""
    rows = [frame["rows"] for frame in frames(messages) if frame.get("missed")]
    return [(one["from"], one["t"][0], one["low"][0][0], one["high"][0][0]) for one in rows]


def test_a_page_that_does_not_acknowledge_gets_the_newest_frames_only_when_it_does():
    async def test():
        broadcast = Broadcast()
        page = broadcast.connect()
        for n in range(1, AHEAD + 1):
            broadcast.frame(frame(n))
            assert numbers(await taken(page)) == [n]
        for n in range(AHEAD + 1, 100):
            broadcast.frame(frame(n, events=n == 20))
            assert n > AHEAD + 1 or await nothing(page)
        page.heard(json.dumps({"ack": AHEAD}))
        found = await taken(page)
        assert numbers(found) == [20, *range(100 - KEPT, 100)]  # no event is lost
        assert missed(found) == [(2.0, 19.0, 2.0, 19.0), (20.0, 93.0, 20.0, 93.0)]  # and no stretch of time
        assert await nothing(page)

    run(test)


def test_a_page_that_connects_late_gets_state_and_description_and_none_of_another_run():
    async def test():
        broadcast = Broadcast()
        broadcast.put("setup", {"run": "a"})
        broadcast.frame(frame(1))
        broadcast.put("state", {"phase": "ended"})
        broadcast.put("setup", {"run": "b"})
        broadcast.frame(frame(7))
        page = broadcast.connect()
        found = await taken(page)
        assert [message["kind"] for message in found] == ["state", "setup", "frames"]
        assert found[1]["setup"] == {"run": "b"}
        assert numbers(found) == [7]
        broadcast.put("setup", None)  # the next run begins
        assert await taken(broadcast.connect()) == [
            {"kind": "state", "state": {"phase": "ended"}},
            {"kind": "setup", "setup": None},
        ]

    run(test)
