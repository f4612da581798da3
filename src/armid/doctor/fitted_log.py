"""A log as it is interpreted, the fit of a model to it, and evidence from the fit about faults of the log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.doctor.downsample import DownsampledLog
from armid.doctor.earlier_run_links import DESCRIPTION, KnownLinks, torque_with_load
from armid.doctor.quick_fit import QuickFit, QuickRows, make_rows, solve, solve_joint
from armid.information.base_regressor_layout import ColumnSource, column_source, torque_source
from armid.information.filtered_rows import all_rows
from armid.information.filtering import in_band, rows_in_band
from armid.measurement.observations import ObservedRun
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

JOINT_SYMBOLS = ("FV", "FS", "FO", "IA")
"""Symbols of parameters that belong to one joint only: friction, offset, rotor inertia."""

POSES = 40
"""Number of poses along the motion at which the inertias about the joints are computed."""


@dataclass(frozen=True, eq=False, slots=True)
class DescriptionComparison:
    """Comparison of measured and described torque for each joint, after friction and offset are projected out.

    The description is that of the arm, or the links of an earlier run.

    Attributes:
        scale: Factor from described to measured torque, shape (n,).
        correlation: Correlation of described and measured torque, shape (n,).
        size: RMS of the described torque after friction and offset are projected out, shape (n,) [N·m or N].
    """

    scale: Array
    correlation: Array
    size: Array

    @property
    def alike(self) -> float:
        """Correlation of described and measured torque: mean over the joints, weighted with the described torque."""
        return float(self.size @ self.correlation / self.size.sum()) if self.size.any() else 0.0


@dataclass(frozen=True, eq=False)
class LogState:
    """A log as it is interpreted (signs, zeros, order of channels …), and the model that is fitted to it.

    Attributes:
        model: Arm and torque terms.
        base: Base parameters of the model.
        log: The recording at a moderate sampling rate.
        known: Links that are compared with the log instead of those of the description.
        change_corrected: True if a change within the log was already found and corrected.
    """

    model: DynamicsModel
    base: BaseParameters
    log: DownsampledLog
    known: KnownLinks | None = None
    change_corrected: bool = False

    @cached_property
    def source(self) -> ColumnSource:
        """Source of the columns of the base parameters."""
        return column_source(self.model, self.base)

    @cached_property
    def rows(self) -> QuickRows:
        """Filtered regressor columns and torque of the log."""
        return make_rows(self.source, self.log)

    def with_torque(self, factor: Array) -> LogState:
        """The same state with the torque of each joint multiplied by a factor (n,); the columns are reused."""
        runs = tuple(replace(run, torque=run.torque * factor) for run in self.log.runs)
        after = self.on(replace(self.log, runs=runs))
        after.__dict__["rows"] = replace(self.rows, torque=self.rows.torque * factor)
        return after

    def without_change(self, change: Array) -> LogState:
        """The same state with a change within the log taken back.

        Args:
            change: Torque by which the changed rows differ from the others, shape (M, n) [N·m or N]. It is
                interpolated between the rows, which are dense enough for the band of the log.
        """
        corrected = self.without_torque(change)
        after = replace(corrected, change_corrected=True)
        after.__dict__["source"], after.__dict__["rows"] = corrected.source, corrected.rows
        return after

    def without_torque(self, change: Array) -> LogState:
        """The same state without a torque at the rows, shape (M, n) [N·m or N], which is interpolated in between."""
        ends = np.cumsum([len(run.rows) for run in self.log.runs])[:-1]
        runs: list[ObservedRun] = []
        for run, own in zip(self.log.runs, np.split(change, ends), strict=True):
            at, time = run.motion.time[run.rows], run.motion.time
            lifted = np.column_stack([np.interp(time, at, column) for column in own.T])
            runs.append(replace(run, torque=run.torque - lifted))
        after = self.on(replace(self.log, runs=tuple(runs)))
        after.__dict__["rows"] = replace(self.rows, torque=self.rows.torque - change)
        return after

    def with_torques(self, torques: Sequence[Array]) -> LogState:
        """The same state with another torque of each run, shape (N, n) [N·m or N]; the columns are reused."""
        runs = tuple(replace(run, torque=x) for run, x in zip(self.log.runs, torques, strict=True))
        after = self.on(replace(self.log, runs=runs))
        source = torque_source(self.model)
        filtered = [all_rows(source, run, after.log.band) for run in runs]
        after.__dict__["rows"] = replace(self.rows, torque=np.concatenate(filtered, axis=1).T)
        return after

    def on(self, log: DownsampledLog) -> LogState:
        """The same model, to be fitted to another log."""
        after = replace(self, log=log)
        after.__dict__["source"] = self.source  # where `cached_property` keeps it
        return after

    def without(self, left_out: NDArray[np.bool_]) -> LogState:
        """The same state without some rows.

        Args:
            left_out: Mask of the rows that are left out, shape (M, n), or (M,) for all joints.
        """
        flags = left_out[:, None] if left_out.ndim == 1 else left_out
        ends = np.cumsum([len(run.mask) for run in self.log.runs])[:-1]
        included = np.split(~flags, ends)
        runs = tuple(replace(run, mask=run.mask & rows) for run, rows in zip(self.log.runs, included, strict=True))
        after = self.on(replace(self.log, runs=runs))
        after.__dict__["rows"] = replace(self.rows, mask=self.rows.mask & ~flags)
        return after

    @cached_property
    def fit(self) -> QuickFit:
        """Fit of all joints with one set of parameters."""
        return solve(self.rows)

    @cached_property
    def joint_fits(self) -> tuple[QuickFit, ...]:
        """Separate fit of each joint, with separate parameters."""
        return tuple(solve_joint(self.fit, j, self._joint_rows(j)) for j in range(self.rows.n))

    @property
    def conflict(self) -> float:
        """Conflict between the joints: increase of the residual if one model is fitted to all joints.

        It is the logarithm of the RMS residual with one model for all joints minus that with a separate model for
        each joint, averaged over the joints.

        An effect that the model does not contain, such as friction at reversals, increases both residuals and
        cancels. A large conflict therefore shows wrong geometry: order of channels, gravity, zeros, signs or scales.
        """
        alone = np.array([fit.sigma[0] for fit in self.joint_fits])
        return self.fit.cost - float(np.mean(np.log(alone)))

    def _joint_rows(self, j: int) -> QuickRows:
        """Rows of joint j alone, with its own parameters numbered from 0."""
        rows, count = self.rows, len(self.rows.parameters[j])
        return replace(
            rows,
            columns=(rows.columns[j],),
            parameters=(np.arange(count, dtype=np.int32),),
            count=count,
            torque=rows.torque[:, [j]],
            mask=rows.mask[:, [j]],
        )

    def symbols(self, j: int) -> list[str]:
        """Symbols of the parameters of joint j's columns; an empty text for parameters of other joints."""
        parameters = [self.model.parameters[self.base.kept[p]] for p in self.rows.parameters[j]]
        return [p.symbol if p.number == j + 1 or p.symbol not in JOINT_SYMBOLS else "" for p in parameters]

    def standard(self, values: Array) -> Array:
        """Standard parameters (p,) that give the same torque as base parameters (b,)."""
        theta = np.zeros(len(self.model.parameters))
        theta[self.base.kept] = values[: self.base.count]
        return theta

    def rigid_torque(self, theta: Array) -> Array:
        """Filtered torque of the links at the rows, shape (M, n) [N·m or N]."""
        bodies = self._bodies(theta)
        return self.at_rows(lambda run: self._torque(bodies, run.motion, run.motion.q))

    def rigid_slopes(self, theta: Array, step: float) -> Array:
        """Filtered derivative of the torque of the links by each position at the rows, shape (n, M, n) [N·m/rad].

        Args:
            theta: Standard parameters.
            step: Displacement of the central difference [rad or m].
        """
        bodies, moves = self._bodies(theta), np.eye(self.rows.n) * step

        def slopes(run: ObservedRun) -> Array:
            m = run.motion
            moved = [self._torque(bodies, m, m.q + e) - self._torque(bodies, m, m.q - e) for e in moves]
            return np.stack(moved, axis=1) / (2.0 * step)

        return np.moveaxis(self.at_rows(slopes), 1, 0)

    def torque_slope(self) -> Array:
        """Time derivative of the filtered torque at the rows, shape (M, n) [N·m/s]."""
        parts = [
            np.gradient(in_band(run.torque, run.rate, self.log.band), 1.0 / run.rate, axis=0)[run.rows]
            for run in self.log.runs
        ]
        return np.concatenate(parts)

    def _bodies(self, theta: Array) -> Array:
        """Inertial parameters of the links, shape (n, 10), taken from standard parameters (p,)."""
        return theta[self.model.inertial_columns].reshape(-1, 10)

    def _torque(self, bodies: Array, motion: Motion, q: Array) -> Array:
        """Torque of the links (N, n) with the velocities of a motion at other positions q (N, n)."""
        return kernel.inverse_dynamics(self.model.tree, bodies, q, motion.dq, motion.ddq)

    def at_rows(self, compute: Callable[[ObservedRun], Array]) -> Array:
        """Filters the values (N, ...) that a function computes for each run and takes their rows (M, ...)."""
        parts: list[Array] = []
        for run in self.log.runs:
            x, raw = compute(run), self.log.band.is_open or not run.consecutive
            parts.append(x[run.rows] if raw else rows_in_band(run, x, self.log.band))
        return np.concatenate(parts)

    def joint_columns(self, j: int) -> Array:
        """Regressor columns of friction, offset and rotor inertia of joint j, shape (M, k) for k such parameters."""
        joint_rows = [k for k, symbol in enumerate(self.symbols(j)) if symbol in JOINT_SYMBOLS]
        return self.rows.columns[j][joint_rows].T

    @property
    def reference(self) -> str:
        """Name, for use in sentences, of the links that are compared with the log."""
        return DESCRIPTION if self.known is None else self.known.source

    @cached_property
    def described(self) -> Array | None:
        """Standard parameters (p,) of the links that are compared with the log.

        The result is `None` if these links are not known.
        """
        if self.known is None:
            return self.model.nominal_parameters()
        theta = np.zeros(len(self.model.parameters))
        theta[self.model.inertial_columns] = self.known.bodies.ravel()
        return theta

    @cached_property
    def nominal(self) -> DescriptionComparison | None:
        """Comparison with the torque of the description; `None` if the description contains no inertias."""
        theta = self.described
        if theta is None:
            return None
        friction = [np.linalg.qr(self.joint_columns(j) * self.rows.mask[:, [j]])[0] for j in range(self.rows.n)]
        described = self._with_load(self.rigid_torque(theta), friction)
        scale, correlation, size = np.zeros((3, self.rows.n))
        for j, whole in enumerate(friction):
            included = self.rows.mask[:, j]
            Q = whole[included]
            x, y = described[included, j], self.rows.torque[included, j]
            x, y = x - Q @ (Q.T @ x), y - Q @ (Q.T @ y)
            power = float(x @ x)
            size[j] = np.sqrt(power / max(len(x), 1))
            if power > 0.0 and (y @ y) > 0.0:
                scale[j], correlation[j] = x @ y / power, x @ y / np.sqrt(power * (y @ y))
        return DescriptionComparison(scale, correlation, size)

    def _with_load(self, described: Array, friction: Sequence[Array]) -> Array:
        """Described torque (M, n), with the load that fits the log best if a link of the earlier run may carry one.

        Args:
            described: Torque of the links, shape (M, n).
            friction: Orthonormal columns of each joint's friction, offset and rotor inertia, n of shape (M, k).
        """
        if self.known is None or self.known.loaded is None:
            return described
        own = self.model.inertial_columns.reshape(-1, 10)[self.known.loaded]
        to_base, mask = self.base.regrouping[:, own], self.rows.mask
        columns = [
            (to_base[parameters].T @ x).T * mask[:, [j]]
            for j, (parameters, x) in enumerate(zip(self.rows.parameters, self.rows.columns, strict=True))
        ]
        return torque_with_load(
            described * mask, columns, friction, self.rows.torque * mask, self.fit.sigma, self.known.usual_load
        )

    @cached_property
    def dissipation(self) -> Array:
        """Mean power that each joint loses by friction, divided by the standard deviation of this power, (n,)."""
        z = np.zeros(self.rows.n)
        for j, fit in enumerate(self.joint_fits):
            power = np.array(
                [
                    float(np.mean(column * self.rows.motion.dq[:, j])) if symbol in ("FV", "FS") else 0.0
                    for symbol, column in zip(self.symbols(j), self.rows.columns[j], strict=True)
                ]
            )
            z[j] = _certainty(power, fit)
        return z

    @cached_property
    def inertia(self) -> Array:
        """Mean inertia about each joint over some poses, divided by the standard deviation of this mean, (n,)."""
        rows, n = self.rows, self.rows.n
        q = rows.motion.q[:: max(1, rows.motion.samples // POSES)]
        still = np.zeros_like(q)
        rest = self.model.regressor(Motion.of_states(q, still, still))
        z = np.zeros(n)
        for j, fit in enumerate(self.joint_fits):
            unit = still.copy()
            unit[:, j] = 1.0
            per_acceleration = (self.model.regressor(Motion.of_states(q, still, unit)) - rest)[:, j].mean(axis=0)
            z[j] = _certainty(per_acceleration[self.base.kept[rows.parameters[j]]], fit)
        return z


def _certainty(direction: Array, fit: QuickFit) -> float:
    """Scalar product of a direction and the fitted parameters, divided by the standard deviation of this product."""
    spread = float(np.sqrt(max(direction @ fit.covariance @ direction, 0.0)))
    return float(direction @ fit.values) / spread if spread > 0.0 else 0.0
