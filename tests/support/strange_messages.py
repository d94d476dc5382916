"""Messages that are made up."""

import random

from rig.bus import messages
from rig.bus.topics import HEADER, Arrived
from rig.errors import BusError

MS = 1_000_000
TOPICS = (
    "step",
    "batch",
    "state",
    "health",
    "scene",
    "act/nf",
    "act/mine",
    "applied/nf",
    "meas/vibrometer",
    "truth/x",
    "event/nf",
    "event/plant",
    "total/nf",
    "total/plant",
    "total/x",
    "param/plant",
    "cmd/plant",
    "alive/controller/nf",
    "alive/plant/plant",
    "nonsense/x",
    "nonsense",
    "",
    "/",
    "//",
    "act",
    "act/",
    "act/*",
    "**",
    "act/nf/more",
    "alive",
    "alive/controller",
    "alive/controller/nf/more",
    "alive/king/nf",
    "act/../../evil x",
    "act/" + "x" * 300,
    "act/\u00e9\u2028\x00",
    "event/\ud800",
)
USERS = ("nf", "recorder", "viewer", "operator", "guest-1", "guest-2", "stranger", "", "\ud800", "x" * 1000)
NUMBERS = (0, 1, 2, 999, 10**6, 10**12, 2**53, 2**62, 2**63 - 1, -1, -(2**63))


def meaningless(rng, topic):
    """The bytes of a message whose numbers make no sense."""
    number = lambda: rng.choice(NUMBERS)  # noqa: E731
    reals = [rng.choice((0.0, 1e308, -1e308, float("nan"), float("inf"))) for _ in range(rng.randrange(4))]
    kinds = messages.TYPES
    try:
        kind = messages.topics.of(topic).message
    except BusError:
        kind = rng.choice(list(kinds))
    if kind == "Event":
        data = rng.choice(("", "{", "[" * 100_000, "[]", '{"a": NaN}', '{"set": 5}'))
        said = kinds["Event"](t_ns=number(), tick=number(), kind=rng.choice(("verdict", "x\x1b[2J")), data=data)
    elif kind == "Totals":
        said = kinds["Totals"](sent_topic=["step", ascii(topic)[:20]], sent=[number()], heard_topic=["step"])
    else:
        said = kinds["Act"](tick=number(), t_ns=number(), values=reals)
    return said.SerializeToString()


def message(rng: random.Random) -> Arrived:
    """One message that is wrong in one way or many."""
    topic = rng.choice(TOPICS)
    try:
        encoding = messages.encoding(topic)
    except BusError:
        encoding = ""
    whole = meaningless(rng, topic) if rng.random() < 0.7 else rng.randbytes(rng.choice((0, 1, 3, 40, 4000)))
    cut = rng.random()
    payload = whole if cut < 0.6 else whole[: rng.randrange(len(whole) + 1)] + (b"\xff" if cut < 0.8 else b"")
    header = rng.choice(
        (
            None,
            b"",
            b"abc",
            rng.randbytes(16),
            HEADER.pack(2**64 - 1, 0),
            HEADER.pack(0, 2**64 - 1),
            HEADER.pack(rng.randrange(50), rng.randrange(10**9)),
            HEADER.pack(0, 0),
        )
    )
    if rng.random() < 0.1:
        encoding = "text/plain"
    return Arrived(rng.choice(USERS), topic, payload, header, rng.random() < 0.9, encoding)
