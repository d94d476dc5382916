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


@pytest.mark.parametrize("login", [(None, None), ("nf", "guess"), ("nobody", "guess")])
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


def put(session, key, seq=0):
    """A command that would be taken if it came from the right user."""
    act = encode.act(0, 0, [1.0])
    session.put(key, HEADER.pack(seq, 0) + act, encoding=messages.encoding("act/nf"))


def test_only_its_own_user_speaks_for_a_controller(plant):
    acts, rest, watch = plant.subscribe("act/*"), plant.subscribe("**"), plant.watch("*/*")
    with raw("guest-1") as guest, bus.join("guarded", role="controller", name="nf") as nf:
        nf.announce()
        for key in ("act/nf", "nf/act/nf", "plant/act/nf", "plant/step", "*/act/nf", "**", "guest-2/act/x", "state"):
            put(guest, f"rig/guarded/{key}")
            put(guest, f"loop/guarded/{key}")
        put(guest, "loop/guarded/guest-1/act/nf")  # passes the hub, which knows no names
        for i in range(300):
            guest.liveliness().declare_token(f"rig/guarded/alive/controller/x{i}")
            guest.liveliness().declare_token(f"rig/guarded/nf/alive/controller/x{i}")
        nf.publisher("act/nf").put(encode.act(0, 0, [2.0]), 0)
        found = [acts.get(2.0), acts.get(0.3)]
        assert [message and list(message.said.values) for message in found] == [[2.0], None]
        assert acts.counts["act/nf"].received == 1
        assert rest.get() is None
        assert plant.inbound.refusals() == {"guest-1 on act/nf: not its own topic": 1}
        assert watch.wait_for("controller", "nf", 3.0)
        assert watch.present == {("plant", "plant"), ("controller", "nf")}


def test_a_guest_is_here_under_one_name(plant):
    watch = plant.watch("*/*")
    with raw("guest-1") as guest:
        tokens = [guest.liveliness().declare_token(f"rig/guarded/guest-1/alive/controller/x{i}") for i in range(500)]
        assert tokens
        deadline = time.monotonic() + 5.0
        while plant.inbound.total < 499 and time.monotonic() < deadline:
            watch.poll(0.1)
        assert len(watch.present) == 2
        assert plant.inbound.refusals() == {"guest-1: a second name": 499}
    while len(watch.present) > 1 and time.monotonic() < deadline:
        watch.poll(0.1)
    assert watch.present == {("plant", "plant")}


def test_nobody_but_an_operator_asks_a_controller(plant):
    with bus.join("guarded", role="controller", name="nf") as nf, raw("guest-1") as guest, raw("recorder") as recorder:
        server, plants = nf.serve("param/nf", lambda _: {"ok": 1}), plant.serve("cmd/plant", lambda _: {})
        deadline = time.monotonic() + 2.0
        refused = [
            (guest, "nf/param/nf/guest-1"),
            (recorder, "nf/param/nf/recorder"),
            (recorder, "plant/cmd/plant/recorder"),
            (guest, "plant/cmd/plant"),
            (guest, "plant/cmd/plant/guest-2"),  # in the name of another
            (guest, "plant/cmd/plant/*"),
            (guest, "plant/cmd/**"),
        ]
        for who, topic in refused:
            assert not list(who.get(f"rig/guarded/{topic}", payload=b"{}", timeout=0.3))
        assert time.monotonic() < deadline  # told at once that nobody answers
        assert server.poll() == plants.poll() == 0


def test_who_asks_is_known_by_the_connection_not_by_what_it_says(plant):
    askers = []
    server = plant.serve("cmd/plant", lambda _: askers.append(server.asker) or {})
    with bus.join("guarded", role="controller", name="mine") as mine, raw("operator") as operator:
        threads = [
            threading.Thread(target=mine.ask, args=("cmd/plant", {"do": "admit", "controller": "guest-7"}, 5.0)),
            threading.Thread(target=lambda: list(operator.get("rig/guarded/plant/cmd/plant/operator", timeout=5.0))),
        ]
        for thread in threads:
            thread.start()
            assert server.poll(5.0) == 1
            thread.join(5.0)
        assert askers == [mine.user, "operator"]
        assert mine.user == "guest-1"


def test_a_controller_of_a_name_is_there_once_and_its_place_is_free_when_it_has_gone(plant):
    with bus.join("guarded", role="controller", name="nf"), pytest.raises(BusError, match="nf is already connected"):
        bus.join("guarded", role="controller", name="nf")
    with bus.join("guarded", role="controller", name="nf") as again:
        assert again.user == "nf"


def test_a_second_recorder_gets_a_name_of_its_own(plant):
    watch = plant.watch("recorder/*")
    with bus.join("guarded", role="recorder", name="recorder") as one:
        with bus.join("guarded", role="recorder", name="recorder") as two:
            one.announce()
            two.announce()
            assert (one.name, two.user) == ("recorder", "guest-1")
            assert two.name == "recorder-1"
            two.publisher("total/recorder-1").put(two.totals(), 0)
            assert watch.wait_for("recorder", "recorder-1", 3.0)


def test_when_all_seats_are_taken_it_says_so(plant):
    sessions = [address.take_user("guarded", "viewer", f"v{i}") for i in range(address.GUESTS)]
    assert {seat.user for seat in sessions} == {f"guest-{i + 1}" for i in range(address.GUESTS)}
    with pytest.raises(BusError, match="accepts no further viewer v"):
        bus.join("guarded", role="viewer", name="v")
    sessions[3].release()
    with bus.join("guarded", role="viewer", name="v") as one:
        assert one.user == sessions[3].user


@pytest.mark.parametrize("name", ["plant", "operator", "guest-1", "a/b", "", "x" * 65, "."])
def test_names_that_a_controller_cannot_have(runs, name):
    with pytest.raises(BusError, match="cannot name a controller"):
        bus.host("guarded", controllers=(name,))
    assert address.list_runs() == []


def test_what_is_too_long_does_not_arrive_and_what_is_long_does(plant):
    events = plant.subscribe("event/*")
    with bus.join("guarded", role="controller", name="nf") as nf:
        for size in (3_000_000, 70_000, 60_000):
            text = messages.event(0, 0, "nf", "note", "x" * size)
            nf.publisher("event/nf").put(text, 0)
            time.sleep(0.1)  # else a full queue drops the next one
        assert len(events.get(3.0).said.text) == 60_000
        assert events.lost == 0  # the two before are missing, but nothing was received before them
        assert events.counts["event/nf"].first == 2


def test_the_setup_of_a_large_scene_passes(plant):
    body = {"sensors": {f"s{i}": ["m/s", 1] for i in range(20_000)}}
    server = plant.serve("scene", lambda _: json.dumps(body).encode())
    thread = threading.Thread(target=lambda: server.poll(5.0))
    thread.start()
    with bus.join("guarded", role="operator", name="o") as one:
        assert one.ask("scene", {}, 3.0, patient=True) == body
    thread.join()


def test_a_refusal_of_a_guest_reaches_who_asked(plant):
    def refused(_):
        raise BusError("speed: 5 s is no speed")

    with bus.join("guarded", role="controller", name="mine") as mine:
        server, stop = mine.serve("param/mine", refused), threading.Event()

        def serve():
            while not stop.is_set():
                server.poll(0.05)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            with (
                bus.join("guarded", role="operator", name="me") as me,
                pytest.raises(BusError, match="5 s is no speed"),
            ):
                me.ask("param/mine", {"set": {"speed": "5 s"}}, 5.0)
        finally:
            stop.set()
            thread.join()


def test_a_guest_that_speaks_first_on_a_topic_locks_nobody_out(plant):
    acts = plant.subscribe("act/*")
    with raw("guest-5") as stranger, bus.join("guarded", role="controller", name="mine") as mine:
        act = encode.act(0, 0, [1.0])
        for topic in ("act/mine", *(f"act/z{i}" for i in range(300))):
            key, encoding = f"loop/guarded/guest-5/{topic}", messages.encoding(topic)
            stranger.put(key, HEADER.pack(0, 0) + act, encoding=encoding)
        mine.publisher("act/mine").put(encode.act(0, 0, [2.0]), 0)
        deadline, found = time.monotonic() + 5.0, {}
        while sum(map(len, found.values())) < 17 and time.monotonic() < deadline:
            if (message := acts.get(0.1)) is not None:
                found.setdefault(message.user, []).append(message.topic)
        while (message := acts.get(0.1)) is not None:
            found.setdefault(message.user, []).append(message.topic)
        assert found["guest-1"] == ["act/mine"]
        assert len(found["guest-5"]) == 16
        assert all(told.endswith("too many topics") for told in plant.inbound.refusals())


def test_the_plant_plays_the_part_of_a_controller_and_nobody_else_can(plant):
    inside = plant.stand_in("controller", "nf")
    server = inside.serve("param/nf", lambda body: {"values": {"gain": 1.0}})
    with pytest.raises(BusError, match="nf is already connected to run guarded"):
        bus.join("guarded", role="controller", name="nf")
    with bus.join("guarded", role="operator", name="tune") as operator:
        events, here = operator.subscribe("event/*"), operator.watch("controller/*")
        inside.announce()
        assert here.wait_for("controller", "nf", 3.0)
        deadline = time.monotonic() + 3.0
        while (found := events.get(0.02)) is None and time.monotonic() < deadline:
            inside.publisher("event/nf").put(messages.event(0, 0, "nf", "mark", "here"), 0)
        assert (found.user, found.topic) == ("nf", "event/nf")
        asking = threading.Thread(target=lambda: answers.append(operator.ask("param/nf", {"get": ["gain"]}, 5.0)))
        answers = []
        asking.start()
        assert server.poll(5.0) == 1
        asking.join(5.0)
        assert answers == [{"values": {"gain": 1.0}}]
        inside.close()
        deadline = time.monotonic() + 3.0
        while here.present and time.monotonic() < deadline:
            here.poll(0.02)
        assert here.present == set()
        assert operator.present("plant/*") == {("plant", "plant")}  # its connection is that of the plant
    with bus.join("guarded", role="controller", name="nf") as process:
        assert process.user == "nf"
