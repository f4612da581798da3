"""Unknowns of a fleet: which parameters are common to all units, and which each unit has for itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.information.information import Information
from armid.model.parameter_name import ParameterName


@dataclass(frozen=True, eq=False, slots=True)
class FleetLayout:
    """Order of the unknowns of a fleet.

    The own unknowns of a unit are its d own parameters, followed by the n deviations of its torque scales from 1;
    m = d + n. The common unknowns are the a shared parameters, followed by the d means of the own parameters.

    Attributes:
        names: Names of the b base parameters.
        own: Indices of the base parameters that each unit has for itself, shape (d,).
        shared: Indices of the other base parameters, shape (a,).
        joint: Joint to which each own unknown belongs, shape (m,).
    """

    names: tuple[ParameterName, ...]
    own: NDArray[np.intp]
    shared: NDArray[np.intp]
    joint: NDArray[np.intp]

    @property
    def count(self) -> int:
        """Number m of own unknowns of a unit."""
        return len(self.joint)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint) - len(self.own)

    @property
    def own_names(self) -> tuple[str, ...]:
        """Names of the own unknowns; `scale_1` is the torque scale of joint 1."""
        return (*(str(self.names[k]) for k in self.own), *(f"scale_{j + 1}" for j in range(self.n)))

    @property
    def mean_map(self) -> Array:
        """Matrix (m, a + d) that gives the means of the own unknowns of a unit from the common unknowns."""
        result = np.zeros((self.count, len(self.shared) + len(self.own)))
        result[: len(self.own), len(self.shared) :] = np.eye(len(self.own))
        return result

    def base_values(self, common: Array, deviations: Array) -> Array:
        """Base parameters (b,) of a unit from common unknowns (a + d,) and deviations of its own unknowns (m,)."""
        values = np.empty(len(self.names))
        values[self.shared] = common[: len(self.shared)]
        values[self.own] = common[len(self.shared) :] + deviations[: len(self.own)]
        return values


def fleet_layout(information: Information, own: NDArray[np.bool_]) -> FleetLayout:
    """Order of the unknowns of a fleet.

    Args:
        information: Information of any unit.
        own: Mask of the base parameters that each unit has for itself, shape (b,).

    Raises:
        EstimationError: No parameter is common, or none is of each unit.
    """
    if own.all() or not own.any():
        raise EstimationError(
            f"A fleet needs parameters that its units share and parameters that differ; of {len(own)} base "
            f"parameters, {int(own.sum())} may differ.",
            remedy="use a model with the terms `rigid-body` and friction or offsets.",
        )
    joint = np.full(information.count, -1, dtype=np.intp)
    for j in reversed(range(information.n)):
        joint[information.joints[j].parameters] = j
    at = np.flatnonzero(own)
    return FleetLayout(
        information.names, at, np.flatnonzero(~own), np.concatenate([joint[at], np.arange(information.n)])
    )
