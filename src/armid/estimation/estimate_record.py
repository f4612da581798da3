"""Estimate in the form that is saved: values, intervals and status, with the inputs from which they were computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.fit_result import Fit
from armid.estimation.standard_parameter_resolution import StandardFit, Status
from armid.estimation.uncertainty.prediction_error import PredictionError
from armid.information.information import FactorOrigin
from armid.model.base_parameters import BaseParameters
from armid.model.parameter_name import ParameterName
from armid.notebook_display import Displayed, Summary, interval_text, percent, plural
from armid.text_stored_value import TextValue


@dataclass(frozen=True, slots=True)
class TermUse:
    """Torque term of an estimate, with the joints on which the term acts and the shapes of its laws.

    Attributes:
        name: Name of the term.
        joints: Names of the joints on which the term acts.
        shapes: Values of the shapes of the term, by name of the shape.
    """

    name: str
    joints: tuple[str, ...]
    shapes: dict[str, float | tuple[float, ...]]

    def __post_init__(self) -> None:
        # A file gives lists where tuples were.
        shapes = {key: tuple(value) if isinstance(value, list) else value for key, value in self.shapes.items()}
        object.__setattr__(self, "shapes", shapes)


EARLIER_RUN = "earlier run"
"""Role under which the digest of an earlier estimate is stored in a recalibrated estimate."""


@dataclass(frozen=True, slots=True)
class InputDigest(TextValue):
    """Digest of an input of an estimate, stored as text such as `robot 1f2e…`.

    Attributes:
        role: Kind of input: `robot`, `train`, `validate`, `earlier run` or `options`.
        sha256: The digest as hexadecimal text.
    """

    role: str
    sha256: str

    def __str__(self) -> str:
        return f"{self.role} {self.sha256}"

    @classmethod
    def read(cls, text: str) -> InputDigest:
        """Reads a digest from its text, such as `robot 1f2e…`."""
        role, _, sha256 = text.rpartition(" ")
        return cls(role, sha256)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Estimate(Displayed):
    """Estimated base parameters of an arm with their intervals.

    Attributes:
        robot: Name of the arm.
        method: Name of the estimator.
        terms: Torque terms with their shapes.
        base: The base parameters and their regrouping.
        fit: Values, deviations, covariance and residuals.
        findings: Findings made during the identification.
        made_from: Digests of the inputs: robot description, recordings and options.
        made_by: Build of the compiled kernel and method of factorisation that were used for the information.
        seconds: Computing time from the recordings to the estimate [s].
        speeds: Highest speed of each joint in the training rows, shape (n,) [rad/s or m/s]; `None` if it is not
            known.
        prediction: Facts about the training recordings that determine the prediction intervals of another recording;
            `None` if they are not known, as in runs of earlier versions.
    """

    robot: str
    method: str
    terms: tuple[TermUse, ...]
    base: BaseParameters
    fit: Fit
    findings: tuple[Finding, ...] = ()
    made_from: tuple[InputDigest, ...] = ()
    made_by: FactorOrigin = field(default_factory=FactorOrigin)
    seconds: float = 0.0
    speeds: Array | None = None
    prediction: PredictionError | None = None

    def summary(self) -> Summary:
        """Table of the base parameters with standard deviations and intervals."""
        units = dict(zip(self.base.names, self.base.units, strict=True))
        rows = tuple(
            (name, f"{value:.5g}", units[name.of_all], percent(deviation), interval_text(low, high))
            for name, value, deviation, (low, high) in zip(
                self.fit.names, self.fit.values, self.fit.relative_deviation, self.intervals, strict=True
            )
        )
        columns = ("parameter", "value", "unit", "σ", "95 % interval")
        note = f"condition number {self.fit.condition:.4g}; {plural(len(self.findings), 'finding')}"
        return Summary(f"{self.robot}: {len(rows)} base parameters, {self.method}", columns, rows, note)

    @property
    def recording_digests(self) -> tuple[str, ...]:
        """Digests (sha256) of the recordings for training and validation, in the order of the study."""
        return tuple(each.sha256 for each in self.made_from if each.role in ("train", "validate"))

    @property
    def intervals(self) -> Array:
        """95 % intervals of the parameters, shape (b, 2)."""
        return self.fit.intervals


def torque_parameters(base: BaseParameters, fit: Fit) -> Array:
    """Standard parameters (p,) that give the same torque as the estimate.

    If the estimator has estimated standard parameters, these are returned. Otherwise each base parameter is used as
    the standard parameter whose column is kept, and all other standard parameters are zero; no real body has such
    parameters. If friction was estimated for each recording, the mean is used.
    """
    if fit.standard is not None:
        return collapse(base.standard_names, fit.standard)
    theta = np.zeros(len(base.standard_names))
    theta[base.kept] = collapse(base.names, fit)
    return theta


def collapse(names: Sequence[str], fit: Fit | StandardFit) -> Array:
    """Values of the parameters `names` in a fit, shape (names,).

    If a parameter has one value for each recording, such as `FV_1[2]` in recording 2, the mean is returned.
    """
    groups: dict[str, list[float]] = {}
    for name, value in zip(fit.names, fit.values, strict=True):
        groups.setdefault(name.of_all, []).append(float(value))
    return np.array([float(np.mean(groups[name])) for name in names], dtype=np.float64)


def averaged(names: tuple[ParameterName, ...], fit: Fit) -> Fit:
    """Fit reduced to the parameters `names`.

    If a parameter has one value for each recording, such as `FV_1[2]` in recording 2, the mean is used.
    """
    copies = [name.of_all for name in fit.names]
    mean = np.array([[name == copy for copy in copies] for name in names], dtype=np.float64)
    mean /= mean.sum(axis=1, keepdims=True)
    return replace(
        fit,
        names=names,
        values=mean @ fit.values,
        white_deviation=np.sqrt(np.diag(mean @ np.diag(fit.white_deviation**2) @ mean.T)),
        covariance=mean @ fit.covariance @ mean.T,
        freedom=mean @ fit.freedom,
        prior_precision=None,
        report=fit.report.mapped(mean),
    )


def standard_parameters(estimate: Estimate) -> list[dict[str, Any]]:
    """Records of all standard parameters, with a value if the data determine the parameter.

    The data determine a parameter if the column of the parameter is kept and no other parameter is regrouped into it.
    A regrouped parameter has no value, unless the estimator estimates standard parameters. In that case the status of
    the parameter states how far the data determine it.
    """
    if estimate.fit.standard is not None:
        return _estimated(estimate.fit.standard)
    base, fit = estimate.base, estimate.fit
    alone = np.count_nonzero(base.regrouping, axis=1) == 1
    fit = averaged(base.names, fit)
    ends = fit.intervals
    position: dict[str, int] = {base.standard_names[k]: row for row, k in enumerate(base.kept)}
    result: list[dict[str, Any]] = []
    own: NDArray[np.bool_] = np.zeros(len(base.standard_names), dtype=bool)
    own[base.kept[alone]] = True
    for k, (name, unit) in enumerate(zip(base.standard_names, base.standard_units, strict=True)):
        row = position.get(name) if own[k] else None
        status: Status = "not identifiable" if row is None else "identified"
        result.append(
            {
                "name": name,
                "value": None if row is None else float(fit.values[row]),
                "unit": unit,
                "interval95": None if row is None else ends[row].tolist(),
                "status": status,
            }
        )
    return result


def _estimated(fit: StandardFit) -> list[dict[str, Any]]:
    """Records of estimated standard parameters: name, value, unit, interval and status."""
    return [
        {
            "name": name,
            "value": float(value),
            "unit": unit,
            # One choice of many is no knowledge, and a prior's own width no interval.
            "interval95": None if status == "not identifiable" else ends.tolist(),
            "status": status,
        }
        for name, value, unit, ends, status in zip(
            fit.names, fit.values, fit.units, fit.intervals, fit.status, strict=True
        )
    ]
