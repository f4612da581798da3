"""Parameters of one unit from its data and from what other units say: the fleet as a prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array, array
from armid.errors import ArmidError, EstimationError
from armid.estimation.fleet.layout import FleetLayout
from armid.estimation.fleet.unit_rows import unit_rows
from armid.information.information import Information, total
from armid.maths.linalg import root_of, triangular_factor
from armid.model.parameter_name import ParameterName, parameter_names

STEPS = 8
"""Largest number of Gauss-Newton steps; scales near 1 need three."""

CONVERGED = 1e-7
"""Largest change of a torque scale at which the steps end, far below its uncertainty."""


ROUNDING = 1e-9
"""Error of a covariance, relative to its largest element, that rounding may cause."""


@dataclass(frozen=True, eq=False, slots=True)
class FleetPrior:
    """Distribution of the parameters of a unit of a fleet before its own data are seen.

    Attributes:
        names: Names of the b base parameters.
        mean: Mean, shape (b,).
        covariance: Covariance, which contains the scatter between units, shape (b, b).
        scale_deviation: Standard deviation of the torque scale of each joint, about 1, shape (n,).
        noise: Standard deviation of the residual of each joint, shape (n,) [N·m or N].
        correlation: Number of consecutive rows that count as one independent sample for each joint, shape (n,).
        own: Names of the parameters that differ between units.
    """

    names: tuple[ParameterName, ...]
    mean: Array
    covariance: Array
    scale_deviation: Array
    noise: Array
    correlation: Array
    own: tuple[str, ...]

    def __post_init__(self) -> None:
        b, n = len(self.names), len(self.noise)
        object.__setattr__(self, "names", parameter_names(self.names))
        object.__setattr__(self, "own", tuple(self.own))
        for name, shape in (("mean", (b,)), ("covariance", (b, b))):
            object.__setattr__(self, name, array(getattr(self, name), shape, name))
        for name in ("scale_deviation", "noise", "correlation"):
            object.__setattr__(self, name, array(getattr(self, name), (n,), name))
        self._require_distribution()

    def _require_distribution(self) -> None:
        """Raises an error if no fleet can have these values."""
        strangers = [name for name in self.own if name not in self.names]
        if strangers:
            raise ArmidError(
                f"A fleet has no parameters {', '.join(strangers)}, so units cannot differ in them.",
                possible=", ".join(self.names),
                remedy="name base parameters of the fleet.",
            )
        for name, least in (("scale_deviation", 0.0), ("noise", 0.0), ("correlation", 1.0)):
            if (getattr(self, name) < least).any():
                found = float(getattr(self, name).min())
                raise ArmidError(f"{name} of a fleet must not be below {least:g}; found {found:g}.")
        if not self.noise.all():
            raise ArmidError("The noise of each joint of a fleet must be above 0.")
        largest = float(np.abs(self.covariance).max(initial=0.0))
        asymmetry = float(np.abs(self.covariance - self.covariance.T).max(initial=0.0))
        smallest = float(np.linalg.eigvalsh(self.covariance).min(initial=0.0))
        if asymmetry > ROUNDING * largest or smallest < -ROUNDING * largest:
            raise ArmidError("The covariance of a fleet must be symmetric and positive semidefinite.")

    @property
    def weights(self) -> Array:
        """Weight of the rows of each joint, so that weighted rows count as independent samples, shape (n,)."""
        return 1.0 / (self.noise * np.sqrt(self.correlation))

    def require_names(self, information: Information) -> None:
        """Raises an error if information is about other parameters than the fleet.

        Raises:
            EstimationError: The names of the parameters differ.
        """
        if tuple(information.names) == self.names:
            return
        missing = [name for name in self.names if name not in information.names]
        more = [name for name in information.names if name not in self.names]
        raise EstimationError(
            "The recordings have other base parameters than the fleet"
            + (f"; not in the fleet: {', '.join(more)}" if more else "")
            + (f"; only in the fleet: {', '.join(missing)}" if missing else "")
            + ".",
            remedy="use the arm description and the torque terms of the fleet.",
        )


@dataclass(frozen=True, eq=False, slots=True)
class UnitEstimate:
    """Parameters of one unit, from its data and the fleet.

    Attributes:
        values: Base parameters, shape (b,).
        covariance: Their covariance, shape (b, b).
        scale: Torque scale of each joint, shape (n,).
        scale_deviation: Standard deviation of the torque scales, shape (n,).
    """

    values: Array
    covariance: Array
    scale: Array
    scale_deviation: Array


def update_unit(prior: FleetPrior, information: Information, layout: FleetLayout) -> UnitEstimate:
    """Estimates the parameters of a unit from its data and a fleet.

    Args:
        prior: What the fleet says before the data are seen.
        information: Information of the unit.
        layout: Order of the unknowns.

    Raises:
        EstimationError: The information is about other parameters than the fleet.
    """
    prior.require_names(information)
    whole = total(information)
    b, n, d, m = len(prior.names), whole.n, len(layout.own), layout.count
    root = np.zeros((b + n, b + n))
    root[:b, :b] = root_of(prior.covariance)
    root[b:, b:] = np.diag(prior.scale_deviation)
    mean = np.concatenate([prior.mean, np.ones(n)])
    values, scale = prior.mean, np.ones(n)
    inner = np.eye(b + n)
    for _ in range(STEPS):
        rows = unit_rows(whole, layout, prior.weights, values, scale)
        ordered = np.empty((len(rows), b + n))
        ordered[:, layout.own] = rows[:, :d]
        ordered[:, b:] = rows[:, d:m]
        ordered[:, layout.shared] = rows[:, m:-1]
        side = rows[:, -1] + ordered[:, b:] @ np.ones(n) - ordered @ mean
        whitened = np.column_stack([ordered @ root, side])
        R = triangular_factor(np.concatenate([whitened, np.eye(b + n, b + n + 1)]))
        inner = np.linalg.inv(R[: b + n, : b + n])
        found = mean + root @ (inner @ R[: b + n, -1])
        change = np.abs(found[b:] - scale).max()
        values, scale = found[:b], found[b:]
        if change <= CONVERGED:
            break
    half = root @ inner
    covariance = half @ half.T
    return UnitEstimate(values, covariance[:b, :b], scale, np.sqrt(np.diag(covariance)[b:]))
