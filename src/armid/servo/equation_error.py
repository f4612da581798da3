"""First estimate of servos and friction from the position error, joint by joint, by linear least squares.

A servo is a drive gain on the position error. Divided by the stiffness K, the equation of motion of a joint is
linear,

    c - q = g / K + (J / K) q̈ + ((d + D) / K) q̇ + (F / K) sgn q̇ + b,

with the torque g of the links of the description, rotor inertia J, viscous and dry friction d and F, and offset b. So
K is found where the links load the joint in different ways, and all else in proportion to K. A servo at its largest
torque gives K times a constant s, whatever the position error is, so c - q is limited to ± s in such a joint. The s
with which the equation holds best is taken.
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

QUANTILES = (0.998, 0.995, 0.99, 0.97, 0.94, 0.9, 0.8, 0.7, 0.5, 0.35)
"""Quantiles of the size of the position error of a joint that are tried as the error at its largest torque."""

SMALLEST_SATURATION = 1e-4
"""Smallest position error at the largest torque that is tried [rad or m]: commands may be copies of positions."""

SATURATED = 0.25
"""Share of the misfit without saturation below which that with saturation is taken. It was at most 0.15 where a tenth
of the rows of virtual arms saturate, and at least 0.3 on real arms with stiction and without saturation."""


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
        saturation: Position error at the largest torque, infinite where none shows, shape (n,) [rad or m].
        largest: Largest position error without the offset, shape (n,) [rad or m].
    """

    compliance: Array
    deviation: Array
    inertia: Array
    viscous: Array
    dry: Array
    offset: Array
    saturation: Array
    largest: Array

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """Mask of the joints whose load shows the stiffness, shape (n,)."""
        return self.compliance > SIGNIFICANT * self.deviation


@dataclass(frozen=True, eq=False, slots=True)
class _JointFit:
    """Coefficients (5,) of a joint, deviation of the first one, and misfit relative to the position error."""

    coefficients: Array
    deviation: float
    misfit: float


def fit_equation_error(
    tree: Tree,
    inertial: Array,
    runs: Sequence[ServoRun],
    known: Array | None = None,
    delay: float = 0.0,
    *,
    saturated: bool = False,
) -> EquationErrorFit:
    """Fits each joint by least squares with coefficients that cannot be negative.

    Args:
        tree: The arm.
        inertial: Inertial parameters of the description, shape (n, 10).
        runs: Training runs.
        known: Stiffness of the joints for which it is known, NaN for the others, shape (n,).
        delay: Expected delay of the commands [s].
        saturated: True if position errors at the largest torque are looked for.
    """
    filters = [_LowPass(run) for run in runs]
    columns = [_columns(tree, inertial, run, low_pass) for run, low_pass in zip(runs, filters, strict=True)]
    errors = [run.held(run.time - delay) - run.q for run in runs]
    rows = sum(low_pass.independent for low_pass in filters)
    fits, saturation = [], np.full(tree.n, np.inf)
    for j in range(tree.n):
        own = np.concatenate([x[:, j] for x in columns])
        compliance = 1.0 / known[j] if known is not None and np.isfinite(known[j]) else None

        def fit(
            limit: float, middle: float = 0.0, j: int = j, own: Array = own, compliance: float | None = compliance
        ) -> _JointFit:
            limited = [
                low_pass(np.clip(e[:, j], middle - limit, middle + limit))
                for e, low_pass in zip(errors, filters, strict=True)
            ]
            return _fit_joint(own, np.concatenate(limited), rows, compliance)

        found = fit(np.inf)
        offset = float(found.coefficients[4])
        sizes = np.abs(np.concatenate([e[:, j] for e in errors]) - offset)
        for limit in np.quantile(sizes, QUANTILES if saturated else ()):
            if limit < SMALLEST_SATURATION:
                continue
            other = fit(limit, offset)
            better = SATURATED * found.misfit if np.isinf(saturation[j]) else found.misfit
            if other.misfit < better:
                found, saturation[j] = other, limit
        fits.append(found)
    coefficients = np.array([each.coefficients for each in fits]).T
    largest = np.max([np.abs(e - coefficients[4]).max(axis=0) for e in errors], axis=0)
    deviation = np.array([each.deviation for each in fits])
    compliance, inertia, viscous, dry, offset = coefficients
    return EquationErrorFit(compliance, deviation, inertia, viscous, dry, offset, saturation, largest)


def _fit_joint(columns: Array, error: Array, rows: float, compliance: float | None) -> _JointFit:
    """Fit of a joint with columns (N, 5) and position errors (N,), of which `rows` are independent."""
    if compliance is not None:
        error = error - columns[:, 0] * compliance
        columns = columns.copy()
        columns[:, 0] = 0.0
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale
    both = np.column_stack([unit, -unit[:, 4]])  # an offset has either sign
    solution, _ = nnls(both, error)
    coefficients = solution[:5] / scale
    coefficients[4] -= solution[5] / scale[4]
    residual = error - columns @ coefficients
    information = unit.T @ unit + 1e-9 * np.eye(5)
    square = float(residual @ residual)
    deviation = float(np.sqrt(square / max(rows - 5.0, 1.0) * np.linalg.inv(information)[0, 0]) / scale[0])
    if compliance is not None:
        coefficients[0], deviation = compliance, 0.0
    misfit = square / max(float(error @ error), 1e-300)
    return _JointFit(coefficients, deviation, misfit)


class _LowPass:
    """Zero-phase low-pass filter of a run, without the ends that it does not know."""

    def __init__(self, run: ServoRun) -> None:
        rate = 1.0 / run.step
        cutoff = min(CUTOFF, NYQUIST_SHARE * rate / 2.0)
        trim = min(round(TRIM * rate), run.samples // 4)
        self._sections = butter(2, cutoff, fs=rate, output="sos")
        self._pad = min(run.samples - 1, round(3.0 * rate / cutoff))
        self.kept = slice(trim, run.samples - trim)
        self.independent: float = (run.samples - 2 * trim) * 2.0 * cutoff / rate

    def whole(self, x: Array) -> Array:
        """Filtered columns of x (N, …), with their ends."""
        return np.asarray(sosfiltfilt(self._sections, x, axis=0, padlen=self._pad), dtype=np.float64)

    def __call__(self, x: Array) -> Array:
        """Filtered columns of x (N, …) without their ends."""
        return self.whole(x)[self.kept]


def _columns(tree: Tree, inertial: Array, run: ServoRun, low_pass: _LowPass) -> Array:
    """Columns (N, n, 5) of a run, filtered like the position errors, without the ends."""
    q = low_pass.whole(run.q)
    dq = np.gradient(q, run.step, axis=0)
    ddq = np.gradient(dq, run.step, axis=0)
    load = kernel.inverse_dynamics(tree, inertial, q, dq, ddq)
    dry = low_pass.whole(np.tanh(dq / WIDTH))
    return np.stack([load, ddq, dq, dry, np.ones_like(q)], axis=2)[low_pass.kept]
