"""Formulas as MathML, made when the site is built: no script, nothing from another host, also from a folder.

All current browsers draw MathML. The converter is that of docutils.
"""

import re

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

_log = logging.getLogger(__name__)
_ALIGNED = re.compile(r"\\(begin|end)\{(?:align|eqnarray|gather|multline|split)\*?\}")
_MISREAD = re.compile(r"\\[dt]?frac\s*\d|\\(?:hat|bar|d?dot|tilde) *\\?[a-zA-Z]+[_^]")
"""What the converter reads as something else without an error: \\frac12 k as the fraction 12 over k, and the subscript
of \\dot q_i as one below q. With braces both are right: \\frac{1}{2} k, \\dot q{}_i."""
_EQUATION = re.compile(r"\\(?:begin|end)\{equation\*?\}")
"""Environments of displayed equations, which the converter knows as `aligned` only. Numbers are Sphinx's."""

_FUNCTION = re.compile(
    r"(<msup>\s*)?(?:<mi>(?=arc|arg|artanh|cos|det|ln|Re|sin|tan)|<mo>(?=max|min))(\w+)</m[io]>"
    r"(?:\s*<mo>&ApplyFunction;</mo>)?"
    r"(?=(\s*<mn>2</mn>\s*</msup>)?(?:\s*<mrow>)?\s*(?:<mo[^>]*>(\())?)"
)
_ENDS = re.compile(r"(?:</(?!mo>)\w+>|<mo[^>]*>[)|]</mo>)\s*$")
"""What a function needs space behind: the end of a quantity."""
_BARS = re.compile(r'<mo class="mathopen">([|‖])</mo>(.*?)<mo>\1</mo>', re.DOTALL)
_SPACE = "0.1667em"
"""Thin space of TeX."""


def _spaced(mathml: str) -> str:
    """Names of functions apart from what they stand beside, and bars close to what they enclose, as TeX sets them."""

    def operator(found: re.Match[str]) -> str:
        before = _SPACE if _ENDS.search(found.string[: found.start()]) else "0"
        behind = "0" if found[4] else _SPACE
        return f'{found[1] or ""}<mo lspace="{before}" rspace="{behind}">{found[2]}</mo>'

    bar = '<mo form="{}" stretchy="false">{}</mo>'
    closed = _BARS.sub(
        lambda found: bar.format("prefix", found[1]) + found[2] + bar.format("postfix", found[1]), mathml
    )
    return _FUNCTION.sub(operator, closed)


def _converted(page: HTML5Translator, node: nodes.math | nodes.math_block, block: bool) -> str:
    if wrong := _MISREAD.search(node.astext()):
        _log.warning("the converter misreads %r: write braces", wrong.group(), location=node)
    text = _EQUATION.sub("", _ALIGNED.sub(r"\\\1{aligned}", node.astext()))
    try:
        return _spaced(str(tex2mathml(text, as_block=block)))
    except MathError as fault:
        _log.warning("this formula cannot be made MathML: %s\n%s", fault, node.astext(), location=node)
        return f"<code>{page.encode(node.astext())}</code>"


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_converted(self, node, block=False))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(self.starttag(node, "div", CLASS="math"))
    if node["number"]:
        number = get_node_equation_number(self, node)
        self.body.append(f'<span class="eqno">({number})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append(_converted(self, node, block=True))
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
