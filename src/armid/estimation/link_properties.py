"""Mass, centre of mass and inertia about the centre of mass of each link: described and estimated values.

An estimate contains first moments h and inertias I_o about the origins of the link frames, because torques are linear
in them. With the mass M and the unit matrix 1, the centre of mass is c = h / M, and the inertia about the centre of
mass is I_c = I_o - (|h|² 1 - h hᵀ) / M. The intervals of c and I_c are computed with the derivatives of these
formulas. An interval is given only if the data determine all parameters in its formula; otherwise the reason is
given. For most arms, the torques do not determine how the mass is distributed among the links, so few links have
intervals for all quantities.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.estimation.estimate_record import Estimate
from armid.estimation.standard_parameter_resolution import StandardFit
from armid.maths.inertia import INERTIA_INDEX, about_com, about_com_slope
from armid.model.dynamics_model import DynamicsModel
from armid.notebook_display import Displayed, Summary, interval_text, plural

QUANTITIES = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Quantities that describe a body: mass, centre of mass and inertia about the centre of mass, in the axes of the link
frame."""

UNITS = ("kg", *("m",) * 3, *("kg·m²",) * 6)
"""Units of `QUANTITIES`."""

NO_BODIES = "{method} estimates base parameters, which do not determine how the mass is distributed among the links"

REMEDY = "identify with --method physical to estimate a body for each link"


def _entering() -> NDArray[np.bool_]:
    """Mask (10, 10) whose row i marks the parameters M MX MY MZ XX XY YY XZ YZ ZZ in the formula of quantity i.

    The quantities are `QUANTITIES`.
    """
    result = np.eye(10, dtype=np.bool_)
    result[1:, 0] = True
    for k, (i, j) in enumerate(INERTIA_INDEX):
        # A moment about an axis takes the distance from it, a product both of its coordinates.
        result[4 + k, [1 + axis for axis in range(3) if (axis != i if i == j else axis in (i, j))]] = True
    result.flags.writeable = False
    return result


ENTERING: NDArray[np.bool_] = _entering()
"""Mask of the inertial parameters from which each of `QUANTITIES` is computed, shape (10, 10)."""


@dataclass(frozen=True, eq=False, slots=True)
class LinkProperties:
    """Values of `QUANTITIES` for a link, in the link frame: described and estimated values.

    Attributes:
        link: Name of the link; bodies on fixed and locked joints belong to the link that carries them.
        joint: Name of the joint that moves the link.
        description: Values of the description, shape (10,); NaN for missing values.
        estimate: Estimated values, shape (10,); NaN for quantities that were not estimated.
        intervals: 95 % intervals of the estimate, shape (10, 2); NaN for values that the data do not determine.
        reasons: For each quantity, the reason why it has no interval; an empty text if it has one.
    """

    link: str
    joint: str
    description: Array
    estimate: Array
    intervals: Array
    reasons: tuple[str, ...]

    def __post_init__(self) -> None:
        for name, shape in (("description", (10,)), ("estimate", (10,)), ("intervals", (10, 2))):
            object.__setattr__(self, name, array(getattr(self, name), shape, name, finite=False))
        object.__setattr__(self, "reasons", tuple(self.reasons))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class LinkTable(Displayed):
    """Properties of all links, in the order of the joints that move them.

    Attributes:
        robot: Name of the arm.
        method: Name of the estimator.
        links: Properties of the n links; empty if the model has no rigid bodies.
        note: Reason why there are no estimated values, with a remedy; empty if there are estimated values.
    """

    robot: str
    method: str
    links: tuple[LinkProperties, ...]
    note: str = ""

    def summary(self) -> Summary:
        """Table of described and estimated values, with one row for each quantity of each link."""
        rows = tuple(
            (link.link, name, unit, _number(old), _number(new), _interval(ends) or reason)
            for link in self.links
            for name, unit, old, new, ends, reason in zip(
                QUANTITIES, UNITS, link.description, link.estimate, link.intervals, link.reasons, strict=True
            )
        )
        columns = ("link", "quantity", "unit", "description", "estimate", "95 % interval, or why there is none")
        return Summary(f"{self.robot}: {plural(len(self.links), 'link')}", columns, rows, self.note)


def link_table(model: DynamicsModel, estimate: Estimate) -> LinkTable:
    """Makes the table of described and estimated properties of the links of an arm.

    Args:
        model: The model that was estimated.
        estimate: Estimate of the parameters of the model.
    """
    robot, fit = model.robot, estimate.fit.standard
    if not model.has_rigid_bodies:
        return LinkTable(estimate.robot, estimate.method, (), "the model has no rigid bodies")
    columns = model.inertial_columns.reshape(-1, 10)
    bodies: list[LinkProperties] = []
    for link, joint, own in zip(robot.links, robot.joints, columns, strict=True):
        said = np.full(10, np.nan) if link.inertial is None else about_com(link.inertial.vector)
        if fit is None:
            nothing = np.full((10, 2), np.nan)
            reasons = ("base parameters only",) * 10
            bodies.append(LinkProperties(link.name, joint.name, said, nothing[:, 0], nothing, reasons))
            continue
        index = [fit.names.index(model.parameters[k].name) for k in own]
        bodies.append(LinkProperties(link.name, joint.name, said, *_estimated(fit, index)))
    note = "" if fit is not None else f"{NO_BODIES.format(method=estimate.method)}; {REMEDY}."
    return LinkTable(estimate.robot, estimate.method, tuple(bodies), note)


def bodies_of(model: DynamicsModel, fit: StandardFit) -> Array | None:
    """Estimated values of `QUANTITIES` of each link, shape (n, 10); `None` if the model has no rigid bodies."""
    if not model.has_rigid_bodies:
        return None
    columns = model.inertial_columns.reshape(-1, 10)
    index = [[fit.names.index(model.parameters[k].name) for k in own] for own in columns]
    return np.array([about_com(fit.values[own]) for own in index])


def link_record(table: LinkTable) -> list[dict[str, Any]]:
    """Records of the links for JSON: described and estimated values of `QUANTITIES`, with intervals."""

    def parts(values: Array) -> dict[str, Any]:
        return {"mass": values[0], "com": values[1:4], "inertia_about_com": values[4:]}

    return [
        {
            "link": body.link,
            "joint": body.joint,
            "description": parts(body.description),
            "estimate": parts(body.estimate),
            "interval95": parts(body.intervals),
            "reasons": dict(zip(QUANTITIES, body.reasons, strict=True)),
        }
        for body in table.links
    ]


def _estimated(fit: StandardFit, index: list[int]) -> tuple[Array, Array, tuple[str, ...]]:
    """Estimated values (10,), intervals (10, 2) and reasons for missing intervals, for one link.

    Args:
        fit: Fit of the standard parameters.
        index: Positions of the ten inertial parameters of the link in the fit.
    """
    theta = fit.values[index]
    values = about_com(theta)
    intervals = np.full((10, 2), np.nan)
    unknown = [
        "; ".join(f"{fit.names[k]} {fit.status[k]}" for k in np.array(index)[row] if fit.status[k] != "identified")
        for row in ENTERING
    ]
    if not theta[0] > 0.0:
        return values, intervals, tuple([unknown[0] or "no mass", *["no mass"] * 9])
    slope = about_com_slope(theta)
    deviation = np.sqrt(np.maximum(np.sum((slope @ fit.covariance[np.ix_(index, index)]) * slope, axis=1), 0.0))
    single = fit.deviation[index]
    # Upper ends are never cut: Student's quantile of each parameter, the widest of what enters.
    quantile = np.where(single > 0.0, fit.intervals[index, 1] - theta, 0.0) / np.where(single > 0.0, single, 1.0)
    for k in range(10):
        if unknown[k]:
            continue
        half = float(quantile[ENTERING[k]].max()) * deviation[k]
        intervals[k] = values[k] - half, values[k] + half
        if k in (0, 4, 6, 9):
            intervals[k] = np.maximum(intervals[k], 0.0)
    return values, intervals, tuple(unknown)


def _number(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"


def _interval(ends: Array) -> str:
    return interval_text(*map(float, ends), digits=4) if np.isfinite(ends).all() else ""
