"""Directives whose content is made from the code when the site is built, so that no page can say something else.

`{modules} armid.model` documents the public names of a package in full. The pages of commands and keys are plain
Markdown (`reference.py`). Equations become MathML, which browsers draw without a script.
"""

from __future__ import annotations

import ast
import re
import tomllib
from abc import ABC, abstractmethod
from contextlib import suppress
from inspect import cleandoc
from typing import Any

import latex2mathml.converter
from docutils import nodes
from docutils.statemachine import StringList
from reference import modules
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

INDENT = "    "

ARRAY = "numpy.ndarray[tuple[Any, ...], numpy.dtype[numpy.float64]]"
"""`armid.checked_array.Array`, spelled out."""


class Made(SphinxDirective, ABC):
    """Markdown that is made here and parsed as if it stood on the page."""

    has_content = False

    @abstractmethod
    def markdown(self) -> str:
        """Return what the page is to say."""

    def run(self) -> list[nodes.Node]:
        """The parsed Markdown, headings included."""
        self.content = StringList(self.markdown().splitlines(), source=type(self).__name__)
        return self.parse_content_to_nodes(allow_section_headings=True)


class Modules(Made):
    """The public names of a package, module by module, by way of autodoc."""

    required_arguments = 1

    def markdown(self) -> str:
        """One section a module that has public names of its own."""
        lines: list[str] = []
        for name, own in modules(self.arguments[0]):
            members = f"   :members: {', '.join(own)}" if own else "   :no-members:"
            lines += [f"## `{name}`", "", "```{eval-rst}", f".. automodule:: {name}", members, "```", ""]
        return "\n".join(lines)


def plain_rst(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with names in backticks; what reStructuredText would make of the rest is undone.

    What a module indents is code or an equation; elsewhere sections are indented.
    """
    told: list[str] = []
    for block in blocks(lines) if what == "module" else [lines]:
        if block[0].startswith(INDENT):
            told += [f".. code-block:: {language_of(block)}", "", *block]
        else:
            told += [plain(line) for line in block]
    lines[:] = told


def blocks(lines: list[str]) -> list[list[str]]:
    """Lines in turn as prose and as what is indented, blank lines in between being of what came before."""
    found: list[list[str]] = []
    for line in lines:
        if not found or (line and line.startswith(INDENT) != found[-1][0].startswith(INDENT)):
            found.append([])
        found[-1].append(line)
    return found


def language_of(block: list[str]) -> str:
    """Return what a block of code is written in, as far as it can be parsed."""
    for language, parse in (("toml", tomllib.loads), ("python", ast.parse)):
        with suppress(ValueError, SyntaxError):
            parse(cleandoc("\n".join(block)))
            return language
    return "text"


def plain(line: str) -> str:
    """A line of prose that shows its characters; names in backticks stay code."""
    parts = re.split(r"(`[^`]*`)", line)
    return "".join(p if p.startswith("`") else re.sub(r"([*|]|(?<=\w)_(?!\w))", r"\\\1", p) for p in parts)


def short_types(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Types of attributes as the code writes them; a name that ends in `_` would be a link."""
    lines[:] = [line.replace(ARRAY, "Array").replace("np.bool_", "bool") for line in lines]


def short_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str | None, result: str | None
) -> tuple[str | None, str | None]:
    """Aliases inside other types by their names."""

    def short(text: str | None) -> str | None:
        return text and re.sub(r"~?(?:[\w.]*\.)?TypeAliasForwardRef\('(\w+)'\)", r"\1", text)

    return short(signature), short(result)


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(latex2mathml.converter.convert(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    number = node.get("number")
    label = f'<span class="eqno">({number})</span>' if number else ""
    mathml = latex2mathml.converter.convert(node.astext(), display="block")
    writer.body.append(f'<div class="math"{_identity(node)}>{label}{mathml}</div>')
    raise nodes.SkipNode


def _identity(node: nodes.math_block) -> str:
    return f' id="{node["ids"][0]}"' if node.get("ids") else ""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register everything."""
    app.add_directive("modules", Modules)
    app.connect("autodoc-process-signature", short_signature)
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    app.connect("autodoc-process-docstring", plain_rst, priority=400)
    app.connect("autodoc-process-docstring", short_types, priority=600)  # after napoleon, which writes them
    return {"parallel_read_safe": True, "parallel_write_safe": True}
