"""Reference pages in plain Markdown, made from the code: commands, keys of studies and estimates, public names.

`scripts/reference` writes them, so that they can be read without building the site; a contract test compares.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import pkgutil
import re
import sys
import typing
from collections.abc import Iterator
from inspect import cleandoc, getdoc
from pathlib import Path
from typing import Any, ClassVar

from armid.toml_writing import toml_line

MISSING = dataclasses.MISSING

PAGES = Path(__file__).resolve().parents[1] / "reference"

MADE = "<!-- made from the code by scripts/reference; what stands below is written anew each time -->"
"""Line of a page from which on it is made."""


def pages() -> dict[Path, str]:
    """The text of every reference page by its path."""
    made = {
        PAGES / "cli.md": commands(),
        PAGES / "keys.md": study_keys(),
        PAGES / "estimate.md": estimate_keys(),
        PAGES / "python.md": names(),
    }
    return {path: f"{_head(path)}{MADE}\n\n{text.strip()}\n" for path, text in made.items()}


def _head(path: Path) -> str:
    """Return what is written by hand above the line."""
    head, found, _ = path.read_text(encoding="utf-8").partition(MADE)
    if not found:
        raise SystemExit(f"{path} has no line {MADE!r}")
    return head


def commands() -> str:
    """Every command with its arguments, options and examples, one section each, in the order of `armid --help`."""
    from typer.main import get_command

    from armid.cli.main import app

    return "\n".join(line for command in get_command(app).commands.values() for line in command_lines(command))


def study_keys() -> str:
    """Every key of a study, options of terms and methods included, one table a dataclass."""
    from armid.estimation.catalogue import ESTIMATORS
    from armid.measurement.log_format import LogFormat
    from armid.measurement.processing.options import ProcessingOptions
    from armid.model.terms import TERMS
    from armid.study.config import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice

    lines = table("[robot]", RobotChoice)
    lines += table("[model]", ModelChoice, without=("shapes", "automatic"))
    for name, term in TERMS.items():
        lines += table(f"[model.{name}]", term)
    lines += table("[[recording]]", RecordingChoice, LogFormat, without=("reading",))
    lines += table("[processing]", ProcessingOptions)
    lines += table("[estimation]", EstimationChoice, without=("options",))
    for name, method in ESTIMATORS.items():
        lines += table(f"[estimation.{name}]", method)
    return "\n".join(lines)


def estimate_keys() -> str:
    """Every key of `estimate.json`, one table for the whole and one for each list."""
    from armid.study.storage.records import BASE_PARAMETER_KEYS, ESTIMATE_KEYS

    lines: list[str] = []
    for title, keys in (("estimate.json", ESTIMATE_KEYS), ("base_parameters", BASE_PARAMETER_KEYS)):
        rows = [f"| `{key}` | {prose(cell(meaning))} |" for key, meaning in keys.items()]
        lines += [f"## `{title}`", "", "| key | meaning |", "|---|---|", *rows, ""]
    return "\n".join(lines)


def names() -> str:
    """Names of `armid` with the first lines of their docstrings, and its modules with links to their source."""
    import armid

    lines = ["## Names of `armid`", "", "| name | meaning |", "|---|---|"]
    lines += [f"| `{each}` | {_described(getattr(armid, each))} |" for each in sorted(armid.__all__)]
    lines += ["", "## Modules", "", "| module | purpose |", "|---|---|"]
    for name, own in modules("armid"):
        if own:
            module = importlib.import_module(name)
            place = Path(str(module.__file__)).relative_to(Path(str(armid.__file__)).parents[1]).as_posix()
            lines.append(f"| [`{name}`](../../src/{place}) | {prose(cell(first_line(module)))} |")
    return "\n".join(lines)


def _described(thing: Any) -> str:
    """First line of what is documented in the code; a constant has no docstring of its own."""
    own = isinstance(thing, type) or callable(thing)
    return prose(cell(first_line(thing))) if own else ""


def first_line(thing: Any) -> str:
    """First paragraph of a docstring on one line."""
    return (getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")


def modules(package: str) -> Iterator[tuple[str, list[str]]]:
    """Modules of a package with the public names that are their own, the package itself first."""
    home = importlib.import_module(package)
    found = [package]
    if hasattr(home, "__path__"):
        found += [each.name for each in pkgutil.walk_packages(home.__path__, f"{package}.")]
    for name in found:
        module = importlib.import_module(name)
        file = Path(str(module.__file__))
        own = getattr(module, "__all__", None) or (defined(file) if file.suffix == ".py" else [])
        own = [each for each in own if getattr(getattr(module, each), "__module__", name) == name]
        if own or name == package:
            yield name, own


def defined(file: Path) -> list[str]:
    """Public names that the text of a module defines."""
    body = ast.parse(file.read_text(encoding="utf-8")).body
    names = [node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    for node in body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", ast.Pass())]
        names += [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
    return [name for name in names if not name.startswith("_")]


def command_lines(command: Any) -> list[str]:
    """A command as Markdown."""
    text, _, examples = command.help.partition("Example")
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(["armid", command.name, "[OPTIONS]", *(p.metavar or p.name.upper() for p in arguments)])
    lines = [f"## `armid {command.name}`", "", prose(cleandoc(text)), "", "```text", usage, "```", ""]
    lines += ["| argument or option | meaning | default |", "|---|---|---|"]
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
    return (
        [*lines, "| key | meaning | default |", "|---|---|---|", *rows, ""]
        if rows
        else [*lines, "It has no options.", ""]
    )


def default_of(field: dataclasses.Field[Any]) -> str:
    """Return what holds where a key is not written, as TOML."""
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
    """Return what a Google docstring says of each attribute."""
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


if __name__ == "__main__":
    for place, content in pages().items():
        place.write_text(content, encoding="utf-8")
        sys.stdout.write(f"{place.relative_to(PAGES.parents[1])}\n")
