"""The bridge from the bus to rerun: what it shows is what was said, and what was lost is a gap."""

import os
import re
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from patience import PATIENCE_S, wait_for

from rig.errors import UsageError
from rig.view import viewer
from rig.view.palette import LINES
from rig.view.process import Bridge

SECONDS = 2


def times(rows):
    """Simulated times of rows [ns], sorted."""
    return sorted(int(np.timedelta64(row["sim_time"], "ns").astype(np.int64)) for row in rows)


def values(rows, component):
    """Values of a component in the order of time; each row holds a list."""
    return [v for row in sorted(rows, key=lambda row: row["sim_time"]) for v in row[component]]


@pytest.fixture(scope="module")
def shown(stage, contents, tmp_path_factory):
    """Two seconds on the bus and the file that the bridge made of them."""
    hub, plant = stage
    path = tmp_path_factory.mktemp("shown") / "new" / "run.rrd"
    plant.serve()
    with hub.open("viewer", "viewer") as session, ThreadPoolExecutor(1) as pool:
        bridge = Bridge(session)
        session.announce()
        with viewer.sink("viewed", bridge.drawing, until=None, save=path) as (rec, process):
            assert process is None
            viewing = pool.submit(bridge.run, rec, threading.Event())
            plant.event("step", "hold for 2 s")
            plant.event("connected", "nf is connected", 1_000_000_000, controller="nf")
            taken, take = [], bridge.feed.take
            bridge.feed.take = lambda lost: taken.append(bridge.feed.messages) or take(lost)
            for k in range(0, 1000 * SECONDS, 125):
                plant.speak(k, 125)
                wait_for(lambda: plant.sent in taken)  # at the pace at which it is taken
            totals = plant.session.subscribe("total/*")
            plant.put("total/plant", plant.session.totals(), 0)
            assert totals.get(PATIENCE_S) is not None
            plant.event("verdict", "VALID", SECONDS * 1_000_000_000)
            plant.session.close()
            viewing = viewing.result(PATIENCE_S)
    return viewing, *contents(path)


def test_the_file_holds_what_was_said(shown, stage):
    (viewing, rows, static), (_, plant) = shown, stage
    assert (viewing.ended, viewing.messages, viewing.lost, viewing.dropped) == ("the plant left", plant.sent, {}, 0)
    k = np.arange(1, 1000 * SECONDS + 1)
    for output in plant.setup.outputs:
        assert times(rows[f"/plant/{output}"]) == (1_000_000 * k).tolist()
    assert np.array_equal(values(rows["/plant/velocity"], "Scalars:scalars"), 0.02 * np.cos(k / 50))
    assert times(rows["/sensor/gauge"]) == list(range(0, SECONDS * 1_000_000_000, 1_000_000))
    assert np.allclose(values(rows["/sensor/gauge"], "Scalars:scalars"), 0.1 * np.arange(1000 * SECONDS))  # newtons
    assert times(rows["/command/nf"]) == list(range(0, SECONDS * 1_000_000_000, 1_000_000))
    assert values(rows["/health/energy_error"], "Scalars:scalars")[0] == pytest.approx(-12.0, abs=1e-5)
    assert [row["SeriesLines:names"] for row in static["/plant/surface_speed"]] == [["surface speed"]]
    packed = int(LINES[1][1:] + "ff", 16)  # the second output of its plot
    assert [row["SeriesLines:colors"] for row in static["/plant/surface_speed"]] == [[packed]]
    assert values(rows["/event/plant"], "TextLog:text") == [
        "step: hold for 2 s",
        "connected: nf is connected",
        "verdict: VALID",
    ]


def test_contact_protocol_and_controllers_are_strips(shown):
    _, rows, _ = shown
    contact = rows["/strip/contact"]
    assert times(contact) == [0, 499_000_000, 999_000_000, 1_499_000_000, 1_999_000_000]  # the begins of the spans
    assert values(contact, "StateChange:state") == ["stick", "slip+", "stick", "slip+", "stick"]
    assert values(rows["/strip/nf"], "StateChange:state") == ["connected"]
    assert values(rows["/strip/protocol"], "StateChange:state") == ["hold for 2 s"]


def test_the_picture_moves_with_the_mass(shown):
    _, rows, static = shown
    moved = rows["/rig/mass"]
    assert 10 * SECONDS <= len(moved) <= 50 * SECONDS
    x = np.array(values(moved, "Transform3D:translation"))[:, 0]
    true = 1e-3 * np.sin(np.array(times(moved)) / 50e6)
    gain = x[true > 5e-4] / true[true > 5e-4]
    assert np.allclose(gain, gain[0], rtol=1e-6)
    assert {"/rig/belt", "/rig/wall", "/rig/rollers"} <= set(static)
    arrows = np.array(values(rows["/rig/mass/friction"], "Arrows3D:vectors"))
    assert np.all(arrows[:, 0] > 0.0)


def test_a_fast_vibration_is_the_band_that_it_is_and_what_was_lost_is_a_gap(plant, hub):
    """States of 200 Hz would show a slow swing, and a line over what was lost."""
    plant.serve()
    bridge = Bridge(hub.open("viewer", "viewer"))
    taken = []
    for first in (0, 20, 60, 100):  # two messages in a row, then one after a gap within a batch, and one after another
        plant.band(first, 20, spread=0.5)
        plant.session.flush()
        if first in (60, 100):
            bridge.listen()
            taken.append({path: rows for path, *rows in bridge.feed.take()})
    for found, begin, parts in ((taken[0], 0, ((0, 40), (60, 80))), (taken[1], 80, ((100, 120),))):
        t_ns, columns = found["plant/velocity"]
        v = columns.fields["scalars"]
        t = t_ns * 1e-6
        known = np.zeros(t.size, bool)
        for low, high in parts:
            part = (t > low) & (t <= high)
            known |= part
            middle = 0.02 * np.cos(np.ceil(t[part]) / 50)
            assert np.abs(v[part] - middle) == pytest.approx(0.5)  # from edge to edge
            assert np.ptp(v[part]) > 0.99
            assert np.diff(t[part]).max() == pytest.approx(0.5)
        assert np.isnan(v[~known]).all()
        assert (~known).any()
        assert t.min() > begin


def test_without_a_display_the_window_says_so(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UsageError, match="there is no display; try --web"):
        viewer.start()


def test_a_page_is_served_on_loopback_only_and_ends_with_its_viewer():
    shown = viewer.start(web=True)
    try:
        assert shown.alive
        assert re.fullmatch(
            r"http://127\.0\.0\.1:\d+/\?theme=dark&url=rerun%2Bhttp%3A%2F%2F127\.0\.0\.1%3A\d+%2Fproxy", shown.page
        )
        assert listeners(shown.process.pid) == {"0100007F"}
    finally:
        shown.stop()
    assert not shown.alive


def listeners(pid):
    """Addresses (hexadecimal) that a process listens on."""
    inodes = set()
    for entry in os.listdir(f"/proc/{pid}/fd"):
        target = os.readlink(f"/proc/{pid}/fd/{entry}")
        inodes |= {target[8:-1]} if target.startswith("socket:[") else set()
    found = set()
    for table in ("tcp", "tcp6"):
        with open(f"/proc/{pid}/net/{table}") as lines:
            rows = [line.split() for line in list(lines)[1:]]
        found |= {row[1].split(":")[0] for row in rows if row[3] == "0A" and row[9] in inodes}
    return found
