"""Robust M-estimate: rows with large residuals get smaller weights.

    minimise Σ_j Σ_m ϱ(r_jm / s_j),        r_jm = τ_jm - x_jm π,        ψ = ϱ'

Here r_jm is the residual of row m of joint j, with the torque τ_jm, the regressor row x_jm and the parameters π; ϱ is
the loss function with the derivative ψ, and s_j the scale of the residuals of the joint. The problem is solved by
iteratively reweighted least squares [Holland1977]: each iteration computes weights ψ(u) / u from the scaled residuals
u = r / s of the previous iteration. The scale s_j is the median of |r_j|, divided by the median of the absolute value
of a standard normal variable. `huber` is convex and has one minimum. `tukey` gives rows with very large residuals
zero weight. It may have several minima, so the iteration starts at the minimum of `huber`.

The covariance is not that of least squares with these weights, since the sensitivity of the estimate to a row is
given by the slope ψ', not by the weight [Huber1981, section 7.6]. With κ_j, the mean of ψ' over the rows of joint j
divided by the mean weight, noise changes the estimate by

    H⁻¹ Σ_j Σ_m x_jmᵀ ψ_jm / s_j,        H = Σ_j κ_j Σ_m (ψ_jm / u_jm) x_jmᵀ x_jm / s_j².

Least squares on rows with the weight κ ψ / u and the torque x π + r / κ has the same H, the same gradients and the
same estimate. So the covariance can be computed from the factors of such rows by the usual methods, for instance the
jackknife.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, did_you_mean
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.estimators.wls import RESOLUTION, WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.least_squares import Solution, solve
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.scale_covariance import scale_covariance
from armid.information.information import Information, JointFactors, stack, total
from armid.information.kept_rows import Batch, KeptRows, kept_rows
from armid.information.weighted_rows import weighted_information
from armid.maths.median import median
from armid.remedy import Remedy, setting
from armid.threads import one_blas_thread

HUBER, TUKEY = 1.345, 4.685
"""Constants of the losses `huber` and `tukey` with which the efficiency is 95 % under normal noise [Holland1977]."""

NORMAL_MEDIAN = 0.6744897501960817
"""Median of the absolute value of a standard normal variable."""

SETTLED = 1e-3
"""Change of a parameter, divided by its standard deviation, below which the iteration ends. Changes decrease by a
twentieth or more in each iteration, so the estimate is within a few hundredths of a standard deviation of its
limit."""

ROUNDING = 1e-10
"""Change of a parameter, divided by the largest parameter, below which the iteration ends for data without noise,
whose deviations are rounding errors."""

SCALED = 20
"""Number of iterations after which the scales are fixed. A median may change between two rows without end; with fixed
scales every iteration decreases the objective."""

SLIGHT = 0.5
"""Weight below which the finding counts a row as an outlier. With normal noise, 1 in 100 rows is counted for
`tukey` and 1 in 140 for `huber`."""

FLATTEST = 0.1
"""Lower limit of κ, the ratio of mean slope to mean weight. If κ is smaller, so many rows have residuals above the
constant of the loss that no covariance is meaningful."""


@dataclass(frozen=True, slots=True)
class RobustLeastSquares:
    """Estimate that is insensitive to rows with large residuals, for instance during contact.

    Attributes:
        loss: `tukey` gives large residuals zero weight; `huber` gives them a small weight.
        constant: Ratio of residual to scale above which weights are below one (`huber`) or zero (`tukey`); if not
            given, 1.345 for `huber` and 4.685 for `tukey`.
        iterations: Largest number of iterations with one loss; each iteration reads all rows once.
    """

    loss: Literal["huber", "tukey"] = "tukey"
    constant: float | None = None
    iterations: int = 300
    name: ClassVar[str] = "robust"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.loss not in ("huber", "tukey"):
            raise EstimationError(
                f"The option `loss` has the unknown value {self.loss!r}.",
                possible="huber, tukey",
                remedy=did_you_mean(self.loss, ("huber", "tukey")),
            )
        if self.constant is not None and not 0.0 < self.constant < np.inf:
            raise EstimationError(
                f"The option `constant` must be above 0; found {self.constant!r}.",
                possible="a number above 0",
                remedy="leave the option out, which gives 1.345 for huber and 4.685 for tukey.",
            )

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals.

        Raises:
            EstimationError: The data do not determine the parameters, the weights do not converge, or the problem
                contains no samples.
        """
        model, base, observations = problem.require_samples(self.name)
        start = WeightedLeastSquares().solve(problem)
        passes = _Passes(problem, kept_rows(model, base, observations))
        huber = _Loss("huber", self.constant if self.loss == "huber" and self.constant else HUBER)
        found = self._settle(passes, huber, _State(start.values, passes.scale(start.values)), moving=True)
        if self.loss == "tukey":
            found = self._settle(passes, _Loss("tukey", self.constant or TUKEY), found, moving=False)
        return passes.fit(start, found, model.robot.joint_names)

    def _settle(self, passes: _Passes, loss: _Loss, state: _State, *, moving: bool) -> _State:
        """Repeats iterations until the parameters converge.

        `moving` is true if the scales of the residuals are computed again in each iteration.
        """
        for k in range(self.iterations):
            updated = passes.improve(state, loss, moving=moving and k < SCALED)
            change = np.abs(updated.values - state.values)
            rounding = ROUNDING * np.abs(updated.values).max(initial=0.0)
            settled = bool((change <= SETTLED * updated.deviation + rounding).all())
            state = updated
            if settled:
                return state
        raise EstimationError(
            f"The weights of the rows did not converge in {self.iterations} iterations.",
            possible="wls, huber, or more iterations",
            remedy=Remedy(
                'use loss = "huber", or ', setting("method", "wls"), " and inspect the residual of each joint."
            ),
        )


@dataclass(frozen=True, slots=True)
class _Loss:
    """Loss function ϱ, given by the weight ψ(u) / u and the slope ψ'(u) of its derivative ψ."""

    kind: str
    constant: float

    def weight(self, u: Array) -> Array:
        if self.kind == "huber":
            return self.constant / np.maximum(np.abs(u), self.constant)
        return np.maximum(1.0 - (u / self.constant) ** 2, 0.0) ** 2

    def slope(self, u: Array) -> Array:
        if self.kind == "huber":
            return np.where(np.abs(u) <= self.constant, 1.0, 0.0)
        square = (u / self.constant) ** 2
        return np.where(square < 1.0, (1.0 - square) * (1.0 - 5.0 * square), 0.0)


@dataclass(frozen=True, eq=False, slots=True)
class _State:
    """State of the iteration.

    Attributes:
        values: Parameters, shape (b,).
        scale: Scale of the residuals of each joint, shape (n,).
        loss: Loss function of the last weights; `None` before the first iteration.
        deviation: Standard deviations of the parameters with the last weights, shape (b,).
    """

    values: Array
    scale: Array
    loss: _Loss | None = None
    deviation: Array = field(default_factory=lambda: np.zeros(0))


class _Passes:
    """Computations that read all rows of a problem, batch by batch."""

    def __init__(self, problem: EstimationProblem, every: KeptRows) -> None:
        self.information = problem.information
        self.every = every
        self.names = every.source.names
        self.own = np.array([name not in problem.information.names for name in self.names])
        rows = problem.information.rows.sum(axis=0)
        whole = total(problem.information)
        torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
        self.floor = RESOLUTION * torque / np.sqrt(np.maximum(rows, 1))
        self.floor[torque == 0.0] = 1.0  # a joint without rows in use may have any scale
        self.free = 1.0 - problem.information.count / max(float(rows.sum()), problem.information.count + 1.0)

    def residual(self, batch: Batch, j: int, values: Array) -> Array:
        """Residuals of the M rows of joint j in a batch, for parameters `values` (b,), shape (M,) [N·m or N]."""
        layout, recording = self.every.source.layout, self.every.observations.runs[batch.run].recording
        numbers = self._numbers(recording)[layout.parameters[j]]
        a, b = layout.offset[j], layout.offset[j + 1]
        return batch.x[b - 1] - values[numbers] @ batch.x[a : b - 1]

    def _numbers(self, recording: int) -> NDArray[np.intp]:
        """Index of each base parameter, or of its copy for a recording, among the parameters of the information."""
        if not self.own.any():
            return np.arange(len(self.names))
        index = {name: k for k, name in enumerate(self.information.names)}
        copies = [
            name.of_recording(recording + 1) if own else name for name, own in zip(self.names, self.own, strict=True)
        ]
        return np.array([index[name] for name in copies], dtype=np.intp)

    def scale(self, values: Array) -> Array:
        """Scale of the residuals of each joint, shape (n,), from the median of their absolute values.

        The scale is corrected for the degrees of freedom.
        """
        sizes: list[list[Array]] = [[] for _ in self.floor]
        for batch in self.every:
            for j, own in enumerate(sizes):
                own.append(np.abs(self.residual(batch, j, values))[batch.mask[:, j]])
        joined = [np.concatenate(own) for own in sizes]
        middle = np.array([float(median(own)) if len(own) else 0.0 for own in joined])
        return np.maximum(middle / (NORMAL_MEDIAN * np.sqrt(self.free)), self.floor)

    def improve(self, state: _State, loss: _Loss, *, moving: bool) -> _State:
        """Makes one iteration: weights from the residuals, then parameters from the weighted rows, then scales.

        The scales are computed only if `moving` is true.
        """
        solution = solve(self.weighted(state, loss, blocks=False), 1.0 / state.scale)
        scale = self.scale(solution.values) if moving else state.scale
        return _State(solution.values, scale, loss, np.sqrt(np.diag(solution.inverse)))

    def weighted(self, state: _State, loss: _Loss, *, blocks: bool) -> Information:
        """Factors of the rows with the weights of a loss.

        Args:
            state: Parameters and scales from which the weights are computed.
            loss: The loss.
            blocks: True to keep the blocks of the information separate, false to merge them.
        """

        def weigh(batch: Batch, j: int) -> Array:
            return loss.weight(self.residual(batch, j, state.values) / state.scale[j])

        return separate_by_recording(weighted_information(self.every, weigh, blocks=blocks), self.own)

    def fit(self, start: Fit, state: _State, joints: tuple[str, ...]) -> Fit:
        """Makes the fit, with the factors and scales from which the covariance is computed.

        Args:
            start: Fit by weighted least squares, from which the entries that do not change are taken.
            state: Last state of the iteration.
            joints: Names of the joints.
        """
        loss = state.loss
        assert loss is not None  # at least one iteration has run
        kappa, squares, slight = self._means(state, loss)
        working = _working(self.weighted(state, loss, blocks=True), state.values, kappa)
        working = replace(working, scale_deviation=self.information.scale_deviation)
        whole, weights = total(working), 1.0 / state.scale
        solution = Solution(whole, weights)
        A, _ = stack(whole, weights * np.sqrt(squares / kappa))  # mean ψ² for every mean ψ' of H
        half = A @ solution.inverse  # the product of a factor with itself has no negative variance
        white = half.T @ half
        once = total(self.information)
        return replace(
            start,
            values=state.values,
            white_deviation=np.sqrt(np.diag(white)),
            covariance=white + scale_covariance(whole, weights, solution.inverse),
            residual_rms=np.sqrt(held_out_squares(once, state.values) / np.maximum(once.rows[0], 1)),
            weights=weights,
            findings=(_finding(slight, once.rows[0], joints),),
            information=working,
        )

    def _means(self, state: _State, loss: _Loss) -> tuple[Array, Array, NDArray[np.int64]]:
        """Three values for each joint, shape (n,): κ, mean ψ² / mean weight, and number of weights below `SLIGHT`.

        The second value is corrected for the degrees of freedom; the symbols are those of the module.
        """
        sums = np.zeros((len(self.floor), 4))
        for batch in self.every:
            for j, row in enumerate(sums):
                u = self.residual(batch, j, state.values)[batch.mask[:, j]] / state.scale[j]
                weight = loss.weight(u)
                row += [loss.slope(u).sum(), weight.sum(), ((weight * u) ** 2).sum(), (weight < SLIGHT).sum()]
        kappa = np.maximum(sums[:, 0] / np.maximum(sums[:, 1], 1.0), FLATTEST)
        squares = sums[:, 2] / (self.free * np.maximum(sums[:, 1], 1.0))
        return kappa, squares, sums[:, 3].astype(np.int64)


def _working(weighted: Information, values: Array, kappa: Array) -> Information:
    """Factors of rows with weight κ ψ / u and torque x π + r / κ, from factors with weight ψ / u and measured torque.

    Least squares on these rows has the covariance of the robust estimate; the symbols are those of the module.
    """
    joints: list[JointFactors] = []
    for share, joint in zip(kappa, weighted.joints, strict=True):
        R = np.sqrt(share) * joint.R
        R[:, :, -1] = R[:, :, -1] / share + (1.0 - 1.0 / share) * (R[:, :, :-1] @ values[joint.parameters])
        joints.append(JointFactors(joint.parameters, R))
    return replace(weighted, joints=tuple(joints))


def _finding(slight: NDArray[np.int64], rows: NDArray[np.int64], joints: tuple[str, ...]) -> Finding:
    """Finding that states, for each joint, the number of rows whose weight is below one half."""
    shares = ", ".join(
        f"{name} {count} of {of}" for name, count, of in zip(joints, slight.tolist(), rows.tolist(), strict=True)
    )
    return Finding("rows-down-weighted", "info", "", f"Number of rows with a weight below one half: {shares}.")
