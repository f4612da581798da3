"""Requirements on standard parameters in addition to physical consistency, such as bounds of masses or known values.

    θ = origin + basis · x

gives the standard parameters θ from the unknowns x. The origin contains the values of the fixed parameters.
Parameters that must be equal depend on the same unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, did_you_mean
from armid.estimation.consistency.cones import consistency_cones, smallest_eigenvalues
from armid.estimation.problem import StandardParameters
from armid.maths.conic_solver import Cone

ROUNDED = 1e-9
"""Largest violation of a constraint that counts as a rounding error of given values: negative eigenvalue of a given
pseudo-inertia, or negative distance of a given value from a bound."""


class ContradictionError(EstimationError):
    """Error that is raised if requirements contradict each other: no parameters meet all of the requirements."""


@dataclass(frozen=True, eq=False, slots=True)
class Requirements:
    """Requirements on the standard parameters, from the options of the estimator `physical`.

    Attributes:
        epsilon: Smallest eigenvalue of a pseudo-inertia.
        heaviest: Largest mass of any link [kg].
        total_mass: Smallest and largest total mass of all links [kg].
        masses: Smallest and largest mass of a link [kg], by the number of the link.
        com: Points that enclose the centre of mass of a link [m], by the number of the link: two corners of a box, or
            at least four points of a convex hull.
        equal: Lists of names of parameters; the parameters of one list must have equal values.
        fixed: Known values of parameters, by name.
        known: Numbers of the links that are not estimated; their parameters are those of the description.
    """

    epsilon: float
    heaviest: float | None = None
    total_mass: tuple[float, ...] | None = None
    masses: Mapping[str, Any] | None = None
    com: Mapping[str, Any] | None = None
    equal: Sequence[Sequence[str]] = ()
    fixed: Mapping[str, Any] | None = None
    known: Sequence[int] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Feasible:
    """Set of the standard parameters that meet all requirements: origin + basis · x with the unknowns x in the cones.

    Attributes:
        origin: Values of the fixed parameters, zero elsewhere, shape (p,).
        basis: Derivative of the p parameters by the x unknowns, shape (p, x); each parameter depends on at most one
            unknown.
        cones: Cones of the unknowns x.
    """

    origin: Array
    basis: Array
    cones: tuple[Cone, ...]

    def of(self, x: Array) -> Array:
        """Computes the standard parameters (p,) from the unknowns (x,)."""
        return self.origin + self.basis @ x

    def unknowns(self, values: Array) -> Array:
        """Computes the unknowns (x,) whose standard parameters are nearest to given standard parameters (p,)."""
        return np.asarray(self.basis.T @ (values - self.origin), dtype=np.float64) / np.sum(self.basis**2, axis=0)


def feasible_set(standard: StandardParameters, asked: Requirements, margin: float = 0.0) -> Feasible:
    """Builds the set of standard parameters that are physically consistent and meet the requirements.

    Args:
        standard: The standard parameters.
        asked: The requirements.
        margin: Number that is added to the required smallest eigenvalue, because a solver rounds.

    Raises:
        EstimationError: A requirement names an unknown parameter or link, or has a wrong form.
        ContradictionError: A given value of a parameter contradicts a bound.
    """
    origin, basis = _affine(standard, asked)
    p = len(standard.names)
    cones = consistency_cones(standard, p, epsilon=asked.epsilon + margin, heaviest=asked.heaviest)
    cones += _mass_cones(standard, asked) + _com_cones(standard, asked.com or {})
    moved = [replace(c, matrix=c.matrix @ basis, offset=c.offset + c.matrix @ origin) for c in cones]
    for own, cone in zip(standard.inertial, moved, strict=False):
        if (
            not cone.matrix.any()
            and smallest_eigenvalues(standard, origin)[list(standard.inertial[:, 0]).index(own[0])] < -ROUNDED
        ):
            raise EstimationError(
                f"The options give all parameters of the link of {standard.names[own[0]]}, but no real body can "
                "have these values.",
                remedy="correct the values of the link in `fixed`, or remove the link from `fixed` and `known`, so "
                "that it is estimated.",
            )
    return Feasible(origin, basis, tuple(part for cone in moved if (part := _felt(cone)) is not None))


def _felt(cone: Cone) -> Cone | None:
    """Removes bounds that depend on no unknown from a cone, after a check of these bounds; `None` if none remain."""
    moves = cone.matrix.any(axis=1)
    if cone.kind == "semidefinite":
        return cone if moves.any() else None
    if (cone.offset[~moves] < -ROUNDED).any():
        raise ContradictionError(
            "A value that `fixed` or `known` gives to a parameter contradicts a bound.",
            remedy="correct the options `fixed` and `known`, or the bounds `heaviest`, `total_mass`, `masses` and "
            "`com`.",
        )
    return Cone(cone.kind, cone.matrix[moves], cone.offset[moves]) if moves.any() else None


def _affine(standard: StandardParameters, asked: Requirements) -> tuple[Array, Array]:
    position: dict[str, int] = {name: k for k, name in enumerate(standard.names)}
    origin = np.zeros(len(standard.names))
    given = np.zeros(len(standard.names), dtype=bool)
    for number in asked.known:
        own = standard.inertial[_link(standard, str(number), "known")]
        if standard.nominal is None:
            raise EstimationError(
                "The option `known` needs a description with inertial parameters, but the description contains none.",
                remedy="remove `known`, and give the values of the parameters with the option `fixed`.",
            )
        origin[own], given[own] = standard.nominal[own], True
    for name, value in (asked.fixed or {}).items():
        k = _position(position, name, "fixed")
        if given[k]:
            raise EstimationError(
                f"{name} is given twice: {value!r} by `fixed`, and {origin[k]:g} because the link of this "
                "parameter is in `known`.",
                remedy="remove the parameter from `fixed`, or the link from `known`.",
            )
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise EstimationError(
                f"The option `fixed` gives {name} = {value!r}, which is not a number.",
                remedy="give a number in SI units, for instance fixed = { XY_7 = 0.0 }.",
            )
        origin[k], given[k] = value, True
    leader = np.arange(len(origin))
    for group in asked.equal:
        where = [_position(position, name, "equal") for name in group]
        if len(where) < 2 or given[where].any():
            raise EstimationError(
                "Each list in `equal` must contain at least two parameters that no other option sets; found "
                f"{list(group)}.",
                remedy="add parameters to the list, or remove the parameters that `fixed` or `known` sets.",
            )
        if len(units := dict.fromkeys(standard.units[k] for k in where)) > 1:
            raise EstimationError(
                f"Each list in `equal` must contain parameters of one unit; found {list(group)} in "
                f"{', '.join(units)}.",
                remedy="give one list for each unit.",
            )
        joined = np.isin(leader, leader[where])
        leader[joined] = leader[joined].min()
    unknown = np.unique(leader[~given])
    basis = np.zeros((len(origin), len(unknown)))
    free = np.flatnonzero(~given)
    basis[free, np.searchsorted(unknown, leader[free])] = 1.0
    return origin, basis


def at_mass_limit(standard: StandardParameters, asked: Requirements, values: Array, near: Array) -> NDArray[np.bool_]:
    """Mask (p,) of the masses of links that are at a limit given by the requirements.

    Args:
        standard: The standard parameters.
        asked: The requirements.
        values: The estimate, shape (p,).
        near: Largest distance from a limit at which a parameter counts as being at the limit, shape (p,).
    """
    low, high = np.full(len(values), -np.inf), np.full(len(values), np.inf)
    masses = standard.inertial[:, 0]
    if asked.heaviest is not None:
        high[masses] = asked.heaviest
    for number, (least, largest) in (asked.masses or {}).items():
        k = masses[_link(standard, number, "masses")]
        low[k], high[k] = least, min(high[k], largest)
    return np.asarray((values <= low + near) | (values >= high - near))


def _mass_cones(standard: StandardParameters, asked: Requirements) -> list[Cone]:
    """Cones that contain the bounds of the masses of links and of the sum of these masses."""
    p = len(standard.names)
    rows: list[Array] = []
    offsets: list[float] = []
    bounds = [
        (standard.inertial[_link(standard, k, "masses"), :1], v, "masses") for k, v in (asked.masses or {}).items()
    ]
    if asked.total_mass is not None:
        bounds.append((standard.inertial[:, 0], asked.total_mass, "total_mass"))
    for where, value, name in bounds:
        good = isinstance(value, list | tuple) and len(value) == 2 and 0.0 <= value[0] < value[1]
        if not good:
            raise EstimationError(
                f"{name} must be a lower and an upper bound of the mass [kg]; found {value!r}.",
                remedy="give two numbers, the smaller one first, for instance [1.0, 4.0].",
            )
        row = np.zeros(p)
        row[where] = 1.0
        rows += [row, -row]
        offsets += [-float(value[0]), float(value[1])]
    return [Cone("nonnegative", np.array(rows), np.array(offsets))] if rows else []


def _com_cones(standard: StandardParameters, com: Mapping[str, Any]) -> list[Cone]:
    """Cones that keep centres of mass inside given volumes.

    A volume is the intersection of half spaces n·c ≤ d. With the centre of mass c = h / m of a link of mass m and
    first moment h, each half space is the linear condition d m - n·h ≥ 0.
    """
    cones: list[Cone] = []
    for key, points in com.items():
        own = standard.inertial[_link(standard, key, "com")]
        normals, distances = _half_spaces(key, points)
        matrix = np.zeros((len(distances), len(standard.names)))
        matrix[:, own[0]] = distances
        matrix[:, own[1:4]] = -normals
        cones.append(Cone("nonnegative", matrix, np.zeros(len(distances))))
    return cones


def _half_spaces(link: str, points: Any) -> tuple[Array, Array]:
    """Half spaces whose intersection is a box between two corners or the convex hull of more points.

    Returns:
        Outward normals of the k faces, shape (k, 3), and distances of the faces from the origin [m], shape (k,).
    """
    try:
        given: Any = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if (
        given.ndim != 2
        or given.shape[1] != 3
        or len(given) not in (2, *range(4, 1000))
        or not np.isfinite(given).all()
    ):
        raise EstimationError(
            f"`com` of link {link} must be two corners of a box or at least four points of a hull, each [x, y, z] "
            f"[m]; found {points!r:.80}.",
            remedy="give two corners, for instance [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.3]].",
        )
    if len(given) == 2:
        low, high = given.min(axis=0), given.max(axis=0)
        if (low >= high).any():
            raise EstimationError(
                f"`com` of link {link}: the box has no volume.",
                remedy="give a second corner with larger x, y and z than the first.",
            )
        return np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([high, -low])
    from scipy.spatial import ConvexHull, QhullError  # the import takes 0.2 s

    try:
        equations = ConvexHull(given).equations
    except QhullError as error:
        raise EstimationError(
            f"`com` of link {link}: the points lie in a plane.", remedy="give points that enclose a volume."
        ) from error
    return equations[:, :3], -equations[:, 3]


def _link(standard: StandardParameters, key: str, option: str) -> int:
    """Index of a link in `standard.inertial`, from the number of the link in an option."""
    numbers = [str(standard.names[own[0]].number) for own in standard.inertial]
    if str(key) not in numbers:
        raise EstimationError(
            f"The option `{option}` contains an unknown link {key!r}.",
            possible=", ".join(numbers),
            remedy="name a link by its number, counted from 1 at the base.",
        )
    return numbers.index(str(key))


def _position(position: Mapping[str, int], name: str, option: str) -> int:
    if name not in position:
        raise EstimationError(
            f"The option `{option}` contains an unknown parameter {name!r}.",
            possible=", ".join(position),
            remedy=did_you_mean(name, position),
        )
    return position[name]
