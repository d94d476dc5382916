"""The disc with 24 points: the bases of the page give its numbers, and its step keeps the energy balance."""

import re
from pathlib import Path

import pytest

import rig
from rig import scenes

DOCS = Path(__file__).parents[2] / "docs"
POINTS = {f"contacts.{pad}.points": [3, 4] for pad in ("pad_up", "pad_down")}
OPEN = POINTS | {"reduction.contact": "open", "reduction.residual": "attachment"}


@pytest.mark.parametrize(
    ("values", "name"),
    [
        pytest.param(
            {"reduction.contact": "closed", "reduction.residual": "attachment"},
            "closed, as the full matrices",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"reduction.contact": "open", "reduction.residual": "attachment"},
            "open, attachments",
            marks=pytest.mark.slow,
        ),
        ({"reduction.contact": "open", "reduction.residual": "spring"}, "open, springs in series"),
    ],
)
def test_the_table_of_the_page_has_the_modes_of_its_bases(disc, values, name):
    report = rig.modes(scenes.load(disc / "disc_squeal.toml", POINTS | values))
    growing = [mode for mode in report.sliding.modes if mode.growth > 0.0]
    cells = [f"{mode.frequency:.0f} Hz ({mode.growth:.3g} 1/s)" for mode in growing]
    page = (DOCS / "structure.md").read_text()
    [row] = re.findall(rf"^\| {name} \|(.*)$", page, re.MULTILINE)
    assert ", ".join(cells) in row
    springs = any("reduction.residual" in note for note in report.notes)
    assert springs == (values["reduction.residual"] == "spring")  # the remedy for the estimated error


@pytest.mark.parametrize(("step", "least", "most"), [("0.5 us", 0.0, 1e-3), ("1 us", 1e-3, 5e-3)])
def test_half_a_microsecond_keeps_the_energy_balance_with_attachments(disc, step, least, most):
    run = rig.simulate(scenes.load(disc / "disc_squeal.toml", OPEN | {"clock.rk4_step": step}), 0.1)
    assert run.signals["contact_fraction"].min() < 1.0  # it squeals
    assert least < abs(run.energy["error"]) < most
