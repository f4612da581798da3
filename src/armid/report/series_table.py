"""Table of the Fourier coefficients of a planned motion, in the form of the thesis's Tables A.1 and A.2."""

from __future__ import annotations

from collections.abc import Callable

from armid.excitation.fourier import Excitation
from armid.report.data.number_format import fixed
from armid.report.tables import Column, Table, TableCell

DIGITS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")

SERIES = "q = q₀ + Σ aₗ / (ω l) sin(ω l t) − bₗ / (ω l) cos(ω l t)"


def coefficient_table(
    key: str,
    caption: str,
    plan: Excitation,
    note: str = "",
    *,
    unit: str = "rad/s",
    text: Callable[[float], str] = lambda value: fixed(value, 5),
    offsets: bool = False,
    folded: bool = False,
) -> Table:
    """Table of Fourier coefficients [Halper2024, Tables A.1 and A.2].

    Each a_l and b_l is a row, and each joint a column.

    Args:
        key: Name that is unique on the page.
        caption: Caption of the table.
        plan: The motion.
        note: Further sentences below the table.
        unit: Unit of the coefficients.
        text: Function that returns the text of a value.
        offsets: True if the positions q₀ about which the joints move are the first row.
        folded: True if the page shows only the caption until the reader opens it.
    """
    columns = [Column(" ", words=True), *(Column(f"q{j + 1}".translate(DIGITS)) for j in range(plan.n))]
    rows = [
        [TableCell(f"{letter}{k + 1}".translate(DIGITS), f"{letter}_{k + 1}", f"${letter}_{{{k + 1}}}$"),
         *(TableCell(text(float(x)), float(x)) for x in values[:, k])]
        for letter, values in (("a", plan.a), ("b", plan.b))
        for k in range(plan.harmonics)
    ]  # fmt: skip
    if offsets:
        first = TableCell("q₀", "q_0", "$q_0$")
        rows.insert(0, [first, *(TableCell(text(float(x)), float(x)) for x in plan.offset)])
    series = SERIES if offsets else SERIES.replace("q₀ + ", "")
    first = f"In {unit}, for {plan.period:g} s: {series}."
    return Table(key, caption, columns, rows, f"{first} {note}".strip(), folded=folded)
