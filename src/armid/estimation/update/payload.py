"""Payload identification: estimates ten parameters from a short recording and an earlier estimate of the arm.

The payload is a body on the last link. It adds G θ to the base parameters, where θ are the ten inertial parameters of
the payload and G the columns of the regrouping matrix for the last link. θ is estimated together with all uncertain
parameters of the arm. The result is an estimate θ̂ with the covariance C. It is then replaced by the nearest
physically consistent body: the θ with a positive semidefinite pseudo-inertia and the smallest distance d.

    d²(θ) = (θ - θ̂)ᵀ C⁻¹ (θ - θ̂)

An interval is computed in three steps. First, it is the interval by Student's t distribution about θ̂. Then it is
intersected with the values of consistent bodies in the joint 95 % region of all parameters. If the nearest consistent
body is outside this intersection, the interval is extended to the value of this body. The true body is consistent, so
the intersection does not reduce the coverage. An interval about the nearest body alone would not contain the true
value of a thin payload, whose inertia is on the boundary of the consistent set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import EstimationError
from armid.estimation.estimate_record import Status
from armid.estimation.link_properties import ENTERING
from armid.estimation.update.stacked_problem import StackedProblem
from armid.estimation.update.stacked_solution import JointSolution, solve_stacked
from armid.maths.conic_solver import Cone, solve_cones, upper_triangle
from armid.maths.distributions import student_quantile
from armid.maths.inertia import (
    PSEUDO_INERTIA_OF,
    about_com,
    about_com_slope,
    pseudo_inertia,
    vector_to_com_inertia,
)

LOAD_NAMES = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
"""Names of the ten parameters of the payload, in the order in which arrays contain the parameters."""

MASS, MOMENTS = 0, slice(1, 4)

EPSILON = 1e-6
"""Smallest eigenvalue that the pseudo-inertia of the payload is required to have [kg and kg·m²]; the eigenvalues
of real payloads are far larger."""

TRACE_WEIGHT = 1e-3
"""Weight with which the trace of the pseudo-inertia is added to the distance [1/kg]. If the data do not
distinguish several bodies, the smallest one is taken. In all other cases the term has no effect, because the
distance increases by one for each standard deviation."""

INFORMATIVE = 0.5
"""Largest half width of an interval with which a parameter counts as identified, divided by the bound of the
parameter that follows from mass and size of the payload."""

RANK_TOLERANCE = 1e-9
"""Ratio of a singular value to the largest below which its direction counts as a rounding error."""


@dataclass(frozen=True, eq=False, slots=True)
class PayloadEstimate:
    """Estimate of the payload on the last link, in the frame of this link.

    Attributes:
        values: Parameters of the nearest consistent body, shape (10,).
        statistical: 95 % intervals under the assumption that the torque scales are exact, shape (10, 2).
        intervals: 95 % intervals that include the uncertainty of the torque scales, shape (10, 2).
        status: Status of each parameter.
        com: Centre of mass, shape (3,) [m].
        com_intervals: 95 % intervals of the centre of mass, shape (3, 2) [m]; NaN if the recording does not determine
            a parameter from which the coordinate is computed.
        inertia_intervals: 95 % intervals of the inertia about the centre of mass, in the order of `LOAD_NAMES`, shape
            (6, 2) [kg·m²]; NaN if the recording does not determine a parameter from which the value is computed.
        distance: Distance between `values` and `unconstrained` in standard deviations; zero if `unconstrained` is
            consistent.
        unconstrained: Estimate without the constraint of consistency, shape (10,).
        solution: Solution of the stacked problem from which the payload was computed.
    """

    values: Array
    statistical: Array
    intervals: Array
    status: tuple[Status, ...]
    com: Array
    com_intervals: Array
    inertia_intervals: Array
    distance: float
    unconstrained: Array
    solution: JointSolution

    @property
    def inertia_about_com(self) -> Array:
        """Inertia about the centre of mass, in the axes of the link frame, shape (3, 3) [kg·m²]."""
        return vector_to_com_inertia(self.values)[2]

    @property
    def covariance(self) -> Array:
        """Covariance of `unconstrained`, with the uncertainty of the torque scales, shape (10, 10)."""
        return self.solution.whole_covariance[-10:, -10:]

    @property
    def quantile(self) -> float:
        """Half width of the 95 % intervals in standard deviations: quantile of Student's t distribution."""
        columns = len(self.solution.values)
        return float(student_quantile(float(self.solution.freedom[columns - 10 : columns].min())))


@dataclass(frozen=True, eq=False, slots=True)
class DriveGains:
    """Corrections of the drive gains: true torque = (1 + correction) · measured torque.

    Attributes:
        correction: Relative correction of each joint's gain, shape (n,).
        intervals: 95 % intervals of the corrections, shape (n, 2).
        determined: Mask of the joints whose gain the data or the prior determine, shape (n,).
    """

    correction: Array
    intervals: Array
    determined: NDArray[np.bool_]


def estimate_payload(stacked: StackedProblem) -> PayloadEstimate:
    """Estimates the payload of the new recordings.

    Args:
        stacked: Stacked problem of an earlier estimate and new recordings, with the ten payload parameters.

    Raises:
        EstimationError: The recording determines no parameter of the payload.
    """
    solution = solve_stacked(stacked)
    load = _payload(stacked, solution, np.full(10, np.nan))
    if all(status == "not identifiable" for status in load.status):
        raise EstimationError(
            "The recording determines none of the parameters of the load.",
            remedy="move the joints near the load faster and through wide angles, so that the load is rotated.",
        )
    return load


def estimate_gains(stacked: StackedProblem, known: Array, deviation: Array) -> tuple[PayloadEstimate, DriveGains]:
    """Estimates drive gains from a known payload, and the unknown parameters of the payload.

    Args:
        stacked: Stacked problem of an earlier estimate and new recordings, with the ten payload parameters.
        known: Known parameters of the payload, NaN for unknown ones, shape (10,).
        deviation: Relative standard deviations of the gains, shape (n,); infinite for unknown gains.

    Raises:
        EstimationError: The iteration does not converge, or the data determine no gain.
    """
    known = array(known, (10,), "known load", finite=False)
    solution = solve_stacked(stacked, scale_deviation=deviation, fixed=known)
    if solution.undetermined_scale.all():
        raise EstimationError(
            "The recordings determine none of the drive gains, because the known load causes no torque.",
            remedy="attach a heavier load, give its mass with --mass, and rotate it through wide angles.",
        )
    correction = 1.0 / solution.scale - 1.0
    freedom = solution.freedom[len(solution.values) :]
    half = student_quantile(freedom) * np.sqrt(np.diag(solution.scale_covariance)) / solution.scale**2
    intervals = np.stack([correction - half, correction + half], axis=1)
    return _payload(stacked, solution, known), DriveGains(correction, intervals, ~solution.undetermined_scale)


def _payload(stacked: StackedProblem, solution: JointSolution, known: Array) -> PayloadEstimate:
    """Computes the payload from the solution of a stacked problem: nearest consistent body, intervals and status."""
    ten = stacked.load
    free = np.isnan(known)
    estimate = solution.values[ten]
    null_space = _span(solution.undetermined[:, ten][:, free])
    undetermined = np.zeros(10, dtype=np.bool_)
    undetermined[free] = np.abs(null_space).max(axis=0, initial=0.0) > RANK_TOLERANCE
    if not free.any():
        return _known_payload(estimate, solution)
    region = _Region(estimate, free, null_space, solution.covariance[np.ix_(ten, ten)])
    region_with_scales = _Region(estimate, free, null_space, solution.whole_covariance[np.ix_(ten, ten)])
    values, distance = region.nearest()
    freedom = float(solution.freedom[ten].min())
    t = float(student_quantile(freedom))
    statistical = region.intervals(values, freedom, undetermined)
    intervals = (
        region_with_scales.intervals(values, freedom, undetermined)
        if solution.scale_effect[ten].any()
        else statistical
    )
    covariance = np.zeros((10, 10))
    covariance[np.ix_(free, free)] = region_with_scales.covariance
    return PayloadEstimate(
        values,
        statistical,
        intervals,
        _status(values, t * np.sqrt(np.diag(solution.covariance)[ten]), undetermined),
        values[MOMENTS] / values[MASS],
        com_intervals(values, covariance, t, undetermined),
        inertia_intervals(values, estimate, covariance, t, undetermined),
        distance,
        estimate,
        solution,
    )


def _known_payload(values: Array, solution: JointSolution) -> PayloadEstimate:
    """Makes the result for a payload whose ten parameters are all given."""
    exact = np.stack([values, values], axis=1)
    com = values[MOMENTS] / values[MASS]
    status: tuple[Status, ...] = ("identified",) * 10
    inertia = np.repeat(about_com(values)[4:, None], 2, axis=1)
    return PayloadEstimate(
        values, exact, exact, status, com, np.stack([com, com], axis=1), inertia, 0.0, values, solution
    )


def _span(directions: Array) -> Array:
    """Orthonormal rows that span the same space as the rows of `directions`."""
    if not directions.size:
        return np.zeros((0, directions.shape[1]))
    _, size, rows = np.linalg.svd(directions, full_matrices=False)
    return rows[size > RANK_TOLERANCE * max(size[0], RANK_TOLERANCE)]


class _Region:
    """Consistent bodies near an estimate of the payload, with the distance that its covariance defines.

    Attributes:
        estimate: The ten parameters without the constraint of consistency, shape (10,).
        free: Mask of the f unknown parameters, shape (10,).
        covariance: Covariance of the free parameters, shape (f, f).
        white: Whitening matrix of k rows, shape (k, f): the distance is |white · (θ - estimate)| standard deviations.
        body: Matrix and offset with which the free parameters give the upper triangle of (pseudo-inertia -
            `EPSILON`).
        reach: Largest change of an eigenvalue of the pseudo-inertia when the parameters change by one standard
            deviation.
    """

    def __init__(self, estimate: Array, free: NDArray[np.bool_], null_space: Array, covariance: Array) -> None:
        self.estimate, self.free = estimate, free
        self.covariance = covariance[np.ix_(free, free)]
        size = np.sqrt(np.maximum(np.diag(self.covariance), np.finfo(float).tiny))
        # The variance of an undetermined parameter is rounding error.
        size = np.where(size > RANK_TOLERANCE * size.max(), size, size.max())
        # The determined combinations are orthogonal to the null space, in units of one standard deviation.
        seen = np.linalg.svd(null_space * size)[2][len(null_space) :] if len(null_space) else np.eye(len(size))
        share, directions = np.linalg.eigh(seen @ (self.covariance / np.outer(size, size)) @ seen.T)
        share = np.maximum(share, RANK_TOLERANCE * share[-1])
        self.white = (directions / np.sqrt(share)).T @ seen / size
        i, j = upper_triangle(4)
        entries = PSEUDO_INERTIA_OF[:, i, j]
        self.body = entries[free].T, entries[~free].T @ estimate[~free] - EPSILON * (i == j)
        self.trace = np.trace(PSEUDO_INERTIA_OF, axis1=1, axis2=2)[free]
        spread = PSEUDO_INERTIA_OF[free].reshape(-1, 16).T @ (size[:, None] * seen.T @ (directions * np.sqrt(share)))
        self.reach = np.inf if len(null_space) else float(np.linalg.norm(spread, 2))

    def nearest(self) -> tuple[Array, float]:
        """Nearest consistent body (10,) and its distance in standard deviations."""
        if self._depth() >= 0.0 and np.isfinite(self.reach):
            return self.estimate.copy(), 0.0
        f = int(self.free.sum())
        rows = np.zeros((len(self.white) + 1, f + 1))
        rows[0, f] = 1.0
        rows[1:, :f] = self.white
        matrix, offset = self.body
        body = Cone("semidefinite", np.column_stack([matrix, np.zeros(len(matrix))]), offset)
        side = np.concatenate([[0.0], -self.white @ self.estimate[self.free]])
        nearest_free = solve_cones(np.append(TRACE_WEIGHT * self.trace, 1.0), [body, Cone("norm", rows, side)]).x[:f]
        values = self.estimate.copy()
        values[self.free] = nearest_free
        return values, self._distance(nearest_free)

    def _depth(self) -> float:
        """Smallest eigenvalue of the estimate's pseudo-inertia minus `EPSILON`; negative for an inconsistent body."""
        return float(np.linalg.eigvalsh(pseudo_inertia(self.estimate))[0]) - EPSILON

    def intervals(self, nearest: Array, freedom: float, undetermined: NDArray[np.bool_]) -> Array:
        """95 % intervals of the payload parameters, shape (10, 2).

        Intervals of undetermined parameters are NaN; intervals of known parameters have no width.
        """
        from scipy.special import fdtri  # a third of a second to import

        inside, rank = nearest[self.free], len(self.white)
        t = float(student_quantile(freedom))
        joint_quantile = rank * float(fdtri(rank, freedom, 0.95))
        radius = float(np.sqrt(max(joint_quantile, self._distance(inside) ** 2 + t**2)))
        half = t * np.sqrt(np.diag(self.covariance))
        ends = np.full((10, 2), np.nan)
        ends[~self.free] = self.estimate[~self.free, None]
        ends[self.free] = self.estimate[self.free, None] + half[:, None] * [-1.0, 1.0]
        if self._depth() < radius * self.reach:  # the region contains inconsistent bodies
            self._intersect(ends, nearest, radius, undetermined)
        ends[undetermined] = np.nan
        return ends

    def _intersect(self, ends: Array, nearest: Array, radius: float, undetermined: NDArray[np.bool_]) -> None:
        """Intersects intervals with the values that consistent bodies in the 95 % region have.

        An interval that contains no such value becomes the nearest one. Each interval is extended so that it contains
        the value of the nearest body.

        Args:
            ends: Lower and upper ends of the intervals, which are changed in place, shape (10, 2).
            nearest: Nearest consistent body, shape (10,).
            radius: Size of the region in standard deviations.
            undetermined: Mask of the parameters that the data do not determine, shape (10,).
        """
        f = int(self.free.sum())
        rows = np.vstack([np.zeros(f), self.white])
        offset = np.concatenate([[radius], -self.white @ self.estimate[self.free]])
        cones = [Cone("semidefinite", *self.body), Cone("norm", rows, offset)]
        for position, k in enumerate(np.flatnonzero(self.free)):
            if undetermined[k]:
                continue
            cost = np.zeros(f)
            cost[position] = 1.0 / np.sqrt(self.covariance[position, position])
            possible = [solve_cones(sign * cost, cones).x[position] for sign in (1.0, -1.0)]
            low, high = np.clip(ends[k], min(possible), max(possible))
            ends[k] = min(low, nearest[k]), max(high, nearest[k])

    def _distance(self, free: Array) -> float:
        """Distance of a body, given by its free parameters (f,), from the estimate in standard deviations."""
        return float(np.linalg.norm(self.white @ (free - self.estimate[self.free])))


def _status(values: Array, half: Array, undetermined: NDArray[np.bool_]) -> tuple[Status, ...]:
    """Status of each parameter of the payload, from the width of its interval and a bound.

    A parameter is identified if half of the interval is small compared with the largest value that is possible for
    the mass M and the size r of the payload: |MX| ≤ M r and |XX| ≤ M r², where r² is the mean square distance of the
    mass from the origin of the frame.

    Args:
        values: Parameters of the payload, shape (10,).
        half: Half widths of the intervals without the constraint of consistency, shape (10,).
        undetermined: Mask of the parameters that the data do not determine, shape (10,).
    """
    mass = max(values[MASS], EPSILON)
    square = max(float(np.trace(pseudo_inertia(values)[:3, :3])) / mass, EPSILON)
    allowed = mass * np.repeat([1.0, np.sqrt(square), square], [1, 3, 6])
    result: list[Status] = []
    for k in range(10):
        if undetermined[k]:
            result.append("not identifiable")
        else:
            result.append("identified" if half[k] <= INFORMATIVE * allowed[k] else "prior-dominated")
    return tuple(result)


def com_intervals(values: Array, covariance: Array, t: float, undetermined: NDArray[np.bool_]) -> Array:
    """95 % intervals of the centre of mass of a payload, shape (3, 2) [m].

    Args:
        values: Parameters of the payload, shape (10,).
        covariance: Covariance of the parameters, shape (10, 10).
        t: Quantile of Student's t distribution for 95 % intervals.
        undetermined: Mask of the parameters that the data do not determine, shape (10,). Intervals of values that
            depend on these are NaN.
    """
    mass = values[MASS]
    com = values[MOMENTS] / mass
    slope = np.zeros((3, 10))
    slope[:, MASS], slope[:, MOMENTS] = -com / mass, np.eye(3) / mass
    half = t * np.sqrt(np.maximum(np.einsum("ik,kl,il->i", slope, covariance, slope), 0.0))
    half[(ENTERING[MOMENTS] & undetermined).any(axis=1)] = np.nan
    return np.stack([com - half, com + half], axis=1)


def inertia_intervals(
    values: Array, estimate: Array, covariance: Array, t: float, undetermined: NDArray[np.bool_]
) -> Array:
    """95 % intervals of the inertia of a payload about its centre of mass, from derivatives by the parameters.

    The intervals are centred at the unconstrained estimate and extended to the nearest consistent body. Intervals of
    moments of inertia contain no negative values.

    Args:
        values: Parameters of the nearest consistent body, shape (10,).
        estimate: Parameters without the constraint of consistency, shape (10,).
        covariance: Covariance of the parameters, shape (10, 10).
        t: Quantile of Student's t distribution for 95 % intervals.
        undetermined: Mask of the parameters that the data do not determine, shape (10,). Intervals of values that
            depend on these are NaN.

    Returns:
        Intervals in the order of `LOAD_NAMES`, shape (6, 2) [kg·m²].
    """
    ends = np.full((6, 2), np.nan)
    if estimate[MASS] > 0.0:
        slope = about_com_slope(estimate)
        half = t * np.sqrt(np.maximum(np.einsum("ik,kl,il->i", slope, covariance, slope), 0.0))
        about = about_com(estimate)
        ends = np.stack([about - half, about + half], axis=1)[4:]
        ends[[0, 2, 5]] = np.maximum(ends[[0, 2, 5]], 0.0)
        nearest = about_com(values)[4:]
        ends = np.stack([np.minimum(ends[:, 0], nearest), np.maximum(ends[:, 1], nearest)], axis=1)
    ends[(ENTERING[4:] & undetermined).any(axis=1)] = np.nan
    return ends
