"""docs/contributing.md: its walks enter the named functions in the named order; it lists the short modules."""

import re
import sys
import tomllib
from pathlib import Path

import pytest

import rig
from rig.bench.again.verify import verify
from rig.record.save_run import save

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "contributing.md").read_text()
STEP = re.compile(r"^\d+\. `(rig/[\w/]+\.py)` `([\w.]+)`", re.MULTILINE)


def steps(walk):
    return STEP.findall(PAGE.partition(f"### {walk}\n")[2].partition("\n#")[0])


def test_the_picture_shows_every_room_in_the_order_of_the_contracts():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rooms, analyses = (one["layers"] for one in contracts if one["type"] == "layers")
    at = rooms.index("analysis | gym | plant_fmu")
    order = [*rooms[1:at], "analysis", *analyses, "gym | plant_fmu", *rooms[at + 1 :]]
    shown = re.findall(r"[a-z_]+", PAGE.partition("```text\n")[2].partition("```")[0])
    within = iter(shown)
    for layer in order[: order.index("machine") + 1]:
        assert all(room in within for room in layer.split(" | ")), layer


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


def test_every_module_below_forty_lines_has_its_reason():
    files = [path for path in (ROOT / "rig").rglob("*.py") if path.name != "__init__.py" and path.parent.name != "laws"]
    short = {str(path.relative_to(ROOT)) for path in files if path.read_text().count("\n") < 40}
    assert set(re.findall(r"^\| `(rig/[\w/]+\.py)` \|", PAGE, re.MULTILINE)) == short
    assert len(short) <= 12
