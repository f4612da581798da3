"""Input of an estimator: information, standard parameters and samples; `build_problem` makes it from observations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import EstimationError
from armid.information.accumulate import Progress, accumulate_information
from armid.information.information import Information
from armid.measurement.observations import Observations
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.parameter_name import ParameterName, parameter_names
from armid.model.terms import TERMS
from armid.model.terms.selection_candidates import automatic_choice
from armid.robot import Robot
from armid.robot.missing_inertia import placeholder_masses

ZERO_ANGLE = 1e-3
"""Standard deviation of the zero error of a revolute joint if a study does not state it [rad]. Calibrations of
industrial arms find errors of this size."""

ZERO_LENGTH = 5e-4
"""Standard deviation of the zero error of a prismatic joint if a study does not state it [m]: `ZERO_ANGLE` at a
lever of half a metre."""


@dataclass(frozen=True, eq=False, slots=True)
class StandardParameters:
    """The p standard parameters from which the b base parameters are computed.

    Attributes:
        names: Names of the p standard parameters.
        units: Units of the p standard parameters.
        regrouping: Matrix with base parameters = regrouping · standard parameters, shape (b, p).
        inertial: Positions of the ten inertial parameters of each link among the p standard parameters, shape (links,
            10).
        links: Names of the links.
        nonnegative: Mask of the parameters that are not inertial and cannot be negative, shape (p,).
        nominal: Inertial parameters of the description, zero for the parameters of other terms, shape (p,); `None` if
            the description has no inertial parameters.
        added: Mask of the friction parameters of terms that a selection may add to a model, shape (p,); `None` if not
            known.
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    regrouping: Array
    inertial: NDArray[np.intp]
    links: tuple[str, ...]
    nonnegative: NDArray[np.bool_]
    nominal: Array | None = None
    added: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        p = len(self.names)
        object.__setattr__(self, "names", parameter_names(self.names))
        object.__setattr__(self, "units", tuple(self.units))
        object.__setattr__(self, "regrouping", array(self.regrouping, (None, p), "regrouping"))
        if self.nominal is not None:
            object.__setattr__(self, "nominal", array(self.nominal, (p,), "nominal"))

    @property
    def described(self) -> bool:
        """True if the description gives every link a mass, so that a prior can prefer the described bodies."""
        masses = np.zeros(0) if self.nominal is None else self.nominal[self.inertial[:, 0]]
        return len(masses) > 0 and bool((masses > 0.0).all())

    @property
    def placeholders(self) -> NDArray[np.bool_]:
        """Mask of the links whose mass in the description is a placeholder, shape (links,)."""
        masses = np.zeros(len(self.inertial)) if self.nominal is None else self.nominal[self.inertial[:, 0]]
        return placeholder_masses(masses)


def default_zero_deviation(robot: Robot) -> Array:
    """Standard deviation of the zero error of each joint if a study does not state it, shape (n,) [rad or m]."""
    return np.array([ZERO_LENGTH if joint.is_prismatic else ZERO_ANGLE for joint in robot.joints])


@dataclass(frozen=True, eq=False, slots=True)
class EstimationProblem:
    """Input of an estimator: parameters and data.

    Attributes:
        information: Factors of the recordings, block by block.
        standard: Standard parameters, for estimators that estimate them.
        model: The model, for estimators that process the samples a second time.
        base: Base parameters of the model, for estimators that process the samples a second time.
        observations: Samples of the recordings, for estimators that process the samples a second time.
        position_zero_deviation: Standard deviation of the zero error of each joint's positions, shape (n,) [rad or
            m]; `None` for the default.
    """

    information: Information
    standard: StandardParameters | None = field(default=None, repr=False)
    model: DynamicsModel | None = field(default=None, repr=False)
    base: BaseParameters | None = field(default=None, repr=False)
    observations: Observations | None = field(default=None, repr=False)
    position_zero_deviation: Array | None = field(default=None, repr=False)

    @property
    def zero_deviation(self) -> Array:
        """Standard deviation of the zero error of each joint's positions, shape (n,) [rad or m]."""
        if self.position_zero_deviation is not None:
            return self.position_zero_deviation
        if self.model is None:
            return np.zeros(self.information.n)
        return default_zero_deviation(self.model.robot)

    def require_standard(self, method: str) -> StandardParameters:
        """Returns the standard parameters of the problem; `method` is the name of the estimator that needs them.

        Raises:
            EstimationError: The problem has no standard parameters.
        """
        if self.standard is None:
            raise EstimationError(
                f"The method {method} needs standard parameters, but the problem has only base parameters.",
                remedy="make the problem by build_problem(model, observations).",
            )
        return self.standard

    def require_samples(self, method: str) -> tuple[DynamicsModel, BaseParameters, Observations]:
        """Returns model, base parameters and observations; `method` is the name of the estimator that needs them.

        Raises:
            EstimationError: The problem lacks model, base parameters or observations.
        """
        if self.model is None or self.base is None or self.observations is None:
            raise EstimationError(
                f"The method {method} needs the samples of the recordings, but the problem has none.",
                remedy="make the problem by build_problem(model, observations).",
            )
        return self.model, self.base, self.observations


def build_problem(
    model: DynamicsModel,
    observations: Observations,
    *,
    base: BaseParameters | None = None,
    scale_deviation: Array | None = None,
    position_zero_deviation: Array | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> EstimationProblem:
    """Builds the estimation problem of a model and observations of its arm.

    Args:
        model: Arm and torque terms.
        observations: Processed recordings.
        base: Base parameters of the model; computed if not given.
        scale_deviation: Relative standard deviation of the torque scale of each joint, shape (n,); if not given, all
            are zero.
        position_zero_deviation: Standard deviation of the zero error of each joint's positions, shape (n,) [rad or
            m]; `ZERO_ANGLE` and `ZERO_LENGTH` if not given.
        threads: Number of threads of the kernel.
        progress: Function that is called with the number of finished samples and the number of all samples.

    Raises:
        ArmidError: The observations have other joints than the model, no row is in use, or the model has hysteresis,
            whose states the recordings do not determine.
    """
    base = find_base_parameters(model) if base is None else base
    information = accumulate_information(model, base, observations, threads=threads, progress=progress)
    if scale_deviation is not None:
        information = replace(information, scale_deviation=scale_deviation)
    return EstimationProblem(
        information, standard_of(model, base), model, base, observations, position_zero_deviation
    )


def standard_of(model: DynamicsModel, base: BaseParameters) -> StandardParameters:
    """Standard parameters of a model, with the regrouping of its base parameters."""
    return replace(bare_standard(model), regrouping=base.regrouping)


def bare_standard(model: DynamicsModel) -> StandardParameters:
    """Standard parameters of a model, without regrouping: the regrouping matrix is the identity."""
    parameters = model.parameters
    return StandardParameters(
        tuple(parameter.name for parameter in parameters),
        tuple(parameter.unit for parameter in parameters),
        np.eye(len(parameters)),
        model.inertial_columns.reshape(-1, 10),
        tuple(link.name for link in model.robot.links) if model.inertial_columns.size else (),
        np.array([parameter.nonnegative for parameter in parameters], dtype=np.bool_),
        model.nominal_parameters(),
        np.array(
            [p.kind in TERMS and automatic_choice(TERMS[p.kind]) is not None for p in parameters], dtype=np.bool_
        ),
    )
