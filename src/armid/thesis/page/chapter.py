"""A chapter of the thesis's page: paragraphs, tables and figures in the order in which they are read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from armid.report.plots.traces import Plot
from armid.report.section import Section
from armid.report.tables import Table, TableCell

__all__ = ["Block", "Figures", "List", "Numbers", "Text", "chapter", "counted", "named", "number", "subscripts"]


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph, in HTML; nothing in it comes from outside the program.

    Attributes:
        html: The paragraph.
    """

    html: str
    kind: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class List:
    """Points, in HTML.

    Attributes:
        items: The points.
    """

    items: Sequence[str]
    kind: ClassVar[str] = "list"


@dataclass(frozen=True, slots=True)
class Numbers:
    """A few numbers that stand for the whole, large.

    Attributes:
        items: Number, unit and what it is.
    """

    items: Sequence[tuple[str, str, str]]
    kind: ClassVar[str] = "numbers"


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures side by side.

    Attributes:
        heading: What they are together.
        plots: The figures.
        columns: How many stand side by side on a wide screen.
        legend: Roles of the traces, and what they are.
    """

    heading: str
    plots: Sequence[Plot]
    columns: int
    legend: Sequence[tuple[str, str]] = ()
    kind: ClassVar[str] = "figures"


Block = Text | List | Numbers | Figures | Table


def chapter(title: str, *blocks: Block) -> Section:
    """The section that the template `chapter` shows."""
    tables = tuple(block for block in blocks if isinstance(block, Table))
    figures = tuple((block.heading, tuple(block.plots)) for block in blocks if isinstance(block, Figures))
    shown = [("table", block) if isinstance(block, Table) else (block.kind, block) for block in blocks]
    return Section(title, {"blocks": shown}, tables, figures, template="chapter")


SMALL = str.maketrans("0123456789ijlnx−", "₀₁₂₃₄₅₆₇₈₉ᵢⱼₗₙₓ₋")
"""Letters that have a small form below the line; others keep their underscore."""


def subscripts(text: str) -> str:
    """`MY_2` as MY₂, `d_3` as d₃, `β_i` as βᵢ, `M_{n−2}` as Mₙ₋₂."""
    return re.sub(
        r"_(?:(\d+|[ijlnx](?![A-Za-z]))|\{([\dn−]+)\})", lambda found: (found[1] or found[2]).translate(SMALL), text
    )


def counted(number: int, what: str) -> str:
    """`1 seed`, `2 seeds`."""
    return f"{number} {what}" + ("" if number == 1 else "s")


def named(name: str) -> TableCell:
    """A parameter's name."""
    symbol, _, index = name.rpartition("_")
    return TableCell(subscripts(name), name, rf"$\mathrm{{{symbol}}}_{{{index}}}$")


def number(value: float, text: str, kind: str = "") -> TableCell:
    """A number with its text; the full one goes into CSV."""
    return TableCell(text, float(value), kind=kind)
