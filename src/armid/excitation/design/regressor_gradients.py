"""Regressor columns of the base parameters along a series, with exact gradients with respect to the states.

The columns of rigid bodies and their adjoints come from the kernel. The columns of the other terms come from their
laws and the derivatives of the laws.
"""

from __future__ import annotations

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.excitation.design.term_columns import TermRows
from armid.information.base_regressor_layout import ColumnSource


class Columns:
    """Regressor columns of the base parameters at N samples, their information matrix, and gradients by the states.

    Args:
        source: Model and layout of the columns.
        samples: Number N of samples.
        width: Width over which laws with corners are smoothed [rad/s or m/s]; if 0, they are not smoothed.
    """

    def __init__(self, source: ColumnSource, samples: int, width: float = 0.0) -> None:
        self.source = source
        self.samples = samples
        self._layout = source.layout
        self._term_rows = TermRows(source, width)
        self._terms = np.zeros((len(self._layout.term), samples))
        self._none = np.zeros((samples, source.tree.n))
        self._states = (self._none, self._none, self._none)

    def fill(self, q: Array, dq: Array, ddq: Array) -> None:
        """Evaluates the regressor columns at states q, dq, ddq, (N, n) each; the other methods use the result."""
        self._states = (q, dq, ddq)
        self._term_rows.fill(self._states, self._terms)

    def information(self, weights: Array) -> Array:
        """Information matrix G = Σ_j weights_j Y_jᵀ Y_j, shape (b, b), with the rows Y_j (N, b) of joint j."""
        count = len(self.source.names)
        return kernel.information(self.source.tree, self._layout, *self._states, self._terms, weights, count)

    def information_gradient(self, slopes: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Gradients by q, dq, ddq, (N, n) each, of a function of G with the derivative `slopes` (b, b) by G.

        `slopes` must be symmetric.
        """
        *gradient, adjoint = kernel.information_adjoint(
            self.source.tree, self._layout, *self._states, self._terms, weights, slopes
        )
        self._term_rows.pullback(adjoint, tuple(gradient))
        return gradient[0], gradient[1], gradient[2]

    def torque(self, values: Array) -> Array:
        """Torque (N, n) [N·m or N] for base parameters (b,), at the states of the last call of `fill`."""
        x = kernel.columns(self.source.tree, self._layout, *self._states, self._none, self._terms)
        offset = self._layout.offset
        return np.stack(
            [values[p] @ x[offset[j] : offset[j + 1] - 1] for j, p in enumerate(self._layout.parameters)], axis=1
        )

    def torque_gradient(self, values: Array, joint: int, slopes: Array) -> tuple[Array, Array, Array]:
        """Gradients by q, dq, ddq, (N, n) each, of the sum over samples of slopes (N,) times a joint's torque."""
        cotangent = np.zeros((self._layout.columns, self.samples))
        p, start = self._layout.parameters[joint], self._layout.offset[joint]
        np.multiply(values[p][:, None], slopes, out=cotangent[start : start + len(p)])
        gradient = kernel.columns_adjoint(self.source.tree, self._layout, *self._states, cotangent)
        self._term_rows.pullback(cotangent[self._layout.term], gradient)
        return gradient
