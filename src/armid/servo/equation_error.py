"""First estimate of servos and friction from the position error, joint by joint, by linear least squares.

A servo is a drive gain on the position error. Divided by the stiffness K, the equation of motion of a joint is
linear,

    c - q = g / K + (J / K) q̈ + ((d + D) / K) q̇ + (F / K) sgn q̇ + b,

with the torque g of the links of the description, rotor inertia J, viscous and dry friction d and F, and offset b. So
K is found where the links load the joint in different ways, and all else in proportion to K.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.signal import butter, sosfiltfilt

from armid import kernel
from armid.checked_array import Array
from armid.kernel.tree import Tree
from armid.servo.servo_run import ServoRun

CUTOFF = 5.0
"""Cut-off frequency of the zero-phase filter on both sides of the equation [Hz]."""

NYQUIST_SHARE = 0.4
"""Largest cut-off frequency as a share of half the sample rate."""

WIDTH = 0.02
"""Velocity over which the sign of dry friction changes [rad/s or m/s]; slower motion is encoder noise."""

TRIM = 0.5
"""Length at both ends of a run that is left out, because the filter does not know what was before [s]."""

SIGNIFICANT = 4.0
"""Number of standard deviations from which a load torque counts as seen. The deviations take the samples within a
period of the cut-off as one."""


@dataclass(frozen=True, eq=False, slots=True)
class EquationErrorFit:
    """Coefficients of each joint, divided by its stiffness; zero where the data show none.

    Attributes:
        compliance: 1 / K, shape (n,) [rad/(N·m) or m/N].
        deviation: Standard deviation of the compliance, shape (n,).
        inertia: J / K, shape (n,) [s²].
        viscous: (d + D) / K, shape (n,) [s].
        dry: F / K, shape (n,) [rad or m].
        offset: b, shape (n,) [rad or m].
    """

    compliance: Array
    deviation: Array
    inertia: Array
    viscous: Array
    dry: Array
    offset: Array

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """Mask of the joints whose load shows the stiffness, shape (n,)."""
        return self.compliance > SIGNIFICANT * self.deviation


def fit_equation_error(
    tree: Tree, inertial: Array, runs: Sequence[ServoRun], known: Array | None = None, delay: float = 0.0
) -> EquationErrorFit:
    """Fits each joint by least squares with coefficients that cannot be negative.

    Args:
        tree: The arm.
        inertial: Inertial parameters of the description, shape (n, 10).
        runs: Training runs.
        known: Stiffness of the joints for which it is known, NaN for the others, shape (n,).
        delay: Expected delay of the commands [s].
    """
    parts = [_columns(tree, inertial, run, delay) for run in runs]
    n = tree.n
    found = np.zeros((5, n))
    deviation = np.zeros(n)
    for j in range(n):
        columns = np.concatenate([x[:, j] for x, _, _ in parts])
        e = np.concatenate([error[:, j] for _, error, _ in parts])
        rows = sum(independent for _, _, independent in parts)
        fixed = known is not None and np.isfinite(known[j])
        if fixed and known is not None:
            e = e - columns[:, 0] / known[j]
            columns = columns.copy()
            columns[:, 0] = 0.0
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        unit = columns / scale
        both = np.column_stack([unit, -unit[:, 4]])  # an offset has either sign
        solution, _ = nnls(both, e)
        coefficients = solution[:5] / scale
        coefficients[4] -= solution[5] / scale[4]
        residual = e - columns @ coefficients
        information = unit.T @ unit + 1e-9 * np.eye(5)
        variance = float(residual @ residual) / max(rows - 5.0, 1.0)
        deviation[j] = np.sqrt(variance * np.linalg.inv(information)[0, 0]) / scale[0]
        found[:, j] = coefficients
        if fixed and known is not None:
            found[0, j], deviation[j] = 1.0 / known[j], 0.0
    return EquationErrorFit(found[0], deviation, *found[1:])


def _columns(tree: Tree, inertial: Array, run: ServoRun, delay: float) -> tuple[Array, Array, float]:
    """Columns (N, n, 5) and position errors (N, n) of a run, filtered alike, and its number of independent rows."""
    rate = 1.0 / run.step
    cutoff = min(CUTOFF, NYQUIST_SHARE * rate / 2.0)
    sections = butter(2, cutoff, fs=rate, output="sos")

    def low_pass(x: Array) -> Array:
        return sosfiltfilt(sections, x, axis=0, padlen=min(len(x) - 1, round(3.0 * rate / cutoff)))

    q = low_pass(run.q)
    dq = np.gradient(q, run.step, axis=0)
    ddq = np.gradient(dq, run.step, axis=0)
    load = kernel.inverse_dynamics(tree, inertial, q, dq, ddq)
    dry = low_pass(np.tanh(dq / WIDTH))
    error = low_pass(run.held(run.time - delay)) - q
    columns = np.stack([load, ddq, dq, dry, np.ones_like(q)], axis=2)
    trim = min(round(TRIM * rate), len(q) // 4)
    kept = slice(trim, len(q) - trim)
    return columns[kept], error[kept], (len(q) - 2 * trim) * 2.0 * cutoff / rate
