"""The page of a run on another host, by the ticket of its operator: in this process, over TLS on loopback."""

import threading
import time

import pytest
from ports import own_port

from rig import bus, scenes
from rig.bench.live.outcome import Job
from rig.bench.live.plant import Plant
from rig.bus.tickets import Listener
from rig.errors import BusError

pytest.importorskip("starlette")
from rig.web.run_control import RunControl


def test_the_page_watches_and_operates_a_run_of_another_host(runs):
    scene = scenes.load("belt")
    listener = Listener(f"tls/127.0.0.1:{own_port()}", ("nf", "operator"))
    stopped = []
    session = bus.host("far", scene.name, None, ["nf"], listener)
    job = Job(scene.to_json(), run="far", pace=1.0, duration=600.0, listener=listener)
    plant = Plant(session, job, lambda: "by the test" if stopped else "")
    session.announce()

    def carry_out():
        plant.run(lambda _: None)
        session.close()

    thread = threading.Thread(target=carry_out)
    frames = []
    page = RunControl(lambda: None, frames.append, lambda kind, content: None)
    try:
        with pytest.raises(BusError, match=r"nf.ticket is the ticket of nf, and not that of operator"):
            bus.join(role="operator", name="page", ticket=session.tickets["nf"])
        page.follow_ticket(session.tickets["operator"])
        thread.start()
        deadline = time.monotonic() + 60.0
        while page.state["phase"] != "running" or len(frames) < 5:
            assert time.monotonic() < deadline, page.state
            time.sleep(0.02)
        assert page.set({"key": "load.force", "value": "15 N"})["values"] == {"load.force": 15.0}
        page.command({"do": "stop"})
        thread.join(60.0)
        while page.active:
            assert time.monotonic() < deadline, page.state
            time.sleep(0.02)
        assert page.state["outcome"]["ended"] == "stopped by an operator"
        assert page.state["fault"] == ""
    finally:
        stopped.append(True)
        if thread.ident is not None:
            thread.join(60.0)
