"""Layout of the kept columns of each joint's rows, and the positions of the terms' columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.kernel.tree import Tree


@dataclass(frozen=True, eq=False, slots=True)
class ColumnLayout:
    """Columns of each joint's rows, which depend on the links that the joint carries and on its own terms.

    Joint j has columns `offset[j]` to `offset[j + 1] - 1`; the last of them is the torque, the others belong to
    `parameters[j]`, in ascending order.

    Attributes:
        offset: First column of each joint, shape (n + 1,).
        target: Column within the joint's own, for each pair of link i and joint j that carries it (links in order,
            joints from the base) and each of the ten parameters, shape (10 pairs,); -1 where the column is not kept;
            empty without rigid bodies.
        term: Column of each row of the terms, shape (e,).
        kept: Kept rows of the model's term columns, shape (e,).
        parameters: Chosen parameters of each joint's columns.
    """

    offset: NDArray[np.int32]
    target: NDArray[np.int32]
    term: NDArray[np.int32]
    kept: NDArray[np.int32]
    parameters: tuple[NDArray[np.int32], ...]

    @property
    def columns(self) -> int:
        """Number of columns of all joints together, torques included."""
        return int(self.offset[-1])

    @property
    def parameter(self) -> NDArray[np.int32]:
        """Chosen parameter of every column, 0 for torques, shape (columns,)."""
        torque = np.zeros(1, dtype=np.int32)
        return np.concatenate([part for own in self.parameters for part in (own, torque)])

    @property
    def widths(self) -> NDArray[np.int32]:
        """Number of columns of each joint, torque included, shape (n,)."""
        return np.diff(self.offset)


def make_layout(
    tree: Tree,
    inertial: NDArray[np.integer],
    term_joint: NDArray[np.integer],
    term_parameter: NDArray[np.integer],
) -> ColumnLayout:
    """Layout of the columns of chosen parameters.

    Args:
        tree: The arm.
        inertial: Number of the chosen parameter for each of the 10 n inertial parameters, shape (10 n,); -1 where it
            is not chosen; empty without rigid bodies.
        term_joint: Joint of each row of the terms' columns, shape (e,).
        term_parameter: Number of the chosen parameter of each row of the terms' columns, -1 where it is not chosen.
    """
    carried = [tree.subtree(j) for j in range(tree.n)]
    parameters = [_of_joint(j, carried[j], inertial, term_joint, term_parameter) for j in range(tree.n)]
    offset = np.concatenate([[0], np.cumsum([len(p) + 1 for p in parameters])]).astype(np.int32)
    target: list[int] = []
    for i in range(tree.n) if len(inertial) else ():
        for j in tree.ancestors(i):
            own = inertial[10 * i : 10 * i + 10]
            target += [int(np.searchsorted(parameters[j], x)) if x >= 0 else -1 for x in own]
    kept = np.flatnonzero(np.asarray(term_parameter) >= 0)
    term = [offset[term_joint[e]] + np.searchsorted(parameters[term_joint[e]], term_parameter[e]) for e in kept]
    return ColumnLayout(
        offset,
        np.array(target, dtype=np.int32),
        np.array(term, dtype=np.int32),
        kept.astype(np.int32),
        tuple(parameters),
    )


def _of_joint(
    j: int,
    carried: Sequence[int],
    inertial: NDArray[np.integer],
    term_joint: NDArray[np.integer],
    term_parameter: NDArray[np.integer],
) -> NDArray[np.int32]:
    """Chosen parameters that the rows of joint j depend on, ascending."""
    chosen = {int(x) for x, at in zip(term_parameter, term_joint, strict=True) if at == j and x >= 0}
    for i in carried if len(inertial) else ():
        chosen |= {int(x) for x in inertial[10 * i : 10 * i + 10] if x >= 0}
    return np.array(sorted(chosen), dtype=np.int32)
