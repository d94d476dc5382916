"""How `make site` builds the pages of this folder: Sphinx, MyST, and the reference generated from the program."""

import sys
import tomllib
from pathlib import Path

import ziamath  # carries the font of the formulas

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT)]

from rig_types import make_known  # noqa: E402

make_known()

project = "friction-rig"
author = "The friction-rig authors"
version = release = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "mathml",
    "docstrings",
    "pages",
    "scene_reference",
    "command_reference",
    "bus_reference",
    "gallery_summary",
]
root_doc = "index"
exclude_patterns = ["site"]
suppress_warnings = ["ref.python"]  # a signature that names one of two classes called Section: it is not linked

myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_update_mathjax = False
nb_execution_mode = "auto"  # notebooks without outputs are run
nb_execution_raise_on_error = True
nb_execution_timeout = 600

smartquotes = False
highlight_language = "none"  # of blocks that name no language: commands and what they print
default_role = "literal"  # single backquotes in docstrings
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {
    "members": True,
    "undoc-members": True,
    "exclude-members": "__init__, __new__, model_config, model_post_init",
}
autodoc_class_signature = "separated"  # and its part left out: users build no results, and the fields are listed
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"
# The reference describes what users call. Types of other packages, and of parts within, are named without a link.
nitpick_ignore_regex = [("py:.*", ".*")]

html_theme = "pydata_sphinx_theme"
html_title = f"friction-rig {version}"
html_math_renderer = "mathml"
html_static_path = ["_static", str(Path(ziamath.__file__).parent / "fonts" / "STIXTwoMath-Regular.ttf")]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # a page from the file system may not read the others
html_show_copyright = False
html_sidebars = {page: [] for page in ("index", "getting_started", "changelog", "decisions")}  # no sub-pages
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": [],
    "footer_end": [],
    "show_toc_level": 2,
}
