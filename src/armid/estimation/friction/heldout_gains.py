"""Held-out gains of candidate columns, from products of the factors, stretch of blocks by stretch of blocks.

With G_f = Σ_j w_j² R_jᵀ R_j over a stretch f that is left out, T_f the same over what trains, and Λ the prior, the
columns that the model has are eliminated, and what remains of a candidate's columns c is a small problem:

    x = (S_cc + κ diag T_cc)⁻¹ S_cy,        gain = 2 xᵀ M_cy - xᵀ M_cc x,

on the rows of its joint, and on those of all. S and M are what T_f and G_f leave after the elimination. That is made
either from T_f alone, so that all parameters are estimated without the stretch, or from all of the data, so that only
the candidate's are. The second way is far more certain where bodies have many parameters and recordings are short;
the first alone tells what imitates gravity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.estimation.crossvalidation import held_out_squares, training_information
from armid.information.information import Information, select
from armid.values import Array

__all__ = ["GainPrior", "HeldOutFolds", "Reduced", "make_folds"]

ROUNDING = 1e-11
"""Added to the diagonal of products with columns of unit length: their rounding is ε times the square of a condition
number of a few hundred, and columns that depend on each other must not divide by zero."""


@dataclass(frozen=True, eq=False, slots=True)
class GainPrior:
    """A Gaussian prior on all parameters of the superset.

    Attributes:
        mean: Shape (b,).
        precision: Zero where nothing is believed, shape (b, b).
    """

    mean: Array
    precision: Array

    @property
    def products(self) -> Array:
        """As if it were rows of data, shape (b + 1, b + 1)."""
        half = self.precision @ self.mean
        return np.block([[self.precision, half[:, None]], [half[None], np.array([[half @ self.mean]])]])

    def spread(self, count: int, own: NDArray[np.intp]) -> GainPrior:
        """The same among more parameters, of which nothing is believed.

        Args:
            count: How many there are.
            own: Positions of the parameters of this prior among them, first; what comes after is not believed either.
        """
        mean, precision = np.zeros(count), np.zeros((count, count))
        own = own[: len(self.mean)]
        mean[own] = self.mean
        precision[np.ix_(own, own)] = self.precision
        return GainPrior(mean, precision)


@dataclass(frozen=True, eq=False, slots=True)
class Reduced:
    """Rest of the columns beside those of the model, the torque last, in each of F stretches.

    Attributes:
        training: S of every stretch, shape (F, r + 1, r + 1).
        held_out: M of every stretch, all joints together, shape (F, r + 1, r + 1).
        own: M of every stretch by the rows of each joint alone and for its columns, shapes (F, r_j + 1, r_j + 1).
        own_place: Position of each of the b parameters among those of each joint, -1 for others, shape (n, b).
        size: Squared length of each column in training, before the elimination, shape (F, r).
        place: Position among the r of each of the b parameters; -1 for the model's own, shape (b,).
        squares: Squared residuals of each joint on each stretch under the model, weighted, shape (F, n).
    """

    training: Array
    held_out: Array
    own: tuple[Array, ...]
    own_place: NDArray[np.intp]
    size: Array
    place: NDArray[np.intp]
    squares: Array

    def gains(self, joint: int, columns: NDArray[np.intp], ridge: float) -> tuple[Array, Array] | None:
        """Tell how much less is left on each stretch with some columns of a joint more; `None` where they are zero.

        Returns:
            Of the joint's own squared residual, and of that of all joints together, shapes (F,).
        """
        at, own = self.place[columns], self.own_place[joint, columns]
        if (self.size[:, at] <= 0.0).any():
            return None
        S = self.training[:, at[:, None], at]
        S = S + ridge * self.size[:, at, None] * np.eye(len(at))
        x = np.asarray(np.linalg.solve(S, self.training[:, at, -1:])[:, :, 0], dtype=np.float64)
        return _gain(x, self.own[joint], own), _gain(x, self.held_out, at)


@dataclass(frozen=True, eq=False, slots=True)
class HeldOutFolds:
    """The data as products, F stretches that are left out in turn.

    Attributes:
        parts: Each stretch by itself.
        held_out: Products of each, weighted, the torque last, shape (F, b + 1, b + 1).
        training: Products of what trains when it is left out, its neighbours excluded, shape (F, b + 1, b + 1).
        whole: Products of everything, shape (b + 1, b + 1).
        weights: Weight of each joint's rows, shape (n,).
        prior: What is believed of the parameters.
    """

    parts: tuple[Information, ...]
    held_out: Array
    training: Array
    whole: Array
    weights: Array
    prior: GainPrior

    def solve(self, products: Array, kept: NDArray[np.intp], ridge: Array) -> Array:
        """Parameters (b,) from products, zero where not kept; ridge (b,) is relative to the columns' size."""
        values = np.zeros(products.shape[0] - 1)
        values[kept] = self._eliminated(products, kept, ridge, np.array([products.shape[0] - 1]))[:, 0]
        return values

    def errors(self, kept: NDArray[np.intp], ridge: Array) -> Array:
        """Squared residuals (F, n) of each joint on each stretch, all parameters estimated without it."""
        return np.stack(
            [
                held_out_squares(part, self.solve(products, kept, ridge))
                for part, products in zip(self.parts, self.training, strict=True)
            ]
        )

    def reduced(self, kept: NDArray[np.intp], ridge: Array, *, all_anew: bool) -> Reduced:
        """Return what the model's own columns leave of the others.

        Args:
            kept: Positions of the model's columns.
            ridge: Relative to the size of each column, shape (b,).
            all_anew: Whether all parameters are estimated without the stretch, or only a candidate's.
        """
        b = len(self.whole) - 1
        rest = np.append(np.setdiff1d(np.arange(b), kept), b)
        place = np.full(b, -1, dtype=np.intp)
        place[rest[:-1]] = np.arange(len(rest) - 1)
        once = None if all_anew else self._eliminated(self.whole, kept, ridge, rest)
        S, M, squares = [], [], []
        mine = [np.intersect1d(rest[:-1], joint.parameters) for joint in self.parts[0].joints]
        own: list[list[Array]] = [[] for _ in mine]
        for part, T, G in zip(self.parts, self.training, self.held_out, strict=True):
            E = self._eliminated(T, kept, ridge, rest) if once is None else once
            M.append(_left(G, kept, rest, E))
            for j, columns in enumerate(mine):
                own[j].append(self._left_of(part, j, columns, kept, E[:, np.append(place[columns], -1)]))
            S.append(_left(T, kept, rest, E))
            values = np.zeros(b)
            values[kept] = E[:, -1]
            squares.append(self.weights**2 * held_out_squares(part, values))
        size = np.stack([np.diag(T)[rest[:-1]] for T in self.training])
        own_place = np.full((len(mine), b), -1, dtype=np.intp)
        for j, columns in enumerate(mine):
            own_place[j, columns] = np.arange(len(columns))
        together = tuple(np.stack(each) for each in own)
        return Reduced(np.stack(S), np.stack(M), together, own_place, size, place, np.stack(squares))

    def _left_of(
        self, part: Information, joint: int, columns: NDArray[np.intp], kept: NDArray[np.intp], E: Array
    ) -> Array:
        """Return what a joint's own rows of a stretch leave of its own columns and the torque, weighted."""
        factors = part.joints[joint]
        number = np.full(part.count, -1, dtype=np.intp)
        number[factors.parameters] = np.arange(len(factors.parameters))
        R = self.weights[joint] * factors.R.reshape(-1, factors.R.shape[2])
        near = np.flatnonzero(number[kept] >= 0)
        left = R[:, np.append(number[columns], -1)] - R[:, number[kept[near]]] @ E[near]
        return left.T @ left

    def _eliminated(self, products: Array, kept: NDArray[np.intp], ridge: Array, rest: NDArray[np.intp]) -> Array:
        """Coefficients (kept, rest) of the kept columns that come nearest to the others, under the prior."""
        H = products + self.prior.products
        A = H[np.ix_(kept, kept)]
        A[np.diag_indices(len(kept))] += ridge[kept] * np.diag(products)[kept]
        length = np.sqrt(np.maximum(np.diag(A), 0.0))  # a difference of products may round below zero
        length[length == 0.0] = 1.0
        A /= np.outer(length, length)
        A[np.diag_indices(len(kept))] += ROUNDING
        return np.linalg.solve(A, H[np.ix_(kept, rest)] / length[:, None]) / length[:, None]


def make_folds(information: Information, fold: NDArray[np.int64], weights: Array, prior: GainPrior) -> HeldOutFolds:
    """Products of the stretches.

    Args:
        information: Blocks in their order.
        fold: Stretch of each block, shape (blocks,).
        weights: Weight of each joint's rows, shape (n,).
        prior: What is believed of the parameters.
    """
    names = np.unique(fold)
    each = [_products(information, fold == f, weights) for f in names]
    whole = np.sum(each, axis=0)
    near = [training_information(information, fold == f) for f in names]
    training = np.stack(
        [whole - own - _products(information, at, weights) for own, at in zip(each, near, strict=True)]
    )
    parts = tuple(select(information, fold == f) for f in names)
    return HeldOutFolds(parts, np.stack(each), training, whole, weights, prior)


def _products(information: Information, chosen: NDArray[np.bool_], weights: Array) -> Array:
    """Σ_j w_j² R_jᵀ R_j of some blocks, shape (b + 1, b + 1)."""
    b = information.count
    result = np.zeros((b + 1, b + 1))
    for weight, joint in zip(weights, information.joints, strict=True):
        R = weight * joint.R[chosen].reshape(-1, joint.R.shape[2])
        at = np.append(joint.parameters, b)
        result[np.ix_(at, at)] += R.T @ R
    return result


def _left(products: Array, kept: NDArray[np.intp], rest: NDArray[np.intp], E: Array) -> Array:
    """Products of the rest after its part in the kept columns is taken off with coefficients E."""
    cross = E.T @ products[np.ix_(kept, rest)]
    return products[np.ix_(rest, rest)] - cross - cross.T + E.T @ products[np.ix_(kept, kept)] @ E


def _gain(x: Array, M: Array, at: NDArray[np.intp]) -> Array:
    """Return what coefficients (F, c) take away, shape (F,)."""
    inner = M[:, at[:, None], at]
    return 2.0 * np.einsum("fi,fi->f", x, M[:, at, -1]) - np.einsum("fi,fij,fj->f", x, inner, x)
