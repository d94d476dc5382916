"""What only real processes can show: sockets, addresses, kills and hangs."""

import os
import signal
import stat
import time

import pytest
from ports import own_port

from rig import bus
from rig.bus import address
from rig.errors import BusError

LISTENER = """
import sys, time
from rig import bus
with bus.join(role="viewer", name="slow", wait=5.0) as me:
    heard, plant = me.subscribe("meas/*", polled=True, depth=100_000), me.watch("plant/*")
    me.announce()
    heard.get(20.0)
    print("begun", flush=True)
    end = time.monotonic() + 20.0
    while "meas/last" not in heard.counts and time.monotonic() < end:
        heard.get(0.05)
    c = heard.counts["meas/laser"]
    print(c.first, c.received, c.lost, c.last, flush=True)
"""


def test_nothing_listens_but_a_private_socket(runs):
    with bus.host("quiet"):
        own = {os.readlink(f"/proc/self/fd/{fd}") for fd in os.listdir("/proc/self/fd") if _is_link(fd)}
        inodes = {link[8:-1] for link in own if link.startswith("socket:[")}
        for table in ("tcp", "tcp6", "udp", "udp6"):
            with open(f"/proc/net/{table}") as rows:
                assert not inodes & {row.split()[9] for row in rows.readlines()[1:]}
        assert stat.S_IMODE((runs / "friction-rig").stat().st_mode) == 0o700
    assert [p.name for p in (runs / "friction-rig").iterdir()] == ["lock"]


def _is_link(fd):
    return os.path.islink(f"/proc/self/fd/{fd}")


def loopback():
    """A port of the loopback device that nobody listens on just now."""
    return f"tcp/127.0.0.1:{own_port()}"


def test_loopback_works_and_open_addresses_are_refused(runs):
    with bus.host("local", endpoint=loopback()), bus.join("local", role="viewer", name="v") as one:
        one.announce()
    with pytest.raises(BusError, match="reachable from other machines"):
        bus.host("wide", endpoint="tcp/0.0.0.0:7447")


def test_an_address_in_use_is_named(runs):
    endpoint = loopback()
    with bus.host("first", endpoint=endpoint):
        with pytest.raises(BusError, match="another process already listens"):
            bus.host("second", endpoint=endpoint)
        with pytest.raises(BusError, match="is already live"):
            bus.host("first")
        assert [run.run for run in address.list_runs()] == ["first"]


def test_a_run_that_is_not_there_is_told_with_those_that_are(runs):
    with pytest.raises(BusError, match="no run is live"):
        bus.join(role="viewer", name="v")
    with bus.host("here"), pytest.raises(BusError, match="no run is called there; live runs: here"):
        bus.join("there", role="viewer", name="v")


def test_the_only_run_of_a_home_is_the_default_and_names_are_unique(runs, monkeypatch, tmp_path):
    claims = [address.reserve(scene="pendulum") for _ in range(3)]
    assert address.list_runs() == []  # nobody listens yet
    for claim in claims:
        claim.open()
    names = [claim.address.run for claim in claims]
    assert len(set(names)) == 3
    assert {run.run for run in address.list_runs()} == set(names)
    with pytest.raises(BusError, match=rf"several runs are live: {names[2]}, {names[1]}, {names[0]}; .* --run"):
        address.find()
    for claim in claims[1:]:
        claim.release()
    assert address.find().run == names[0]
    monkeypatch.setenv("HOME", str(tmp_path / "another"))
    with pytest.raises(BusError, match=f"no run of this home .* others are: {names[0]} .* --run"):
        address.find()
    claims.append(address.reserve("mine"))
    claims[-1].open()
    assert address.find().run == "mine"
    assert address.find(names[0]).run == names[0]
    claims[0].release()
    claims[-1].release()
    assert address.list_runs() == []


@pytest.mark.parametrize(
    ("name", "told"), [("a/b", "cannot name a run"), ("", "cannot name a run"), ("x" * 120, "longer than")]
)
def test_a_name_that_cannot_be_a_key_or_a_socket_is_refused(runs, name, told):
    with pytest.raises(BusError, match=told):
        address.reserve(name)


def test_a_hung_listener_never_holds_the_plant_and_its_loss_is_counted(runs, script):
    with bus.host("stopped") as plant:
        watch = plant.watch()
        slow = script(LISTENER)
        assert watch.wait_for("viewer", "slow", 20.0)
        laser = plant.publisher("meas/laser")
        laser.put(b"", 0)
        plant.flush()
        assert slow.stdout.readline() == "begun\n"
        slow.send_signal(signal.SIGSTOP)
        for _ in range(400):  # 20 MB: far more than queue and socket hold. It would wait for ever if it waited
            laser.put(b"x" * 50_000, 0)
        slow.send_signal(signal.SIGCONT)
        while slow.poll() is None:  # what is put while the queue is full is lost
            laser.put(b"", 0)
            plant.publisher("meas/last").put(b"", 0)
            plant.flush()
            time.sleep(0.1)
        first, received, lost, last = map(int, slow.communicate(timeout=10)[0].split())
    assert lost > 0
    assert first == 0
    assert received + lost == last + 1 <= laser.sent
