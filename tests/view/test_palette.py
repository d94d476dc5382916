"""What no single figure shows: its bytes, and the printed form of its units."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rig.view.palette import encoded, printed


def drawn():
    figure = Figure(figsize=(6.0, 4.0), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0, 2.0], [0.0, 1.0, 4.0], label="curve")
    axes.set(xlabel="time [s]", ylabel="velocity [m/s]")
    return figure, axes


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_the_same_figure_has_the_same_bytes(kind):
    first, second = (encoded(drawn()[0], kind) for _ in range(2))
    assert first == second
    assert b"Date" not in first


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
