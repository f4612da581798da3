"""Elements of a chapter of the page on the thesis: paragraphs, lists, key numbers, tables and figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from armid.model.parameter_name import ParameterName
from armid.report.plots.plot_specification import Plot
from armid.report.section import Section
from armid.report.tables import Table, TableCell


@dataclass(frozen=True, slots=True)
class Text:
    """Paragraph of HTML; it contains no text from users or files.

    Attributes:
        html: Text of the paragraph.
    """

    html: str
    kind: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class List:
    """Bulleted list in HTML.

    Attributes:
        items: Texts of the points of the list.
    """

    items: Sequence[str]
    kind: ClassVar[str] = "list"


@dataclass(frozen=True, slots=True)
class Numbers:
    """Key numbers in large type.

    Attributes:
        items: Number, unit and description of each key number.
    """

    items: Sequence[tuple[str, str, str]]
    kind: ClassVar[str] = "numbers"


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures side by side.

    Attributes:
        heading: Common heading of the figures.
        plots: The figures.
        columns: Number of figures side by side on a wide screen.
        legend: Role and description of each trace.
    """

    heading: str
    plots: Sequence[Plot]
    columns: int
    legend: Sequence[tuple[str, str]] = ()
    kind: ClassVar[str] = "figures"


@dataclass(frozen=True, slots=True)
class Equation:
    """Equation in MathML.

    Attributes:
        mathml: Content of the element `math`.
        number: Number of the equation in the thesis.
    """

    mathml: str
    number: str
    kind: ClassVar[str] = "equation"


@dataclass(frozen=True, slots=True)
class Drawings:
    """Drawings side by side.

    Attributes:
        heading: Common heading of the drawings.
        items: SVG and caption of each drawing.
    """

    heading: str
    items: Sequence[tuple[str, str]]
    kind: ClassVar[str] = "drawings"


Block = Text | List | Numbers | Equation | Drawings | Figures | Table


def chapter(title: str, *blocks: Block) -> Section:
    """Section of the page with a title and elements in reading order."""
    tables = tuple(block for block in blocks if isinstance(block, Table))
    figures = tuple((block.heading, tuple(block.plots)) for block in blocks if isinstance(block, Figures))
    shown = [("table", block) if isinstance(block, Table) else (block.kind, block) for block in blocks]
    return Section(title, {"blocks": shown}, tables, figures, template="chapter")


SMALL = str.maketrans("0123456789ijlnx−", "₀₁₂₃₄₅₆₇₈₉ᵢⱼₗₙₓ₋")
"""Translation table from characters to their subscript forms; before all other characters the underscore is kept."""


def subscripts(text: str) -> str:
    """Replaces underscores by subscripts: `MY_2` by MY₂, `d_3` by d₃, `β_i` by βᵢ, `M_{n−2}` by Mₙ₋₂."""
    return re.sub(
        r"_(?:(\d+|[ijlnx](?![A-Za-z]))|\{([\dn−]+)\})", lambda found: (found[1] or found[2]).translate(SMALL), text
    )


def counted(number: int, what: str) -> str:
    """Text of a number with a noun in singular or plural, for instance `1 seed` or `2 seeds`."""
    return f"{number} {what}" + ("" if number == 1 else "s")


def named(name: str) -> TableCell:
    """Table cell with the name of a parameter as armid or the thesis writes it."""
    parts = ParameterName.read(name)
    symbol = parts.symbol + "R" * parts.grouped
    return TableCell(subscripts(name), name, rf"$\mathrm{{{symbol}}}_{{{parts.number}}}$")


def number(value: float, text: str, kind: str = "") -> TableCell:
    """Table cell with a number; the page shows `text`, and the CSV file has the number in full precision."""
    return TableCell(text, float(value), kind=kind)
