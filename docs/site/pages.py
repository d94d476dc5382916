"""What differs between a page that is read as a file and the same page on the site."""

import re
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

from rig.papers import gallery_tables, kept

SHOWN = {"README": "index", "CHANGELOG": "changelog", "recordings/README": "golden_recordings"}
"""File outside of this folder -> page that includes it. A link to the file leads to the page."""
_FOLDER = re.compile(r"^(\w+)/\*\n", re.MULTILINE)


def _lead_to_pages(app: Sphinx, doctree: nodes.document) -> None:
    project = f"{Path(app.srcdir).parent.as_posix()}/"
    for link in doctree.findall(pending_xref):
        path, _, part = link["reftarget"].partition("#")
        page = SHOWN.get(path.removeprefix(project).removesuffix(".md"))
        if link["reftype"] == "myst" and page is not None:
            link.attributes |= {"refdomain": "doc", "reftarget": page}
            link["reftargetid"] = link.get("reftargetid") or part or None


def _leave_out_empty_folders(app: Sphinx, page: str, source: list[str]) -> None:
    """Remove `folder/*` from tables of contents where the folder has no pages: Sphinx would warn."""

    def kept(line: re.Match[str]) -> str:
        folder = Path(app.srcdir) / line[1]
        return line[0] if any(one.suffix in (".md", ".ipynb") for one in folder.glob("*")) else ""

    source[0] = _FOLDER.sub(kept, source[0])


def with_figures(text: str, folder: Path) -> str:
    """Return the text of the page of the gallery with all figures and numbers: as a file it is short."""
    return "\n".join([text, *gallery_tables(kept(folder)), ""])


def _add_figures(app: Sphinx, page: str, source: list[str]) -> None:
    if page == "gallery/README":
        folder = Path(app.srcdir) / "gallery"
        app.env.note_dependency(str(folder / "numbers.json"))
        source[0] = with_figures(source[0], folder)


def _widen_lessons(_: Sphinx, page: str, __: str, context: dict[str, object], ___: object) -> None:
    """Leave out the list of sections beside a lesson: its figures take that width, so that one can read them."""
    if page.startswith("lessons/") and page != "lessons/index":
        context["meta"] = {**dict(context.get("meta") or {}), "html_theme.sidebar_secondary.remove": True}


def setup(app: Sphinx) -> dict[str, bool]:
    """Change pages before and after they are read."""
    app.connect("source-read", _leave_out_empty_folders)
    app.connect("source-read", _add_figures)
    app.connect("doctree-read", _lead_to_pages)
    app.connect("html-page-context", _widen_lessons)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
