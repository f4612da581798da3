"""Draws of bodies and friction from the distribution of an estimate, inside the cone of real bodies.

Base parameters are drawn from the normal distribution of the estimate on another recording. A draw outside the cone
of real bodies is replaced by the nearest point of the cone, in the metric of the covariance, so that the torque
changes as little as possible. Of all bodies with these base parameters, those near the exported ones are taken: the
bodies θ of a draw β minimise

    |C (K θ - β)|² + ε² |M (θ - θ₀)|²

with Cᵀ C the inverse covariance, K the regrouping, θ₀ the exported parameters, and M the relative change of the
pseudo-inertias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import OutputError
from armid.estimation.consistency.cones import EPSILON, consistency_cones, smallest_eigenvalues
from armid.estimation.estimate_record import collapse
from armid.estimation.problem import StandardParameters, standard_of
from armid.export.standard_values import relative_change
from armid.maths.conic_solver import Cone, solve_cones
from armid.runs.run import Run
from armid.study.progress import Progress, no_progress
from armid.threads import one_blas_thread
from armid.validation.prediction_interval import parameter_covariance

NEARNESS = 1e-3
"""Weight ε: a relative change of all bodies by 1 counts as much as a thousandth of a standard deviation of a base
parameter."""

SMALLEST_VARIANCE = 1e-9
"""Smallest eigenvalue of the correlation matrix of the base parameters, relative to 1, for its inverse."""

MOVED = 0.01
"""Distance from which a draw counts as replaced, in standard deviations."""


@dataclass(frozen=True, eq=False, slots=True)
class Draws:
    """Draws from the distribution of an estimate.

    Attributes:
        base: Base parameters of each draw after the replacement, shape (N, b).
        standard: Standard parameters of real bodies with these base parameters, and friction, shape (N, p).
        distance: Distance of each draw from the base parameters that were drawn, in standard deviations, shape (N,).
    """

    base: Array
    standard: Array
    distance: Array

    @property
    def replaced(self) -> float:
        """Share of the draws that were outside the cone and were replaced by the nearest point."""
        return float(np.mean(self.distance > MOVED))


@one_blas_thread
def draw_bodies(run: Run, centre: Array, count: int, seed: int = 0, *, progress: Progress = no_progress) -> Draws:
    """Draws possible arms from the distribution of the estimate of a run.

    Args:
        run: The run.
        centre: Standard parameters that a single export writes, shape (p,).
        count: Number of draws.
        seed: Seed of the random numbers.
        progress: Function that is called with the share of the draws that are done.

    Raises:
        OutputError: The number of draws is not positive.
        EstimationError: A program could not be solved accurately enough.
    """
    if count < 1:
        raise OutputError(f"An ensemble needs at least one draw; found {count}.", remedy="give a positive number.")
    base, fit = run.estimate.base, run.estimate.fit
    standard = standard_of(run.model, base)
    covariance = parameter_covariance(run.estimate)
    values = collapse(base.names, fit)
    drawn = values + np.random.default_rng(seed).standard_normal((count, len(values))) @ _root(covariance).T
    whitening = _whitening(covariance)
    program = _Program(standard, centre, whitening)
    bodies = np.empty((count, len(centre)))
    for k, each in enumerate(drawn):
        progress("ensemble", k / count)
        bodies[k] = program.nearest(each)
    kept = bodies @ standard.regrouping.T
    distance = np.linalg.norm((kept - drawn) @ whitening.T, axis=1)
    return Draws(kept, bodies, distance)


class _Program:
    """Bodies near drawn base parameters and near the exported bodies, inside the cone of real bodies.

    The variables are z = R (θ - θ₀), where Q R is the matrix of the squares to be minimised, stacked. So they all
    have the same scale, and the minimum is the point of the cone that is nearest to Qᵀ times the drawn values.
    """

    def __init__(self, standard: StandardParameters, centre: Array, whitening: Array) -> None:
        self.standard, self.centre = standard, centre
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

    def nearest(self, base: Array) -> Array:
        """Standard parameters (p,) of the bodies for drawn base parameters (b,)."""
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
        """True if standard parameters are those of real bodies, with friction that is not negative."""
        if (values[np.flatnonzero(self.standard.nonnegative)] < 0.0).any():
            return False
        return bool((smallest_eigenvalues(self.standard, values) >= EPSILON).all())


def _root(covariance: Array) -> Array:
    """Matrix (b, b) whose product with its transpose is a covariance that may be singular."""
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))


def _whitening(covariance: Array) -> Array:
    """Matrix C (b, b) with Cᵀ C the inverse of a covariance; very small eigenvalues of the correlation are raised."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    sizes, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return (vectors / np.sqrt(np.maximum(sizes, SMALLEST_VARIANCE))).T / scale
