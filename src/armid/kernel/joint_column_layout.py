"""Layout of the regressor columns that are kept for each joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.kernel.tree import Tree


@dataclass(frozen=True, eq=False, slots=True)
class ColumnLayout:
    """Layout of the regressor columns of each joint: links that it carries, its torque terms, and last its torque.

    Joint j has columns `offset[j]` to `offset[j + 1] - 1`. The last of these columns is the torque; the others are
    the regressor columns of `parameters[j]`, in ascending order.

    Attributes:
        offset: First column of each joint, and the number of all columns, shape (n + 1,).
        target: Column, counted from the first column of joint j, of each inertial parameter of link i, for all pairs
            of a link i and a joint j that carries link i (links in order, joints from the base). Shape (10 pairs,);
            -1 if the column is not kept; empty without rigid bodies.
        term: Index of the column of each of the e kept regressor columns of the torque terms, shape (e,).
        kept: Indices of these e columns among all columns of the torque terms of the model, shape (e,).
        parameters: Indices of the chosen parameters that the torque of each joint depends on, one array for each
            joint.
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
        """Index of the chosen parameter to which each column belongs, shape (columns,); 0 for torques."""
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
    """Layout of the regressor columns of chosen parameters, for instance of the base parameters of a model.

    Args:
        tree: The arm.
        inertial: Index among the chosen parameters of each of the 10 n inertial parameters, shape (10 n,); -1 if it
            is not chosen; empty without rigid bodies.
        term_joint: Joint of each regressor column of the torque terms, shape (e,).
        term_parameter: Index among the chosen parameters of each of these columns, -1 if it is not chosen, shape
            (e,).
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
    """Indices of the chosen parameters that the torque of joint j depends on, ascending."""
    chosen = {int(x) for x, at in zip(term_parameter, term_joint, strict=True) if at == j and x >= 0}
    for i in carried if len(inertial) else ():
        chosen |= {int(x) for x in inertial[10 * i : 10 * i + 10] if x >= 0}
    return np.array(sorted(chosen), dtype=np.int32)
