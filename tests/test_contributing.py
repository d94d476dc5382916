"""docs/contributing.md: its walks enter the named functions in the named order. Each mutant changes one place."""

import re
import sys
from pathlib import Path

import pytest

import rig
from rig.bench.again.verify import verify
from rig.record.save_run import save
from tests.mutants import MUTANTS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "contributing.md").read_text()
STEP = re.compile(r"^\d+\. `(rig/[\w/]+\.py)` `([\w.]+)`", re.MULTILINE)


def steps(walk):
    return STEP.findall(PAGE.partition(f"### {walk}\n")[2].partition("\n#")[0])


def entered(function):
    """The functions of rig that `function` enters, as (file, qualified name), each at its first time and again."""
    calls = []

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_filename.startswith(f"{ROOT}/rig/"):
            calls.append((str(Path(frame.f_code.co_filename).relative_to(ROOT)), frame.f_code.co_qualname))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        function()
    finally:
        sys.setprofile(before)
    return calls


@pytest.mark.parametrize(
    "walk", ["A frame of a run", "How a command reaches an actuator", "How a recording is verified"]
)
def test_a_walk_enters_the_named_functions_in_order(walk, tmp_path):
    path = tmp_path / "run.mcap"
    save(rig.simulate("belt_normal_force", duration=0.05), path)
    runs = (lambda: verify(path)) if "verified" in walk else (lambda: rig.simulate("belt_normal_force", duration=0.05))
    calls = iter(entered(runs))
    named = steps(walk)
    assert len(named) > 2
    assert len({file for file, _ in named}) <= 3
    assert [step for step in named if step in calls] == named  # `in` on an iterator: each after the one before


def test_every_mutant_changes_one_place_and_names_tests():
    assert len(MUTANTS) == 40
    for mutant in MUTANTS:
        assert (ROOT / mutant.path).read_text().count(mutant.side(0)) == 1, mutant.text
        assert mutant.side(0) != mutant.side(1)
        assert all((ROOT / "tests" / f"{name}.py").is_file() for name in mutant.tests.split())
