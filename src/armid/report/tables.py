"""Tables of a page, which are also copied as LaTeX and as CSV."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

__all__ = ["Column", "Table", "TableCell", "latex_text"]

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
"""What LaTeX reads as something else, or does not have in a text font."""

ACCENTS = {"\u0302": r"\hat", "\u0307": r"\dot", "\u0308": r"\ddot"}
"""Marks above a letter."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column.

    Attributes:
        title: Its head.
        unit: Unit of its numbers, where all have the same.
        words: Whether it holds words, which stand to the left.
    """

    title: str
    unit: str = ""
    words: bool = False


@dataclass(frozen=True, slots=True)
class TableCell:
    """One cell.

    Attributes:
        text: What the page shows.
        value: What CSV gets, at full precision; the text where there is none.
        latex: What LaTeX gets; the text, made safe, where there is none.
        kind: How it is shown: `name`, `formula`, `guessed`, `good`, `poor` or nothing.
    """

    text: str
    value: float | str | None = None
    latex: str = ""
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table.

    Attributes:
        key: Name of it that no other table of the page has.
        caption: What it shows.
        columns: Its columns.
        rows: Cells, row by row; the first of a row is its head.
        note: What signs in it mean.
        folded: Whether a page shows its caption alone until it is opened.
        groups: What the rows from an index on belong to, for instance a joint.
    """

    key: str
    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[TableCell]] = field(default_factory=tuple[Sequence[TableCell], ...])
    note: str = ""
    folded: bool = False
    groups: Mapping[int, str] = field(default_factory=dict[int, str])

    def csv(self) -> str:
        """Comma-separated values at full precision, units in the head; the group of a row is its last value."""
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
        """A tabular with the rules of booktabs."""
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
    """Text with what LaTeX would read as commands made safe."""
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
