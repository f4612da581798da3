"""Directives whose content is made from the code when the site is built, so that no page can say something else.

`{commands}` lists the command line, `{study-keys}` the keys of a study, `{modules} armid.model` the public names of a
package. Equations become MathML, which browsers draw without a script.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import pkgutil
import re
import tomllib
import typing
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import suppress
from inspect import cleandoc, getdoc
from typing import Any, ClassVar

import latex2mathml.converter
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from armid.toml import toml_line

MISSING = dataclasses.MISSING

INDENT = "    "

ARRAY = "numpy.ndarray[tuple[Any, ...], numpy.dtype[numpy.float64]]"
"""`armid.values.Array`, spelled out."""


class Made(SphinxDirective, ABC):
    """Markdown that is made here and parsed as if it stood on the page."""

    has_content = False

    @abstractmethod
    def markdown(self) -> str:
        """What the page is to say."""

    def run(self) -> list[nodes.Node]:
        """The parsed Markdown, headings included."""
        self.content = StringList(self.markdown().splitlines(), source=type(self).__name__)
        return self.parse_content_to_nodes(allow_section_headings=True)


class Commands(Made):
    """Every command with its arguments, options and examples."""

    def markdown(self) -> str:
        """One section a command, in the order of `armid --help`."""
        from typer.main import get_command

        from armid.cli.main import app

        return "\n".join(line for command in get_command(app).commands.values() for line in command_lines(command))


class StudyKeys(Made):
    """Every key of a study, options of terms and methods included."""

    def markdown(self) -> str:
        """One table a dataclass."""
        from armid.estimation.estimators import ESTIMATORS
        from armid.measurement.processing import Processing
        from armid.measurement.reading import Reading
        from armid.model.terms import TERMS
        from armid.study.study import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice

        lines = table("[robot]", RobotChoice)
        lines += table("[model]", ModelChoice, without=("shapes", "automatic"))
        for name, term in TERMS.items():
            lines += table(f"[model.{name}]", term)
        lines += table("[[recording]]", RecordingChoice, Reading, without=("reading",))
        lines += table("[processing]", Processing)
        lines += table("[estimation]", EstimationChoice, without=("options",))
        for name, method in ESTIMATORS.items():
            lines += table(f"[estimation.{name}]", method)
        return "\n".join(lines)


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


def modules(package: str) -> Iterator[tuple[str, list[str]]]:
    """Modules of a package with the public names that are their own, the package itself first."""
    home = importlib.import_module(package)
    found = [package]
    if hasattr(home, "__path__"):
        found += [each.name for each in pkgutil.walk_packages(home.__path__, f"{package}.")]
    for name in found:
        module = importlib.import_module(name)
        own = [each for each in getattr(module, "__all__", ()) if _home(module, each) == name]
        if own or name == package:
            yield name, own


def _home(module: Any, name: str) -> str:
    """The module that defines a name; constants count as their module's own."""
    return getattr(getattr(module, name), "__module__", module.__name__)


def command_lines(command: Any) -> list[str]:
    """A command as Markdown."""
    text, _, examples = command.help.partition("Example")
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(["armid", command.name, "[OPTIONS]", *(p.metavar or p.name.upper() for p in arguments)])
    lines = [f"## `armid {command.name}`", "", prose(cleandoc(text)), "", "```text", usage, "```", ""]
    lines += ["| | | default |", "|---|---|---|"]
    for each in command.params:
        if each.name != "help":
            names = ", ".join(f"`{name}`" for name in each.opts) if each not in arguments else ""
            shown = " ".join(part for part in (names, f"`{cell(each.metavar)}`" if each.metavar else "") if part)
            default = "" if each.default in (None, False, ()) else f"`{cell(str(each.default))}`"
            lines.append(f"| {shown or f'`{each.name.upper()}`'} | {prose(cell(each.help or ''))} | {default} |")
    shown = [line.strip() for line in examples.splitlines()[1:] if line.strip()]
    return [*lines, "", "```text", *shown, "```", ""] if shown else [*lines, ""]


def table(title: str, *kinds: type, without: tuple[str, ...] = ()) -> list[str]:
    """Fields of dataclasses as a table of keys, types, defaults and what their docstrings say."""
    lines = [f"## `{title}`", ""]
    rows: list[str] = []
    for kind in kinds:
        said = attributes(getdoc(kind) or "")
        hints = typing.get_type_hints(kind)
        for field in dataclasses.fields(kind):
            if field.name not in without and typing.get_origin(hints[field.name]) is not ClassVar:
                # TOML has no word for nothing.
                what = prose(cell(said.get(field.name, "").replace("`None`", "left out")))
                rows.append(f"| `{field.name}` | {what} | {default_of(field)} |")
    summary = (getdoc(kinds[0]) or "").split("\n\n")[0].replace("\n", " ")
    lines += [prose(summary), ""]
    return [*lines, "| key | | default |", "|---|---|---|", *rows, ""] if rows else [*lines, "It has no options.", ""]


def default_of(field: dataclasses.Field[Any]) -> str:
    """What holds where a key is not written, as TOML."""
    if field.default is MISSING and field.default_factory is MISSING:
        return "*needed*"
    value = field.default if field.default is not MISSING else field.default_factory()  # pyright: ignore
    if value is None or value in ((), {}):
        return ""
    if isinstance(value, str | bool | int | float | tuple):
        plain_value = list(value) if isinstance(value, tuple) else value
        return f"`{cell(toml_line('key', plain_value).removeprefix('key = '))}`"
    return ""


def attributes(docstring: str) -> dict[str, str]:
    """What a Google docstring says of each attribute."""
    found = re.search(r"^Attributes:\n((?:[ ]{4}.*\n?|\n)*)", docstring, re.MULTILINE)
    said: dict[str, str] = {}
    for part in re.split(r"^ {4}(?=\w+:)", found[1] if found else "", flags=re.MULTILINE):
        name, colon, text = part.partition(":")
        if colon:
            said[name.strip()] = " ".join(text.split())
    return said


def prose(text: str) -> str:
    """Text as Markdown that shows its characters: only single backticks keep a meaning."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([*_<\[\]|{}$])", r"\\\1", part) for part in parts)


def cell(text: str) -> str:
    """Text within a table's cell."""
    return text.replace("\n", " ").replace("|", "ǀ")


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
    """What a block of code is written in, as far as it can be parsed."""
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
    app.add_directive("commands", Commands)
    app.add_directive("study-keys", StudyKeys)
    app.add_directive("modules", Modules)
    app.connect("autodoc-process-signature", short_signature)
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    app.connect("autodoc-process-docstring", plain_rst, priority=400)
    app.connect("autodoc-process-docstring", short_types, priority=600)  # after napoleon, which writes them
    return {"parallel_read_safe": True, "parallel_write_safe": True}
