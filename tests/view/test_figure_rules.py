"""The rules that tests/conftest.py applies to every figure which a test saves, and what no single figure shows."""

import figure_rules
import matplotlib as mpl
import numpy as np
import pytest
from colour_vision import nearest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rig.analysis.map.figure import COLOURS as REGIONS
from rig.papers import pick
from rig.qualify.cost.report import COLOURS as METHODS
from rig.qualify.torture.picture import COLOURS as RESULTS
from rig.view import contact
from rig.view.curves import apart
from rig.view.palette import GREY, LINES, encoded, printed


def drawn(size=(6.0, 4.0)):
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0, 2.0], [0.0, 1.0, 4.0], label="curve")
    axes.set(xlabel="time [s]", ylabel="velocity [m/s]")
    return figure, axes


def faults(figure):
    figure.canvas.draw()
    return list(figure_rules.faults(figure))


@pytest.mark.parametrize(
    ("colours", "least"),
    [
        ((*LINES, GREY), 15.0),
        (METHODS.values(), 15.0),
        (RESULTS.values(), 15.0),
        (REGIONS, 12.0),
        (contact.COLOURS, 14.0),
    ],
    ids=["curves", "methods", "torture", "regions", "contact"],
)
def test_colour_blind_readers_can_tell_the_colours_apart(colours, least):
    distance, kind, one, other = nearest(colours)
    assert distance > least, f"{one} and {other} look alike with {kind}"


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_the_same_figure_has_the_same_bytes(kind):
    first, second = (encoded(drawn()[0], kind) for _ in range(2))
    assert first == second
    assert b"Date" not in first


def test_no_line_joins_what_is_apart():
    x, y = apart(np.arange(4.0), np.array([1.0, 2.0, 9.0, 8.0]), np.array([False, True, False]))
    assert x == pytest.approx([0.0, 1.0, np.nan, 2.0, 3.0], nan_ok=True)
    assert y == pytest.approx([1.0, 2.0, np.nan, 9.0, 8.0], nan_ok=True)


def test_every_figure_of_a_paper_fits_a_page():
    for entry in pick("all"):
        width, height = entry.size
        assert height <= 1.41 * width
        assert width <= 12.0
        assert mpl.rcParams["font.size"] * figure_rules.PAPER[1] / width > 6.0


@pytest.mark.parametrize(
    ("typed", "sign"),
    [
        ("[(m/s^2)^2/Hz]", "[(m/s²)²/Hz]"),
        ("[dB re 20 uPa]", "[dB re 20 µPa]"),
        ("[N*s/m]", "[N s/m]"),
        ("[number of runs]", "[number of runs]"),
    ],
)
def test_a_unit_in_a_figure_has_its_printed_form(typed, sign):
    assert printed(typed) == sign
    figure, axes = drawn()
    axes.set_ylabel(f"depth^2 um* {typed}")
    encoded(figure, "svg")
    assert axes.get_ylabel() == f"depth^2 um* {sign}"
