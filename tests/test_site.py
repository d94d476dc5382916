"""The site that `make site` builds: complete, without anything from another host, its formulas and its reference."""

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import rig

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
SITE = DOCS / "site"
GALLERY = DOCS / "gallery"
CODE = re.compile(r"^(```|~~~).*?^\1|`[^`\n]+`", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)")


@pytest.mark.parametrize("page", [*DOCS.rglob("*.md")], ids=lambda page: page.name)
def test_a_link_of_a_page_leads_to_a_file(page):
    """That it leads to a heading there is checked by `make site`."""
    links = [link.partition("#")[0] for link in LINK.findall(CODE.sub("", page.read_text()))]
    assert [link for link in links if link and "://" not in link and not (page.parent / link).is_file()] == []


def test_the_reference_of_python_has_every_function():
    page = (DOCS / "reference" / "python.md").read_text()
    assert set(
        re.findall(r"^\.\. autofunction:: (\w+)$", page.partition("## Scenes and runs")[0], re.MULTILINE)
    ) == set(rig.__all__)


@pytest.fixture
def site(monkeypatch):
    """The modules of the site can be imported; skipped without Sphinx."""
    pytest.importorskip("sphinx", reason="Sphinx is not installed: make site installs it")
    monkeypatch.syspath_prepend(str(SITE))


@pytest.mark.usefixtures("site")
def test_a_value_of_the_reference_has_its_unit_range_and_default():
    import scene_reference

    rows = {row[0]: row[1:] for row in scene_reference.rows(scene_reference.PLANTS["belt"].Parameters)}
    assert rows["`body.mass`"][:3] == ("`kg`", "1e-09 to 1e+06", "required")
    assert rows["`body.damping`"][:3] == ("`N*s/m`", "0 to 1e+09", "`0`")
    clock = "\n".join(scene_reference.section("rig.scenes.protocol:Clock"))
    assert "| `frame` | `s` | 1e-06 to 1 | `0.001` | loop period" in clock
    disc = "\n".join(scene_reference.section("rig.effects.disc_modes:Disc"))
    assert "| `poisson` | `1` | 0 to below 0.5 | required |" in disc


@pytest.mark.usefixtures("site")
def test_a_command_of_the_reference_has_its_options_and_its_example():
    import command_reference

    text = "\n".join(command_reference.commands())
    for name, command in command_reference.every().items():
        assert f"### rig {name}" in text
        shown = [one for one in command.params if one.name != "help" and not getattr(one, "hidden", False)]
        for one in shown:
            word = one.opts[0] if one.param_type_name == "option" else one.metavar.replace("|", r"\|")
            assert f"| `{word}" in text, (name, one.opts)


class Loaded(HTMLParser):
    """Collects what a page loads by itself, and its links to files."""

    def __init__(self):
        super().__init__()
        self.loaded, self.links, self.formulas = [], [], 0

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if tag in ("script", "img", "iframe", "source", "video", "audio", "embed"):
            self.loaded += [given[key] for key in ("src", "srcset") if given.get(key)]
        elif tag == "link" and given.get("rel") not in ("canonical", "next", "prev", "index", "search"):
            self.loaded.append(given.get("href", ""))
        elif tag == "a":
            self.links.append(given.get("href", ""))
        self.formulas += tag == "math"


@pytest.mark.slow
def test_the_site_stands_alone(tmp_path):
    """Built with every warning an error; nothing that a page loads is on another host, and every file is there."""
    pytest.importorskip("sphinx", reason="Sphinx is not installed: make site installs it")
    out = tmp_path / "site"
    options = ["--quiet", "--fail-on-warning", "--keep-going", "--nitpicky", "-c", str(SITE), str(DOCS), str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    found = subprocess.run(
        [sys.executable, "-m", "sphinx", *options], capture_output=True, text=True, env=environment, timeout=300
    )
    assert found.returncode == 0, found.stderr
    built = sorted(page for page in out.rglob("*.html") if "_static" not in page.parts)
    assert len(built) > 40
    for page in built:
        seen = Loaded()
        seen.feed(page.read_text())
        for address in seen.loaded:
            assert not re.match(r"(https?:)?//", address), f"{page}: {address}"
            assert address.startswith("data:") or (page.parent / address.partition("?")[0]).exists(), (
                f"{page}: {address}"
            )
        for address in seen.links:
            file = address.partition("#")[0].partition("?")[0]
            assert re.match(r"\w+:", file) or (page.parent / file).exists(), f"{page}: {address}"
    for sheet in out.rglob("*.css"):
        assert not re.search(r"(url\(|@import )\s*['\"]?(https?:)?//", sheet.read_text()), sheet
    assert (out / "searchindex.js").read_text().startswith("Search.setIndex(")


def test_the_short_page_of_the_gallery_counts_what_agrees():
    rows = {}
    for figure in json.loads((GALLERY / "numbers.json").read_text()):
        compared = [one["agrees"] for one in figure["comparisons"] if one["expected"] is not None]
        for name in (figure["name"].partition("-")[0], "all"):
            before = rows.get(name, (0, 0, 0, 0))
            rows[name] = tuple(map(sum, zip(before, (1, all(compared), len(compared), sum(compared)))))
    counted = re.compile(r"^\|.*\| `(\w+)`((?: \| \d+){4}) \|$", re.MULTILINE)
    told = counted.finditer((GALLERY / "README.md").read_text())
    assert {row[1]: tuple(map(int, row[2].split("|")[1:])) for row in told} == rows
