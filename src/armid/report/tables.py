"""Tables of a page, also available as LaTeX and CSV."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "\u00a0": "~",
    "−": "$-$",
    "–": "--",
    "·": r"$\cdot$",
    "…": r"\dots{}",
    "²": "$^2$",
    "σ": r"$\sigma$",
    "τ": r"$\tau$",
    "±": r"$\pm$",
    "≤": r"$\le$",
    "≥": r"$\ge$",
    "○": r"$\circ$",
    "×": r"$\times$",
    "▲": r"$\blacktriangle$",
    "▼": r"$\blacktriangledown$",
    "ḋ": r"$\dot{d}$",
    "Ṙ": r"$\dot{R}$",
    "β": r"$\beta$",
    "φ": r"$\phi$",
    "θ": r"$\theta$",
    "ψ": r"$\psi$",
    "π": r"$\pi$",
    "ω": r"$\omega$",
    "Σ": r"$\Sigma$",
    "∂": r"$\partial$",
    "§": r"\S{}",
    "†": r"$^\dagger$",
    "ᵀ": r"$^\mathrm{T}$",
    "‖": r"$\|$",
    "√": r"$\surd$",
    "→": r"$\rightarrow$",
    "∞": r"$\infty$",
    "₋": "$_-$",
    "ₗ": "$_l$",
    **{small: f"$_{letter}$" for letter, small in zip("ijnx", "ᵢⱼₙₓ", strict=True)},
    **{small: f"$_{digit}$" for digit, small in enumerate("₀₁₂₃₄₅₆₇₈₉")},
    **{small: f"$^{digit}$" for digit, small in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹") if small != "²"},
    "⁻": "$^-$",
}
"""Characters that have a special meaning in LaTeX or are missing in its text fonts, and their replacements."""

ACCENTS = {"\u0302": r"\hat", "\u0307": r"\dot", "\u0308": r"\ddot"}
"""Combining accents and their LaTeX commands."""


@dataclass(frozen=True, slots=True)
class Column:
    """Column of a table.

    Attributes:
        title: Title of the column.
        unit: Unit of the numbers, if all have the same unit.
        words: True if the column contains text, which is left-aligned.
    """

    title: str
    unit: str = ""
    words: bool = False


@dataclass(frozen=True, slots=True)
class TableCell:
    """Cell of a table.

    Attributes:
        text: Text on the page.
        value: Value for CSV, at full precision; by default the text.
        latex: Text for LaTeX; by default the escaped text.
        kind: Style: `name`, `formula`, `guessed`, `good`, `poor` or empty.
    """

    text: str
    value: float | str | None = None
    latex: str = ""
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """Table of a page.

    Attributes:
        key: Name that is unique on the page.
        caption: Caption of the table.
        columns: Columns of the table.
        rows: Cells, row by row; the first cell of a row is its head.
        note: Note with the meaning of the symbols.
        folded: True if the page shows only the caption until the reader opens it.
        groups: Group titles, for instance joints, by the index of the group's first row.
    """

    key: str
    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[TableCell]] = field(default_factory=tuple[Sequence[TableCell], ...])
    note: str = ""
    folded: bool = False
    groups: Mapping[int, str] = field(default_factory=dict[int, str])

    def csv(self) -> str:
        """Table as CSV at full precision, with units in the titles; the last value of a row is its group."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        head = [f"{column.title} [{column.unit}]" if column.unit else column.title for column in self.columns]
        writer.writerow([*head, *(["group"] if self.groups else [])])
        group: list[str] = []
        for k, row in enumerate(self.rows):
            group = [self.groups[k]] if k in self.groups else group
            writer.writerow([*(_csv(cell) for cell in row), *group])
        return stream.getvalue()

    def latex(self) -> str:
        """Table as a LaTeX `tabular` with rules of booktabs."""
        head = [latex_text(f"{c.title} [{c.unit}]" if c.unit else c.title) for c in self.columns]
        rows: list[str] = []
        for k, row in enumerate(self.rows):
            if k in self.groups:
                rows.append(rf"\multicolumn{{{len(head)}}}{{l}}{{{latex_text(self.groups[k])}}} \\")
            rows.append(" & ".join(cell.latex or latex_text(cell.text) for cell in row) + r" \\")
        lines = [
            rf"\begin{{tabular}}{{{''.join('l' if column.words else 'r' for column in self.columns)}}}",
            r"\toprule",
            " & ".join(head) + r" \\",
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
        ]
        return "\n".join(lines) + "\n"


def latex_text(text: str) -> str:
    """Text for LaTeX, in which special characters are escaped."""
    parts = re.split(r"(.[\u0302\u0307\u0308])", text)
    return "".join(
        rf"${ACCENTS[part[1]]}{{{LATEX.get(part[0], part[0]).strip('$')}}}$"
        if len(part) == 2 and part[1] in ACCENTS
        else "".join(LATEX.get(letter, letter) for letter in part)
        for part in parts
    )


def _csv(cell: TableCell) -> str:
    value = cell.text if cell.value is None else cell.value
    return value if isinstance(value, str) else repr(float(value))
