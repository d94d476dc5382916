"""Figures of the papers: the list, what compares, and the page. The figures themselves run with the slow tests."""

import json
from pathlib import Path

import pytest

from rig import papers
from rig.papers import Comparison, Entry

GALLERY = Path(__file__).parents[2] / "docs" / "gallery"


def wrong(made):
    """What differs, and what is said to differ but agrees."""
    return [(one.what, one.ours, one.expected) for one in made.comparisons if one.compared and one.agrees == one.missed]


def test_the_gallery_has_every_figure_as_pixels_and_as_curves():
    names = {entry.name for entry in papers.pick("all")}
    assert {path.stem for path in GALLERY.glob("*.png")} == {path.stem for path in GALLERY.glob("*.svg")} == names
    lines = papers.gallery_tables(papers.kept(GALLERY))
    for name in names:
        drawn = (GALLERY / f"{name}.svg").read_text()
        assert len(drawn) < 1_000_000
        assert "<dc:date>" not in drawn
        assert f"### {name}" in lines
        assert f"The figure as [SVG]({name}.svg)." in lines


def test_a_number_agrees_within_its_bound_only():
    assert Comparison("x", "", 1.0 + 9e-7, 1.0, "reference", relative=1e-6).agrees
    assert not Comparison("x", "", 1.0 + 2e-6, 1.0, "reference", relative=1e-6).agrees
    assert Comparison("x", "", 0.1, 0.0, "reference", absolute=0.2).agrees
    assert not Comparison("x", "", float("nan"), 0.0, "reference", absolute=0.2).agrees
    for ours in (22.0, 19.9, float("nan")):  # a floor may be exceeded
        assert Comparison("x", "dB", ours, 20.0, "paper", floor=True).agrees is (ours == 22.0)


def test_a_number_that_is_known_to_differ_or_that_the_paper_does_not_state_is_no_failure_and_no_agreement(tmp_path):
    missed = Comparison("band", "ohm", 30.0, 50.0, "paper", relative=0.1, missed=True)
    silent = Comparison("drop", "dB", 22.0, float("nan"), "paper")
    assert (missed.agrees, missed.result) == (False, "not reproduced")
    assert (silent.agrees, silent.result, silent.bound) == (False, "no number in the paper", "")
    shown = Entry("kroeger-9", "kroeger", "Figure 9", "two", ("belt",), lambda _: iter([missed, silent]))
    made = papers.make(shown, tmp_path)
    assert made.agrees
    papers.keep([made], tmp_path)
    page = papers.gallery_page(papers.keep([], tmp_path), "this machine")
    assert "| 2 | 0 of 1 |" in page
    assert "| band | 30 ohm | 50 ohm | paper | 0.1 relative | not reproduced |" in page
    assert "| drop | 22 dB |  | paper |  | no number in the paper |" in page


def test_figures_that_worker_processes_make_are_the_same_and_one_made_again_leaves_the_others_on_the_page(tmp_path):
    wanted = [*papers.pick("kroeger-9"), *papers.pick("liu000-3")]
    found = papers.make_all(wanted, tmp_path / "together", workers=2)
    alone = [papers.make(entry, tmp_path) for entry in wanted]
    assert [(one.entry, one.comparisons) for one in found] == [(one.entry, one.comparisons) for one in alone]
    assert [one.picture.read_bytes() for one in found] == [one.picture.read_bytes() for one in alone]
    assert [wrong(one) for one in alone] == [[], []]
    first, last = alone
    assert papers.keep([last], tmp_path) == [last]
    assert papers.keep([first], tmp_path) == [first, last]
    (tmp_path / "numbers.json").write_text("{")  # broken off
    assert papers.keep([first], tmp_path) == [first]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("entry", papers.pick("all"), ids=lambda entry: entry.name)
def test_every_figure_agrees_in_all_numbers_of_the_gallery(entry, tmp_path):
    made = papers.make(entry, tmp_path)
    assert wrong(made) == []
    [shown] = [one for one in json.loads((GALLERY / "numbers.json").read_text()) if one["name"] == entry.name]
    assert [one.what for one in made.comparisons] == [one["what"] for one in shown["comparisons"]]
