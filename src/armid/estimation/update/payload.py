"""The load that an arm carries: ten parameters from a short recording beside an earlier estimate of the arm.

The load is a body on the last link, so it adds G θ to the base parameters, with θ its ten parameters and G their
columns of the regrouping. θ is estimated together with all that is uncertain about the arm, then moved to the nearest
real body: the one with pseudo-inertia ⪰ 0 whose distance d from the estimate θ̂, by its covariance C, is least.

    d²(θ) = (θ - θ̂)ᵀ C⁻¹ (θ - θ̂)

An interval is Student's about θ̂, less what no real body within the joint 95 % region of all parameters has, and
widened to the nearest real body where that lies outside. The truth is a real body, so nothing is lost by it; an
interval about the nearest body alone would miss a thin load, whose inertia lies at the border of what is real.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError
from armid.estimation.estimate import Status
from armid.estimation.link_properties import ENTERING
from armid.estimation.update.joint_solution import JointSolution, solve_joined
from armid.estimation.update.stacked_problem import StackedProblem
from armid.maths.cones import Cone, solve_cones, upper_triangle
from armid.maths.inertia import (
    PSEUDO_INERTIA_OF,
    about_com,
    about_com_slope,
    pseudo_inertia,
    vector_to_com_inertia,
)
from armid.values import Array, array

__all__ = ["LOAD_NAMES", "DriveGains", "PayloadEstimate", "estimate_gains", "estimate_payload"]

LOAD_NAMES = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
"""Names of the load's parameters, in the order that they have everywhere."""

MASS, MOMENTS = 0, slice(1, 4)

EPSILON = 1e-6
"""Smallest eigenvalue asked of the load's pseudo-inertia [kg and kg·m²]: a speck of dust."""

SMALLEST = 1e-3
"""Weight of the pseudo-inertia's trace [1/kg] beside the distance: of bodies that the data cannot tell apart, the
smallest is taken. Where data tell of it to better than hundreds of kilograms the distance alone decides, whose slope
is one a standard deviation wherever it is not zero."""

TELLS = 0.5
"""Half width of an interval, over what mass and extension of the load allow at all, from which on the recording adds
little to them."""

SAME_SPACE = 1e-9
"""Singular value over the largest below which a direction is no further one: rounding."""


@dataclass(frozen=True, eq=False, slots=True)
class PayloadEstimate:
    """A body on the last link, in the frame of its ten parameters.

    Attributes:
        values: Parameters of the nearest real body, shape (10,).
        statistical: 95 % intervals, scales of torque taken as exact, shape (10, 2).
        intervals: 95 % intervals with uncertain scales of torque, shape (10, 2).
        status: What the recording says of each.
        com: Centre of mass, shape (3,) [m].
        com_intervals: Its 95 % intervals, shape (3, 2) [m]; NaN where the recording does not determine what enters.
        inertia_intervals: Those of the inertia about it, in parameter order, shape (6, 2) [kg·m²]; NaN likewise.
        moved: Distance of the unconstrained estimate from it, in standard deviations; zero where that was real.
        unconstrained: The estimate without the condition, shape (10,).
        solved: Solution that it comes from.
    """

    values: Array
    statistical: Array
    intervals: Array
    status: tuple[Status, ...]
    com: Array
    com_intervals: Array
    inertia_intervals: Array
    moved: float
    unconstrained: Array
    solved: JointSolution

    @property
    def inertia_about_com(self) -> Array:
        """Inertia about the centre of mass, axes of the frame, shape (3, 3) [kg·m²]."""
        return vector_to_com_inertia(self.values)[2]


@dataclass(frozen=True, eq=False, slots=True)
class DriveGains:
    """Gains of the joints' torques: true = (1 + correction) · measured.

    Attributes:
        correction: Shape (n,).
        intervals: 95 % intervals, shape (n, 2).
        determined: Which of them something determines, shape (n,).
    """

    correction: Array
    intervals: Array
    determined: NDArray[np.bool_]


def estimate_payload(joined: StackedProblem) -> PayloadEstimate:
    """The load of the new recordings.

    Args:
        joined: New recordings beside an earlier estimate, with the load's ten parameters.

    Raises:
        EstimationError: The recording tells nothing about the load.
    """
    solved = solve_joined(joined)
    load = _load(joined, solved, np.full(10, np.nan))
    if "identified" not in load.status:
        raise EstimationError(
            "The recording determines none of the load's parameters: "
            + ", ".join(f"{name} ({status})" for name, status in zip(LOAD_NAMES, load.status, strict=True))
            + ".",
            remedy="move the joints next to the load through wide angles, so that its weight turns, and faster.",
        )
    return load


def estimate_gains(joined: StackedProblem, known: Array, deviation: Array) -> tuple[PayloadEstimate, DriveGains]:
    """Scales of the joints' torques from a load that is known, and what is not known of the load.

    Args:
        joined: As for `estimate_payload`.
        known: Parameters of the load that are known, NaN where they are not, shape (10,).
        deviation: How far the scales may be from what was said, relative, shape (n,); infinite for no idea.

    Raises:
        EstimationError: They do not settle, or nothing determines any of them.
    """
    known = array(known, (10,), "known load", finite=False)
    solved = solve_joined(joined, scale_deviation=deviation, fixed=known)
    if solved.unseen_scale.all():
        raise EstimationError(
            "The recordings determine none of the drive gains: the known load makes no torque in them.",
            remedy="give --mass of a load that the arm feels, and turn it through wide angles.",
        )
    correction = 1.0 / solved.scale - 1.0
    freedom = solved.freedom[len(solved.values) :]
    half = _student(freedom) * np.sqrt(np.diag(solved.scale_covariance)) / solved.scale**2
    intervals = np.stack([correction - half, correction + half], axis=1)
    return _load(joined, solved, known), DriveGains(correction, intervals, ~solved.unseen_scale)


def _student(freedom: Array) -> Array:
    """Student's quantiles of 95 % intervals."""
    from scipy.special import stdtrit  # a third of a second to import

    return np.asarray(stdtrit(freedom, 0.975), dtype=np.float64)


def _load(joined: StackedProblem, solved: JointSolution, known: Array) -> PayloadEstimate:
    """The load from a solution: the nearest real body, intervals, what each is worth."""
    ten = joined.load
    free = np.isnan(known)
    estimate = solved.values[ten]
    unseen = _span(solved.unseen[:, ten][:, free])
    blind = np.zeros(10, dtype=np.bool_)
    blind[free] = np.abs(unseen).max(axis=0, initial=0.0) > SAME_SPACE
    if not free.any():
        return _as_known(estimate, solved)
    narrow = _Region(estimate, free, unseen, solved.covariance[np.ix_(ten, ten)])
    wide = _Region(estimate, free, unseen, solved.whole_covariance[np.ix_(ten, ten)])
    values, moved = narrow.nearest()
    freedom = float(solved.freedom[ten].min())
    t = float(_student(np.array(freedom)))
    statistical = narrow.intervals(values, freedom, blind)
    intervals = wide.intervals(values, freedom, blind) if solved.moves[ten].any() else statistical
    covariance = np.zeros((10, 10))
    covariance[np.ix_(free, free)] = wide.covariance
    com, com_half = _com(values, covariance, t)
    com_half[(ENTERING[MOMENTS] & blind).any(axis=1)] = np.nan
    return PayloadEstimate(
        values,
        statistical,
        intervals,
        _status(values, t * np.sqrt(np.diag(solved.covariance)[ten]), blind),
        com,
        np.stack([com - com_half, com + com_half], axis=1),
        _inertia_about_com(values, estimate, covariance, t, blind),
        moved,
        estimate,
        solved,
    )


def _as_known(values: Array, solved: JointSolution) -> PayloadEstimate:
    """A load of which everything was said."""
    exact = np.stack([values, values], axis=1)
    com = values[MOMENTS] / values[MASS]
    status: tuple[Status, ...] = ("identified",) * 10
    inertia = np.repeat(about_com(values)[4:, None], 2, axis=1)
    return PayloadEstimate(
        values, exact, exact, status, com, np.stack([com, com], axis=1), inertia, 0.0, values, solved
    )


def _span(directions: Array) -> Array:
    """Orthonormal rows with the same span."""
    if not directions.size:
        return np.zeros((0, directions.shape[1]))
    _, size, rows = np.linalg.svd(directions, full_matrices=False)
    return rows[size > SAME_SPACE * max(size[0], SAME_SPACE)]


class _Region:
    """Real bodies near an estimate, in the metric of its covariance.

    Attributes:
        estimate: All ten parameters, unconstrained, shape (10,).
        free: Which are unknown, f of them, shape (10,).
        covariance: Of the free parameters, shape (f, f).
        white: Distance = |white · (θ - estimate)| in standard deviations of what is determined, shape (k, f).
        body: Matrix and offset of the pseudo-inertia's upper triangle, less the speck, in the free parameters.
        reach: Largest change of an eigenvalue of the pseudo-inertia within one standard deviation.
    """

    def __init__(self, estimate: Array, free: NDArray[np.bool_], unseen: Array, covariance: Array) -> None:
        self.estimate, self.free = estimate, free
        self.covariance = covariance[np.ix_(free, free)]
        size = np.sqrt(np.maximum(np.diag(self.covariance), np.finfo(float).tiny))
        # Of a parameter that nothing shows only rounding has a size.
        size = np.where(size > SAME_SPACE * size.max(), size, size.max())
        # What the data see are combinations at right angles to all that they do not, in units of one deviation.
        seen = np.linalg.svd(unseen * size)[2][len(unseen) :] if len(unseen) else np.eye(len(size))
        share, directions = np.linalg.eigh(seen @ (self.covariance / np.outer(size, size)) @ seen.T)
        share = np.maximum(share, SAME_SPACE * share[-1])
        self.white = (directions / np.sqrt(share)).T @ seen / size
        i, j = upper_triangle(4)
        entries = PSEUDO_INERTIA_OF[:, i, j]
        self.body = entries[free].T, entries[~free].T @ estimate[~free] - EPSILON * (i == j)
        self.trace = np.trace(PSEUDO_INERTIA_OF, axis1=1, axis2=2)[free]
        spread = PSEUDO_INERTIA_OF[free].reshape(-1, 16).T @ (size[:, None] * seen.T @ (directions * np.sqrt(share)))
        self.reach = np.inf if len(unseen) else float(np.linalg.norm(spread, 2))

    def nearest(self) -> tuple[Array, float]:
        """The nearest real body (10,) and its distance in standard deviations."""
        if self._depth() >= 0.0 and np.isfinite(self.reach):
            return self.estimate.copy(), 0.0
        f = int(self.free.sum())
        rows = np.zeros((len(self.white) + 1, f + 1))
        rows[0, f] = 1.0
        rows[1:, :f] = self.white
        matrix, offset = self.body
        body = Cone("semidefinite", np.column_stack([matrix, np.zeros(len(matrix))]), offset)
        side = np.concatenate([[0.0], -self.white @ self.estimate[self.free]])
        found = solve_cones(np.append(SMALLEST * self.trace, 1.0), [body, Cone("norm", rows, side)]).x[:f]
        values = self.estimate.copy()
        values[self.free] = found
        return values, self._distance(found)

    def _depth(self) -> float:
        """Smallest eigenvalue of the estimate's pseudo-inertia over the speck; negative where it is no real body."""
        return float(np.linalg.eigvalsh(pseudo_inertia(self.estimate))[0]) - EPSILON

    def intervals(self, nearest: Array, freedom: float, blind: NDArray[np.bool_]) -> Array:
        """95 % intervals (10, 2): NaN for what nothing determines, of no width for what is known."""
        from scipy.special import fdtri  # a third of a second to import

        inside, rank = nearest[self.free], len(self.white)
        t = float(_student(np.array(freedom)))
        together = rank * float(fdtri(rank, freedom, 0.95))
        radius = float(np.sqrt(max(together, self._distance(inside) ** 2 + t**2)))
        half = t * np.sqrt(np.diag(self.covariance))
        ends = np.full((10, 2), np.nan)
        ends[~self.free] = self.estimate[~self.free, None]
        ends[self.free] = self.estimate[self.free, None] + half[:, None] * [-1.0, 1.0]
        if self._depth() < radius * self.reach:  # some bodies in the region are not real
            self._cut(ends, nearest, radius, blind)
        ends[blind] = np.nan
        return ends

    def _cut(self, ends: Array, nearest: Array, radius: float, blind: NDArray[np.bool_]) -> None:
        """Take from intervals what no real body in the region has, and widen them to the nearest real body."""
        f = int(self.free.sum())
        rows = np.vstack([np.zeros(f), self.white])
        offset = np.concatenate([[radius], -self.white @ self.estimate[self.free]])
        cones = [Cone("semidefinite", *self.body), Cone("norm", rows, offset)]
        for place, k in enumerate(np.flatnonzero(self.free)):
            if blind[k]:
                continue
            cost = np.zeros(f)
            cost[place] = 1.0 / np.sqrt(self.covariance[place, place])
            low = max(ends[k, 0], solve_cones(cost, cones).x[place])
            high = min(ends[k, 1], solve_cones(-cost, cones).x[place])
            ends[k] = min(low, high, nearest[k]), max(low, high, nearest[k])

    def _distance(self, free: Array) -> float:
        """Distance from the estimate in standard deviations."""
        return float(np.linalg.norm(self.white @ (free - self.estimate[self.free])))


def _status(values: Array, half: Array, blind: NDArray[np.bool_]) -> tuple[Status, ...]:
    """Return the share of the recording in each parameter, beside what mass and extension of a real body allow.

    `half` are half widths (10,) of intervals without the condition. With r² the mean square distance of the load's
    mass from the origin, |MX| ≤ M r and |XX| ≤ M r².
    """
    mass = max(values[MASS], EPSILON)
    square = max(float(np.trace(pseudo_inertia(values)[:3, :3])) / mass, EPSILON)
    allowed = mass * np.repeat([1.0, np.sqrt(square), square], [1, 3, 6])
    result: list[Status] = []
    for k in range(10):
        if blind[k]:
            result.append("not identifiable")
        else:
            result.append("identified" if half[k] <= TELLS * allowed[k] else "prior-dominated")
    return tuple(result)


def _com(values: Array, covariance: Array, t: float) -> tuple[Array, Array]:
    """Centre of mass (3,) and half width of its intervals, by its slope in mass and first moments."""
    mass = values[MASS]
    com = values[MOMENTS] / mass
    slope = np.zeros((3, 10))
    slope[:, MASS], slope[:, MOMENTS] = -com / mass, np.eye(3) / mass
    return com, t * np.sqrt(np.einsum("ik,kl,il->i", slope, covariance, slope))


def _inertia_about_com(
    values: Array, estimate: Array, covariance: Array, t: float, blind: NDArray[np.bool_]
) -> Array:
    """Intervals (6, 2) of the inertia about the centre of mass, by its slope.

    About the estimate without the condition, widened to the nearest real body, whose moments are not negative.
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
    ends[(ENTERING[4:] & blind).any(axis=1)] = np.nan
    return ends
