"""Uncertainty of an estimate: a covariance whose intervals cover, and why it is of its kind.

Residuals of filtered recordings are correlated over many rows, and an interval made as if they were white covers a
third of what it says. What the samples and the motion allow decides what is used instead:

- `white`, the textbook's (2.44) to (2.47), only where the residuals pass a test of whiteness;
- `period`, the scatter between periods, where the motion was repeated often enough and what is left of the torque
  does not repeat with it, else the scatter would say how repeatable the estimate is and not how right;
- `spectral`, from the spectrum that the residuals show and that of the columns, with all there is between joints;
- `block`, the scatter between blocks of rows, where there are factors and no samples.

All are of the form H⁻¹ (S + c P) H⁻¹, S being the scatter of the data's pull, P the precision of a prior in rows,
with the cone of real bodies counted as one, and c the rows that count as one of the independent samples in which a
prior is stated: with S = c (H - P) that is c H⁻¹, the variance a posteriori. How far an estimate in the cone stands
from the middle of what can be is added. Standard parameters follow from the base ones, and what stands alone has one
interval in both.

What an estimator holds at zero is not surer for it: it keeps the interval that the data give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.estimation.fit import CovarianceReport, Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.standard_fit import stated
from armid.estimation.uncertainty.frequency_bands import BandProducts, band_products, has_repetitions
from armid.estimation.uncertainty.jackknife import RepetitionBlocks, correlation, group_blocks, jackknife, periods
from armid.estimation.uncertainty.noise_spectrum import LARGEST, LevelScatter, NoiseModel
from armid.estimation.uncertainty.reversals import moved_by_reversals
from armid.estimation.uncertainty.whiteness import whiteness
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.information import Information, stack, total
from armid.maths.linalg import unit_columns
from armid.threads import one_blas_thread
from armid.values import Array

__all__ = [
    "FEWEST_BLOCKS",
    "FEWEST_PERIODS",
    "Uncertainty",
    "block_covariance",
    "choose_covariance_kind",
    "estimate_covariance",
    "scale_covariance",
]

FEWEST_BLOCKS = 4
"""With fewer blocks their scatter says next to nothing (three degrees of freedom); the white covariance is used."""

FEWEST_PERIODS = 6
"""With fewer periods Student's intervals are more than a third wider than those of many."""

MERGED_BLOCKS = 10
"""Blocks are not made longer where fewer than these would be left."""

NEIGHBOURS = 0.05
"""Correlation of neighbouring blocks' pulls up to which blocks count as independent: it makes deviations a twentieth
too small, and chance alone makes it that large with a few parameters and some twenty blocks."""

WHITE = 0.05
"""Probability of the test of whiteness below which residuals are not white."""

LEAST_SAID = 1e-6
"""Probabilities below are not told apart in words."""

REPEATED = 1.5
"""What is left of the mean of all periods, as a variance over that which independent periods would leave, from which
on the model lacks something that repeats. Chance makes it 1 within a tenth or two."""

BY_CHANCE = 1.0
"""RMS over the parameters of what reversals move them by, in deviations, that a right model is allowed: rows next to
them are a quarter of all and move an estimate by half a deviation."""

REACH = 0.65
"""Share of that move that counts as a deviation: a 95 % interval then reaches a quarter beyond the move. Set on
simulated logs of twelve arms in closed loop, where half of it left one below 88 %; docs/uncertainty.md has others."""

FEWEST_ROWS = 3
"""Rows of all joints for each parameter below which a spectrum cannot be told from the estimate."""

UNSEEN = 1e-13
"""Least eigenvalue of the normal equations with unit columns: directions that neither data nor prior see get a huge
variance instead of a division by zero."""

ALIKE = 0.1
"""Largest difference of the rates of rows, relative, at which spectra of runs are put together."""


@one_blas_thread
def estimate_covariance(fit: Fit, source: EstimationProblem | Information) -> Fit:
    """The fit with a covariance whose intervals cover, and the reason why it is of its kind.

    Args:
        fit: As the estimator gave it.
        source: The problem, whose samples are gone through again, or the information alone, blocks apart.
    """
    problem = source if isinstance(source, EstimationProblem) else EstimationProblem(source)
    return Uncertainty(fit, problem).covered()


def choose_covariance_kind(white: float, free: int | None, repeated: float) -> tuple[str, str]:
    """Tell which kind of covariance it should be where the samples are at hand, and why.

    Args:
        white: Probability of such residuals if they were white.
        free: Degrees of freedom of the scatter between periods; `None` where the motion does not repeat.
        repeated: Variance of the residual that repeats with the motion, over what chance leaves.
    """
    if white >= WHITE:
        return "white", f"residuals are uncorrelated in time (test of whiteness, p = {white:.2g})"
    said = f"p = {white:.1g}" if white > LEAST_SAID else f"p < {LEAST_SAID:g}"
    coloured = f"residuals are correlated in time (test of whiteness, {said})"
    if free is None:
        return "spectral", coloured
    if free < FEWEST_PERIODS - 1:
        return "spectral", f"{coloured}, and there are fewer than {FEWEST_PERIODS} periods"
    if repeated > REPEATED:
        return "spectral", f"{coloured}, and {repeated:.1f} times what chance leaves of them repeats with the motion"
    return "period", f"{coloured}, and the motion repeats"


class Uncertainty:
    """Needs of every kind of covariance.

    Attributes:
        fit: As the estimator gave it.
        problem: With its samples, where there are any.
        information: Factors of the same rows in the parameters of the fit.
        prior: Precision of what holds these beside the rows, shape (b, b).
        inverse: Inverse of the normal equations, prior included, shape (b, b).
        known: What is added to the scatter for certain, shape (b, b).
        moved: What reversals move the estimate by, as far as intervals reach, shape (b,).
        felt: Which parameters the rows show, shape (b,).
    """

    def __init__(self, fit: Fit, problem: EstimationProblem, information: Information | None = None) -> None:
        self.fit, self.problem = fit, problem
        own = problem.information if fit.information is None else fit.information
        self.information = own if information is None else information
        self.whole = total(self.information)
        b = self.whole.count
        self.prior = np.zeros((b, b)) if fit.prior_precision is None else fit.prior_precision
        A, length = unit_columns(stack(self.whole, fit.weights)[0])
        values, vectors = np.linalg.eigh(A.T @ A + self.prior / np.outer(length, length))
        half = vectors / np.sqrt(np.maximum(values, UNSEEN)) / length[:, None]
        self.inverse: Array = half @ half.T
        self.known = scale_covariance(self.whole, fit.weights, self.inverse)
        # A prior of precision P in rows errs by c P⁻¹, c rows being one independent sample, and moves by H⁻¹ P of it.
        self.known = self.known + fit.prior_correlation * (self.inverse @ self.prior @ self.inverse)
        own = None if fit.standard is None else fit.standard.lift
        # An estimate at the border of what can be stands apart from the middle of it.
        self.apart: Array = np.zeros((b, b)) if own is None else np.outer(own.base_shift, own.base_shift)
        self.moved: Array = np.zeros(b)  # by reversals
        self.felt: NDArray[np.bool_] = np.ones(b, dtype=np.bool_)

    def covered(self) -> Fit:
        """The fit with the covariance that fits the case."""
        motions = self._motions()
        spectrum, hindrance = self._spectrum()
        if spectrum is None:
            return self._from_factors(motions, hindrance)
        scatter = spectrum.scatter
        free = None if motions is None else motions.free
        kind, why = choose_covariance_kind(spectrum.whiteness, free, spectrum.repeated)
        report = CovarianceReport(why, len(spectrum.model.basis), spectrum.whiteness, scatter.noise)
        if kind == "white":
            return replace(self.white(), report=replace(report, parts=0))
        if kind == "period" and motions is not None:
            return self._periods(motions, report)
        moved, reach, share = self.move(self.by_noise(scatter.covariance))
        self.moved = reach * moved if len(moved) else self.moved
        report = replace(report, moved=moved, reach=reach)
        if share:
            said = f"samples next to velocity reversals shift a parameter by up to {share:.1f} standard deviations"
            report = replace(report, why=f"{why}; {said}, by which intervals are widened")
        return replace(self._with(scatter.covariance, kind, scatter.freedom), report=report)

    def move(self, covariance: Array) -> tuple[Array, float, float]:
        """Return what reversals move the estimate by (b,), how much of it is a deviation, and its most in deviations.

        What chance does is left out of the second; the third is zero where there is no more.
        """
        found = self.without_reversals()
        if found is None:
            return np.zeros(0), 0.0, 0.0
        reach, most = self.reach(found, covariance)
        return found, reach, most

    def reach(self, moved: Array, covariance: Array) -> tuple[float, float]:
        """Share of a move (b,) that counts as a deviation beside noise, and its most in deviations by noise."""
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        ratio = np.divide(moved, deviation, out=np.zeros_like(moved), where=deviation > 0.0)[self.felt]
        size = float(np.sqrt(np.mean(ratio**2)))
        if size <= BY_CHANCE:
            return 0.0, 0.0
        return float(REACH * np.sqrt(1.0 - (BY_CHANCE / size) ** 2)), float(np.abs(ratio).max())

    def by_noise(self, scatter: Array) -> Array:
        """All covariance that noise makes, with that of the scatter of these rows, shape (b, b)."""
        return scatter

    def without_reversals(self) -> Array | None:
        """Move of the estimate without rows next to reversals, shape (b,); `None` where it is not known."""
        if self.problem.base is None or self.information.names != self.problem.information.names:
            return None
        return moved_by_reversals(self.problem, self.fit.values, self.fit.weights, self.prior)

    def _motions(self) -> RepetitionBlocks | None:
        """Tell which blocks are one repetition of which motion; `None` where motion does not repeat."""
        runs = () if self.problem.observations is None else self.problem.observations.runs
        known = [run.repetition is not None for run in runs]
        if not any(known):
            motions = periods(self.information)
            return None if motions is None else RepetitionBlocks.of_blocks(motions)
        if not all(known) or any(has_repetitions(run) is None for run in runs):
            return None
        if sum(len(np.unique(run.block)) for run in runs) != self.information.blocks:
            return None
        return RepetitionBlocks.of_runs(runs, self.information.rows.sum(axis=1) > 0)

    def _from_factors(self, motions: RepetitionBlocks | None, hindrance: str) -> Fit:
        """The best that factors alone allow."""
        report = CovarianceReport(hindrance, noise=self._noise())
        if motions is not None and motions.free >= FEWEST_PERIODS - 1:
            return self._periods(motions, replace(report, why=f"{hindrance}; the motion repeats"))
        found = block_covariance(self.information, self.fit.values, self.fit.weights, self.inverse)
        if found is None:
            why = f"{hindrance}, and fewer than {FEWEST_BLOCKS} blocks of rows: residuals are taken as uncorrelated"
            return replace(self.white(), report=replace(report, why=why))
        covariance, free = found
        return replace(self._with(covariance, "block", free), report=replace(report, parts=round(free) + 1))

    def _periods(self, found: RepetitionBlocks, report: CovarianceReport) -> Fit:
        """The scatter between periods."""
        covariance = jackknife(
            self.information, found.groups, found.motions, self.fit.values, self.fit.weights, self.inverse
        )
        fit = self._with(covariance, "period", float(found.free))
        return replace(fit, report=replace(report, parts=len(found.motions)))

    def white(self) -> Fit:
        """The fit as the estimator gave it."""
        return self.settled(self.fit, self.fit.covariance, np.zeros_like(self.apart), self.fit.freedom)

    def _with(self, covariance: Array, kind: str, freedom: Array | float) -> Fit:
        """The fit with a scatter of the data, to which prior and torque scales add what is known for certain."""
        return self.settled(replace(self.fit, covariance_kind=kind), covariance, self.known, freedom)

    def settled(self, fit: Fit, scatter: Array, known: Array, freedom: Array | float) -> Fit:
        """The fit with its covariance, and standard parameters that follow it."""
        known = known + np.outer(self.moved, self.moved)
        certain = known + self.apart
        learned, sure = np.diag(scatter), np.diag(certain)
        # What is known for certain has no degrees of freedom to pay for [Satterthwaite1946].
        share = np.where(learned > 0.0, 1.0 + sure / np.where(learned > 0.0, learned, 1.0), 1.0)
        each = np.broadcast_to(np.asarray(freedom, dtype=np.float64), learned.shape)
        standard = fit.standard
        if standard is not None and standard.lift is not None:
            standard = replace(stated(standard, scatter, known, each), lift=None)
        return replace(fit, covariance=scatter + certain, freedom=each * share**2, standard=standard)

    def _spectrum(self) -> tuple[_Spectrum | None, str]:
        """Return what the samples say about the noise; `None` and the reason where they say nothing."""
        observations, rows = self.problem.observations, self.whole.rows[0]
        if self.fit.information is not None:
            return None, "rows have weights of their own"
        if observations is None or self.problem.model is None or self.problem.base is None:
            return None, "there are factors and no samples"
        if not all(run.consecutive for run in observations.runs):
            return None, "rows do not follow each other in time"
        if not _same(self.problem, rows):
            return None, "the samples at hand are not those of the factors"
        rates = np.array([run.rate / run.step for run in observations.runs])
        if np.ptp(rates) > ALIKE * rates.max():
            return None, "recordings have rows at different rates"
        if rows.sum() < FEWEST_ROWS * self.whole.count:
            return None, f"there are only {rows.sum()} rows for {self.whole.count} parameters"
        bands = band_products(self.problem, self.shown())
        if NoiseModel.size(bands, self.whole.count) > LARGEST:
            return None, "the arm has too many joints for a spectrum between all of them"
        model = NoiseModel(bands, self.fit.weights, self.inverse, self.through())
        scatter = model.scatter(bands.moments, bands.squares, rows)
        white = whiteness(model, bands.moments, bands.squares, bands.pieces, rows)
        return _Spectrum(model, scatter, white, _repeated(bands, scatter, rows, self.fit.weights)), ""

    def shown(self) -> Array:
        """Parameters of the samples' columns, shape (b,), or of each joint's, shape (n, b)."""
        return self.fit.values

    def through(self) -> tuple[Array, ...] | None:
        """Map the fit's parameters to those of each joint's columns; `None` where they are the same."""
        return None

    def _noise(self) -> Array:
        """Standard deviation of each joint's residual, degrees of freedom paid, shape (n,)."""
        rows = self.whole.rows[0]
        spent = np.array(
            [
                weight**2 * np.sum((R := joint.R[0, :, :-1]) @ self.inverse[np.ix_(own := joint.parameters, own)] * R)
                for weight, joint in zip(self.fit.weights, self.whole.joints, strict=True)
            ]
        )
        return self.fit.residual_rms * np.sqrt(rows / np.maximum(rows - spent, 1.0))


@dataclass(frozen=True, eq=False, slots=True)
class _Spectrum:
    """Evidence of the samples.

    Attributes:
        model: Equations for the levels of the noise.
        scatter: What the noise does to the estimate.
        whiteness: Probability of such residuals if they were white.
        repeated: Variance that repeats with the motion, over what chance leaves; 1 where nothing was folded.
    """

    model: NoiseModel
    scatter: LevelScatter
    whiteness: float
    repeated: float


def block_covariance(
    information: Information, values: Array, weights: Array, inverse: Array
) -> tuple[Array, float] | None:
    """Jackknife covariance (b, b) over blocks, made longer while neighbours pull alike, and its degrees of freedom.

    Args:
        information: Factors, one set a block, in the order of time.
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: H⁻¹ of the weighted normal equations, prior included, shape (b, b).

    Returns:
        `None` where there are too few blocks with rows that count.
    """
    together = 1
    groups = group_blocks(information)
    count = int(groups.max()) + 1
    if count < FEWEST_BLOCKS:
        return None
    while count // 2 >= MERGED_BLOCKS and correlation(information, groups, values, weights, inverse) > NEIGHBOURS:
        together *= 2
        groups = group_blocks(information, together)
        count = int(groups.max()) + 1
    one = np.zeros(count, dtype=np.int64)
    return jackknife(information, groups, one, values, weights, inverse), count - 1.0


def _same(problem: EstimationProblem, rows: NDArray[np.int64]) -> bool:
    """Tell whether samples and information are about the same rows and parameters."""
    model, base, observations = problem.require_samples("cover")
    known = {name.split("[", 1)[0] for name in problem.information.names}  # copies for each recording are FV_1[1], …
    counted = sum(with_hysteresis_states(model, run, observations.band).mask.sum(axis=0) for run in observations.runs)
    return known == set(base.names) and bool(np.array_equal(counted, rows))


def _repeated(bands: BandProducts, scatter: LevelScatter, rows: Array, weights: Array) -> float:
    """Variance of the mean of periods over what their differences say it should be."""
    squares, free = bands.within
    if not (free > 0.0).all():
        return 1.0
    folded = np.einsum("ejj->j", bands.count)
    whole = scatter.noise**2 * np.maximum(rows, 1)  # differences between periods and what is left of their mean
    of_mean = np.maximum(whole - squares, 0.0) / np.maximum(folded, 1.0)
    return float(np.sum(weights**2 * of_mean) / np.sum(weights**2 * squares / free))


def scale_covariance(whole: Information, weights: Array, inverse: Array) -> Array:
    """Return what uncertain scales of the joints' torques, such as drive gains, add to the covariance (b, b).

    With torque j off by a factor 1 + δ_j, the estimate moves by δ_j H⁻¹ w_j² R_jᵀ ρ_j; the δ_j are independent.
    """
    covariance = np.zeros_like(inverse)
    for j in np.flatnonzero(whole.scale_deviation):
        only = np.where(np.arange(whole.n) == j, weights, 0.0)
        A, y = stack(whole, only)
        move = inverse @ (A.T @ y)
        covariance += whole.scale_deviation[j] ** 2 * np.outer(move, move)
    return covariance
