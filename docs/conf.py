"""How the documentation site is built: ``make site``; nothing of it needs a network, to build or to read."""

import importlib
import re
import sys
from functools import reduce
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from numpy.typing import ArrayLike
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.typing import stringify_annotation

sys.path.insert(0, str(Path(__file__).parent.parent))
import jssa_gym  # the one beside these pages

logger = logging.getLogger(__name__)

_MATHML = "{http://www.w3.org/1998/Math/MathML}"
ElementTree.register_namespace("", _MATHML.strip("{}"))

_ALIASES = tuple(
    (stringify_annotation(kind, mode), name)
    for kind, name in ((ArrayLike, "ArrayLike"), (jssa_gym.types.Array, "Array"))
    for mode in ("fully-qualified", "smart")
)

DOCUMENTED = (
    *("certificate", "control", "envs", "evaluation", "humans", "plots", "policies", "robots", "safety", "shields"),
    *("train", "types"),
)
"""Subpackages in the reference."""


project = "jssa_gym"
author = "The jssa_gym developers"
project_copyright = "The jssa_gym developers, Apache-2.0"
version = release = jssa_gym.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

myst_heading_anchors = 4
nitpicky = True  # see `resolve` for what that means here

autodoc_member_order = "groupwise"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
python_maximum_signature_line_length = 88
add_module_names = False
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = f"jssa_gym {version}"
html_math_renderer = "mathml"
html_show_sphinx = False
html_copy_source = False
html_baseurl = ""
html_theme_options = {"source_directory": "docs/", "navigation_with_keys": True}


def mathml(formula: str, *, as_block: bool) -> str:
    """A formula as MathML, which browsers draw by themselves.

    docutils puts an index under a letter that has an accent, where it belongs behind both; and what it calls an accent
    is drawn into tall letters.
    """
    math = ElementTree.fromstring(tex2mathml(formula, as_block=as_block))
    for stack in math.iter(f"{_MATHML}munderover"):
        base, index, accent = stack
        if accent.tag == f"{_MATHML}mo":
            accented = ElementTree.Element(f"{_MATHML}mover")
            accented.extend([base, accent])
            stack.tag = f"{_MATHML}msub"
            stack[:] = [accented, index]
    for over in math.iter(f"{_MATHML}mover"):
        over.attrib.pop("accent", None)
    return ElementTree.tostring(math, encoding="unicode")


def visit_inline(self: Any, node: nodes.math) -> None:
    """A formula in the line."""
    self.body.append(mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    """A formula of its own line."""
    self.body.append(f'<div class="math">{mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def is_there(name: str) -> bool:
    """Whether a dotted name is something that can be imported."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:k]))
        except ImportError:
            continue
        return reduce(lambda at, part: getattr(at, part, None), parts[k:], thing) is not None
    return False


def resolve(app: Sphinx, env: Any, node: Any, contnode: nodes.Element) -> nodes.Element | None:
    """A name that is given by another way than the reference lists it, or that the reference does not list.

    It is linked if only one listed name ends so. What a docstring names besides, elsewhere in the package or of another
    library, stays code. A name of the package that is nowhere is a warning, which ends the build; so is one that a page
    wants linked and that is not listed, or twice.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"].lstrip(".~")
    if target.startswith("jssa_gym.") and not is_there(target):
        return None
    inside = (node.get("py:module") or "").startswith("jssa_gym")  # a docstring of the package
    of_page = "py:module" not in node or not node["py:module"]
    last = target.rpartition(".")[2]
    found = [
        (name, entry)
        for name, entry in env.get_domain("py").objects.items()
        if name.rpartition(".")[2] == last and not entry.aliased and entry.objtype != "module"
    ]
    if len(found) == 1 and (inside or of_page or target.startswith("jssa_gym.")):
        ((name, entry),) = found
        uri = f"{app.builder.get_relative_uri(node['refdoc'], entry.docname)}#{entry.node_id}"
        return nodes.reference("", "", contnode, internal=True, refuri=uri, reftitle=name)
    return None if of_page else contnode


def complete(app: Sphinx, env: Any) -> None:
    """Warn of what the package offers and the reference does not list."""
    listed = {name.rpartition(".")[2] for name in env.get_domain("py").objects}
    for module in ("jssa_gym", *(f"jssa_gym.{name}" for name in DOCUMENTED)):
        for name in getattr(importlib.import_module(module), "__all__", ()):
            if name not in listed and name != "__version__":
                logger.warning("%s.%s is not in docs/api", module, name)


def without_empty_places(app: Sphinx, docname: str, source: list[str]) -> None:
    """Leave out of a table of contents the places that are kept for pages which are not there yet."""
    folder = Path(app.srcdir, docname).parent
    lines = source[0].splitlines(keepends=True)
    source[0] = "".join(
        line for line in lines if not re.fullmatch(r"[\w/]*\*\n", line) or any(folder.glob(f"{line.strip()}.md"))
    )


def without_type(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from taking what stands before a colon for the type of an attribute: annotations say types here."""
    if what in {"attribute", "data", "property"} and lines:
        lines[:0] = ["..", ""]  # an empty comment


def short_types(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Signatures with numpy's types by the names that the code has for them."""

    def short(text: str | None) -> str | None:
        for long, alias in _ALIASES:
            text = text and text.replace(long, alias)
        return text

    return short(signature), short(returned)


class Diagram(TextLexer):
    """Diagrams are drawn where the pages are read on GitHub, and are text here."""

    name = "Mermaid"


def setup(app: Sphinx) -> None:
    """What the pages need beside the extensions."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.add_lexer("mermaid", Diagram)
    app.connect("autodoc-process-docstring", without_type, priority=400)
    app.connect("source-read", without_empty_places)
    app.connect("autodoc-process-signature", short_types)
    app.connect("env-check-consistency", complete)
    app.connect("missing-reference", resolve)
