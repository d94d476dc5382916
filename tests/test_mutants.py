"""The faults of tests/mutants.py: each changes one place and names tests."""

from pathlib import Path

from tests.mutants import MUTANTS

ROOT = Path(__file__).parents[1]


def test_every_mutant_changes_one_place_and_names_tests():
    assert len(MUTANTS) == 40
    for mutant in MUTANTS:
        assert (ROOT / mutant.path).read_text().count(mutant.side(0)) == 1, mutant.text
        assert mutant.side(0) != mutant.side(1)
        assert all((ROOT / "tests" / f"{name}.py").is_file() for name in mutant.tests.split())
