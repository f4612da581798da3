"""Bodies of the links as engineers state them: mass, centre of mass and inertia about it, old and new.

An estimate holds first moments h and inertias I_o about the origins of links, where torques are linear in them. Of
a body follow c = h / M and I_c = I_o - (|h|² 1 - h hᵀ) / M, and by the slope of these their intervals. An interval is
given only where the data determine every parameter that enters, else the reason. The torques of most arms leave open
how links share their mass, so that few bodies have intervals throughout.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.estimation.estimate import Estimate
from armid.estimation.standard_parameter_status import StandardFit
from armid.maths.inertia import INERTIA_INDEX, about_com, about_com_slope
from armid.model.dynamics import DynamicsModel
from armid.notebook import Displayed, Summary, plural
from armid.values import Array, array

QUANTITIES = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Quantities that describe a body: mass, centre of mass and inertia about it, with the axes of the link frame."""

UNITS = ("kg", *("m",) * 3, *("kg·m²",) * 6)
"""Units of `QUANTITIES`."""

NO_BODIES = "{method} estimates base parameters, which leave open how links share their mass"

REMEDY = "identify with --method physical to have a body for each link"


def _entering() -> NDArray[np.bool_]:
    """Rows: quantities; columns: the parameters M MX MY MZ XX XY YY XZ YZ ZZ that they are made from."""
    result = np.eye(10, dtype=np.bool_)
    result[1:, 0] = True
    for k, (i, j) in enumerate(INERTIA_INDEX):
        # A moment about an axis takes the distance from it, a product both of its coordinates.
        result[4 + k, [1 + axis for axis in range(3) if (axis != i if i == j else axis in (i, j))]] = True
    result.flags.writeable = False
    return result


ENTERING: NDArray[np.bool_] = _entering()
"""Mask of the inertial parameters that enter each of `QUANTITIES`, shape (10, 10)."""


@dataclass(frozen=True, eq=False, slots=True)
class LinkProperties:
    """A link's body, old and new, each as `QUANTITIES` in the link frame.

    Attributes:
        link: Name of the link; bodies on fixed and locked joints count to the link that carries them.
        joint: Name of the joint that moves it.
        description: What the description says, shape (10,); NaN where it says nothing.
        estimate: What was estimated, shape (10,); NaN where nothing was.
        intervals: 95 % intervals of the estimate, shape (10, 2); NaN where the data do not determine it.
        reasons: Why there is no interval, one each; empty where there is one.
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
    """Bodies of all links, in the order of the joints that move them.

    Attributes:
        robot: Name of the arm.
        method: Name of the estimator.
        links: The bodies, n of them; none where the model has no rigid bodies.
        note: Why there is no estimate of bodies and what gives one; empty where there is one.
    """

    robot: str
    method: str
    links: tuple[LinkProperties, ...]
    note: str = ""

    def summary(self) -> Summary:
        """One row a link and quantity."""
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
    """The bodies of an arm's links as described and as estimated.

    Args:
        model: The model that was estimated.
        estimate: Its parameters.
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


def link_record(table: LinkTable) -> list[dict[str, Any]]:
    """The bodies as JSON, one object a link: mass, com and inertia about it, as described, estimated and known."""

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
    """Estimate (10,), intervals (10, 2) and the reasons why there are none, of the link with these parameters."""
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
    return f"{ends[0]:.4g} … {ends[1]:.4g}" if np.isfinite(ends).all() else ""
