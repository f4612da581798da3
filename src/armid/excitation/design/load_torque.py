"""Torque of the rigid bodies, on which load-dependent friction depends, with its exact gradient."""

from __future__ import annotations

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.model.dynamics_model import DynamicsModel

States = tuple[Array, Array, Array]


class LoadTorque:
    """Torque of the rigid bodies of a model with its load parameters, and its gradient, at given states.

    Args:
        model: Model with load parameters.
    """

    def __init__(self, model: DynamicsModel) -> None:
        assert model.load_parameters is not None
        none = np.zeros(0, dtype=np.int32)
        self._tree = model.tree
        self._inertial = model.load_parameters
        self._layout = kernel.make_layout(model.tree, np.arange(10 * model.n, dtype=np.int32), none, none)
        none_yet = np.zeros((0, model.n))
        self._states: States = (none_yet, none_yet, none_yet)

    def fill(self, states: States) -> Array:
        """Computes the torque (N, n) at states q, dq, ddq, (N, n) each; the states are stored for `pullback`."""
        self._states = states
        return kernel.inverse_dynamics(self._tree, self._inertial, *states)

    def pullback(self, weights: Array, gradient: tuple[Array, ...]) -> None:
        """Adds the gradient of the sum of weights (N, n) times torque to the gradients by q, dq, ddq, (N, n) each."""
        layout, values = self._layout, self._inertial.ravel()
        cotangent = np.zeros((layout.columns, len(weights)))
        for j, parameters in enumerate(layout.parameters):
            start = layout.offset[j]
            cotangent[start : start + len(parameters)] = values[parameters][:, None] * weights[:, j]
        parts = kernel.columns_adjoint(self._tree, layout, *self._states, cotangent)
        for total, part in zip(gradient, parts, strict=True):
            total += part
