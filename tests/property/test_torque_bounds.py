"""Bounds of torque between the points of a grid: never below what happens, and not far above."""

from __future__ import annotations

import numpy as np
import pytest

from armid import kernel
from armid.excitation.fourier import Excitation
from armid.excitation.limits.torque_curvature import ORDERS, torque_curvature
from trees import random_tree, structured_tree

ROUNDING = 1e-5
"""Of second differences with a step of 1e-3 s, relative: torque is known to fifteen digits, and they lose six."""

FAR = 3000.0
"""Norms add up whatever the directions; along twelve joints that exaggerates so much."""


@pytest.mark.parametrize("seed", range(24))
def test_second_derivatives_stay_below_the_bound(seed: int):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 7
    tree = (structured_tree if seed % 3 == 0 else random_tree)(rng, n)
    a, b = rng.normal(scale=0.4, size=(2, n, 3))
    series = Excitation(1.3, a, b, rng.normal(size=n))
    inertial = rng.normal(size=(n, 10))  # of no bodies: base parameters need not be those of any
    step = 1e-3
    time = np.arange(0.0, series.period, step)
    torque = kernel.inverse_dynamics(tree, inertial, *(getattr(series.at(time), key) for key in ("q", "dq", "ddq")))
    seen = np.abs(np.diff(torque, n=2, axis=0)).max(axis=0) / step**2
    frequency = 1.3 * np.arange(1.0, 4.0)
    amplitude = np.hypot(a, b)
    derivatives = np.array([amplitude @ frequency ** (order - 1) for order in range(ORDERS + 1)])
    derivatives[0] += np.abs(series.offset)
    bound = torque_curvature(tree, inertial, derivatives)
    assert (seen <= bound * (1.0 + ROUNDING)).all()
    assert (bound <= FAR * np.maximum(seen, 1e-3 * seen.max())).all()


def test_a_pendulum_by_hand():
    """One joint about a horizontal axis: τ = I q̈ + m g l cos q, where every bound is known."""
    tree = kernel.Tree(
        np.array([-1]), np.array([False]), np.array([[0.0, 0.0, 1.0]]), np.eye(3)[None], np.zeros((1, 3)),
        np.array([0.0, -9.81, 0.0]),
    )  # fmt: skip
    inertial = np.zeros((1, 10))
    inertial[0, 9] = 2.0
    derivatives = np.array([[1.0], [0.5], [0.7], [0.9], [1.1]])
    assert torque_curvature(tree, inertial, derivatives)[0] >= 2.0 * 1.1
    weight = np.zeros((1, 10))
    weight[0, 1] = 3.0
    lowest = 3.0 * 9.81 * (0.7 + 0.5**2)  # |d²/dt² of a unit vector| times weight
    assert torque_curvature(tree, weight, derivatives)[0] >= lowest
