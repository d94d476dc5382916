"""Tickets: who gets in by TLS, who does not, and the line that each of them reads."""

import dataclasses
import json
import os
import socket
import sys
import threading
import time
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from ports import own_port
from relay import Relay

from rig import bus
from rig.bus import certificates, contact, run_setup, tickets
from rig.bus.place import parted
from rig.bus.run_setup import Setup
from rig.bus.tickets import Listener
from rig.errors import BusError, UsageError
from rig.qualify import remote_link

SEATS = ("nf", "recorder", "viewer", "operator")
DESCRIBED = Setup("far", "{}", 1_000_000, 1_000_000, {}, {}, core=1)


class Hosted:
    """A run with tickets, in this process."""

    def __init__(self, name="far", port=None, seats=SEATS, host="127.0.0.1"):
        self.listener = Listener(f"tls/{host}:{port or own_port()}", seats, 5.0)
        self.session = bus.host(name, controllers=["nf", "other"], listener=self.listener)
        self._scene = self.session.serve("scene", self._describe)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.session.announce()
        self._thread.start()

    def _describe(self, asked):
        self.session.seat(self._scene.asker, asked.get("holds", ""))
        return DESCRIBED.to_json()

    def _serve(self):
        while not self._stop.is_set():
            self._scene.poll(0.02)

    def ticket(self, seat="nf"):
        return self.session.tickets[seat]

    def close(self):
        self._stop.set()
        self._thread.join(5.0)
        self.session.close()


@pytest.fixture
def hosted(runs):
    made = Hosted()
    yield made
    made.close()


def _join(ticket, role="controller", name="nf", **more):
    return bus.join(role=role, name=name, ticket=ticket, **more)


def _values(hosted, of="nf"):
    """What is in a ticket."""
    return json.loads(hosted.ticket(of).read_text().partition("\n")[2])


def _written(tmp_path, text):
    path = tmp_path / "altered.ticket"
    path.touch(mode=0o600)
    path.write_text(text)
    return path


def _altered(hosted, tmp_path, of="nf", **changes):
    """A copy of a ticket with other values."""
    return _written(tmp_path, tickets.sealed(_values(hosted, of) | changes))


def test_the_address_may_be_a_name(runs):
    hosted = Hosted(host="localhost")
    try:
        with pytest.raises(UsageError, match="another process listens there"):
            hosted.listener.check(["nf"])
        with _join(hosted.ticket()) as session:
            assert run_setup.fetch(session).run == "far"
    finally:
        hosted.close()


def test_a_ticket_is_of_its_owner_alone_and_vanishes_with_the_run(hosted):
    path = hosted.ticket()
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    hosted.close()
    assert not path.parent.exists()


def test_the_holder_takes_its_seat_and_the_second_one_is_refused(hosted):
    with _join(hosted.ticket()) as first, _join(hosted.ticket()) as second:
        assert run_setup.fetch(first).core == -1  # a core of the plant's host is none of this one
        with pytest.raises(BusError, match=r"the seat nf is taken: another process uses this ticket"):
            run_setup.fetch(second)
        assert run_setup.fetch(first) == dataclasses.replace(DESCRIBED, core=-1)


def test_of_two_that_start_at_once_one_is_refused(hosted):
    told = []

    def enter():
        with _join(hosted.ticket()) as session:
            barrier.wait(10.0)
            try:
                run_setup.fetch(session)
                told.append("in")
            except BusError:
                told.append("out")
            barrier.wait(10.0)

    barrier = threading.Barrier(2)
    entering = [threading.Thread(target=enter) for _ in range(2)]
    for thread in entering:
        thread.start()
    for thread in entering:
        thread.join(20.0)
    assert sorted(told) == ["in", "out"]


def test_a_seat_is_free_again_when_its_holder_has_left(hosted):
    with _join(hosted.ticket()) as first:
        run_setup.fetch(first)
    deadline = time.monotonic() + 10.0
    with _join(hosted.ticket()) as second:
        while True:
            try:
                run_setup.fetch(second)
                break
            except BusError:
                assert time.monotonic() < deadline
                time.sleep(0.02)


def test_a_seat_with_a_ticket_is_not_there_on_the_plants_host(hosted):
    with pytest.raises(
        BusError, match=r"the seat of controller nf of run far has the ticket .*nf.ticket: use --ticket"
    ):
        bus.join("far", role="controller", name="nf")
    with bus.join("far", role="controller", name="other") as other:
        assert other.user == "other"


def test_recorder_and_viewer_leave_those_of_the_run_their_seats(hosted):
    for seat in ("recorder", "viewer"):
        with _join(hosted.ticket(seat), seat, seat) as far, bus.join("far", role=seat, name=seat) as here:
            assert (far.name, here.name) == (f"remote-{seat}", seat)


def test_a_ticket_opens_its_own_seat_only(hosted):
    with pytest.raises(BusError, match=r"nf.ticket is the ticket of nf, and not that of recorder"):
        _join(hosted.ticket(), "recorder", "recorder")
    with pytest.raises(BusError, match=r"recorder.ticket is the ticket of recorder, and not that of controller nf"):
        _join(hosted.ticket("recorder"))


def test_a_certificate_is_bound_to_its_user(hosted, tmp_path):
    """User and password of the operator with the certificate of nf: connected, and nobody hears it."""
    certificate = {name: _values(hosted)[name] for name in ("certificate", "key")}
    mixed = _altered(hosted, tmp_path, "operator", **certificate)
    with _join(mixed, "operator", "tune") as session, pytest.raises(BusError, match="no process answered scene"):
        session.ask("scene", {}, timeout=0.5)
    with _join(hosted.ticket("operator"), "operator", "tune") as session:
        assert session.ask("scene", {}, timeout=5.0)["run"] == "far"


def test_a_user_without_a_ticket_cannot_come_by_tls(hosted, tmp_path):
    """The password of `other`, which has no ticket, with the certificate of nf."""
    password = (hosted.ticket().parents[1] / "far.users" / "other").read_text()
    with _join(_altered(hosted, tmp_path, user="other", password=password)) as session:
        with pytest.raises(BusError, match="no process answered scene"):
            session.ask("scene", {}, timeout=0.5)


def test_a_wrong_password_is_told(hosted, tmp_path, monkeypatch):
    monkeypatch.setattr("rig.bus.link.CONNECT_MS", 500)
    with pytest.raises(BusError, match=r"run far refuses the user, the password or the certificate of .*: copy the"):
        _join(_altered(hosted, tmp_path, password="wrong"))


def test_a_ticket_of_a_run_that_has_ended(hosted, tmp_path):
    old = _altered(hosted, tmp_path)
    port = parted(hosted.listener.endpoint)[1]
    hosted.close()
    with pytest.raises(BusError, match=rf"nobody listens at 127.0.0.1:{port}: the run far has ended, or not begun"):
        _join(old)
    for name in ("next", "far"):
        following = Hosted(name, port)
        try:
            begin = time.monotonic()
            with pytest.raises(
                BusError, match=r"the run that listens at .* has not issued it: ask for a ticket of that"
            ):
                _join(old, wait=60.0)
            assert time.monotonic() - begin < 30.0  # to wait changes nothing
        finally:
            following.close()


def test_another_program_at_the_address(hosted, tmp_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()

        def answer():
            with other.accept()[0] as there:
                there.recv(1000)
                there.send(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        port = other.getsockname()[1]
        with pytest.raises(BusError, match=rf"what listens at 127.0.0.1:{port} is no run: another program"):
            _join(_altered(hosted, tmp_path, endpoint=f"tls/127.0.0.1:{port}"))
        thread.join(5.0)


def test_a_name_that_the_certificate_lacks(hosted, tmp_path):
    port = parted(hosted.listener.endpoint)[1]
    with pytest.raises(BusError, match=rf"the run at localhost:{port} does not name localhost: use the address that"):
        _join(_altered(hosted, tmp_path, endpoint=f"tls/localhost:{port}"))


def test_a_ticket_that_others_can_read(hosted):
    hosted.ticket().chmod(0o644)
    with pytest.raises(BusError, match=r"can be read by others \(its mode is 644\), and holds a key: chmod 600 .*nf"):
        _join(hosted.ticket())


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("pipe", "it is not a regular file"),
        ("folder", "it is a folder"),
        ("huge", "it is larger than 1 MiB, the largest size that is read"),
        ("binary", "it is no text"),
        ("missing", "No such file or directory"),
    ],
)
def test_what_is_no_file_of_text(kind, why, tmp_path):
    path = tmp_path / kind
    if kind == "pipe":
        os.mkfifo(path, 0o600)
    elif kind == "folder":
        path.mkdir(0o700)
    elif kind != "missing":
        path.touch(0o600)
        path.write_bytes(b"\xff" * 1000)
    if kind == "huge":
        os.truncate(path, 1 << 32)
    with pytest.raises(BusError, match=rf"the ticket .*{kind} cannot be read: {why}$"):
        tickets.read(path)


@pytest.mark.parametrize("text", ["", "{}", "not JSON", "\n", "[" * 100_000], ids=len)
def test_what_is_no_ticket(text, tmp_path):
    with pytest.raises(BusError, match=r"altered.ticket is damaged, or no ticket: copy it again from the plant's host"):
        _join(_written(tmp_path, text))


def test_a_ticket_of_which_a_part_is_missing_or_another_one_is_damaged(hosted, tmp_path):
    text = hosted.ticket().read_text()
    assert tickets.read(_written(tmp_path, text.replace("\n", "\r\n").rstrip())).seat == "nf"  # sent by mail
    for place in range(0, len(text) - 1, 97):
        for damaged in (text[:place], text[place + 1 :], f"{text[:place]}~{text[place + 1 :]}"):
            with pytest.raises(BusError, match="is damaged"):
                tickets.read(_written(tmp_path, damaged))


def test_a_ticket_that_cannot_be_read(tmp_path):
    _written(tmp_path, "").write_bytes(b"\xff\xfe")
    with pytest.raises(BusError, match="cannot be read: it is no text"):
        _join(tmp_path / "altered.ticket")
    with pytest.raises(BusError, match="nowhere cannot be read: No such file"):
        _join(tmp_path / "nowhere")


def test_another_version(hosted, tmp_path):
    with pytest.raises(
        BusError, match=r"is of friction-rig 0.1.0, sources 0, and this is friction-rig .*: install the"
    ):
        _join(_altered(hosted, tmp_path, sources="friction-rig 0.1.0, sources 0"))
    older = {name: value for name, value in _values(hosted).items() if name != "reserved"}
    with pytest.raises(BusError, match=r"install the same version on both hosts"):
        _join(_written(tmp_path, tickets.sealed(older | {"sources": "friction-rig 0.1.0, sources 1", "added": 3})))


class _Clock:
    """Times that a test moves."""

    CLOCK_BOOTTIME = 7
    slept = 3.0

    def monotonic(self):
        return 100.0

    def clock_gettime(self, which):
        assert which == self.CLOCK_BOOTTIME
        return 100.0 + self.slept


def _clock_ahead(monkeypatch, hours):
    """The clock of the plant's host is ahead of that of this one."""

    class Clock(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(hours=hours)

    monkeypatch.setattr(certificates, "datetime", Clock)


@pytest.mark.parametrize("hours", [-1, 1, 24, -24 * 6])
def test_clocks_apart_do_no_harm(hours, runs, monkeypatch):
    _clock_ahead(monkeypatch, hours)
    hosted = Hosted()
    try:
        with _join(hosted.ticket()) as session:
            assert run_setup.fetch(session).run == "far"
    finally:
        hosted.close()


@pytest.mark.parametrize(("days", "why"), [(-8, "its time is over"), (2, "its time has not begun")])
def test_a_ticket_of_another_time(days, why, runs, monkeypatch):
    _clock_ahead(monkeypatch, 24 * days)
    hosted = Hosted()
    try:
        with pytest.raises(BusError, match=rf"{why} by the clock of this host \(20"):
            _join(hosted.ticket())
    finally:
        hosted.close()


def test_run_and_ticket_exclude_each_other_and_the_environment_names_one(hosted, monkeypatch):
    with pytest.raises(BusError, match=r"--run far: the ticket .*nf.ticket names the run; leave --run out"):
        bus.join("far", role="controller", name="nf", ticket=hosted.ticket())
    monkeypatch.setenv("RIG_TICKET", str(hosted.ticket("operator")))
    with bus.join(role="operator", name="tune") as far, bus.join("far", role="operator", name="tune") as here:
        assert (far.holds.keys(), here.holds) == ({"holds"}, {})


def _until(true, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_plant_that_is_gone_is_told(hosted):
    with _join(hosted.ticket()) as session:
        run_setup.fetch(session)
        plant = session.watch("plant/*")
        assert session.goes_on(plant)
        assert session.gone == ""
        hosted.close()
        _until(lambda: not session.goes_on(plant))
        assert (
            session.gone == f"the plant of run far at {hosted.listener.endpoint} is gone: nobody listens there any more"
        )


def test_a_plant_that_has_said_farewell_is_not_gone(hosted):
    with _join(hosted.ticket()) as session:
        run_setup.fetch(session)
        hosted.session.publisher("total/plant").put(hosted.session.totals(), 0)
        hosted.close()
        _until(lambda: session.ended)
        assert session.gone == ""


def test_a_seat_that_was_lost_is_not_taken_back(hosted, tmp_path):
    """The connection of the first holder breaks, the second one takes the seat, and the way is free again."""
    relay = Relay(parted(hosted.listener.endpoint))
    endpoint = f"tls/127.0.0.1:{relay.port}"
    watch = hosted.session.watch("controller/*")
    try:
        with _join(_altered(hosted, tmp_path, endpoint=endpoint)) as first:
            run_setup.fetch(first)
            first.announce()
            plant = first.watch("plant/*")
            assert watch.wait_for("controller", "nf", 10.0)
            relay.cut()
            _until(lambda: first.lost)
            with _join(hosted.ticket()) as second:
                _until(lambda: _takes(second))
                second.announce()
                relay.join()
                _until(lambda: first.present("plant/*"))  # Zenoh is connected again
                assert not first.goes_on(plant)
                assert first.gone == f"the connection to run far at {endpoint} was lost; start again with the ticket"
                first.close()
                time.sleep(0.2)
                assert ("controller", "nf") in watch.all_here()
                assert run_setup.fetch(second).run == "far"
                assert second.goes_on(second.watch("plant/*"))
    finally:
        relay.close()


def _takes(session):
    try:
        return run_setup.fetch(session)
    except BusError:
        return None


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such time")
def test_a_connection_with_a_host_that_vanishes_ends_with_the_lease(hosted):
    """Each connection that the plant has by TLS, and the one that listens; nobody else's."""
    port = parted(hosted.listener.endpoint)[1]
    times = {}
    with _join(hosted.ticket()) as session:
        run_setup.fetch(session)
        for descriptor in filter(Path.is_socket, [*Path("/proc/self/fd").glob("*")]):
            with socket.fromfd(int(descriptor.name), socket.AF_INET, socket.SOCK_STREAM) as opened:
                with suppress(OSError):  # of another kind
                    time_ms = opened.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
                    times.setdefault(opened.getsockname()[1] == port, []).append(time_ms)
    assert times[True] == [30_000, 30_000]
    assert set(times[False]) == {0}


def test_the_link_is_measured_beside_the_holder_of_the_seat(hosted):
    with _join(hosted.ticket()) as holder:
        run_setup.fetch(holder)
        for seat in SEATS:
            link = remote_link.measure(hosted.ticket(seat), asked=20)
            assert (link.asked, link.missed) == (20, 0)
            assert 0.0 < link.p50 <= link.p99 <= link.worst
            assert link.period_ms is None or link.p99 <= 0.8 * link.period_ms
            first, second = link.text().splitlines()
            assert first.startswith(f"run far at {hosted.listener.endpoint}: round trip ")
            assert second.startswith("it holds ")


@pytest.mark.parametrize(
    ("slept", "address", "why"),
    [
        (0.0, "192.0.2.7", ""),
        (95.0, "192.0.2.7", ": this computer slept for 95 s"),
        (0.0, "192.0.2.9", ": the address of this computer was 192.0.2.7, and is 192.0.2.9 now"),
    ],
)
@pytest.mark.parametrize("answers", [False, True])
def test_a_loss_says_what_this_computer_has_to_do_with_it(slept, address, why, answers, hosted, monkeypatch):
    clock = _Clock()
    here = ["192.0.2.7"]

    def silent(place, timeout):
        raise TimeoutError

    monkeypatch.setattr(contact, "time", clock)
    monkeypatch.setattr(contact, "_local_address", lambda host, port: here[0])
    ticket = tickets.read(hosted.ticket())
    held = contact.Contact(ticket)
    clock.slept += slept
    here[0] = address
    at = f"run far at {ticket.endpoint}"
    if answers:
        assert held.loss() == f"the connection to {at} was lost{why}; start again with the ticket"
    else:
        monkeypatch.setattr(contact.socket, "create_connection", silent)
        assert held.loss() == f"the plant of {at} is out of reach{why}"


@pytest.mark.parametrize(
    ("endpoint", "why"),
    [
        ("tcp/127.0.0.1:7450", r"expected tls/HOST:PORT with the name or address"),
        ("127.0.0.1:7450", r"expected tls/HOST:PORT"),
        ("tls/127.0.0.1", r"expected tls/HOST:PORT"),
        ("tls/127.0.0.1:http", r"expected tls/HOST:PORT"),
        ("tls/0.0.0.0:7450", r"name the one address or name of this host"),
        ("tls/0:7450", r"name the one address or name of this host"),
        ("tls/127.1:7450", r"certificates need the whole address; write 127.0.0.1"),
        ("tls/2130706433:7450", r"certificates need the whole address; write 127.0.0.1"),
        ("tls/[127.0.0.1]:7450", r"an IPv6 address stands in brackets, .*, and no other host"),
        ("tls/*:7450", r"\* is no name and no address of a host"),
        ("tls//127.0.0.1:7450", r"/127.0.0.1 is no name and no address of a host"),
        ("tls/127.0.0.1:७४५०", r"expected tls/HOST:PORT"),
        ("tls/224.0.0.1:7450", r"; give an address of this host"),
        ("tls/255.255.255.255:7450", r"; give an address of this host"),
        ("tls/127.0.0.1:443", r"the port must be 1024 to 65535; those below belong to the system"),
        ("tls/127.0.0.1:70000", r"the port must be 1024 to 65535"),
        ("tls/[::1]:7450", r"processes cannot join at an IPv6 address; give a name or an IPv4 address"),
        ("tls/::1:7450", r"processes cannot join at an IPv6 address; give a name or an IPv4 address"),
        ("tls/192.0.2.7:7450", r"Cannot assign requested address; give an address of this host"),
        ("tls/no.such.name.invalid:7450", r"no address is known for the name no.such.name.invalid"),
    ],
)
def test_where_nobody_can_listen(endpoint, why):
    with pytest.raises(UsageError, match=why) as told:
        Listener(endpoint, ("nf",)).check(["nf"])
    assert str(told.value).startswith(f"--listen {endpoint}: ")


def test_a_name_that_means_another_address_to_the_others(monkeypatch):
    """Debian gives the name of a host an address of loopback."""
    resolved = [(socket.AF_INET, 1, 6, "", ("127.0.1.1", 7450))]
    monkeypatch.setattr("rig.bus.place.socket.getaddrinfo", lambda *_, **__: resolved)
    with pytest.raises(UsageError, match=r"the name plant means 127.0.1.1, which no other host reaches; give its addr"):
        Listener("tls/plant:7450", ("nf",)).check(["nf"])


def test_an_address_in_use_and_a_seat_that_is_not_there(runs):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        endpoint = f"tls/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(UsageError, match="another process listens there; choose another port"):
            Listener(endpoint, ("nf",)).check(["nf"])
        with pytest.raises(BusError, match=rf"cannot listen at .* and {endpoint}"):
            bus.host("busy", controllers=["nf"], listener=Listener(endpoint, ("nf",)))
    with pytest.raises(
        UsageError, match="--tickets fn: the run has no such seat; it has nf, recorder, viewer, operator"
    ):
        Listener("tls/127.0.0.1:7450", ("fn",)).check(["nf"])
    with pytest.raises(UsageError, match="--tickets nf: named twice; a seat has one ticket and one holder"):
        Listener("tls/127.0.0.1:7450", ("nf", "viewer", "nf")).check(["nf"])
