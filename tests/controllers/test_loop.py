import math

import pytest

from rig import controllers
from rig.controllers.normal_force import NormalForce
from rig.controllers.runtime.loop import Loop
from rig.errors import UsageError

NAN = math.nan


def feedback(**given):
    return controllers.build(NormalForce(kind="normal_force", sensor="v", gain=200.0, nominal=20.0, **given), {})


class Faulty:
    reads, drives, period_ns = ("v",), ("load.force",), 1_000_000

    def start(self):
        return 0

    def update(self, state, t_ns, values):
        return state + 1, (NAN if state == 2 else float(state),)


def test_nothing_is_said_before_the_first_sample():
    loop = Loop(feedback())
    assert loop.answer(0, (NAN,)) == ()
    assert loop.answer(1_000_000, (0.05,)) == (10.0,)
    assert loop.counters() == {"updates": 1, "held": 1, "refused": 0, "skipped": 0}


@pytest.mark.parametrize("bad", [NAN, -math.inf])
def test_a_value_that_is_no_number_holds_command_and_state(bad):
    loop = Loop(feedback(filter=10.0))
    loop.answer(0, (0.05,))
    state = loop.state
    assert loop.answer(1_000_000, (bad,)) == loop.command == (10.0,)
    assert loop.state is state


def test_an_answer_that_is_no_number_is_not_sent_and_the_state_starts_afresh():
    loop = Loop(Faulty())
    assert [loop.answer(k, (0.0,)) for k in range(5)] == [(0.0,), (1.0,), (1.0,), (0.0,), (1.0,)]
    assert loop.counters() == {"updates": 4, "held": 0, "refused": 1, "skipped": 0}


class Touchy:
    """Takes any parameters it is given; what it makes of some is a fault."""

    reads, drives, period_ns = ("v",), ("load.force",), 1_000_000

    def __init__(self, section, numbers):
        if section.gain == 13.0:
            raise KeyError("superstition")
        self.section, self.numbers = section, numbers

    def start(self):
        return 0

    def update(self, state, t_ns, values):
        if self.section.gain == 2.0:
            return state, ()
        return state + 1, (1.0 / (self.section.gain - 1.0),)


@pytest.mark.parametrize(
    ("gain", "fault"),
    [(13.0, "KeyError"), (1.0, "ZeroDivisionError"), (2.0, "one number for each of load.force"), ("x", "gain")],
)
def test_a_retune_that_breaks_something_is_a_refusal(gain, fault):
    loop = Loop(Touchy(feedback(highest=100.0).section, {}))
    assert loop.answer(0, (0.0,)) == (1.0 / 199.0,)
    with pytest.raises(UsageError, match=fault):
        loop.retune({"gain": gain})
    assert loop.controller.section.gain == 200.0
    assert (loop.answer(1_000_000, (0.0,)), loop.state) == ((1.0 / 199.0,), 2)
    loop.retune({"gain": 3.0})
    assert loop.answer(2_000_000, (0.0,)) == (0.5,)
