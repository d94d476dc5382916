"""Who is let onto the bus of a run, and for what: the hub of Zenoh decides, before anything reaches Python."""

import json
import stat
import threading
import time

import pytest
import zenoh

from rig import bus
from rig.bus import address, encode, messages
from rig.bus.link import configuration
from rig.bus.topics import HEADER
from rig.errors import BusError


@pytest.fixture
def plant(runs):
    with bus.host("guarded", controllers=("nf",)) as session:
        session.announce()
        yield session


def raw(user, password=None):
    """A bare connection of Zenoh, as a script of somebody's own would open it."""
    login = {}
    if user is not None:
        if password is None:
            password = (address.folder("guarded") / user).read_text()
        login = {"transport/auth/usrpwd/user": user, "transport/auth/usrpwd/password": password}
    login["connect/timeout_ms"] = 1000
    return zenoh.open(configuration("client", None, address.find("guarded").endpoint, **login))


@pytest.mark.parametrize("login", [(None, None), ("nf", "guess")])
def test_without_its_password_nobody_connects(plant, login):
    with pytest.raises(zenoh.ZError):
        raw(*login)


def test_passwords_are_private_new_for_every_run_and_gone_after_it(runs):
    seen = set()
    for _ in range(2):
        with bus.host("guarded", controllers=("nf",)):
            here = address.folder("guarded")
            assert stat.S_IMODE(here.stat().st_mode) == 0o700
            files = list(here.iterdir())
            assert {stat.S_IMODE(one.stat().st_mode) for one in files} == {0o600}
            names = {one.name for one in files}
            assert {"nf", "recorder", "viewer", "operator", "guest-1"} <= names
            assert ".dictionary" not in names
            seen |= {one.read_text() for one in files}
        assert not here.exists()
    assert len(seen) == 2 * len(names)


def until(watch, done):
    """Wait until `done()` holds, while what arrives is read."""
    deadline = time.monotonic() + 20.0
    while not done():
        assert time.monotonic() < deadline
        watch.poll(0.05)


def put(session, key):
    """A command that would be taken if it came from the right user."""
    session.put(key, HEADER.pack(0, 0) + encode.act(0, 0, [1.0]), encoding=messages.encoding("act/nf"))


def test_only_its_own_user_speaks_for_a_controller(plant):
    acts, rest, watch = plant.subscribe("act/*"), plant.subscribe("**"), plant.watch("*/*")
    with raw("guest-1") as guest, bus.join("guarded", role="controller", name="nf") as nf:
        nf.announce()
        for key in ("act/nf", "nf/act/nf", "plant/act/nf", "plant/step", "*/act/nf", "**", "guest-2/act/x", "state"):
            put(guest, f"rig/guarded/{key}")
            put(guest, f"loop/guarded/{key}")
        put(guest, "loop/guarded/guest-1/act/nf")  # passes the hub, which knows no names
        guest.liveliness().declare_token("rig/guarded/alive/controller/x")
        guest.liveliness().declare_token("rig/guarded/nf/alive/controller/x")
        nf.publisher("act/nf").put(encode.act(0, 0, [2.0]), 0)
        told = [acts.get(20.0), acts.get(0.3)]
        assert [message and list(message.said.values) for message in told] == [[2.0], None]
        assert acts.counts["act/nf"].received == 1
        assert rest.get() is None
        assert plant.inbound.refusals() == {"guest-1 on act/nf: not its own topic": 1}
        assert watch.wait_for("controller", "nf", 20.0)
        assert watch.present == {("plant", "plant"), ("controller", "nf")}


def test_nobody_but_an_operator_asks_a_controller(plant):
    with bus.join("guarded", role="controller", name="nf") as nf, raw("guest-1") as guest, raw("recorder") as recorder:
        server, plants = nf.serve("param/nf", lambda _: {"ok": 1}), plant.serve("cmd/plant", lambda _: {})
        refused = [
            (guest, "nf/param/nf/guest-1"),
            (recorder, "nf/param/nf/recorder"),
            (recorder, "plant/cmd/plant/recorder"),
            (guest, "plant/cmd/plant"),
            (guest, "plant/cmd/plant/guest-2"),  # in the name of another
            (guest, "plant/cmd/**"),
        ]
        for who, topic in refused:
            assert not list(
                who.get(f"rig/guarded/{topic}", payload=b"{}", timeout=60.0)
            )  # told at once: nobody answers
        assert server.poll() == plants.poll() == 0


def test_a_second_recorder_gets_a_name_of_its_own(plant):
    watch = plant.watch("recorder/*")
    with bus.join("guarded", role="recorder", name="recorder"):
        with bus.join("guarded", role="recorder", name="recorder") as two:
            two.announce()
            assert (two.name, two.user) == ("recorder-1", "guest-1")
            two.publisher("total/recorder-1").put(two.totals(), 0)
            assert watch.wait_for("recorder", "recorder-1", 20.0)


def test_what_is_too_long_does_not_arrive_and_what_is_long_does(plant):
    events = plant.subscribe("event/*")
    with bus.join("guarded", role="controller", name="nf") as nf:
        for size in (3_000_000, 70_000, 60_000):
            nf.publisher("event/nf").put(messages.event(0, 0, "nf", "note", "x" * size), 0)
            time.sleep(0.1)  # else a full queue drops the next one
        assert len(events.get(20.0).said.text) == 60_000
        assert events.lost == 0  # the two before are missing, but nothing was received before them
        assert events.counts["event/nf"].first == 2


def served(server):
    """Answers one query in a thread."""
    thread = threading.Thread(target=lambda: server.poll(20.0), daemon=True)
    thread.start()
    return thread


def test_the_setup_of_a_large_scene_passes_and_a_refusal_of_a_guest_reaches_who_asked(plant):
    def refused(_):
        raise BusError("speed: 5 s is no speed")

    body = {"sensors": {f"s{i}": ["m/s", 1] for i in range(20_000)}}
    served(plant.serve("scene", lambda _: json.dumps(body).encode()))
    with (
        bus.join("guarded", role="controller", name="mine") as mine,
        bus.join("guarded", role="operator", name="o") as o,
    ):
        assert o.ask("scene", {}, 20.0, patient=True) == body
        served(mine.serve("param/mine", refused))
        with pytest.raises(BusError, match="5 s is no speed"):
            o.ask("param/mine", {"set": {"speed": 5.0}}, 20.0)


def test_the_plant_plays_the_part_of_a_controller_and_nobody_else_can(plant):
    inside = plant.stand_in("controller", "nf")
    served(inside.serve("param/nf", lambda body: {"values": {"gain": 1.0}}))
    with pytest.raises(BusError, match="nf is already connected to run guarded"):
        bus.join("guarded", role="controller", name="nf")
    with bus.join("guarded", role="operator", name="tune") as operator:
        events, here = operator.subscribe("event/*"), operator.watch("controller/*")
        inside.announce()
        assert here.wait_for("controller", "nf", 20.0)
        deadline = time.monotonic() + 20.0
        while (event := events.get(0.02)) is None and time.monotonic() < deadline:
            inside.publisher("event/nf").put(messages.event(0, 0, "nf", "mark", "here"), 0)
        assert (event.user, event.topic) == ("nf", "event/nf")
        assert operator.ask("param/nf", {"get": ["gain"]}, 20.0) == {"values": {"gain": 1.0}}
        inside.close()
        until(here, lambda: not here.present)
        assert operator.present("plant/*") == {("plant", "plant")}  # its connection is that of the plant
    with bus.join("guarded", role="controller", name="nf") as process:
        assert process.user == "nf"
