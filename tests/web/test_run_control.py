"""What the page tells of a run of another terminal, without processes."""

import threading
import time
from types import SimpleNamespace

import pytest

import rig
from rig.errors import UsageError
from rig.web import run_control
from rig.web.run_control import RunControl


class Follower:
    """Follows nothing; a test tells its news. `last`: the one that was made last."""

    last = None

    def __init__(self, run, frame, news, arrived, trust, ticket):
        self.run, self.news, self.events, self.trust = run, news, [], trust
        Follower.last = self

    def start(self):
        self.news("setup", {"scene": "belt", "title": "Mass on a belt"})
        self.news("values", [])
        self.news("status", {"pace": 0.5, "paused": False})

    def stop(self):
        self.news("left", None)


@pytest.fixture
def control(monkeypatch):
    monkeypatch.setattr(run_control, "Follower", Follower)
    monkeypatch.setattr(run_control.address, "find", lambda run: SimpleNamespace(run=run, scene="belt"))
    found = RunControl(lambda: None, lambda *_: None, lambda *_: None)
    state = found.follow({"run": "belt-1"})
    assert (state["phase"], state["pace"], state["title"]) == ("running", 0.5, "Mass on a belt")
    return found


def test_a_followed_run_without_a_summary_has_lost_its_plant(control):
    Follower.last.news("left", None)
    assert control.state["phase"] == "ended"
    assert "its plant ended unexpectedly; its terminal shows the reason" in control.state["fault"]


def test_an_automatic_pace_is_that_of_the_plant_once_it_is_known(monkeypatch):
    monkeypatch.setattr(run_control, "Follower", Follower)
    told, plays = [], threading.Event()

    def run(scene, *, pace, begun, **options):
        told.append(pace)
        begun("belt-1")
        plays.wait(10.0)
        raise UsageError("over")

    monkeypatch.setattr(run_control.supervise, "run", run)
    control = RunControl(lambda: None, lambda *_: None, lambda *_: None)
    assert control.start(rig.load("belt"), "belt", {}, "auto")["command"] == "rig run belt --pace auto"
    for _ in range(1000):
        if control.state["pace"] != "auto":
            break
        time.sleep(0.01)
    assert (told, control.state["pace"]) == (["auto"], 0.5)
    plays.set()
