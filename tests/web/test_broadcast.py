"""What a slow, a hidden and a late page get."""

import asyncio
import json

from patience import PATIENCE_S

from rig.web.broadcast import AHEAD, KEPT, Broadcast


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


def numbers(messages):
    return [frame["n"] for message in messages for frame in message.get("frames", [])]


def test_a_page_that_does_not_acknowledge_gets_the_newest_frames_only_when_it_does():
    async def test():
        broadcast = Broadcast()
        page = broadcast.connect()
        for n in range(1, AHEAD + 1):
            broadcast.frame(json.dumps({"n": n}), False)
            assert numbers(await taken(page)) == [n]
        for n in range(AHEAD + 1, 100):
            broadcast.frame(json.dumps({"n": n}), n == 20)
            assert n > AHEAD + 1 or await nothing(page)
        page.heard(json.dumps({"ack": AHEAD}))
        assert numbers(await taken(page)) == [20, *range(100 - KEPT, 100)]  # no event is lost
        assert await nothing(page)

    run(test)


def test_a_hidden_page_gets_the_state_but_no_frames():
    async def test():
        broadcast = Broadcast()
        page = broadcast.connect()
        page.heard('{"hidden": true}')
        broadcast.frame('{"n": 1}', False)
        broadcast.put("state", {"phase": "running"})
        assert await taken(page) == [{"kind": "state", "state": {"phase": "running"}}]
        page.heard('{"hidden": false, "ack": 1}')
        broadcast.frame('{"n": 2}', False)
        assert numbers(await taken(page)) == [2]

    run(test)


def test_a_page_that_connects_late_gets_state_and_description_and_none_of_another_run():
    async def test():
        broadcast = Broadcast()
        broadcast.put("setup", {"run": "a"})
        broadcast.frame('{"n": 1}', False)
        broadcast.put("state", {"phase": "ended"})
        broadcast.put("setup", {"run": "b"})
        broadcast.frame('{"n": 7}', False)
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
