"""Estimate of a fleet: common bodies, and friction, offsets and torque scales of each unit.

The rows of a unit are linear in all unknowns at given torque scales. Noise, torque scales and the scatter between units
are estimated in turn until they no longer change. Units that differ from all others are found, left out of means and
scatter, and the estimate is repeated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import EstimationError
from armid.estimation.fleet.between_units import FREE, LEAST, STEPS, Population, common_names, estimate_population
from armid.estimation.fleet.elimination import Common, eliminate, left_out_factors, solve_common
from armid.estimation.fleet.layout import FleetLayout, fleet_layout
from armid.estimation.fleet.odd_units import (
    FALSE_ALARM,
    FEWEST,
    TOLD,
    OddBodies,
    OddUnknown,
    bodies_probability,
    holm,
    robust_start,
    student_two_sided,
)
from armid.estimation.fleet.unit_rows import residual_squares, score_squares, torque_squares, unit_rows
from armid.estimation.fleet.unit_update import FleetPrior, UnitEstimate, update_unit
from armid.information.information import Information, total
from armid.threads import one_blas_thread

ROUNDS = 12
"""Largest number of rounds in which noise, torque scales and scatter are estimated in turn; five are usual."""

SETTLED = 1e-3
"""Largest relative change of the noise, and largest change of a torque scale, at which the rounds end."""

FIRST_OWN, FIRST_SCALE, NO_SCALE = 0.3, 0.05, 1e-6
"""First standard deviations between units: effect of an own parameter on the RMS torque; torque scale; torque scale in
the first round, in which the predicted torque is not known yet."""

AGAIN = 0.1
"""Share of the first standard deviations from which a round starts at least. The algorithm approaches a variance from
above in few steps; from far below it would need many."""

REPEATS = 8
"""Largest number of estimates with other odd units left out."""

BODY_EFFECT = 0.02
"""Smallest change of the RMS torque of a joint, relative to its RMS torque, for which bodies count as odd."""


@dataclass(frozen=True, eq=False, slots=True)
class FleetEstimate:
    """Estimate of a fleet of U units.

    Attributes:
        units: Names of the units.
        prior: Distribution of a further unit of the fleet.
        values: Base parameters of each unit, shape (U, b).
        deviation: Their standard deviations, shape (U, b).
        scale: Torque scale of each unit and joint, shape (U, n).
        scale_deviation: Standard deviations of the torque scales, shape (U, n).
        between: Standard deviation between units of each own unknown, shape (m,).
        score: Difference of each own unknown from the other units, divided by its standard deviation, shape (U, m);
            NaN if it cannot be judged.
        odd: Own unknowns that differ from the other units, the least probable first.
        odd_bodies: Units whose bodies differ from the other units.
        own: Names of the own unknowns, m of them.
        joint: Joint to which each own unknown belongs, from 0, shape (m,).
    """

    units: tuple[str, ...]
    prior: FleetPrior
    values: Array
    deviation: Array
    scale: Array
    scale_deviation: Array
    between: Array
    score: Array
    odd: tuple[OddUnknown, ...] = ()
    odd_bodies: tuple[OddBodies, ...] = ()
    own: tuple[str, ...] = ()
    joint: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", tuple(self.units))
        object.__setattr__(self, "own", tuple(self.own))
        count = len(self.units)
        for name in ("values", "deviation", "scale", "scale_deviation", "score"):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, array(given, (count, None), name, finite=name != "score"))
        object.__setattr__(self, "odd", tuple(self.odd))
        object.__setattr__(self, "odd_bodies", tuple(self.odd_bodies))


@dataclass(frozen=True, eq=False, slots=True)
class FleetResult:
    """Estimate of a fleet, and for each of its units what all other units say about it.

    Attributes:
        estimate: The estimate.
        priors: Distribution of the parameters of each unit without its own data, by the name of the unit.
        layout: Order of the unknowns.
    """

    estimate: FleetEstimate
    priors: Mapping[str, FleetPrior]
    layout: FleetLayout


@one_blas_thread
def estimate_fleet(units: Mapping[str, Information], own: NDArray[np.bool_]) -> FleetResult:
    """Estimates a fleet from the information of its units; the order of the units has no effect.

    Args:
        units: Information of each unit, by name; at least two.
        own: Mask of the base parameters that each unit has for itself, shape (b,).

    Raises:
        EstimationError: There are fewer than two units, they have different parameters, or they do not determine all
            common parameters.
    """
    names = sorted(units)
    if len(names) < 2:
        raise EstimationError(
            f"A fleet needs at least two units whose parameters are not known; found {len(names)}.",
            remedy="add the recordings of another unit, or use armid identify for a single arm.",
        )
    first = units[names[0]]
    for name in names[1:]:
        if units[name].names != first.names or units[name].n != first.n:
            raise EstimationError(
                f"The units {names[0]} and {name} have different base parameters.",
                remedy="compute all units with the same robot and the same torque terms.",
            )
    return _Fleet([units[name] for name in names], names, fleet_layout(first, own)).result(list(units))


class _Fleet:
    """State of the estimate of a fleet: noise, torque scales, parameters of each unit, and odd units.

    Attributes:
        kept: Mask of the own unknowns that count for means and scatter, shape (U, m).
        bodies: Mask of the units that count for the shared parameters, shape (U,).
        noise: Standard deviation of each joint's residual, shape (n,) [N·m or N].
        correlation: Number of rows that count as one independent sample, shape (n,).
        values: Base parameters of each unit, shape (U, b).
        scale: Torque scales, shape (U, n).
        deviation: Standard deviation of each own unknown between units, shape (m,).
        first: First standard deviation of each own unknown between units, shape (m,).
        stage: Number of rounds that were made.
    """

    def __init__(self, units: list[Information], names: list[str], layout: FleetLayout) -> None:
        self.units, self.names, self.layout = units, names, layout
        self.whole = [total(each) for each in units]
        count, n = len(units), layout.n
        self.rows = np.sum([each.rows[0] for each in self.whole], axis=0)
        torque = np.sum([torque_squares(each) for each in self.whole], axis=0)
        self.torque = np.sqrt(np.maximum(torque / np.maximum(self.rows, 1), np.finfo(float).tiny))
        self.noise, self.correlation = self.torque.copy(), np.ones(n)
        self.values, self.scale = np.zeros((count, len(layout.names))), np.ones((count, n))
        self.kept = np.ones((count, layout.count), dtype=np.bool_)
        self.bodies = np.ones(count, dtype=np.bool_)
        size = self._own_sizes()
        self.first = np.concatenate([FIRST_OWN * size, np.full(n, FIRST_SCALE)])
        self.deviation = self.first.copy()
        self.stage = 0
        self.least = LEAST * self.first

    def _own_sizes(self) -> Array:
        """Size of each own parameter that has the RMS torque of its joint, shape (d,)."""
        sizes = np.ones(len(self.layout.own))
        for k, (parameter, j) in enumerate(zip(self.layout.own, self.layout.joint, strict=False)):
            at = int(np.searchsorted(self.whole[0].joints[j].parameters, parameter))
            square = sum(float(np.sum(each.joints[j].R[0, :, at] ** 2)) for each in self.whole)
            sizes[k] = self.torque[j] / np.sqrt(square / max(self.rows[j], 1)) if square > 0.0 else 1.0
        return sizes

    @property
    def weights(self) -> Array:
        """Weight of the rows of each joint, shape (n,)."""
        return 1.0 / (self.noise * np.sqrt(self.correlation))

    def result(self, order: list[str]) -> FleetResult:
        """Estimates the fleet; the units of the result are in the given order."""
        population = self._settled()
        for repeat in range(REPEATS):
            priors = self._priors(population)
            estimates = [
                update_unit(prior, each, self.layout) for prior, each in zip(priors, self.whole, strict=True)
            ]
            if len(self.units) < FEWEST:
                score, odd, bodies = np.full(population.own.shape, np.nan), [], []
                break
            score, odd = self._odd_unknowns(population, priors, estimates)
            bodies = self._odd_bodies(population)
            kept, usual = np.ones_like(self.kept), np.ones_like(self.bodies)
            for each in odd:
                kept[self.names.index(each.unit), self.layout.own_names.index(each.parameter)] = False
            for each in bodies:
                usual[self.names.index(each.unit)] = False
            if np.array_equal(kept, self.kept) and np.array_equal(usual, self.bodies):
                break
            if repeat < REPEATS - 1:
                self.kept, self.bodies = kept, usual
                population = self._settled()
        return self._assembled(population, priors, estimates, score, (odd, bodies), order)

    def _settled(self) -> Population:
        """Estimates noise, torque scales, scatter and parameters in turn until they no longer change."""
        for round_number in range(ROUNDS):
            rows = self._unit_rows()
            start = np.maximum(self.deviation, AGAIN * self.first)
            steps = STEPS
            if self.stage == 0:  # without predicted torques, noise and scales are not known
                steps, start[len(self.layout.own) :] = 0, NO_SCALE
            population = estimate_population(
                rows, self.layout, start, self.least, self._masks(), usual=self.bodies, steps=steps
            )
            self.deviation = population.deviation.copy()
            if self.stage == 0:
                self.deviation = self.first.copy()
            elif self.stage == 1:
                self.kept = robust_start(population.own, population.squares - population.own**2)
            self.stage += 1
            before = self.noise.copy(), self.scale.copy()
            self._use(population)
            change = np.abs(np.log(self.noise / before[0])).max(), np.abs(self.scale - before[1]).max()
            if round_number > 1 and max(change) <= SETTLED:
                break
        return population

    def _unit_rows(self) -> list[Array]:
        """Triangular factors of all units, linearised at the current parameters and torque scales."""
        return [
            unit_rows(each, self.layout, self.weights, values, scale)
            for each, values, scale in zip(self.whole, self.values, self.scale, strict=True)
        ]

    def _masks(self) -> NDArray[np.bool_]:
        """Mask of the own unknowns that count for means and scatter; a unit with odd bodies does not count."""
        return self.kept & self.bodies[:, None]

    def _use(self, population: Population) -> None:
        """Takes over parameters and torque scales of the units, and computes noise and correlation from residuals."""
        layout, d, n = self.layout, len(self.layout.own), self.layout.n
        squares, free = np.zeros(n), np.zeros(n)
        gradients, ranks = np.zeros(n), np.zeros(n)
        per_joint = np.bincount(layout.joint, minlength=n)
        for u, each in enumerate(self.whole):
            self.values[u] = layout.base_values(population.common.values, population.own[u])
            self.scale[u] = 1.0 + population.own[u, d:]
            squares += residual_squares(each, self.values[u], self.scale[u])
            free += np.maximum(each.rows[0] - np.where(each.rows[0] > 0, per_joint, 0), 0)
            found = score_squares(self.units[u], self.values[u], self.scale[u])
            gradients += found[0]
            ranks += found[1]
        free -= len(layout.shared) / n
        variance = np.maximum(squares / np.maximum(free, 1.0), 1e-24 * self.torque**2)
        self.noise = np.sqrt(variance)
        self.correlation = np.maximum(gradients / (variance * np.maximum(ranks, 1.0)), 1.0)

    def _priors(self, population: Population) -> list[FleetPrior]:
        """What all other units say about each unit."""
        factors = [unit.factor for unit in population.units]
        mask = self._masks()
        number = mask.sum(axis=0)
        total_squares = np.where(mask, population.squares, 0.0).sum(axis=0)
        result: list[FleetPrior] = []
        for u, factor in enumerate(left_out_factors(factors)):
            others = number - mask[u]
            squares = total_squares - np.where(mask[u], population.squares[u], 0.0)
            deviation = np.maximum(np.sqrt(squares / np.maximum(others, 1)), self.least)
            common = solve_common(factor, common_names(self.layout))
            wide = np.where(self.kept[u], deviation, FREE * deviation)
            result.append(self._prior(common, wide, float(others.min()) - 1.0, odd_bodies=not self.bodies[u]))
        return result

    def _prior(self, common: Common, deviation: Array, freedom: float, *, odd_bodies: bool = False) -> FleetPrior:
        """Distribution of a unit from common unknowns and the scatter between units.

        Args:
            common: Common unknowns, from other units.
            deviation: Standard deviation of each own unknown of the unit, shape (m,).
            freedom: Degrees of freedom of the scatter.
            odd_bodies: True if the bodies of the unit are known to differ.
        """
        layout, d = self.layout, len(self.layout.own)
        order = np.concatenate([layout.shared, layout.own])
        root = np.empty_like(common.half)
        root[order] = common.half
        covariance = root @ root.T
        if odd_bodies:
            covariance = FREE**2 * covariance
        covariance[layout.own, layout.own] += deviation[:d] ** 2
        mean = np.empty(len(layout.names))
        mean[order] = common.values
        own = layout.own_names[:d]
        return FleetPrior(
            layout.names, mean, covariance, deviation[d:], self.noise, self.correlation, own, max(freedom, 1.0)
        )

    def _odd_unknowns(
        self, population: Population, priors: list[FleetPrior], estimates: list[UnitEstimate]
    ) -> tuple[Array, list[OddUnknown]]:
        """Scores of all own unknowns, shape (U, m), and those that differ from the other units."""
        layout, d = self.layout, len(self.layout.own)
        score = np.full(population.own.shape, np.nan)
        freedom = np.ones_like(score)
        mask = self._masks()
        for u, (prior, found) in enumerate(zip(priors, estimates, strict=True)):
            width = np.append(np.diag(prior.covariance)[layout.own], prior.scale_deviation**2)
            after = np.append(np.diag(found.covariance)[layout.own], found.scale_deviation**2)
            # An unknown that was left out has a wide distribution here; it is compared with that of the others.
            others = mask.sum(axis=0) - mask[u]
            squares = np.where(mask, population.squares, 0.0).sum(axis=0) - np.where(
                mask[u], population.squares[u], 0.0
            )
            usual = np.maximum(squares / np.maximum(others, 1), self.least**2)
            between = np.where(self.kept[u], usual, FREE**2 * usual)
            noise = np.where(after < width, after * width / np.maximum(width - after, 1e-12 * width), np.inf)
            spread = width - between + usual + noise  # of a unit's own value about the mean of the others
            told = (width - between + usual) / spread >= TOLD
            gain = np.where(after < width, width / np.maximum(width - after, 1e-12 * width), np.inf)
            difference = np.append(found.values[layout.own] - prior.mean[layout.own], found.scale - 1.0) * gain
            score[u] = np.where(told & (others >= FEWEST - 1), difference / np.sqrt(spread), np.nan)
            freedom[u] = np.maximum(others - 1, 1) * (spread / usual) ** 2
        probability = student_two_sided(score, freedom)
        tested = np.isfinite(score)
        corrected = np.ones_like(probability)
        corrected[tested] = holm(probability[tested])
        odd: list[OddUnknown] = []
        for u, k in zip(*np.nonzero(corrected < FALSE_ALARM), strict=True):
            value = estimates[u].values[layout.own[k]] if k < d else estimates[u].scale[k - d]
            expected = priors[u].mean[layout.own[k]] if k < d else 1.0
            odd.append(
                OddUnknown(
                    self.names[u],
                    int(layout.joint[k]),
                    layout.own_names[k],
                    float(value),
                    float(expected),
                    float(population.deviation[k]),
                    float(score[u, k]),
                    float(corrected[u, k]),
                )
            )
        return score, sorted(odd, key=lambda each: (-abs(each.score), each.unit, each.parameter))

    def _odd_bodies(self, population: Population) -> list[OddBodies]:
        """Units whose shared parameters differ from those of the other units."""
        layout, a = self.layout, len(self.layout.shared)
        free = np.append(FREE * population.deviation[: len(layout.own)], population.deviation[len(layout.own) :])
        rows = self._unit_rows()
        squares, change = np.zeros(len(rows)), np.zeros((len(rows), a))
        for u, left in enumerate(left_out_factors([unit.factor for unit in population.units])):
            others = solve_common(left, common_names(layout))
            factor = eliminate(rows[u], layout, free).factor
            F, side = factor[:a, :a], factor[:a, -1] - factor[:a, a:-1] @ others.values[a:]
            half = others.half[:a]
            innovation = side - F @ others.values[:a]
            spread = np.eye(a) + (F @ half) @ (F @ half).T
            solved = np.linalg.solve(spread, innovation)
            squares[u] = innovation @ solved
            change[u] = half @ (half.T @ (F.T @ solved))
            wide = FREE * half
            change[u] = wide @ (wide.T @ (F.T @ np.linalg.solve(np.eye(a) + (F @ wide) @ (F @ wide).T, innovation)))
        ratio, probability = bodies_probability(squares, a)
        found: list[OddBodies] = []
        for u in np.flatnonzero(probability < FALSE_ALARM):
            effect = self._effects(u, change[u])
            j = int(np.argmax(effect))
            if effect[j] >= BODY_EFFECT:
                found.append(OddBodies(self.names[u], j, float(effect[j]), float(ratio[u]), float(probability[u])))
        return found

    def _effects(self, u: int, change: Array) -> Array:
        """RMS change of the torque of each joint by a change of the shared parameters (a,), relative, shape (n,)."""
        full = np.zeros(len(self.layout.names))
        full[self.layout.shared] = change
        whole = self.whole[u]
        squares = np.array([np.sum((joint.R[0, :, :-1] @ full[joint.parameters]) ** 2) for joint in whole.joints])
        return np.sqrt(squares / np.maximum(torque_squares(whole), np.finfo(float).tiny))

    def _assembled(
        self,
        population: Population,
        priors: list[FleetPrior],
        estimates: list[UnitEstimate],
        score: Array,
        odd: tuple[list[OddUnknown], list[OddBodies]],
        order: list[str],
    ) -> FleetResult:
        """Result with the units in the given order."""
        at = [self.names.index(name) for name in order]
        number = self._masks().sum(axis=0)
        # The mean of few units is known with few degrees of freedom, and so is the scatter.
        prior = self._prior(population.common, population.deviation, float(number.min()) - 1.0)
        estimate = FleetEstimate(
            tuple(order),
            prior,
            np.array([estimates[u].values for u in at]),
            np.array([np.sqrt(np.diag(estimates[u].covariance)) for u in at]),
            np.array([estimates[u].scale for u in at]),
            np.array([estimates[u].scale_deviation for u in at]),
            population.deviation,
            score[at],
            tuple(odd[0]),
            tuple(odd[1]),
            self.layout.own_names,
            self.layout.joint.astype(np.int64),
        )
        return FleetResult(estimate, {name: priors[self.names.index(name)] for name in order}, self.layout)
