"""A recording is checked: what ended the run the first time must end it again."""

import dataclasses

import pytest

import rig
from rig.bench.again.verify import verify
from rig.bus import messages
from rig.record.save_run import save


@pytest.fixture(scope="module")
def limited():
    """A run that a limit has ended."""
    scene = rig.load("belt", {"friction.mu_static": "0.45", "limits.displacement": "1 mm"})
    run = rig.simulate(scene, duration=2.0)
    assert "is beyond its limit of 0.001 m" in run.summary["ended"]
    return run


def test_a_run_that_a_limit_ended_holds(limited, tmp_path):
    # as a plant process tells it: the summary of a run over the bus names the limit as what stopped the run
    save(dataclasses.replace(limited, fault=limited.summary["ended"]), tmp_path / "limited.mcap")
    found = verify(tmp_path / "limited.mcap")
    assert found.passed, found.text()
    assert found.identical
    assert found.compared > 1000


def test_what_strangers_say_is_kept_and_not_done_again(tmp_path):
    """A guest calls itself the plant, and tells what an operator is to have done; it said so on a topic of its own."""
    run = rig.simulate("belt", duration=0.2)
    path = tmp_path / "run.mcap"
    strange = [("begin", {}), ("parameter", {}), ("parameter", {"set": {"friction.mu_static": 0.1}})]
    strange += [("dismissed", {"controller": "nf"}), ("verdict", {"verdict": "INVALID"})]
    events = [
        {"t_ns": 5 * 10**7, "tick": 50, "source": "mine", "kind": kind, "text": "", "data": {"by": "operator", **data}}
        for kind, data in strange
    ]
    packed = messages.event

    def lying(t_ns, tick, source, *said, **more):
        return packed(t_ns, tick, "plant", *said, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(messages, "event", lying)
        save(dataclasses.replace(run, events=[*run.events, *events]), path)
    assert [event for event in rig.open(path).events if event["source"] == "mine"] == events
    found = verify(path)
    assert found.passed, found.text()
    assert found.identical


def test_a_stop_that_does_not_come_again_is_told(limited, tmp_path):
    save(dataclasses.replace(limited, fault="the state is not finite"), tmp_path / "stopped.mcap")
    assert verify(tmp_path / "stopped.mcap").faults == ("the state is not finite",)
