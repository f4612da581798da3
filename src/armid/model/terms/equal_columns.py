"""Regressor columns of torque terms with the same expression, whose values are computed together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.model.terms.term import Law
from armid.model.torque_law_expression import Expression, symbols


@dataclass(frozen=True, eq=False, slots=True)
class EqualColumns:
    """Columns of one expression on several joints, or of one law.

    Attributes:
        entries: Indices of the columns among all columns, shape (g,).
        joints: Joint on whose torque each column acts, shape (g,).
        expression: Expression of their laws.
        symbols: Symbols in this expression.
        law: The law if it depends on a combination of joints or has hysteresis; `None` for laws of single joints,
            whose symbols are those of the joints of the columns.
    """

    entries: NDArray[np.intp]
    joints: NDArray[np.intp]
    expression: Expression
    symbols: frozenset[str]
    law: Law | None


def equal_columns(columns: Sequence[tuple[int, Law]]) -> tuple[EqualColumns, ...]:
    """Groups of columns of which each has the same expression, or the same law.

    Args:
        columns: Joint and law of each column.
    """
    of_expressions: dict[Expression, list[int]] = {}
    of_laws: dict[int, list[int]] = {}
    for e, (_, law) in enumerate(columns):
        if law.coordinate == ((law.joint, 1.0),) and law.memory is None:
            of_expressions.setdefault(law.expression, []).append(e)
        else:
            of_laws.setdefault(id(law), []).append(e)
    joint = np.array([j for j, _ in columns], dtype=np.intp)
    groups = [(entries, None) for entries in of_expressions.values()]
    groups += [(entries, columns[entries[0]][1]) for entries in of_laws.values()]
    result: list[EqualColumns] = []
    for entries, law in groups:
        expression = columns[entries[0]][1].expression
        result.append(EqualColumns(np.array(entries), joint[entries], expression, symbols(expression), law))
    return tuple(result)
