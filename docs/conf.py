"""Sphinx builds the documentation: `make docs` writes it to build/docs."""

import re
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from docutils import nodes  # noqa: E402
from docutils.utils.math.latex2mathml import tex2mathml  # noqa: E402
from numpy.typing import ArrayLike  # noqa: E402
from page_numbers import NAMED, texts  # noqa: E402
from sphinx.util.typing import stringify_annotation  # noqa: E402

import fabric_fenicsx  # noqa: E402

project = "fabric_fenicsx"
author = "The fabric_fenicsx authors"
version = release = fabric_fenicsx.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx_design"]
exclude_patterns = ["examples/*.md"]
templates_path = ["templates"]
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

html_math_renderer = "mathml"  # of the browser itself, so that pages need no network
html_theme = "pydata_sphinx_theme"
html_title = "fabric_fenicsx"
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_end": [],
}
alone = "index getting_started gallery studies accuracy verification published limits alternatives"
html_sidebars = {page: [] for page in alone.split()}  # pages without others beside them
html_static_path = ["static"]
html_show_sourcelink = False

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
nitpicky = True
# types in signatures: other packages' are not linked, since a build needs no network
nitpick_ignore_regex = [("py:(class|data|exc)", ".*")]


NUMBERS = texts()


def short_types(app, what, name, obj, options, signature, returns):
    """Write NumPy's long type of all that can be an array by its name."""
    for mode in ("smart", "fully-qualified", "fully-qualified-except-typing"):
        long = stringify_annotation(ArrayLike, mode)
        signature, returns = (t and t.replace(long, "ArrayLike") for t in (signature, returns))
    return signature, returns


def as_rst(app, what, name, obj, options, lines):
    """Turn docstrings, which are Markdown with formulas, into what autodoc reads."""
    text, kept = "\n".join(lines), []

    def keep(words):
        kept.append(words)
        return f"\0{len(kept) - 1}\0"

    def formula(match):
        inner = "\n".join("   " + line.strip() for line in match[1].strip().splitlines())
        return keep(f"\n.. math::\n\n{inner}\n")

    text = re.sub(r"^[ ]*\$\$(.*?)\$\$", formula, text, flags=re.S | re.M)
    text = re.sub(r"\$([^$]+)\$", lambda m: keep(f":math:`{' '.join(m[1].split())}`"), text)
    text = re.sub(r"`([^`]+)`", lambda m: keep(f"``{m[1]}``"), text)
    # an indented block after a colon is a program
    text = re.sub(r":\n\n(?=    )", "::\n\n", text)
    programs = r"(?<=::\n\n)((?:    .*(?:\n|$)|\n(?=    ))+)"
    text = re.sub(programs, lambda m: keep(m[1]), text)
    text = re.sub(r"([*|\\_])", r"\\\1", text)
    text = re.sub(r"(?<=[^\n])\n(?=- )", "\n\n", text) if "\n- " in text else text
    while "\0" in text:
        text = re.sub("\0(\\d+)\0", lambda m: kept[int(m[1])], text)
    lines[:] = text.split("\n")


def fill_in(app, page, source):
    """Write the numbers that a page names; a KeyError names one that is not known."""
    source[0] = NAMED.sub(lambda found: NUMBERS[found[1]], source[0])


SPELLINGS = {  # what docutils wants written in another way
    r"\\([dt]?)frac\s*(\\[a-zA-Z]+|\w)\s*(\\[a-zA-Z]+|\w)": r"\\\1frac{\2}{\3}",
    r"(\\\\)\[\w+\]": r"\1",
    r"\\(sin|cos|tan|ln|arccos)\s*(?=[a-z0-9\\])": r"\\\1\\,",
}


def mathml(node, as_block):
    """A formula as MathML."""
    text = node.astext()
    for ours, theirs in SPELLINGS.items():
        text = re.sub(ours, theirs, text)
    return tex2mathml(text, as_block=as_block)


def formula(self, node):
    """Write a formula as MathML."""
    self.body.append(mathml(node, False))
    raise nodes.SkipNode


def displayed_formula(self, node):
    """Write a formula of its own paragraph as MathML."""
    self.body.append(f'<div class="formula">{mathml(node, True)}</div>')
    raise nodes.SkipNode


def setup(app):
    """Register what is our own."""
    app.add_html_math_renderer("mathml", (formula, None), (displayed_formula, None))
    app.add_css_file("formulas.css")
    app.connect("source-read", fill_in)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", short_types)
