"""What a page gets of other processes is JSON, whatever they say."""

import json
from types import SimpleNamespace

from rig.scenes import load
from rig.web.broadcast import Broadcast
from rig.web.follower import LiveValues
from rig.web.plain_json import Answer

STRANGE = {"t": float("nan"), "data": {"state": [1.0, float("inf"), (None, -float("inf"))]}}
PLAIN = {"t": None, "data": {"state": [1.0, None, [None, None]]}}


def strict(text):
    def refuse(number):
        raise AssertionError(number)

    return json.loads(text, parse_constant=refuse)


def test_numbers_that_json_does_not_have_are_null_for_every_page():
    assert strict(Answer({"events": [STRANGE]}).body) == {"events": [PLAIN]}
    broadcast = Broadcast()
    broadcast.put("summary", STRANGE)
    _, texts = broadcast.since(0)
    assert [strict(text) for text in texts] == [{"kind": "summary", "summary": PLAIN}]


def values_of(answers):
    """The values of a run whose processes give these answers."""

    scene = load("belt_normal_force")
    session = SimpleNamespace(ask=lambda topic, *_: answers[topic])
    return LiveValues(session, scene, scene.assemble().inputs)


PLANT = {"values": {"load.force": 20.0}, "units": {"load.force": "N"}, "overruled": {}}


def test_a_process_changes_no_value_of_another_one_on_the_page():
    values = values_of({"param/plant": PLANT, "param/nf": {"values": {"gain": 1.0}, "units": {"gain": "N*s/m"}}})
    values.read()

    def hear(source, changes):
        new = values.hear({"kind": "parameter", "source": source, "data": {"set": changes}})
        return new, values.entries["load.force"]["value"], values.entries["controllers.nf.gain"]["value"]

    assert hear("me", {"load.force": 90.0, "controllers.nf.gain": 3.0}) == (False, 20.0, 1.0)
    assert hear("nf", {"load.force": 90.0, "gain": 2.0}) == (True, 20.0, 2.0)
    assert hear("nf", {"gain": ["3"]}) == (False, 20.0, 2.0)
    assert hear("plant", {"load.force": 30.0}) == (True, 30.0, 2.0)
