"""What keeps a front end from being run: each wrong value is a line, before a bank of instruments is made of it."""

import math

import pytest

from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instants import Instants

WRONG = [
    ({"instants": 1000.0}, "instants is 1000.0; expected self.instants"),
    ({"delay_ns": 0.5}, "delay_ns is 0.5; expected whole nanoseconds from 0 to 1e+11"),
    ({"averages": "no"}, "averages is 'no'; expected True or False"),
    ({"gain": "loud"}, "gain is 'loud'; expected a finite number"),
    ({"noise": -1.0}, "noise is -1; expected at least 0"),
    ({"low": math.nan}, "low is nan; expected a number, or math.inf"),
    ({"low": 1.0, "high": -1.0}, "low is 1, above high = -1"),
    ({"slew": 0.0}, "slew is 0; expected above 0"),
    ({"dropout_shortest": 2.0, "dropout_longest": 1.0}, "dropout_shortest is 2 s, above dropout_longest = 1 s"),
    ({"poles": 3, "residues": 4}, "poles are 3, residues 4; expected two tuples of numbers"),
    ({"poles": (-1.0,)}, "there are 1 poles and 0 residues; expected as many of both"),
    ({"poles": (1.0,), "residues": (1.0,)}, "a pole is 1; expected a negative real part, so that it decays"),
    ({"poles": (-1.0,), "residues": ("a",)}, "residues contain 'a'; expected finite numbers"),
    ({"echoes": ((0.5, -1.0),)}, "echoes contain (0.5, -1.0); expected pairs (share, delay)"),
]


@pytest.mark.parametrize(("given", "told"), WRONG, ids=str)
def test_a_wrong_value_is_one_line(given, told):
    (line,) = FrontEnd(**{"instants": Instants.of(1000.0)} | given).faults()
    assert line.startswith(told)


def test_a_perfect_front_end_has_no_fault():
    assert [*FrontEnd(Instants.of(1000.0)).faults()] == []
