"""The section [network], and the same in one line: what is accepted, and what a user is told about faults."""

import pytest

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.scenes.network import EXAMPLE, described, keys
from rig.scenes.sections import dump

BELT = "belt_normal_force"


def refused(changes):
    with pytest.raises(SceneError) as caught:
        scenes.load(BELT, changes)
    return caught.value.faults


def faults(changes):
    return refused({f"network.{key}": value for key, value in changes.items()})


def test_the_example_of_the_help_text_is_the_section():
    found = scenes.load(BELT, keys([EXAMPLE, "act/nf: loss 10%"])).network
    link = found.meas["vibrometer"]
    assert (link.delay, link.jitter, link.loss, link.duplicate, link.reorder) == (2_000_000, 500_000, 0.01, 0.001, True)
    assert (found.seed, found.act["nf"].loss, [*found.links]) == (3, 0.1, ["meas/vibrometer", "act/nf"])
    assert link.ticks(1_000_000) == (2, 3)
    assert f"meas/vibrometer: {described(dump(link))}; seed 3" == EXAMPLE


def test_all_faults_of_a_section_are_told_at_once():
    changes = {
        "meas.vibromter.delay": "1 ms",
        "act.fn.loss": "1 %",
        "meas.vibrometer.delay": "-1 ms",
        "meas.vibrometer.los": "1 %",
        "act.nf.loss": "120 %",
        "act.nf.reorder": 3,
        "seed": -3,
    }
    assert [line.removesuffix(" (given in the call)") for line in faults(changes)] == [
        "network.seed = -3: must be at least 0",
        'network.meas.vibrometer.delay = "-1 ms": must be at least 0 s',
        "network.meas.vibrometer.los: unknown key; did you mean network.meas.vibrometer.loss?",
        'network.act.nf.loss = "120 %": must be at most 1',
        "network.act.nf.reorder = 3: expected true or false",
        "network.meas.vibromter: unknown sensor; did you mean vibrometer?",
        "network.act.fn: unknown controller; known: nf",
    ]
    assert "network.mess: unknown key; did you mean network.meas?" in faults({"mess.vibrometer.loss": "1 %"})[0]
    [told] = faults({"act.nf.jitter": "3 ms", "act.nf.delay": "2 ms"})
    assert "is more than the delay of 2 ms; a message cannot arrive before it is sent, so at most 2 ms" in told


def test_a_delay_between_frames_is_rounded_up():
    scene = scenes.load(BELT, {"network.act.nf.delay": "2.1 ms"})
    assert scene.network.act["nf"].ticks(scene.frame_ns) == (3, 3)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["meas/a: loss 1 %", "meas/a: loss 2 %"], "network.meas.a.loss is given twice, as 1 % and as 2 %"),
        (["mesa/v: loss 1 %"], "mesa/v: a link is meas/SENSOR or act/CONTROLLER, then a colon, then its values"),
        (["act/b: loss 1 %; delay 1 ms"], "delay 1 ms: only the seed may be after the semicolon"),
        (["meas/b: loss 1 %"], "--net and -p: both give network.meas.b.loss; leave out one of them"),
    ],
)
def test_what_is_wrong_with_a_line_is_told(lines, told):
    with pytest.raises(UsageError) as caught:
        keys(lines, ["network.meas.b.loss"])
    assert told in str(caught.value)
