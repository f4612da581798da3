"""Held-out gains of candidate columns, from products of the triangular factors, for folds of consecutive blocks.

The sums of products G_f = Σ_j w_j² R_jᵀ R_j are computed over each held-out fold f, and in the same way T_f over its
training blocks, to which the products Λ of the prior are added. The columns of the present model are eliminated. With
S and M, the Schur complements of T_f and G_f, the parameters x of the candidate's columns c and the reduction of the
squared residual (gain) are:

    x = (S_cc + κ diag T_cc)⁻¹ S_cy,        gain = 2 xᵀ M_cy - xᵀ M_cc x,

where y is the torque, κ the shrinkage, and M contains the rows of the candidate's joint, or of all joints. If the
elimination uses T_f, all parameters are estimated without the fold. If it uses all data, only the parameters of the
candidate are estimated without the fold. The second variant has far less scatter if bodies have many parameters and
recordings are short. Only the first variant shows that a candidate imitates gravity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.crossvalidation import held_out_squares, training_information
from armid.estimation.prior import OF_WHOLE
from armid.information.information import Information, select

ROUNDING = 1e-11
"""Number that is added to the diagonal of products of columns with unit length, so that dependent columns cause no
division by zero. It is the rounding error of products: machine precision times the square of a condition number of a
few hundred."""


@dataclass(frozen=True, eq=False, slots=True)
class GainPrior:
    """Gaussian prior on the parameters of a candidate model.

    Attributes:
        mean: Mean of the parameters, shape (b,).
        precision: Inverse covariance, zero for parameters without a prior, shape (b, b).
    """

    mean: Array
    precision: Array

    @property
    def products(self) -> Array:
        """Normal matrix of data that are equivalent to the prior, right-hand side last, shape (b + 1, b + 1)."""
        half = self.precision @ self.mean
        return np.block([[self.precision, half[:, None]], [half[None], np.array([[half @ self.mean]])]])

    def embedded(self, count: int, own: NDArray[np.intp]) -> GainPrior:
        """The same prior on a larger set of parameters, without information about the added parameters.

        Args:
            count: Number of parameters of the larger set.
            own: Positions in the larger set; the first entries are the positions of the parameters of this prior,
                further entries are not used.
        """
        mean, precision = np.zeros(count), np.zeros((count, count))
        own = own[: len(self.mean)]
        mean[own] = self.mean
        precision[np.ix_(own, own)] = self.precision
        return GainPrior(mean, precision)


@dataclass(frozen=True, eq=False, slots=True)
class NormalMatrix:
    """Weighted products of the columns of some blocks, with the torque as the last column.

    Attributes:
        data: Products of the data, shape (b + 1, b + 1).
        with_prior: Products of the data and of the prior, shape (b + 1, b + 1).
        length: Squared length of each column, in units of which the shrinkage is given, shape (b,).
    """

    data: Array
    with_prior: Array
    length: Array

    def elimination(self, kept: NDArray[np.intp], ridge: Array, rest: NDArray[np.intp]) -> Array:
        """Coefficients of the fit of the columns `rest` by the columns `kept`, prior included, shape (kept, rest).

        Args:
            kept: Positions of the columns of the fit.
            ridge: Shrinkage, in shares of the squared length of each column, shape (b,).
            rest: Positions of the columns that are fitted.
        """
        whole = self.with_prior[kept]  # whole rows first: half of the time of single elements
        A = np.ascontiguousarray(whole[:, kept])
        diagonal = np.einsum("ii->i", A)
        diagonal += ridge[kept] * self.length[kept]
        length = np.sqrt(np.maximum(diagonal, 0.0))  # a difference of products may round below zero
        length[length == 0.0] = 1.0
        A /= length[:, None] * length
        diagonal += ROUNDING
        return np.linalg.solve(A, whole[:, rest] / length[:, None]) / length[:, None]

    def solve(self, kept: NDArray[np.intp], ridge: Array) -> Array:
        """Solves the normal equations for the parameters (b,); parameters outside `kept` are zero.

        Args:
            kept: Indices of the parameters that are estimated.
            ridge: Shrinkage, in shares of the squared length of each column, shape (b,).
        """
        values = np.zeros(len(self.length))
        values[kept] = self.elimination(kept, ridge, np.array([len(self.length)]))[:, 0]
        return values


def normal_matrix(data: Array, prior: GainPrior, base: NDArray[np.intp]) -> NormalMatrix:
    """Adds the prior to the products of data, and computes the squared lengths of the columns.

    Args:
        data: Products of the data, shape (b + 1, b + 1).
        prior: Prior on the parameters.
        base: Positions of the columns of the model without candidates. For any other column, the squared length is
            that of the part that these columns do not explain, plus `OF_WHOLE` times that of the whole column.
    """
    H = data + prior.products
    length = np.maximum(np.diag(data)[:-1], 0.0)
    if len(base):
        others = np.setdiff1d(np.arange(len(length)), base)
        A = H[np.ix_(base, base)]
        scale = np.sqrt(np.maximum(np.diag(A), 0.0))
        scale[scale == 0.0] = 1.0
        A = A / np.outer(scale, scale) + ROUNDING * np.eye(len(scale))
        cross = data[np.ix_(base, others)] / scale[:, None]
        left = length[others] - np.sum(cross * np.linalg.solve(A, cross), axis=0)
        length[others] = np.maximum(left, 0.0) + OF_WHOLE * length[others]
    return NormalMatrix(data, H, length)


@dataclass(frozen=True, eq=False, slots=True)
class Reduced:
    """Products of r candidate columns and the torque (last) in F folds, after elimination of the model's columns.

    The symbols S and M are those of the module.

    Attributes:
        training: Products S over the training blocks of each fold, shape (F, r + 1, r + 1).
        held_out: Products M over the held-out rows of all joints, shape (F, r + 1, r + 1).
        own: For each joint j, products M of its r_j candidate columns over its held-out rows, shapes (F, r_j + 1,
            r_j + 1).
        joint_position: Position of each of the b parameters among the r_j candidates of each joint, -1 for all other
            parameters, shape (n, b).
        size: Squared length of each candidate column in training, before the elimination, shape (F, r).
        position: Position of each of the b parameters among the r candidates; -1 for parameters of the model, shape
            (b,).
        squares: Weighted sum of squared residuals of the model for each fold and joint, shape (F, n).
    """

    training: Array
    held_out: Array
    own: tuple[Array, ...]
    joint_position: NDArray[np.intp]
    size: Array
    position: NDArray[np.intp]
    squares: Array

    def gains(self, joint: int, columns: NDArray[np.intp], ridge: float) -> tuple[Array, Array] | None:
        """Reduction of the squared residual on each fold by candidate columns of a joint; `None` if one is zero.

        Args:
            joint: Index of the joint.
            columns: Positions of the columns among the b parameters.
            ridge: Shrinkage, in shares of the squared length of each column.

        Returns:
            Reduction of the squared residual of the joint, shape (F,), and of all joints together, shape (F,).
        """
        at, own = self.position[columns], self.joint_position[joint, columns]
        if (self.size[:, at] <= 0.0).any():
            return None
        S = self.training[:, at[:, None], at]
        S = S + ridge * self.size[:, at, None] * np.eye(len(at))
        x = np.asarray(np.linalg.solve(S, self.training[:, at, -1:])[:, :, 0], dtype=np.float64)
        return _gain(x, self.own[joint], own), _gain(x, self.held_out, at)


@dataclass(frozen=True, eq=False, slots=True)
class HeldOutFolds:
    """Products of the data for cross-validation with F folds.

    Attributes:
        parts: Information of each fold.
        held_out: Weighted products of each fold, with the torque as the last column, shape (F, b + 1, b + 1).
        training: Products of the training blocks of each fold, without the blocks next to the fold.
        whole: Products of all blocks.
        weights: Weight of each joint's rows, shape (n,).
        prior: Prior on the parameters.
        base: Positions of the columns of the model without candidates.
    """

    parts: tuple[Information, ...]
    held_out: Array
    training: tuple[NormalMatrix, ...]
    whole: NormalMatrix
    weights: Array
    prior: GainPrior
    base: NDArray[np.intp]

    def with_prior(self, prior: GainPrior) -> HeldOutFolds:
        """The same folds with another prior."""
        training = tuple(normal_matrix(each.data, prior, self.base) for each in self.training)
        whole = normal_matrix(self.whole.data, prior, self.base)
        return replace(self, training=training, whole=whole, prior=prior)

    def errors(self, kept: NDArray[np.intp], ridge: Array) -> Array:
        """Sum of squared residuals of each joint on each held-out fold, shape (F, n), unweighted.

        All parameters are estimated without the fold.

        Args:
            kept: Indices of the parameters that are estimated.
            ridge: Shrinkage, in shares of the squared length of each column, shape (b,).
        """
        return np.stack(
            [
                held_out_squares(part, products.solve(kept, ridge))
                for part, products in zip(self.parts, self.training, strict=True)
            ]
        )

    def reduced(self, kept: NDArray[np.intp], ridge: Array, *, refit_all: bool) -> Reduced:
        """Eliminates the columns of the present model.

        Args:
            kept: Positions of the model's columns.
            ridge: Shrinkage, in shares of the squared length of each column, shape (b,).
            refit_all: True if all parameters are estimated without the fold; false if only those of a candidate are.
        """
        b = len(self.whole.length)
        rest = np.append(np.setdiff1d(np.arange(b), kept), b)
        position = np.full(b, -1, dtype=np.intp)
        position[rest[:-1]] = np.arange(len(rest) - 1)
        once = None if refit_all else self.whole.elimination(kept, ridge, rest)
        S, M, squares = [], [], []
        joint_columns = [np.intersect1d(rest[:-1], joint.parameters) for joint in self.parts[0].joints]
        own: list[list[Array]] = [[] for _ in joint_columns]
        for part, T, G in zip(self.parts, self.training, self.held_out, strict=True):
            E = T.elimination(kept, ridge, rest) if once is None else once
            M.append(_schur_complement(G, kept, rest, E))
            for j, columns in enumerate(joint_columns):
                own[j].append(self._joint_products(part, j, columns, kept, E[:, np.append(position[columns], -1)]))
            S.append(_schur_complement(T.data, kept, rest, E))
            values = np.zeros(b)
            values[kept] = E[:, -1]
            squares.append(self.weights**2 * held_out_squares(part, values))
        size = np.stack([T.length[rest[:-1]] for T in self.training])
        joint_position = np.full((len(joint_columns), b), -1, dtype=np.intp)
        for j, columns in enumerate(joint_columns):
            joint_position[j, columns] = np.arange(len(columns))
        together = tuple(np.stack(each) for each in own)
        return Reduced(np.stack(S), np.stack(M), together, joint_position, size, position, np.stack(squares))

    def _joint_products(
        self, part: Information, joint: int, columns: NDArray[np.intp], kept: NDArray[np.intp], E: Array
    ) -> Array:
        """Products of a joint's candidate columns and torque in a fold, after elimination of the model's columns.

        Args:
            part: Information of the fold.
            joint: Index of the joint.
            columns: Positions of the joint's candidate columns.
            kept: Positions of the model's columns.
            E: Coefficients with which the model's columns fit these columns and the torque (last).
        """
        factors = part.joints[joint]
        number = np.full(part.count, -1, dtype=np.intp)
        number[factors.parameters] = np.arange(len(factors.parameters))
        R = self.weights[joint] * factors.R.reshape(-1, factors.R.shape[2])
        near = np.flatnonzero(number[kept] >= 0)
        left = R[:, np.append(number[columns], -1)] - R[:, number[kept[near]]] @ E[near]
        return left.T @ left


def make_folds(
    information: Information,
    fold: NDArray[np.int64],
    weights: Array,
    prior: GainPrior,
    base: NDArray[np.intp] | None = None,
) -> HeldOutFolds:
    """Computes the products of all folds.

    Args:
        information: Blocks in their order.
        fold: Fold of each block, shape (blocks,).
        weights: Weight of each joint's rows, shape (n,).
        prior: Prior on the parameters.
        base: Positions of the columns of the model without candidates; none if not given. The shrinkage of a
            candidate is relative to the part of its column that these columns do not explain.
    """
    base = np.zeros(0, dtype=np.intp) if base is None else base
    names = np.unique(fold)
    each = [_products(information, fold == f, weights) for f in names]
    whole = np.sum(each, axis=0)
    near = [training_information(information, fold == f) for f in names]
    training = tuple(
        normal_matrix(whole - own - _products(information, at, weights), prior, base)
        for own, at in zip(each, near, strict=True)
    )
    parts = tuple(select(information, fold == f) for f in names)
    return HeldOutFolds(parts, np.stack(each), training, normal_matrix(whole, prior, base), weights, prior, base)


def _products(information: Information, chosen: NDArray[np.bool_], weights: Array) -> Array:
    """Weighted products Σ_j w_j² R_jᵀ R_j over the chosen blocks, shape (b + 1, b + 1).

    R_j is the triangular factor of joint j with the torque as the last column, and w_j the weight of the joint.
    """
    b = information.count
    result = np.zeros((b + 1, b + 1))
    for weight, joint in zip(weights, information.joints, strict=True):
        R = weight * joint.R[chosen].reshape(-1, joint.R.shape[2])
        at = np.append(joint.parameters, b)
        result[np.ix_(at, at)] += R.T @ R
    return result


def _schur_complement(products: Array, kept: NDArray[np.intp], rest: NDArray[np.intp], E: Array) -> Array:
    """Products of the columns `rest` after subtraction of their fit by the columns `kept`, with coefficients E."""
    fitted = E.T @ products[kept]  # whole rows, which are gathered far faster than single elements
    cross = fitted[:, rest]
    return products[np.ix_(rest, rest)] - cross - cross.T + fitted[:, kept] @ E


def _gain(x: Array, M: Array, at: NDArray[np.intp]) -> Array:
    """Reduction 2 xᵀ M_cy - xᵀ M_cc x of the squared residual on each of F folds, shape (F,).

    Args:
        x: Coefficients of the c columns for each fold, shape (F, c).
        M: Products of all columns for each fold, with the torque y last.
        at: Positions of the c columns in M, shape (c,).
    """
    inner = M[:, at[:, None], at]
    return 2.0 * np.einsum("fi,fi->f", x, M[:, at, -1]) - np.einsum("fi,fij,fj->f", x, inner, x)
