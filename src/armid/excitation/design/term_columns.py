"""Regressor columns of all torque terms except rigid bodies along a motion, and their gradients.

Columns with the same law are evaluated together. Common subexpressions of a law and its derivatives are computed
once; for instance, tanh(x/w) and its derivative need only one tanh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ModelError
from armid.excitation.design.load_torque import LoadTorque
from armid.excitation.design.smoothed_laws import smoothed
from armid.information.base_regressor_layout import ColumnSource
from armid.model.torque_law_expression import FUNCTIONS, Expression, derivative

STATES = ("q", "dq", "ddq", "load")


class _ExpressionProgram:
    """Evaluation of several expressions of the states that computes each common subexpression once.

    Args:
        expressions: The expressions.
        given: Symbols that the expressions may contain.
    """

    def __init__(self, expressions: Sequence[Expression], given: Sequence[str] = STATES) -> None:
        self._given = given
        self._known: dict[Expression, int] = {}
        self._steps: list[tuple[str, tuple[int, ...]]] = []
        self._constants: list[Array | None] = []
        self._wanted = [self._add(expression) for expression in expressions]
        self.states = frozenset(name for name, inputs in self._steps if name in STATES and not inputs)

    def _add(self, expression: Expression) -> int:
        if expression in self._known:
            return self._known[expression]
        inputs = tuple(self._add(argument) for argument in expression.arguments)
        number = isinstance(expression.head, float)
        if not number and not inputs and expression.head not in self._given:
            raise ModelError(
                f"A torque law of the model depends on {expression.head!r}, but only the motion is known in a "
                "design.",
                remedy="leave this term out of the model, or use laws of position, velocity and acceleration only.",
            )
        self._steps.append(("" if number else str(expression.head), inputs))
        self._constants.append(np.asarray(expression.head) if number else None)
        self._known[expression] = len(self._steps) - 1
        return len(self._steps) - 1

    def __call__(self, states: dict[str, Array]) -> list[Array]:
        """Values of the expressions, one array for each, for given arrays of the states (by symbol)."""
        values: list[Array] = []
        for (name, inputs), constant in zip(self._steps, self._constants, strict=True):
            if constant is not None:
                values.append(constant)
            elif inputs:
                values.append(FUNCTIONS[name].value(*(values[k] for k in inputs)))
            else:
                values.append(states[name])
        return [values[k] for k in self._wanted]


@dataclass(frozen=True, eq=False, slots=True)
class _Group:
    """Rows of the torque terms that have the same law.

    Attributes:
        rows: Indices of the group's rows among the rows of all terms, shape (e,).
        coordinate: Weights of the joint positions in the coordinate of each row, shape (e, n): the coordinate is
            their weighted sum.
        joints: Index of the joint of each row, shape (e,); `None` if a coordinate combines several joints.
        weight: Factor of each row, shape (e, 1).
        slopes: Indices in `STATES` of the states on which the law depends.
        steps: Program that evaluates the smoothed law and its derivatives by these states.
    """

    rows: NDArray[np.intp]
    coordinate: Array
    joints: NDArray[np.intp] | None
    weight: Array
    slopes: tuple[int, ...]
    steps: _ExpressionProgram


def _groups(source: ColumnSource, width: float) -> tuple[_Group, ...]:
    """Groups the rows of the terms that the layout contains by their law."""
    by_law: dict[Expression, list[int]] = {}
    entries = [source.model.entries[e] for e in source.layout.kept]
    for row, (_, _, law, _) in enumerate(entries):
        by_law.setdefault(law.expression, []).append(row)
    given = STATES if source.model.load_parameters is not None else STATES[:3]
    groups: list[_Group] = []
    for expression, rows in by_law.items():
        law = smoothed(expression, width)
        slopes = {k: derivative(law, state) for k, state in enumerate(STATES)}
        slopes = {k: slope for k, slope in slopes.items() if slope != Expression(0.0)}
        coordinate = np.zeros((len(rows), source.model.n))
        for at, row in enumerate(rows):
            for j, weight in entries[row][2].coordinate:
                coordinate[at, j] = weight
        plain = bool((np.count_nonzero(coordinate, axis=1) == 1).all() and (coordinate.max(axis=1) == 1.0).all())
        groups.append(
            _Group(
                np.array(rows),
                coordinate,
                coordinate.argmax(axis=1) if plain else None,
                np.array([[entries[row][3]] for row in rows]),
                tuple(slopes),
                _ExpressionProgram([law, *slopes.values()], given),
            )
        )
    return tuple(groups)


class TermRows:
    """Regressor columns of the torque terms of a model, as rows (e, N), at the states of the last call of `fill`.

    Args:
        source: Model and layout of the columns.
        width: Width over which laws with corners are smoothed [rad/s or m/s]; if 0, they are not smoothed.
    """

    def __init__(self, source: ColumnSource, width: float) -> None:
        self._groups = _groups(source, width)
        self._slopes: list[list[Array]] = []
        loaded = any("load" in group.steps.states for group in self._groups)
        self._load = LoadTorque(source.model) if loaded else None

    def fill(self, states: tuple[Array, Array, Array], rows: Array) -> None:
        """Computes the rows (e, N) and their derivatives at states q, dq, ddq, (N, n) each.

        The rows are written to `rows`; the derivatives are stored for `pullback`.
        """
        self._slopes = []
        values_of_all = states if self._load is None else (*states, self._load.fill(states))
        for group in self._groups:
            environment: dict[str, Array] = {}
            for name, x in zip(STATES, values_of_all, strict=False):
                if name in group.steps.states:
                    environment[name] = x.T[group.joints] if group.joints is not None else group.coordinate @ x.T
            values, *slopes = group.steps(environment)
            rows[group.rows] = group.weight * values
            self._slopes.append(slopes)

    def pullback(self, adjoint: Array, gradient: tuple[Array, ...]) -> None:
        """Adds the gradient of the sum of adjoint times rows, (e, N) each, to the gradients by the states.

        `gradient` contains the gradients by q, dq and ddq, (N, n) each.
        """
        by_load = np.zeros_like(gradient[0])
        by_state = (*gradient, by_load)
        for group, slopes in zip(self._groups, self._slopes, strict=True):
            weighted = group.weight * adjoint[group.rows]
            for k, slope in zip(group.slopes, slopes, strict=True):
                by_state[k][:] += (weighted * slope).T @ group.coordinate
        if self._load is not None:
            self._load.pullback(by_load, gradient)
