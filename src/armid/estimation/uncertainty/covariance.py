"""Covariance of an estimate, chosen so that intervals have the correct coverage, and the reason for the choice.

Residuals of filtered recordings are correlated over many rows. Intervals that assume white residuals then contain the
true value in about a third of the cases instead of 95 %. The kind of covariance depends on samples and motion:

- `white`, equations (2.44) to (2.47) of the thesis, only if the residuals pass a test of whiteness;
- `period`, from the scatter between periods, if the motion was repeated often enough and the residual does not repeat
  with the motion. If the residual repeats, the scatter shows the repeatability of the estimate and not its error;
- `spectral`, from the spectra of the residuals and of the columns, correlations between joints included;
- `block`, from the scatter between blocks of rows, if factors but no samples are available.

All kinds have the form H⁻¹ (S + c P) H⁻¹. H is the normal matrix, prior included. S is the covariance of the
right-hand side that the noise of the data causes. P is the precision of the prior in units of one row (the cone of
consistent bodies counts as a prior). c is the number of rows that count as one independent sample, which is the unit
of the weight of the prior. For S = c (H - P), the form becomes c H⁻¹, the posterior covariance. For an estimate on
the boundary of the cone, the distance to the analytic centre is added. Covariances of standard parameters are
computed from those of base parameters; a standard parameter that is also a base parameter has the same interval.

A parameter that an estimator sets to zero has the interval of the estimate with all parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.fit_result import CovarianceReport, Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.standard_parameter_resolution import stated
from armid.estimation.uncertainty.covariance_choice_thresholds import (
    EXPECTED_SHIFT,
    FEWEST_BLOCKS,
    FEWEST_PERIODS,
    FEWEST_ROWS,
    MAX_REPEATED,
    RATE_TOLERANCE,
    SHIFT_SHARE,
    WHITENESS_LEVEL,
)
from armid.estimation.uncertainty.cross_products_by_frequency import BandProducts, band_products, find_periods
from armid.estimation.uncertainty.jackknife import RepetitionBlocks, block_covariance, jackknife, periods
from armid.estimation.uncertainty.noise_spectrum import MAX_SIZE, LevelScatter, NoiseModel
from armid.estimation.uncertainty.reversal_sensitivity import shift_by_reversals
from armid.estimation.uncertainty.scale_covariance import scale_covariance
from armid.estimation.uncertainty.systematic.effect_on_fit import effect_on_fit
from armid.estimation.uncertainty.systematic.regressor_noise import noise_finding
from armid.estimation.uncertainty.systematic.systematic_error_effect import ErrorEffect, error_findings
from armid.estimation.uncertainty.whiteness import whiteness
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.information import Information, stack, total
from armid.threads import one_blas_thread

SMALLEST_P = 1e-6
"""Smallest probability that a message states as a number; for smaller ones, the message states this limit."""

MIN_EIGENVALUE = 1e-13
"""Lower limit of an eigenvalue of the normal matrix with unit columns. If neither data nor prior determine a
direction, the direction then gets a very large variance, and there is no division by zero."""


@one_blas_thread
def estimate_covariance(fit: Fit, source: EstimationProblem | Information, *, systematic_errors: bool = True) -> Fit:
    """Estimates the covariance of a fit so that intervals have the correct coverage, and states the reason.

    Args:
        fit: Fit of an estimator.
        source: The problem, whose samples are processed again; or only information, with separate blocks.
        systematic_errors: False to leave systematic errors out, as textbooks do; for comparisons only.
    """
    problem = source if isinstance(source, EstimationProblem) else EstimationProblem(source)
    return Uncertainty(fit, problem).with_covariance(systematic_errors=systematic_errors)


def choose_covariance_kind(white: float, free: int | None, repeated: float) -> tuple[str, str]:
    """Chooses the kind of covariance if samples are available; returns the kind and the reason.

    Args:
        white: p-value of the test of whiteness.
        free: Degrees of freedom of the scatter between periods; `None` if the motion does not repeat.
        repeated: Variance of the mean residual of all periods, divided by the variance that independent periods would
            give.
    """
    if white >= WHITENESS_LEVEL:
        return "white", f"residuals are uncorrelated in time (test of whiteness, p = {white:.2g})"
    p_value = f"p = {white:.1g}" if white > SMALLEST_P else f"p < {SMALLEST_P:g}"
    correlated = f"residuals are correlated in time (test of whiteness, {p_value})"
    if free is None:
        return "spectral", correlated
    if free < FEWEST_PERIODS - 1:
        return "spectral", f"{correlated}, and there are fewer than {FEWEST_PERIODS} periods"
    if repeated > MAX_REPEATED:
        return (
            "spectral",
            f"{correlated}; their part that repeats with the motion has {repeated:.1f} times the variance expected "
            "by chance",
        )
    return "period", f"{correlated}, and the motion repeats"


class Uncertainty:
    """Computes the covariance of a fit, of the kind that samples and motion allow.

    Attributes:
        fit: Fit of an estimator.
        problem: The problem, with its samples if it has any.
        information: Factors of the same rows in the parameters of the fit.
        prior: Precision of the prior, shape (b, b).
        inverse: Inverse of the normal matrix, prior included, shape (b, b).
        known_covariance: Covariance by prior and torque scales, which is added to that from noise, shape (b, b).
        moved: Shift of the estimate by rows near velocity reversals, multiplied by the share that counts as one
            standard deviation, shape (b,).
        observed: Mask of the parameters on which the rows depend, shape (b,).
        errors: Effect of systematic errors of measurement and friction; empty if there are no samples.
    """

    def __init__(self, fit: Fit, problem: EstimationProblem, information: Information | None = None) -> None:
        self.fit, self.problem = fit, problem
        own = problem.information if fit.information is None else fit.information
        self.information = own if information is None else information
        self.whole = total(self.information)
        b = self.whole.count
        self.prior = np.zeros((b, b)) if fit.prior_precision is None else fit.prior_precision
        self.inverse: Array = self._inverse_with(self.prior)
        self.known_covariance = scale_covariance(self.whole, fit.weights, self.inverse)
        # A prior of precision P in rows has the covariance c P⁻¹ and changes the estimate by H⁻¹ P of its error.
        by_prior = fit.prior_correlation * (self.inverse @ self.prior @ self.inverse)
        self.known_covariance = self.known_covariance + by_prior + self.misfit_covariance
        self.moved: Array = np.zeros(b)  # by reversals
        self.observed: NDArray[np.bool_] = np.ones(b, dtype=np.bool_)
        self.errors = ErrorEffect(covariance=np.zeros((b, b)), attenuation=np.zeros(b))

    def _inverse_with(self, prior: Array) -> Array:
        """Inverse of the normal matrix if the prior has the precision `prior` (b, b), shape (b, b)."""
        # The prior counts in the scale: it may be so much surer of some parameters than the data that it would round
        # away what these say of all others.
        A = stack(self.whole, self.fit.weights)[0]
        length = np.sqrt(np.sum(A**2, axis=0) + np.diag(prior))
        length = np.where(length > 0.0, length, 1.0)
        A = A / length
        values, vectors = np.linalg.eigh(A.T @ A + prior / np.outer(length, length))
        half = vectors / np.sqrt(np.maximum(values, MIN_EIGENVALUE)) / length[:, None]
        return np.asarray(half @ half.T, dtype=np.float64)

    @property
    def misfit_covariance(self) -> Array:
        """Covariance that is added because links differ more from the description than the prior says, (b, b)."""
        change, excess = self.inverse @ self.prior, self.fit.prior_excess
        return np.zeros_like(change) if excess is None else change @ excess @ change.T

    @property
    def systematic_covariance(self) -> Array:
        """Covariance of the estimate that systematic errors cause, shape (b, b)."""
        return self.errors.covariance + np.outer(self.errors.attenuation, self.errors.attenuation)

    @property
    def border_covariance(self) -> Array:
        """Covariance that is added for the distance between the estimate and the analytic centre, shape (b, b).

        The distance is not zero if the estimate is near the boundary of the cone of consistent bodies.
        """
        own = None if self.fit.standard is None else self.fit.standard.lift
        return np.zeros_like(self.inverse) if own is None else np.outer(own.base_shift, own.base_shift)

    def with_covariance(self, *, systematic_errors: bool = True) -> Fit:
        """Fit with its covariance, of the kind that samples and motion allow, with systematic errors or without."""
        motions = self._motions()
        if systematic_errors:
            self.errors = self._systematic_errors()
        spectrum, obstacle = self._spectrum()
        if spectrum is None:
            return self._from_factors(motions, obstacle)
        scatter = spectrum.scatter
        free = None if motions is None else motions.free
        kind, why = choose_covariance_kind(spectrum.whiteness, free, spectrum.repeated)
        report = CovarianceReport(why, len(spectrum.model.basis), spectrum.whiteness, scatter.noise)
        if kind == "white":
            return replace(self.white(), report=replace(report, parts=0))
        if kind == "period" and motions is not None:
            return self._periods(motions, report)
        moved, reach, share = self.reversal_effect(self.noise_covariance(scatter.covariance))
        self.moved = reach * moved if len(moved) else self.moved
        report = replace(report, moved=moved, reach=reach)
        if share:
            reversal_text = (
                "intervals are widened by the shift that samples next to velocity reversals cause, up to "
                f"{share:.1f} standard deviations of a parameter"
            )
            report = replace(report, why=f"{why}; {reversal_text}")
        return replace(self._with(scatter.covariance, kind, scatter.freedom), report=report)

    def reversal_effect(self, covariance: Array) -> tuple[Array, float, float]:
        """Shift of the estimate by rows near reversals, compared with the standard deviations caused by noise.

        Returns:
            The shift, shape (b,), the share of it that counts as one standard deviation, and the largest ratio of
            shift to standard deviation.
        """
        found = self.reversal_shift()
        if found is None:
            return np.zeros(0), 0.0, 0.0
        reach, most = self.reach(found, covariance)
        return found, reach, most

    def reach(self, moved: Array, covariance: Array) -> tuple[float, float]:
        """Share of a shift (b,) that counts as one standard deviation, and largest ratio of shift to deviation."""
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        ratio = np.divide(moved, deviation, out=np.zeros_like(moved), where=deviation > 0.0)[self.observed]
        size = float(np.sqrt(np.mean(ratio**2)))
        if size <= EXPECTED_SHIFT:
            return 0.0, 0.0
        return float(SHIFT_SHARE * np.sqrt(1.0 - (EXPECTED_SHIFT / size) ** 2)), float(np.abs(ratio).max())

    def noise_covariance(self, scatter: Array) -> Array:
        """Covariance of the estimate that the noise of all data causes, shape (b, b).

        `scatter` is the covariance that the noise of the samples causes, shape (b, b).
        """
        return scatter

    def reversal_shift(self) -> Array | None:
        """Shift of the estimate if rows near reversals are left out, shape (b,); `None` if it cannot be computed."""
        if self.problem.base is None or self.information.names != self.problem.information.names:
            return None
        return shift_by_reversals(self.problem, self.fit.values, self.fit.weights, self.prior)

    def _motions(self) -> RepetitionBlocks | None:
        """Assignment of the blocks to repetitions of a motion; `None` if the motion does not repeat."""
        runs = () if self.problem.observations is None else self.problem.observations.runs
        # Blocks of a motion whose period nobody knows may look alike here and there. Only whole periods can be tested
        # for a residual that repeats with them.
        if any(find_periods(run) is None for run in runs):
            return None
        known = [run.repetition is not None for run in runs]
        if not any(known):
            motions = periods(self.information)
            return None if motions is None else RepetitionBlocks.of_blocks(motions)
        if not all(known):
            return None
        if sum(len(np.unique(run.block)) for run in runs) != self.information.blocks:
            return None
        return RepetitionBlocks.of_runs(runs, self.information.rows.sum(axis=1) > 0)

    def _from_factors(self, motions: RepetitionBlocks | None, obstacle: str) -> Fit:
        """Fit with the covariance that is computed from factors, because no samples can be used.

        Args:
            motions: Assignment of the blocks to repetitions of a motion; `None` if the motion does not repeat.
            obstacle: Reason why samples cannot be used, as text.
        """
        report = CovarianceReport(obstacle, noise=self._noise())
        if motions is not None and motions.free >= FEWEST_PERIODS - 1:
            return self._periods(motions, replace(report, why=f"{obstacle}; the motion repeats"))
        found = block_covariance(self.information, self.fit.values, self.fit.weights, self.inverse)
        if found is None:
            why = f"{obstacle}, and fewer than {FEWEST_BLOCKS} blocks of rows: residuals are taken as uncorrelated"
            return replace(self.white(), report=replace(report, why=why))
        covariance, free = found
        return replace(self._with(covariance, "block", free), report=replace(report, parts=round(free) + 1))

    def _periods(self, found: RepetitionBlocks, report: CovarianceReport) -> Fit:
        """Fit with the covariance from the scatter between periods of the motion."""
        covariance = jackknife(
            self.information, found.groups, found.motions, self.fit.values, self.fit.weights, self.inverse
        )
        fit = self._with(covariance, "period", float(found.free))
        return replace(fit, report=replace(report, parts=len(found.motions)))

    def white(self) -> Fit:
        """Fit with the covariance for white residuals that the estimator has computed."""
        return self.with_scatter(
            self.fit, self.fit.covariance, np.zeros_like(self.border_covariance), self.fit.freedom
        )

    def _with(self, covariance: Array, kind: str, freedom: Array | float) -> Fit:
        """Fit with a given covariance from the noise, plus the covariance from prior and torque scales."""
        return self.with_scatter(replace(self.fit, covariance_kind=kind), covariance, self.known_covariance, freedom)

    def with_scatter(self, fit: Fit, scatter: Array, known_covariance: Array, freedom: Array | float) -> Fit:
        """Fit with covariance, degrees of freedom and the intervals of the standard parameters.

        The covariance is the sum of `scatter`, caused by the noise of the data, and `known_covariance`, which is not
        estimated from residuals; `freedom` are the degrees of freedom of `scatter`.
        """
        known_covariance = known_covariance + np.outer(self.moved, self.moved) + self.systematic_covariance
        certain = known_covariance + self.border_covariance
        estimated, certain_part = np.diag(scatter), np.diag(certain)
        # A covariance of known size has infinite degrees of freedom [Satterthwaite1946].
        share = np.where(estimated > 0.0, 1.0 + certain_part / np.where(estimated > 0.0, estimated, 1.0), 1.0)
        each = np.broadcast_to(np.asarray(freedom, dtype=np.float64), estimated.shape)
        standard = fit.standard
        if standard is not None and standard.lift is not None:
            standard = replace(stated(standard, scatter, known_covariance, each), lift=None)
        findings = fit.findings
        if self.errors.kinds and self.problem.model is not None:
            findings = (*findings, *error_findings(self.errors, scatter, fit.names, self.problem.model.robot))
            findings = (*findings, *noise_finding(self.errors.attenuation, scatter, fit.names))
        return replace(
            fit, covariance=scatter + certain, freedom=each * share**2, standard=standard, findings=findings
        )

    def _systematic_errors(self) -> ErrorEffect:
        """Effect of systematic errors on the estimate; empty if there are no samples of the same rows."""
        problem = self.problem
        if problem.base is None or problem.model is None or problem.observations is None:
            return self.errors
        if not _samples_match(self.problem, self.whole.rows[0]):
            return self.errors
        values = np.broadcast_to(self.joint_values(), (self.whole.n, problem.information.count))
        return effect_on_fit(
            problem, self.fit, values, self.prior, self.inverse, self._inverse_with, self.column_maps()
        )

    def _spectrum(self) -> tuple[_Spectrum | None, str]:
        """Noise spectrum of the samples, and an empty text; or `None`, and the reason why it cannot be estimated."""
        observations, rows = self.problem.observations, self.whole.rows[0]
        if self.fit.information is not None:
            return None, "rows have individual weights"
        if observations is None or self.problem.model is None or self.problem.base is None:
            return None, "only factors are stored, and no samples"
        if not all(run.consecutive for run in observations.runs):
            return None, "rows are not consecutive in time"
        if not _samples_match(self.problem, rows):
            return None, "the available samples are not those from which the factors were computed"
        rates = np.array([run.rate / run.step for run in observations.runs])
        if np.ptp(rates) > RATE_TOLERANCE * rates.max():
            return None, "the recordings have different row rates"
        if rows.sum() < FEWEST_ROWS * self.whole.count:
            return None, f"there are only {rows.sum()} rows for {self.whole.count} parameters"
        bands = band_products(self.problem, self.joint_values())
        if NoiseModel.size(bands, self.whole.count) > MAX_SIZE:
            return None, "the arm has too many joints for the cross spectra of all of them"
        model = NoiseModel(bands, self.fit.weights, self.inverse, self.column_maps())
        scatter = model.scatter(bands.moments, bands.squares, rows)
        white = whiteness(model, bands.moments, bands.squares, bands.parts, rows)
        return _Spectrum(model, scatter, white, _repeated(bands, scatter, rows, self.fit.weights)), ""

    def joint_values(self) -> Array:
        """Values of the parameters of the regressor columns, shape (b,), or (n, b) if they differ between joints."""
        return self.fit.values

    def column_maps(self) -> tuple[Array, ...] | None:
        """Matrices from the parameters of the fit to the parameters of each joint's regressor columns.

        The result is `None` if both are the same parameters.
        """
        return None

    def _noise(self) -> Array:
        """Standard deviation of each joint's residual, corrected for the degrees of freedom, shape (n,)."""
        rows = self.whole.rows[0]
        effective_dof = np.array(
            [
                weight**2 * np.sum((R := joint.R[0, :, :-1]) @ self.inverse[np.ix_(own := joint.parameters, own)] * R)
                for weight, joint in zip(self.fit.weights, self.whole.joints, strict=True)
            ]
        )
        return self.fit.residual_rms * np.sqrt(rows / np.maximum(rows - effective_dof, 1.0))


@dataclass(frozen=True, eq=False, slots=True)
class _Spectrum:
    """Noise spectrum of the samples, and results of tests that use this spectrum.

    Attributes:
        model: Equations for the levels of the noise.
        scatter: Effect of the noise on the estimate.
        whiteness: p-value of the test of whiteness.
        repeated: Variance of the mean residual of all periods, divided by the variance that independent periods would
            give; 1 if no periods were averaged.
    """

    model: NoiseModel
    scatter: LevelScatter
    whiteness: float
    repeated: float


def _samples_match(problem: EstimationProblem, rows: NDArray[np.int64]) -> bool:
    """True if samples and information have the same rows and parameters."""
    model, base, observations = problem.require_samples("cover")
    known_covariance = {name.of_all for name in problem.information.names}  # copies for each recording are FV_1[1], …
    counted = sum(with_hysteresis_states(model, run, observations.band).mask.sum(axis=0) for run in observations.runs)
    return known_covariance == set(base.names) and bool(np.array_equal(counted, rows))


def _repeated(bands: BandProducts, scatter: LevelScatter, rows: Array, weights: Array) -> float:
    """Variance of the mean residual of all periods, divided by its value for independent periods.

    Without periods the result is 1.
    """
    squares, free = bands.within
    if not (free > 0.0).all():
        return 1.0
    folded = np.einsum("ejj->j", bands.count)
    whole = scatter.noise**2 * np.maximum(rows, 1)  # differences between periods and what is left of their mean
    of_mean = np.maximum(whole - squares, 0.0) / np.maximum(folded, 1.0)
    return float(np.sum(weights**2 * of_mean) / np.sum(weights**2 * squares / free))
