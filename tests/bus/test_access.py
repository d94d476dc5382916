"""Who is let onto the bus of a run, and for what: the hub of Zenoh decides, before anything reaches Python."""

import stat

import pytest
import zenoh

from rig import bus
from rig.bus import address, encode, messages
from rig.bus.link import configuration
from rig.bus.topics import HEADER


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
