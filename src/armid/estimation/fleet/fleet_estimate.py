"""Estimate of a fleet: common bodies, and friction, offsets and torque scales of each unit.

Units that differ from all others are found, left out of means and scatter, and the estimate is repeated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.estimation.fleet.find_odd import odd_bodies, odd_unknowns
from armid.estimation.fleet.fleet_data import FleetData, fleet_data
from armid.estimation.fleet.fleet_rounds import FleetState, first_rounds, rounds
from armid.estimation.fleet.layout import FleetLayout
from armid.estimation.fleet.odd_units import FEWEST, OddBodies, OddUnknown
from armid.estimation.fleet.unit_priors import left_out_priors, others_without_each, prior_of, scatter_of_others
from armid.estimation.fleet.unit_update import FleetPrior, update_unit
from armid.information.information import Information
from armid.threads import one_blas_thread

REPEATS = 8
"""Largest number of estimates with other odd units left out."""


@dataclass(frozen=True, eq=False, slots=True)
class OwnUnknowns:
    """Unknowns that each unit of a fleet has for itself: own parameters, then torque scales.

    Attributes:
        names: Names, m of them; `scale_1` is the torque scale of joint 1.
        joint: Joint to which each unknown belongs, from 0, shape (m,).
        deviation: Standard deviation between units, shape (m,).
    """

    names: tuple[str, ...]
    joint: NDArray[np.int64]
    deviation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "deviation", array(self.deviation, (len(self.names),), "deviation"))
        if np.shape(self.joint) != (len(self.names),):
            raise ArmidError(
                f"{len(self.names)} unknowns have {np.size(self.joint)} joints.",
                remedy="give the joint of each unknown.",
            )


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
        own: Own unknowns, m of them.
        score: Difference of each own unknown from the other units, divided by its standard deviation, shape (U, m);
            NaN if it cannot be judged.
        odd: Own unknowns that differ from the other units, the least probable first.
        odd_bodies: Units whose bodies differ from the other units.
    """

    units: tuple[str, ...]
    prior: FleetPrior
    values: Array
    deviation: Array
    scale: Array
    scale_deviation: Array
    own: OwnUnknowns
    score: Array
    odd: tuple[OddUnknown, ...] = ()
    odd_bodies: tuple[OddBodies, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", tuple(self.units))
        b, n, m = len(self.prior.names), len(self.prior.noise), len(self.own.names)
        if m != len(self.prior.own) + n:
            raise ArmidError(
                f"A fleet has {m} own unknowns, but {len(self.prior.own)} own parameters and {n} joints.",
                remedy="give one unknown for each own parameter and one torque scale for each joint.",
            )
        for name, length in (("values", b), ("deviation", b), ("scale", n), ("scale_deviation", n), ("score", m)):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, array(given, (len(self.units), length), name, finite=name != "score"))
        if min(float(each.min(initial=0.0)) for each in (self.deviation, self.scale_deviation)) < 0.0:
            raise ArmidError(
                "Standard deviations of the units of a fleet must not be negative.",
                remedy="identify the fleet again.",
            )
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
    data = fleet_data(units, own)
    state, population = first_rounds(data)
    count, m = len(data.names), data.layout.count
    score, odd, bodies = np.full((count, m), np.nan), list[OddUnknown](), list[OddBodies]()
    repeats = 0
    while True:
        others = others_without_each(data, population)
        scatter = scatter_of_others(data, state, population, others)
        priors = left_out_priors(data, state, others, scatter[0])
        estimates = [update_unit(prior, each, data.layout) for prior, each in zip(priors, data.whole, strict=True)]
        if count >= FEWEST:
            score, odd = odd_unknowns(data, state, scatter, priors, estimates)
            bodies = odd_bodies(data, state, population, others)
        without = _without(data, state, odd, bodies)
        same = np.array_equal(without.kept, state.kept) and np.array_equal(without.usual, state.usual)
        repeats += 1
        if same or repeats == REPEATS:
            break
        state, population = rounds(data, without)
    order = list(units)
    at = [data.names.index(name) for name in order]
    estimate = FleetEstimate(
        tuple(order),
        prior_of(data, state, population.common, population.deviation),
        np.array([estimates[u].values for u in at]),
        np.array([np.sqrt(np.diag(estimates[u].covariance)) for u in at]),
        np.array([estimates[u].scale for u in at]),
        np.array([estimates[u].scale_deviation for u in at]),
        OwnUnknowns(data.layout.own_names, data.layout.joint.astype(np.int64), population.deviation),
        score[at],
        tuple(odd),
        tuple(bodies),
    )
    return FleetResult(estimate, {name: priors[u] for name, u in zip(order, at, strict=True)}, data.layout)


def _without(data: FleetData, state: FleetState, odd: list[OddUnknown], bodies: list[OddBodies]) -> FleetState:
    """State in which odd own unknowns and units with odd bodies do not count."""
    kept, usual = np.ones_like(state.kept), np.ones_like(state.usual)
    for each in odd:
        kept[data.names.index(each.unit), data.layout.own_names.index(each.parameter)] = False
    for each in bodies:
        usual[data.names.index(each.unit)] = False
    return replace(state, kept=kept, usual=usual)
