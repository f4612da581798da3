"""Functions of the kernel: each checks the shapes, allocates the output and calls the chosen build.

N is the number of samples, n the number of joints. All arrays are float64 in C order. The argument `chosen` names the
build of the kernel, one of `instruction_sets()`; by default it is `in_use()`.
"""

from __future__ import annotations

import os
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

import armid.kernel._native as _native
from armid.checked_array import Array
from armid.errors import ArmidError
from armid.kernel import reference, reference_factor, reference_play
from armid.kernel.joint_column_layout import ColumnLayout
from armid.kernel.tree import Tree

TWIN = "numpy"
NO_MASK = np.empty(0, dtype=np.uint8)

coriolis_matrix = reference.coriolis_matrix
potential_energy = reference.potential_energy


def instruction_sets() -> tuple[str, ...]:
    """Builds of the kernel that this machine supports, fastest first; the last is the NumPy twin."""
    return (*_native.instruction_sets(), TWIN)


@lru_cache(maxsize=1)
def in_use() -> str:
    """Name of the default build: the value of `ARMID_KERNEL` if it is set, otherwise the fastest build.

    Raises:
        ArmidError: `ARMID_KERNEL` names a build that this machine does not support.
    """
    possible = instruction_sets()
    wanted = os.environ.get("ARMID_KERNEL", "") or possible[0]
    if wanted not in possible:
        raise ArmidError(
            f"The environment variable ARMID_KERNEL asks for {wanted!r}, which this machine does not support.",
            possible=", ".join(possible),
            remedy="unset ARMID_KERNEL; the fastest of these builds is then used.",
        )
    return wanted


@lru_cache(maxsize=64)
def compiled_arm(tree: Tree) -> _native.Arm:
    """Converts a tree to the arm object of the compiled kernel; the result is cached."""
    return _native.Arm(tree.parent, tree.prismatic, tree.axis, tree.rotation, tree.translation, tree.gravity)


def states_of(tree: Tree, *arrays: ArrayLike) -> list[Array]:
    """Converts arrays of joint positions, velocities, … (N, n) to float64 in C order, as the kernel needs them.

    Raises:
        ArmidError: The arrays do not all have the shape (N, n) with the n joints of the tree.
    """
    result = [np.ascontiguousarray(x, dtype=np.float64) for x in arrays]
    shapes = [x.shape for x in result]
    if len(shapes[0]) != 2 or shapes[0][1] != tree.n or shapes.count(shapes[0]) != len(shapes):
        raise ArmidError(f"The arrays q, dq, … must have the same shape (N, {tree.n}); found {shapes}.")
    return result


def _output(out: Array | None, shape: tuple[int, ...]) -> Array:
    """Array for a result of this shape: `out` after a check of its shape and type, or a new array."""
    if out is None:
        return np.empty(shape)
    if out.shape != shape or out.dtype != np.float64 or not out.flags.c_contiguous or not out.flags.writeable:
        raise ArmidError(f"out must be a writable float64 array of shape {shape} in C order; found {out.shape}.")
    return out


def regressor(
    tree: Tree,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    *,
    out: Array | None = None,
    chosen: str | None = None,
) -> Array:
    """Rigid-body regressor Y, shape (N, n, 10 n), with τ = Y θ for the 10 n inertial parameters θ, link by link.

    If `out` is given, the result is written to `out`, and `out` is returned. This saves time, because the allocation
    of a large array takes longer than the computation.
    """
    q, dq, ddq = states_of(tree, q, dq, ddq)
    chosen = chosen or in_use()
    out = _output(out, (len(q), tree.n, 10 * tree.n))
    if chosen == TWIN:
        out[:] = reference.regressor(tree, q, dq, ddq)
        return out
    _native.regressor(chosen, compiled_arm(tree), q, dq, ddq, out)
    return out


def inverse_dynamics(
    tree: Tree,
    inertial: ArrayLike,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    *,
    chosen: str | None = None,
) -> Array:
    """Joint torque, shape (N, n) [N·m or N], of rigid links with inertial parameters of shape (n, 10)."""
    q, dq, ddq = states_of(tree, q, dq, ddq)
    inertial = np.ascontiguousarray(inertial, dtype=np.float64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference.inverse_dynamics(tree, inertial, q, dq, ddq)
    out = np.empty_like(q)
    _native.inverse_dynamics(chosen, compiled_arm(tree), inertial, q, dq, ddq, out)
    return out


def gravity_torque(tree: Tree, inertial: ArrayLike, q: ArrayLike, *, chosen: str | None = None) -> Array:
    """Gravity torque g(q), shape (N, n) [N·m or N]: the joint torque that holds the arm at rest.

    Inertial parameters have shape (n, 10), positions (N, n).
    """
    (q,) = states_of(tree, q)
    still = np.zeros_like(q)
    return inverse_dynamics(tree, inertial, q, still, still, chosen=chosen)


def mass_matrix(tree: Tree, inertial: ArrayLike, q: ArrayLike, *, chosen: str | None = None) -> Array:
    """Mass matrix, shape (N, n, n), of rigid links with inertial parameters of shape (n, 10) at positions (N, n)."""
    (q,) = states_of(tree, q)
    inertial = np.ascontiguousarray(inertial, dtype=np.float64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference.mass_matrix(tree, inertial, q)
    out = np.empty((len(q), tree.n, tree.n))
    _native.mass_matrix(chosen, compiled_arm(tree), inertial, q, out)
    return out


def columns(
    tree: Tree,
    layout: ColumnLayout,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    torque: ArrayLike,
    terms: ArrayLike,
    *,
    out: Array | None = None,
    chosen: str | None = None,
) -> Array:
    """Regressor columns of every joint, followed by its torque, at N samples: shape (columns, N).

    Args:
        tree: The arm.
        layout: Layout of the kept columns.
        q: Joint positions, shape (N, n).
        dq: Joint velocities, shape (N, n).
        ddq: Joint accelerations, shape (N, n).
        torque: Joint torques, shape (N, n) [N·m or N].
        terms: Regressor columns of the torque terms that are kept, one in each row, shape (e, N).
        out: Array to which the result is written; a new array if not given.
        chosen: Build of the kernel.
    """
    q, dq, ddq, torque = states_of(tree, q, dq, ddq, torque)
    terms = np.ascontiguousarray(terms, dtype=np.float64)
    chosen = chosen or in_use()
    out = _output(out, (layout.columns, len(q)))
    if chosen == TWIN:
        out[:] = reference_factor.columns(tree, layout, q, dq, ddq, torque, terms)
        return out
    _native.columns(
        chosen, compiled_arm(tree), layout.offset, layout.target, layout.term, q, dq, ddq, torque, terms, out
    )
    return out


def factor(
    tree: Tree,
    layout: ColumnLayout,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    torque: ArrayLike,
    terms: ArrayLike,
    bounds: ArrayLike,
    *,
    mask: NDArray[np.bool_] | None = None,
    by_gram: bool = False,
    threads: int = 1,
    chosen: str | None = None,
) -> Array:
    """Triangular factors of the columns of each joint, one for each block of samples; the columns are not stored.

    Args:
        tree: The arm.
        layout: Layout of the kept columns.
        q: Joint positions, shape (N, n).
        dq: Joint velocities, shape (N, n).
        ddq: Joint accelerations, shape (N, n).
        torque: Joint torques, shape (N, n) [N·m or N].
        terms: Regressor columns of the torque terms that are kept, one in each row, shape (e, N).
        bounds: First sample of each block, and N, shape (blocks + 1,): block k contains samples `bounds[k]` to
            `bounds[k + 1] - 1`.
        mask: Mask of the rows in use, shape (N, n); all rows if not given.
        by_gram: If true, the factors are computed by Cholesky factorisation of the products of the columns, not by
            QR. This needs half the arithmetic, but its relative error is ε times the square of the scaled condition
            number. The caller must check this error.
        threads: Number of threads that share the blocks.
        chosen: Build of the kernel.

    Returns:
        Factors of all joints, concatenated into one row for each block, shape (blocks, sum of widths squared); see
        `unpack_factors`.
    """
    q, dq, ddq, torque = states_of(tree, q, dq, ddq, torque)
    terms = np.ascontiguousarray(terms, dtype=np.float64)
    bounds = np.ascontiguousarray(bounds, dtype=np.int64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_factor.factor(tree, layout, q, dq, ddq, torque, terms, bounds, mask)
    out = np.zeros((len(bounds) - 1, int((layout.widths.astype(np.int64) ** 2).sum())))
    rows = NO_MASK if mask is None else np.ascontiguousarray(mask, dtype=np.uint8)
    _native.factor(
        chosen, compiled_arm(tree), layout.offset, layout.target, layout.term,
        q, dq, ddq, torque, terms, rows, bounds, by_gram, threads, out,
    )  # fmt: skip
    return out


def unpack_factors(layout: ColumnLayout, factors: Array) -> tuple[Array, ...]:
    """Splits the result of `factor` into the upper triangular factors of each joint, shape (blocks, width, width).

    `width` is the number of columns of the joint, torque included.
    """
    sizes = layout.widths.astype(np.int64) ** 2
    starts = np.concatenate([[0], np.cumsum(sizes)])
    return tuple(
        factors[:, a:b].reshape(len(factors), k, k)
        for a, b, k in zip(starts[:-1], starts[1:], layout.widths, strict=True)
    )


def factor_columns(x: ArrayLike, bounds: ArrayLike | None = None, *, chosen: str | None = None) -> Array:
    """Upper triangular factors R of K given columns, one for each block of rows, shape (blocks, K, K).

    Rᵀ R is the matrix of the products of the columns in the block.

    Args:
        x: Columns, shape (K, rows).
        bounds: First row of each block, and the number of rows: block k contains rows `bounds[k]` to `bounds[k + 1] -
            1`; if not given, all rows are one block.
        chosen: Build of the kernel.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    bounds = np.array([0, x.shape[1]] if bounds is None else bounds, dtype=np.int64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_factor.factor_columns(x, bounds)
    out = np.zeros((len(bounds) - 1, len(x), len(x)))
    _native.factor_columns(chosen, x, bounds, out)
    return out


def decimate(
    tree: Tree,
    layout: ColumnLayout,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    torque: ArrayLike,
    terms: ArrayLike,
    taps: ArrayLike,
    step: int,
    first: int,
    out: Array,
    *,
    chosen: str | None = None,
) -> None:
    """Filters and decimates the columns of every joint and adds them to `out`; the full-rate columns are not stored.

    For each column, entry r of `out` is increased by the sum of taps[s - first - r step] · column[s] over the samples
    s.

    Args:
        tree: The arm.
        layout: Layout of the kept columns.
        q: Joint positions, shape (N, n).
        dq: Joint velocities, shape (N, n).
        ddq: Joint accelerations, shape (N, n).
        torque: Joint torques, shape (N, n) [N·m or N].
        terms: Regressor columns of the torque terms that are kept, one in each row, shape (e, N).
        taps: Filter coefficients, shape (length,).
        step: Number of samples between successive output rows.
        first: Index of the sample that is multiplied by the first tap for output row 0; it may be negative.
        out: Array to which the result is added, shape (columns, rows).
        chosen: Build of the kernel.
    """
    q, dq, ddq, torque = states_of(tree, q, dq, ddq, torque)
    terms = np.ascontiguousarray(terms, dtype=np.float64)
    taps = np.ascontiguousarray(taps, dtype=np.float64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        reference_factor.decimate(tree, layout, q, dq, ddq, torque, terms, taps, step, first, out)
        return
    _native.decimate(
        chosen, compiled_arm(tree), layout.offset, layout.target, layout.term,
        q, dq, ddq, torque, terms, taps, step, first, out,
    )  # fmt: skip


def play(
    x: ArrayLike, column: ArrayLike, width: ArrayLike, *, chosen: str | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """States of play operators along one contiguous run: z ← min(max(z, q - r), q + r).

    Args:
        x: Coordinates q that drive the operators, shape (N, k) [rad or m].
        column: Index of the coordinate that drives each operator, shape (m,).
        width: Half-width r of each operator, shape (m,) [rad or m].
        chosen: Build of the kernel.

    Returns:
        States z, shape (N, m); and for each operator the first sample from which z does not depend on its unknown
        initial value, shape (m,), N if there is none. Before that sample, z is the middle of its possible range.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    column = np.ascontiguousarray(column, dtype=np.int32)
    width = np.ascontiguousarray(width, dtype=np.float64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_play.play(x, column, width)
    out, known = np.empty((len(x), len(column))), np.empty(len(column), dtype=np.int64)
    _native.play(chosen, x, column, width, out, known)
    return out, known
