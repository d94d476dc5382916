"""The section [network], and the same in one line: what is accepted, and what a user is told about faults."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.scenes.network import EXAMPLE, described, keys
from rig.scenes.sections import dump

BELT = "belt_normal_force"


def faults(changes):
    with pytest.raises(SceneError) as caught:
        scenes.load(BELT, {f"network.{key}": value for key, value in changes.items()})
    return caught.value.faults


def test_the_example_of_the_help_text_is_the_section():
    found = scenes.load(BELT, keys([EXAMPLE, "act/nf: loss 10%"])).network
    link = found.meas["vibrometer"]
    assert (link.delay, link.jitter, link.loss, link.duplicate, link.reorder) == (2_000_000, 500_000, 0.01, 0.001, True)
    assert (found.seed, found.act["nf"].loss, [*found.links]) == (3, 0.1, ["meas/vibrometer", "act/nf"])
    assert link.ticks(1_000_000) == (2, 3)


@given(
    st.integers(0, 10**8).map(lambda us: f"{us} us"),
    st.integers(0, 100).map(lambda p: f"{p} %"),
    st.integers(0, 100).map(lambda p: f"{p / 100}"),
    st.booleans(),
)
def test_a_link_in_words_is_read_as_it_was(delay, loss, duplicate, reorder):
    given = {"delay": delay, "jitter": "0 s", "loss": loss, "duplicate": duplicate, "reorder": str(reorder).lower()}
    one = scenes.network.Link.model_validate({**given, "reorder": reorder})
    text = described(dump(one))
    again = {} if text == "perfect" else keys([f"meas/v: {text}"])
    values = {key.rpartition(".")[2]: value for key, value in again.items()}
    other = scenes.network.Link.model_validate({**values, "reorder": "reorder" in values})
    assert other.delay == pytest.approx(one.delay, rel=1e-5)
    assert (other.loss, other.duplicate, other.reorder) == (
        pytest.approx(one.loss),
        pytest.approx(one.duplicate),
        one.reorder,
    )


def test_all_faults_of_a_section_are_told_at_once():
    changes = {"meas.vibromter.delay": "1 ms", "act.fn.loss": "1 %", "meas.vibrometer.delay": "-1 ms",
               "meas.vibrometer.los": "1 %", "act.nf.loss": "120 %", "act.nf.reorder": 3, "seed": -3}  # fmt: skip
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
    ("text", "told"),
    [
        ("vibrometer: loss 1 %", "column 1: vibrometer: a link is meas/SENSOR or act/CONTROLLER, then a colon"),
        ("mesa/vibrometer: loss 1 %", "column 1: mesa/vibrometer: did you mean meas/vibrometer?"),
        ("meas/vibrometer", "column 1: meas/vibrometer has no colon"),
        ("meas/vibrometer:", "column 17: says nothing about the link; known: delay, jitter, loss, duplicate, reorder"),
        ("meas/vibrometer: dely 2 ms", "column 18: dely: unknown; did you mean delay?"),
        ("meas/vibrometer: delay 2 ms, los 1 %", "column 30: los: unknown; did you mean loss?"),
        ("meas/vibrometer: delay", "column 18: delay: expected a number and a unit"),
        ("meas/vibrometer: reorder 3", "column 18: reorder 3: reorder takes no value"),
        ("meas/vibrometer: loss 1 %, loss 2 %", "column 28: loss is given twice"),
        ("meas/vibrometer: loss 1 %, seed 3", "seed must be at the end, after a semicolon"),
        ("meas/vibrometer: loss 1 %; seed x", "column 28: seed x: expected a whole number"),
        ("meas/vibrometer: loss 1 %; delay 1 ms", "delay is after a semicolon; only the seed may be there"),
    ],
)
def test_a_fault_of_the_line_has_its_column_and_near_words(text, told):
    with pytest.raises(UsageError) as caught:
        keys([text])
    assert told in str(caught.value)
    assert f'--net "{EXAMPLE}"' in str(caught.value)


def test_all_faults_of_all_lines_are_told_at_once_and_contradictions_too():
    with pytest.raises(UsageError) as caught:
        keys(
            ["meas/a: loss 1 %; seed 3", "meas/a: loss 2 %; seed 4", "act/b: dely 3 ms, jiter 3 ms"],
            ["network.meas.a.loss"],
        )
    lines = str(caught.value).splitlines()
    assert len(lines) == 6
    assert "network.meas.a.loss is given twice, as 1 % and as 2 %" in lines[0]
    assert "network.seed is given twice, as 3 and as 4" in lines[1]
    assert lines[4] == "--net and -p: both give network.meas.a.loss; leave out one of them"
