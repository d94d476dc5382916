"""The pages: their Python runs, and their commands are ones that the program takes."""

import itertools
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rig import scenes
from rig.cli.app import GROUPS, every, program
from rig.laws import LAWS
from rig.qualify.torture import case
from rig.quantities import Unit
from rig.scenes.faults import metadata

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "recordings" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "gallery").glob("*.md")),
    *sorted((ROOT / "docs" / "lessons").glob("*.md")),
    *sorted((ROOT / "docs" / "reference").glob("*.md")),
    *sorted((ROOT / "docs" / "theory").glob("*.md")),
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
QUICKER = {"docs/robust.md": "from rig.analysis.robust import design; design.AUDIT = 100"}  # random rigs
PYTHON = ("docs/python.md", "docs/export.md", "docs/studies.md", "docs/robust.md", "docs/gym.md")


def blocks(page, language):
    return [body for kind, body in FENCE.findall((ROOT / page).read_text()) if kind == language]


def commands():
    """(page, words) of every line in a fence that starts with `rig`."""
    for page in PAGES:
        for body in blocks(page, ""):
            for line in body.splitlines():
                if line.startswith("rig "):
                    yield page.relative_to(ROOT).as_posix(), shlex.split(line, comments=True)


@pytest.mark.parametrize("page", PYTHON)
def test_the_python_of_a_page_runs(page, tmp_path):
    begin = [f"import os; os.chdir({str(ROOT)!r})", QUICKER.get(page, "")]
    code = "\n".join([*begin, *blocks(page, "python")])
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, env=environment, cwd=tmp_path
    )
    assert found.returncode == 0, found.stderr


def test_the_outputs_in_readme_are_those_of_the_lines_above_them(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    text = (ROOT / "README.md").read_text()
    assert "](docs/soft.png)" in text
    (scene,) = blocks("README.md", "toml")
    assert len(scene.split("\n\n")[0].splitlines() + scene.split("\n\n")[1].splitlines()) <= 10
    (tmp_path / "soft.toml").write_text(scene)
    shown = 0
    for (kind, body), (after, output) in itertools.pairwise(FENCE.findall(text)):
        if after != "text":
            continue
        lines = [shlex.split(line, comments=True)[1:] for line in body.splitlines() if line.startswith("rig ")]
        calls = [["-c", body]] if kind == "python" else [["-m", "rig", *words] for words in lines]
        printed = ""
        for call in calls:
            done = subprocess.run(
                [sys.executable, "-W", "error", *call], capture_output=True, text=True, env=environment, cwd=tmp_path
            )
            assert done.returncode == 0, done.stderr
            printed = done.stdout
        assert printed == output
        shown += 1
    assert shown == 2
    assert (tmp_path / "soft.png").stat().st_size > 10_000


@pytest.mark.parametrize(("page", "words"), [*commands()], ids=str)
def test_a_command_of_a_page_is_one_that_the_program_takes(page, words):
    command = program
    words = words[1:]
    while hasattr(command, "commands"):
        assert words[0] in command.commands, f"{page}: no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    options = {name for one in command.params for name in one.opts if name.startswith("-")}
    given = {word for word in words if re.match(r"--?[a-z]", word)}
    assert given <= options, f"{page}: {sorted(given - options)}"
    if any(one.metavar == "SCENE" for one in command.params) and words[0] in scenes.names():
        changed = [words[i + 1] for i, word in enumerate(words) if word == "-p"]
        scenes.load(words[0], dict(one.split("=", 1) for one in changed))


def test_a_test_that_a_page_names_exists():
    named = {name for page in PAGES for name in re.findall(r"\btests/[\w/]+\.py\b", page.read_text())}
    assert len(named) > 10
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_every_command_of_the_program_is_on_the_page_of_commands():
    shown = [words[1:] for page, words in commands() if page == "docs/commands.md"]
    named = {" ".join(words[: 2 if words[0] in GROUPS else 1]) for words in shown}
    assert named == {" ".join(name.split()[:2]) for name in every()}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_the_toml_of_a_page_is_read(page, tmp_path):
    """A block with `based_on` is a scene, unless a controller of it is a file that the reader makes first."""
    for file in (ROOT / "docs").glob("example_*"):
        shutil.copy(file, tmp_path)
    for body in blocks(page, "toml"):
        read = tomllib.loads(body)
        assert read
        if "based_on" in read and not any("file" in one for one in read.get("controllers", {}).values()):
            file = tmp_path / "mine.toml"
            file.write_text(body)
            assert scenes.load(str(file)).notes == () or "friction" in read  # another law drops keys, and says so
        elif "steps" in read:
            file = tmp_path / "case.toml"
            file.write_text(body)
            assert case.read(file).scene == read["scene"]


def test_the_version_is_the_same_everywhere():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1] == version
    assert re.search(r"^## \[?([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == version


def laws():
    """The rows of the table of friction laws: law, formula, coefficient at rest, keys, defaults."""
    text = (ROOT / "docs" / "laws.md").read_text()
    for line in text[text.index("## The laws") : text.index("## Laws with memory, compared")].splitlines():
        if line.startswith("| `"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            yield cells[0].strip("`"), *cells[1:5]


def test_the_table_of_friction_laws_is_that_of_the_program():
    declared = {name: LAWS[name] for name in LAWS.shipped}
    assert sorted(law for law, *_ in laws()) == sorted(declared)
    size = iter(range(1, 100))
    for law, formula, at_rest, keys, defaults in laws():
        fields = {key: info for key, info in declared[law].model_fields.items() if key != "law"}
        units = {}
        for key, info in fields.items():
            stated = (str(one) for one in metadata(info.annotation, info.metadata) if isinstance(one, Unit))
            units[key] = next(stated, "1")
        told = dict(re.findall(r"`(\w+)`(?: \[([^,]*)\])?", keys))
        assert told == {key: unit.replace("1", "") if unit == "1" else unit for key, unit in units.items()}, law
        optional = dict(re.findall(r"`(\w+) = ([^`]*)`", defaults))
        assert optional.keys() == {key for key, info in fields.items() if not info.is_required()}, law
        if declared[law].states:  # with memory
            told = {key: float(text) if text[0].isdigit() else text for key, text in optional.items()}
            assert told == {key: fields[key].default or ("none" if key == "load" else 0.0) for key in told}, law
            continue
        if law == "table":
            points = {"speeds": (0.0, 0.1, 0.3), "values": (0.5, 0.3, 0.4)}
            made = declared[law](law=law, **points).friction()
            assert (made.static, made.mu(0.1), made.mu(9.0)) == pytest.approx((0.5, 0.3, 0.4))
            continue
        if law == "directional":
            ways = {key: {"law": "constant", "mu": mu} for key, mu in (("forward", 0.3), ("backward", 0.4))}
            made = declared[law](law=law, **ways).friction()
            assert (made.mu(0.1), made.towards(-1.0).mu(0.1), made.towards(-1.0).static) == (0.3, 0.4, 0.4)
            continue
        values = {key: 0.9 / next(size) for key in fields if key not in optional}  # falls: static above kinetic
        made = declared[law](law=law, **values).friction()
        names = values | {key: float(text) for key, text in optional.items()}
        names |= {"exp": math.exp, "log": math.log, "sqrt": math.sqrt, "max": max}
        assert made.static == pytest.approx(eval(at_rest.strip("`"), names), rel=1e-12), law
        for v in (0.0, 0.01, 0.3, 20.0):
            assert made.mu(v) == pytest.approx(eval(formula.strip("`"), names | {"v": v}), rel=1e-12), (law, v)


def test_each_page_is_in_the_contents_of_the_site():
    folder = ROOT / "docs"
    contents = [
        tree
        for page in folder.glob("*.md")
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(), re.DOTALL)
    ]
    listed = {line.strip() for tree in contents for line in tree.splitlines()}
    assert {page.stem for page in folder.glob("*.md")} - listed == {"index"}
