"""Numbers with units as users write them."""

import math

import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rig
from rig import units
from rig.errors import UsageError
from rig.units import si, with_point


@settings(deadline=None)  # the first conversion loads all units
@given(
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["s", "ms", "km", "rpm", "µm", "N/m", "eV", "E"])
)
def test_the_space_before_a_unit_may_be_left_out(number, unit):
    def read(text):
        found = []
        for target in ("s", "m", "rad/s", "N/m", "J"):
            try:
                found.append(si(text, target))
            except ValueError:
                found.append(None)
        return found

    assert read(f"{number!r}{unit}") == read(f"{number!r} {unit}")


@pytest.mark.parametrize("text", ["1e3e3", "2m s", "0x10", "1,5s", "s", "10-20s"])
def test_what_is_no_number_with_a_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"expected a (number|unit)"):
        si(text, "s")


@pytest.mark.parametrize("duration", [-1.0, math.nan, 1e9, "3"])
def test_a_run_of_an_impossible_length_is_refused(duration):
    calls = (
        lambda: rig.simulate("belt", duration),
        lambda: rig.study("belt", {"load.force": [10.0]}, ["run.rms"], duration=duration),
        lambda: rig.optimise("belt", {"load.force": (10.0, 20.0)}, "run.rms", duration=duration),
    )
    for call in calls:
        with pytest.raises(UsageError, match=r"the duration (of .* s must be|is '3')"):
            call()


@pytest.mark.parametrize("text", ["\u22123.5\xa0mm", "\u2212.35e1\u2009mm"])
def test_characters_of_a_typeset_page_are_read(text):
    assert si(text, "m") == pytest.approx(-3.5e-3, rel=1e-15)


@pytest.mark.parametrize(
    ("typed", "read"),
    [
        ("15,5 N", "15.5 N"),
        ("\u22120,25", "-0.25"),
        ("0,125 m", "0.125 m"),
        ("1234,567 N", "1234.567 N"),
        ("1,5e-3m", "1.5e-3m"),
        *((text, text) for text in ("10, 20 N", "[0,1]", "1,2,3", "1,5.csv", "coulomb")),
    ],
)
def test_a_typed_decimal_comma_is_a_point(typed, read):
    assert with_point(typed, "x") == read


def test_a_comma_that_may_part_thousands_is_refused():
    with pytest.raises(UsageError, match=r"load 1,500 N may be 1\.500 or 1500"):
        with_point("1,500 N", "load")


@pytest.mark.parametrize("value", ["15,5 N", "\u22120,1\xa0N", [0, 1, "chosen"]])
def test_a_decimal_comma_in_a_file_is_named(value):
    with pytest.raises(ValueError, match="with a decimal point, not a comma"):
        si(value, "N")


@pytest.mark.parametrize("unit", units.USUAL)
def test_usual_units_have_exactly_the_sizes_of_pint(unit):
    assert units.SIZES.keys() >= {unit}
    everything = pint.UnitRegistry()
    for name, size in units.USUAL[unit].items():
        for text in {name, name.replace("u", "µ"), name.replace("u", "\u03bc")}:  # \u03bc: the Greek letter
            zero, one = (
                everything.Quantity(value, everything.parse_units(text)).to("" if unit == "1" else unit).magnitude
                for value in (0.0, 1.0)
            )
            assert (size, 0.0) == (one, zero), text
            assert si(f"3 {text}", unit) == 3.0 * one
