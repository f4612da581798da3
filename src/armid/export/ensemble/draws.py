"""Draws of bodies and friction from the distribution of an estimate, inside the cone of real bodies.

Base parameters are drawn from the normal distribution of the estimate on another recording. A draw outside the cone
of real bodies is replaced by the nearest point of the cone, in the metric of the covariance, so that the torque
changes as little as possible. Where many draws lie outside, the replacements are closer together than the estimate
says. Therefore the draws come from a wider distribution, such that the covariance of the replacements is that of the
estimate. Let S be the covariance of the replacements of a pilot sample, in coordinates in which the covariance of the
estimate is the identity. The pilot sample is multiplied by a power of S⁻¹ and replaced again, in several passes. The
mean of the replacements moves into the cone.
What the covariance of the parameters does not explain of the prediction interval (noise, model error, and the change
of offsets) is drawn as a torque error, which is constant during a motion. The torque of the draws with these errors
spreads as the prediction interval says.
The random numbers are standardised, so that their sample covariance is exact; the draws of one ensemble are therefore
not quite independent.

Of all bodies with these base parameters, those near the exported ones are taken: the bodies θ of a draw β minimise

    |C (K θ - β)|² + ε² |M (θ - θ₀)|²

with Cᵀ C the inverse covariance, K the regrouping, θ₀ the exported parameters, and M the relative change of the
pseudo-inertias.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import OutputError
from armid.estimation.consistency.cones import EPSILON, consistency_cones, smallest_eigenvalues
from armid.estimation.estimate_record import collapse
from armid.estimation.problem import StandardParameters, standard_of
from armid.export.standard_values import relative_change
from armid.maths.conic_solver import Cone, solve_cones
from armid.model.motion import Motion
from armid.runs.run import Run
from armid.study.progress import Progress, no_progress
from armid.threads import one_blas_thread
from armid.validation.prediction_interval import parameter_covariance, torque_error_deviation

NEARNESS = 1e-3
"""Weight ε: a relative change of all bodies by 1 counts as much as a thousandth of a standard deviation of a base
parameter."""

SMALLEST_VARIANCE = 1e-9
"""Bound to which smaller eigenvalues of the correlation matrix of the base parameters are raised for its inverse."""

PILOT = 4
"""Number of draws of the pilot sample, divided by the number of base parameters."""

FIRST_POWER, POWER = 0.7, 0.5
"""Exponent of the inverse covariance of the pilot sample in the first pass, and in every later pass. With 0.5, a
direction that the cone does not restrict is corrected exactly; a direction that it cuts on one side needs a larger
exponent at first. With exponents of 0.8 and 1 the passes do not converge (Panda and Med 7)."""

MOST_PASSES = 6
"""Largest number of pilot samples."""

CLOSE = 0.05
"""Largest absolute logarithm of the ratio of the standard deviation of a base parameter in the pilot sample to that
of the estimate, at which the passes end."""

SMALLEST_SPREAD = 0.05
"""Bound to which smaller eigenvalues of the covariance of the pilot sample, relative to that of the estimate, are
raised before a power of it is computed."""

MOVED = 0.01
"""Distance of a draw from its replacement, in standard deviations, above which the draw counts as replaced."""


@dataclass(frozen=True, eq=False, slots=True)
class Draws:
    """Draws from the distribution of an estimate.

    Attributes:
        base: Base parameters of each draw after the replacement, shape (N, b).
        standard: Standard parameters of real bodies with these base parameters, and friction, shape (N, p).
        distance: Distance between the base parameters of each draw before and after the replacement, in standard
            deviations, shape (N,).
        spread: Smallest and largest standard deviation of a base parameter in the pilot sample, relative to that of
            the estimate, shape (2,).
        torque_error: Torque error of each draw by noise, model error and change of offsets, the same during a whole
            motion, shape (N, n) [N·m or N].
    """

    base: Array
    standard: Array
    distance: Array
    spread: Array
    torque_error: Array

    @property
    def replaced(self) -> float:
        """Share of the draws that were outside the cone and were replaced by the nearest point."""
        return float(np.mean(self.distance > MOVED))


@one_blas_thread
def draw_arms(
    run: Run,
    centre: Array,
    count: int,
    seed: int = 0,
    *,
    motion: Motion | None = None,
    progress: Progress = no_progress,
) -> Draws:
    """Draws possible arms from the distribution of the estimate of a run.

    Args:
        run: The run.
        centre: Standard parameters that a single export writes, shape (p,).
        count: Number of draws.
        seed: Seed of the random numbers.
        motion: Motion for which the torque errors are drawn; if not given, a motion like the training motion.
        progress: Function that is called with the text `ensemble` and the share of the draws that are done.

    Raises:
        OutputError: The number of draws is not positive.
        EstimationError: A cone program could not be solved accurately enough.
    """
    if count < 1:
        raise OutputError(f"An ensemble needs at least one draw; found {count}.", remedy="give a positive number.")
    base, fit = run.estimate.base, run.estimate.fit
    standard = standard_of(run.model, base)
    covariance, values = parameter_covariance(run.estimate), collapse(base.names, fit)
    program = _Program(standard, centre, _whitening(covariance))
    random = np.random.default_rng(seed)
    pilot = _standardised(random, PILOT * len(values), len(values))
    deviation = torque_error_deviation(run.model, run.estimate, motion)
    own = _standardised(random, max(count, len(pilot)), len(values) + len(deviation))[:count]
    total = MOST_PASSES * len(pilot) + count
    root, spread = _widened_root(program, values, covariance, pilot, lambda done: progress("ensemble", done / total))
    drawn = values + own[:, : len(values)] @ root.T
    bodies = program.all_nearest(drawn, lambda done: progress("ensemble", (total - count + done) / total))
    kept = bodies @ standard.regrouping.T
    distance = np.linalg.norm((kept - drawn) @ program.whitening.T, axis=1)
    return Draws(kept, bodies, distance, spread, own[:, len(values) :] * deviation)


def _widened_root(
    program: _Program, values: Array, covariance: Array, pilot: Array, done: Callable[[int], None]
) -> tuple[Array, Array]:
    """Root (b, b) of the covariance of draws whose replacements have a required covariance, and their spread (2,).

    The spread is that of `Draws`, for the replacements of the pilot sample.

    Args:
        program: Program that replaces draws.
        values: Mean of the draws, shape (b,).
        covariance: Required covariance of the replacements, shape (b, b).
        pilot: Standard normal random numbers of the pilot sample, shape (M, b).
        done: Function that is called with the number of draws that are done.
    """
    whitening, colouring = program.whitening, np.linalg.inv(program.whitening)
    size = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    missing = np.eye(len(values)) - whitening @ covariance @ whitening.T  # of directions that hardly vary
    root = best = _root(covariance)
    spread, error = np.ones(2), np.inf
    for k in range(MOST_PASSES):
        bodies = program.all_nearest(values + pilot @ root.T, lambda own, k=k: done(k * len(pilot) + own))
        found = bodies @ program.standard.regrouping.T
        relative = np.std(found, axis=0) / size
        worst = float(np.abs(np.log(np.maximum(relative, np.finfo(float).tiny))).max())
        if worst >= error:  # the cone is so narrow that wider draws only move along its sides
            break
        best, error, spread = root, worst, np.array([relative.min(), relative.max()])
        if error < CLOSE:
            break
        inverse = _power(np.cov(whitening @ found.T, bias=True) + missing, -(POWER if k else FIRST_POWER))
        root = colouring @ inverse @ whitening @ root
    return best, spread


class _Program:
    """Search for real bodies near drawn base parameters and near the exported bodies.

    The variables are z = R (θ - θ₀), where Q R is the QR factorisation of the stacked matrices of the squares to be
    minimised. All variables thus have the same scale, and the minimum is the point of the cone of real bodies that is
    nearest to Qᵀ times the drawn values.
    """

    def __init__(self, standard: StandardParameters, centre: Array, whitening: Array) -> None:
        self.standard, self.centre, self.whitening = standard, centre, whitening
        change = relative_change(standard, centre, list(standard.inertial))
        Q, R = np.linalg.qr(np.concatenate([whitening @ standard.regrouping, NEARNESS * change]))
        self.aim = Q[: len(whitening)].T @ whitening
        self.steps = np.linalg.inv(R)
        p = len(centre)
        self.cones: list[Cone] = []
        for cone in consistency_cones(standard, p):
            matrix = np.pad(cone.matrix @ self.steps, ((0, 0), (0, 1)))
            self.cones.append(Cone(cone.kind, matrix, cone.matrix @ centre + cone.offset))
        self.cost = np.append(np.zeros(p), 1.0)
        self.norm = np.roll(np.eye(p + 1), 1, axis=0)

    def all_nearest(self, base: Array, done: Callable[[int], None]) -> Array:
        """Standard parameters (N, p) of the real bodies that are nearest to drawn base parameters (N, b)."""
        bodies = np.empty((len(base), len(self.centre)))
        for k, each in enumerate(base):
            done(k)
            bodies[k] = self.nearest(each)
        return bodies

    def nearest(self, base: Array) -> Array:
        """Standard parameters (p,) of the real bodies that are nearest to drawn base parameters (b,)."""
        aim = self.aim @ (base - self.standard.regrouping @ self.centre)
        free = self.centre + self.steps @ aim
        if self._is_possible(free):
            return free
        offset = np.concatenate([[0.0], -aim])
        solution = solve_cones(self.cost, [*self.cones, Cone("norm", self.norm, offset)])
        found = self.centre + self.steps @ solution.x[:-1]
        bounded = np.flatnonzero(self.standard.nonnegative)
        found[bounded] = np.maximum(found[bounded], 0.0)  # zero to the accuracy of the solver
        return found

    def _is_possible(self, values: Array) -> bool:
        """True if standard parameters (p,) are those of real bodies, and no friction parameter is negative."""
        if (values[np.flatnonzero(self.standard.nonnegative)] < 0.0).any():
            return False
        return bool((smallest_eigenvalues(self.standard, values) >= EPSILON).all())


def _standardised(random: np.random.Generator, count: int, size: int) -> Array:
    """Normal random numbers (count, size) whose mean is zero and whose covariance is the identity, count > size."""
    drawn = random.standard_normal((count, size))
    drawn -= drawn.mean(axis=0)
    return drawn @ _power(np.cov(drawn.T, bias=True), -0.5)


def _power(covariance: Array, power: float) -> Array:
    """Power of a symmetric matrix (b, b), after eigenvalues below `SMALLEST_SPREAD` are raised to this bound."""
    sizes, vectors = np.linalg.eigh(np.atleast_2d(covariance))
    return (vectors * np.maximum(sizes, SMALLEST_SPREAD) ** power) @ vectors.T


def _root(covariance: Array) -> Array:
    """Matrix (b, b) whose product with its transpose is a covariance that may be singular."""
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))


def _whitening(covariance: Array) -> Array:
    """Matrix C (b, b) for which Cᵀ C is the inverse of a covariance.

    Eigenvalues of the correlation matrix below `SMALLEST_VARIANCE` are raised to this bound before.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    sizes, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return (vectors / np.sqrt(np.maximum(sizes, SMALLEST_VARIANCE))).T / scale
