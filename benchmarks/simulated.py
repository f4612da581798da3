"""Identifications simulated by the thousand: the regressor is made once, each run draws new noise.

The arm is the virtual iiwa 14 with the 57 base parameters of the thesis, on the motion of its Table A.1. Least
squares is linear, so the truth is zero without loss: torque is noise, and every estimate is an error. Noise goes
through the band as a recording's torque does. Matrices that depend on the weights of the joints alone are made at
the weights of one recording; `real_path` makes everything anew from observations, to check that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, build_problem
from armid.estimation.uncertainty.bootstrap import bootstrap
from armid.estimation.uncertainty.covariance import choose_covariance_kind, estimate_covariance
from armid.estimation.uncertainty.cross_products_by_frequency import BandProducts, band_products, residual_moments
from armid.estimation.uncertainty.noise_spectrum import NoiseModel
from armid.estimation.uncertainty.whiteness import spectrum_test, variance_test
from armid.excitation.thesis_plans import builtin_plan
from armid.information.accumulate import accumulate_information
from armid.information.base_regressor_layout import column_source
from armid.information.filtered_rows import all_rows
from armid.information.filtering import in_band
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot

LEVELS = np.array([1.0, 1.0, 0.6, 0.6, 0.4, 0.25, 0.25])
"""Standard deviation of each joint's noise as it is recorded [N·m]."""

UNEQUAL = LEVELS * [1.0, 8.0, 0.2, 3.0, 0.5, 10.0, 1.0]
COLOURS = (0.01, 0.3, 0.05, 0.1, 0.2, 0.03, 0.0)
"""Time constants of the case in which joints differ [s]."""

COMMON = 0.6
"""Correlation of any two joints in the case in which they share noise."""

BOOTSTRAP_DRAWS = 200
"""Draws of a bootstrap: a deviation is then known to 5 %."""

UNSEEN_EVERY = 7
"""Rows of the unseen motion are looked at by the seventh."""


FIVE_HERTZ = Band("butterworth", 5.0, 4, "periodic")


@dataclass(frozen=True, slots=True)
class Case:
    """One kind of noise on one kind of recording.

    Attributes:
        name: What it is.
        seconds: Period of the motion [s].
        periods: How often it is run through.
        memory: Time constants of the noise, first-order autoregressive, one or one for each joint [s]; 0 is white.
        levels: Standard deviation of each joint's noise.
        common: Correlation between any two joints.
        rate: Samples a second [Hz].
        drawn: Samples a second at which white noise is drawn [Hz], where it is less: what lies above half of it does
            not pass the band. 0 for the rate.
        band: Band of the comparison.
        rows: Rows a second [Hz].
    """

    name: str
    seconds: float = 27.0
    periods: int = 6
    memory: float | tuple[float, ...] = 0.0
    levels: tuple[float, ...] = tuple(LEVELS)
    common: float = 0.0
    rate: float = 100.0
    drawn: float = 0.0
    band: Band = FIVE_HERTZ
    rows: float = 25.0

    def noise(self, rng: np.random.Generator, periods: int) -> Array:
        """Noise as it is drawn, shape (samples, n)."""
        from scipy.signal import lfilter

        n, rate = len(self.levels), self.drawn or self.rate
        samples = round(self.seconds * rate) * periods
        memory = np.broadcast_to(np.asarray(self.memory, dtype=np.float64), n)
        before = int(6.0 * memory.max() * rate)
        z = rng.standard_normal((samples + before, n))
        if self.common:
            z = z @ np.linalg.cholesky(self.common + (1.0 - self.common) * np.eye(n)).T
        for j in np.flatnonzero(memory):
            a = np.exp(-1.0 / (rate * memory[j]))
            z[:, j] = lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], z[:, j])
        return z[before:] * self.levels * np.sqrt(rate / self.rate)

    def recorded(self, drawn: Array) -> Array:
        """The same noise at the recording's rate; its lower frequencies, where it was drawn at a lower one."""
        if not self.drawn:
            return drawn
        more = round(self.rate / self.drawn)
        return np.fft.irfft(np.fft.rfft(drawn, axis=0), more * len(drawn), axis=0) * more

    def in_band(self, drawn: Array) -> Array:
        """The noise on the rows of the output grid, shape (M, n)."""
        rate = self.drawn or self.rate
        return in_band(drawn, rate, self.band)[:: 1 if self.band.is_open else round(rate / self.rows)]


@dataclass(frozen=True, eq=False, slots=True)
class Outcome:
    """Result of one simulated identification.

    Attributes:
        error: Of each parameter, shape (b,).
        half: Half widths of the 95 % intervals by each method, shapes (b,).
        chosen: Kind of covariance that was chosen.
        inside: Share of unseen rows inside the 95 % band of the chosen covariance.
    """

    error: Array
    half: dict[str, Array]
    chosen: str
    inside: float


class Simulation:
    """Everything about a case that does not change from run to run."""

    def __init__(self, case: Case, seed: int = 0) -> None:
        self.case = case
        robot = load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))
        self.model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.0)))
        self.base = find_base_parameters(self.model)
        self.plan = builtin_plan("thesis-a1").stretched(case.seconds)
        self.motion = self.plan.sample(case.rate, case.periods)
        self.step = 1 if case.band.is_open else round(case.rate / case.rows)
        first = self.observed(case.noise(np.random.default_rng((seed, 1)), case.periods))
        self.problem = build_problem(self.model, first, base=self.base)
        fit = WeightedLeastSquares().solve(self.problem)
        self.fit, self.weights = fit, fit.weights
        self.rows = len(first.runs[0].rows)
        x = all_rows(column_source(self.model, self.base), replace_torque(first.runs[0], 0.0), case.band)
        self.X = self._dense(x)[: self.rows // case.periods]  # (M / K, n, b)
        self.normal = np.stack([self.X[:, j].T @ self.X[:, j] for j in range(self.model.n)]) * case.periods
        self.inverse = np.linalg.inv(np.tensordot(self.weights**2, self.normal, 1))
        self.bands: BandProducts = band_products(self.problem, fit.values)
        self.noise_model = NoiseModel(self.bands, self.weights, self.inverse)
        self._prepare_blocks()
        self._prepare_unseen()

    def observed(self, drawn: Array, *, blocks: int = 0) -> Observations:
        """Observations of this noise, in so many blocks: not said, periods where there are several, else seconds."""
        rows = len(range(0, self.motion.samples, self.step))
        count = blocks or (self.case.periods if self.case.periods > 1 else round(self.case.seconds))
        mask = np.ones((rows, self.model.n), dtype=np.bool_)
        block = np.arange(rows) * count // rows
        run = ObservedRun(self.motion, self.case.recorded(drawn), self.case.rate, self.step, 0, mask, block)
        return Observations((run,), self.case.band)

    def real_path(self, drawn: Array) -> Fit:
        """The fit, from the samples, as a study makes it, but without systematic errors, which no run here has."""
        problem = build_problem(self.model, self.observed(drawn), base=self.base)
        return estimate_covariance(WeightedLeastSquares().solve(problem), problem, systematic_errors=False)

    def bootstrapped(self, drawn: Array, seed: int) -> Array:
        """Half widths by drawing blocks of about a second."""
        seconds = round(self.case.seconds) * self.case.periods
        information = accumulate_information(self.model, self.base, self.observed(drawn, blocks=seconds))
        fit = WeightedLeastSquares().solve(EstimationProblem(information))
        return 1.96 * bootstrap(fit, information, draws=BOOTSTRAP_DRAWS, seed=seed).std(axis=0)

    def run(self, drawn: Array) -> Outcome:
        """One identification from torque that is all noise, as `Case.noise` draws it."""
        K = self.case.periods
        y = self.case.in_band(drawn)
        folded = y.reshape(K, -1, self.model.n).mean(axis=0)
        values, weights, inverse = self._estimate(y, folded)
        residual = y - np.tile(np.einsum("mjb,b->mj", self.X, values, optimize=True), (K, 1))
        half: dict[str, Array] = {"textbook": 1.96 * np.sqrt(np.diag(inverse))}
        half["block"] = self._blocks(residual)
        if K > 1:
            half["period"] = self._periods(residual)
        mean = residual.reshape(K, -1, self.model.n).sum(axis=0) / np.sqrt(K)
        moments = residual_moments(mean.T, self.case.rate / self.step, self.bands)
        squares, rows = (residual**2).sum(axis=0), np.full(self.model.n, float(len(residual)))
        scatter = self.noise_model.scatter(moments, squares, rows)
        half["spectral"] = _student(scatter.freedom) * np.sqrt(np.diag(scatter.covariance))
        in_time = variance_test(_parts(mean), weights, self.bands.averaged)
        white = min(1.0, 2.0 * min(spectrum_test(self.noise_model, moments, squares, rows), in_time))
        within = np.stack([squares - (mean**2).sum(axis=0), rows - len(mean)])
        repeated = self._repeated(scatter.noise, within, rows)
        chosen = choose_covariance_kind(white, K - 1 if K > 1 else None, repeated)[0]
        half["chosen"] = half["textbook" if chosen == "white" else chosen]
        covariance = {"white": inverse, "spectral": scatter.covariance}.get(chosen)
        if covariance is None:
            covariance = self._period_scatter(residual)
        free = 1e9 if chosen == "white" else K - 1 if chosen == "period" else float(np.median(scatter.freedom))
        return Outcome(values, half, chosen, self._inside(values, covariance, free, scatter.noise, drawn))

    def _dense(self, x: Array) -> Array:
        """Columns of all joints as rows of all parameters, shape (M, n, b)."""
        layout = self.problem.information.joints
        offset = column_source(self.model, self.base).layout.offset
        X = np.zeros((x.shape[1], self.model.n, self.base.count))
        for j, joint in enumerate(layout):
            X[:, j, joint.parameters] = x[offset[j] : offset[j + 1] - 1].T
        return X

    def _estimate(self, y: Array, folded: Array) -> tuple[Array, Array, Array]:
        """Weighted least squares as the estimator iterates it: values, weights and inverse."""
        K, n = self.case.periods, self.model.n
        side = K * np.stack([self.X[:, j].T @ folded[:, j] for j in range(n)])
        squares = (y**2).sum(axis=0)
        weights = self.weights
        for _ in range(20):
            inverse = np.linalg.inv(np.tensordot(weights**2, self.normal, 1))
            values = inverse @ (weights**2 @ side)
            left = squares - 2.0 * side @ values + np.einsum("jab,a,b->j", self.normal, values, values, optimize=True)
            spent = weights**2 * np.tensordot(self.normal, inverse, ([1, 2], [0, 1]))
            updated = 1.0 / np.sqrt(left / (len(y) - spent))
            settled = np.allclose(updated, weights, rtol=1e-7)
            weights = updated
            if settled:
                break
        return values, weights, inverse

    def _prepare_blocks(self) -> None:
        """Inverses without each block of a second, and without each period."""
        weighted = self.X * self.weights[:, None]
        count = round(self.case.seconds)
        self.cut = np.arange(len(self.X)) * count // len(self.X)
        self.starts = np.flatnonzero(np.diff(self.cut, prepend=-1))
        H = np.linalg.inv(self.inverse)
        parts = [weighted[self.cut == k].reshape(-1, self.base.count) for k in range(count)]
        self.without = np.stack([np.linalg.inv(H - part.T @ part) for part in parts])

    def _scores(self, residual: Array) -> Array:
        """Pull of each row, summed over joints, shape (K, M / K, b)."""
        weighted = residual.reshape(self.case.periods, -1, self.model.n) * self.weights**2
        return np.einsum("mjb,kmj->kmb", self.X, weighted, optimize=True)

    def _blocks(self, residual: Array) -> Array:
        """Half widths from blocks of a second."""
        pulls = np.add.reduceat(self._scores(residual), self.starts, axis=1)
        change = np.einsum("cab,kcb->kca", self.without, pulls, optimize=True).reshape(-1, self.base.count)
        change -= change.mean(axis=0)
        count = len(change)
        return _student(count - 1.0) * np.sqrt((change**2).sum(axis=0) * (count - 1) / count)

    def _period_scatter(self, residual: Array) -> Array:
        """Covariance of the mean of the periods' own estimates, the textbook's."""
        K = self.case.periods
        own = self._scores(residual).sum(axis=1) @ self.inverse * K
        return np.cov(own.T) / K

    def _periods(self, residual: Array) -> Array:
        """Half widths from the scatter between periods."""
        return _student(self.case.periods - 1.0) * np.sqrt(np.diag(self._period_scatter(residual)))

    def _repeated(self, noise: Array, within: Array, rows: Array) -> float:
        if self.case.periods == 1:
            return 1.0
        squares, free = within
        of_mean = np.maximum(noise**2 * rows - squares, 0.0) / len(self.X)
        return float(np.sum(self.weights**2 * of_mean) / np.sum(self.weights**2 * squares / free))

    def _prepare_unseen(self) -> None:
        """Columns of Table A.2 in the band."""
        motion = builtin_plan("thesis-a2").stretched(self.case.seconds).sample(self.case.rate)
        rows = len(range(0, motion.samples, self.step))
        zero = np.zeros((motion.samples, self.model.n))
        mask = np.ones((rows, self.model.n), dtype=np.bool_)
        run = ObservedRun(motion, zero, self.case.rate, self.step, 0, mask, np.zeros(rows, dtype=np.int64))
        x = all_rows(column_source(self.model, self.base), run, self.case.band)
        self.unseen = self._dense(x)[::UNSEEN_EVERY]

    def _inside(self, values: Array, covariance: Array, free: float, noise: Array, drawn: Array) -> float:
        """Share of rows of unseen motion whose torque lies inside the band."""
        rng = np.random.default_rng(int(abs(drawn[0, 0]) * 1e9))
        fresh = self.case.in_band(self.case.noise(rng, 1))[::UNSEEN_EVERY]
        error = fresh - np.einsum("mjb,b->mj", self.unseen, values, optimize=True)
        share = np.einsum("mjb,mjb->mj", self.unseen @ covariance, self.unseen, optimize=True)
        variance = share + noise**2
        return float(np.mean(error**2 <= _student(free * (variance / share) ** 2) ** 2 * variance))


def replace_torque(run: ObservedRun, value: float) -> ObservedRun:
    """The run with the same torque everywhere."""
    return replace(run, torque=np.full_like(run.torque, value))


def _student(free: Array | float) -> Array:
    """Student's quantile of a 95 % interval."""
    from scipy.special import stdtrit

    return np.asarray(stdtrit(free, 0.975), dtype=np.float64)


def _parts(residual: Array) -> Array:
    """Sum of squares and number of rows of ten parts of the time, as the second pass keeps them."""
    starts = np.unique(np.arange(10) * len(residual) // 10)
    squares = np.add.reduceat(residual**2, starts, axis=0)
    counts = np.add.reduceat(np.ones_like(residual), starts, axis=0)
    return np.stack([squares, counts], axis=1)
