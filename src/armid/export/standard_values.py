"""Standard parameters to write: the estimated ones, or bodies that have exactly the estimated base values.

Base parameters leave open how mass is shared between links, θ = particular + basis · z. Among all bodies that have
them, those nearest to the description are taken, relative to its pseudo-inertias; without one, the smallest.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError, Finding, OutputError
from armid.estimation.consistency.cones import consistency_cones
from armid.estimation.estimate import collapse, torque_parameters
from armid.estimation.prior import LENGTH, THINNEST, size_of_bodies
from armid.estimation.problem import StandardParameters, standard_of
from armid.export.attached_inertias import is_possible
from armid.maths.conic_solver import Cone, solve_cones, upper_triangle
from armid.maths.inertia import PSEUDO_INERTIA_OF, pseudo_inertia, vector_from_pseudo_inertia
from armid.remedy import Remedy, setting
from armid.robot.robot import InertialParameters
from armid.runs.run import Run
from armid.values import Array

EPSILONS = (1e-6, 1e-8)
"""Required smallest eigenvalues of the pseudo-inertias, tried in turn from a speck of dust downwards."""

LIGHTEST = 0.01
"""Least mass that serves as the scale for a link, as a share of the mean link mass."""

SAME = 1e-9
"""Largest tolerated change of a base parameter relative to the largest, due to rounding of the regrouping."""


AGAIN = Remedy("identify again with ", setting("method", "physical"), ".")


def values_to_write(
    run: Run,
    placeless: Collection[int] = (),
    carried: Array | None = None,
    *,
    nearest: bool = False,
    allow_unphysical: bool = False,
) -> tuple[Array, str, tuple[Finding, ...]]:
    """Standard parameters (p,) of a run.

    Args:
        run: The run.
        placeless: Links without a body in the file, such as those between two joints of one body.
        carried: Inertial parameters (n, 10) of attached bodies in the file, which should fit into the links; `None`
            where there is nothing of the kind.
        nearest: Always take the bodies nearest to the description.
        allow_unphysical: If no consistent bodies have the base values, take inconsistent ones near the description.

    Returns:
        The parameters; `estimated`, `nearest` or `unphysical`; what was done.

    Raises:
        OutputError: There are none; the message says what to do.
    """
    if not run.model.has_rigid_bodies:
        raise OutputError("The run has no rigid bodies to write.", remedy="identify with the term rigid-body.")
    base, fit = run.estimate.base, run.estimate.fit
    standard = standard_of(run.model, base)
    theta = torque_parameters(base, fit) if fit.standard is not None else None
    empty = standard.inertial[sorted(placeless)].ravel() if placeless else np.zeros(0, dtype=np.intp)
    carried = np.zeros((len(standard.inertial), 10)) if carried is None else carried
    usable = False
    if theta is not None and not nearest and not theta[empty].any():
        links = theta[standard.inertial]
        if _fits(np.delete(links - carried, sorted(placeless), axis=0)):
            return theta, "estimated", ()
        usable = _fits(np.delete(links, sorted(placeless), axis=0))
    anchor = theta if standard.nominal is None else standard.nominal
    every = _all_with(standard, collapse(base.names, fit), base.kept, empty)
    # Attached bodies that do not fit into any bodies with these base values are scaled later.
    for room in [carried, np.zeros_like(carried)] if carried.any() else [carried]:
        if theta is not None and usable and not room.any():
            return theta, "estimated", ()
        consistent = _search(standard, every, anchor, empty, room)
        if consistent is not None:
            why = _reason(run, theta, empty, nearest=nearest, usable=usable)
            return consistent, "nearest", (_choice_finding(run, standard, theta, consistent, why),)
    if theta is not None and not theta[empty].any():
        # The writer reports inconsistent links.
        return theta, "estimated", (_none_nearer(),) if nearest else ()
    if allow_unphysical and anchor is not None:
        particular, basis = every
        change = np.linalg.lstsq(basis, anchor - particular, rcond=None)[0]
        return particular + basis @ change, "unphysical", (_unphysical(run),)
    raise OutputError(
        f"No physically consistent links have exactly the base parameters that {run.estimate.method} estimated; "
        "nothing was written.",
        possible="armid certify gives the distance to the nearest consistent ones",
        remedy=AGAIN if theta is None else "give the file a body for each link.",
    )


def _all_with(
    standard: StandardParameters, values: Array, kept: NDArray[np.intp], empty: NDArray[np.intp]
) -> tuple[Array, Array]:
    """All standard parameters with the base values, as a particular solution (p,) and a basis (p, z).

    Kept columns have the identity in the regrouping, so the other parameters are free and the kept ones follow. Those
    that must be zero come as conditions on them.
    """
    p = len(standard.names)
    free = np.setdiff1d(np.arange(p), kept)
    particular, basis = np.zeros(p), np.zeros((p, len(free)))
    particular[kept] = values
    basis[free, np.arange(len(free))] = 1.0
    basis[kept] = -standard.regrouping[:, free]
    if not len(empty):
        return particular, basis
    rows = basis[empty]
    step = np.linalg.lstsq(rows, -particular[empty], rcond=None)[0]
    _, sizes, right = np.linalg.svd(rows)
    rank = int(np.sum(sizes > SAME * sizes[0]))
    return particular + basis @ step, basis @ right[rank:].T


def _search(
    standard: StandardParameters,
    every: tuple[Array, Array],
    anchor: Array | None,
    empty: NDArray[np.intp],
    room: Array,
) -> Array | None:
    """Consistent parameters with exactly the base values, whose links can contain `room`; else `None`."""
    values = standard.regrouping @ every[0]
    for epsilon in EPSILONS:
        try:
            candidate = _nearest(standard, *every, anchor, empty, epsilon, room)
        except EstimationError:
            continue
        if np.abs(standard.regrouping @ candidate - values).max() <= SAME * np.abs(values).max():
            return candidate
    return None


def _nearest(
    standard: StandardParameters,
    particular: Array,
    basis: Array,
    anchor: Array | None,
    empty: NDArray[np.intp],
    epsilon: float,
    room: Array,
) -> Array:
    """Consistent parameters with the given base parameters, nearest to the anchor, or smallest without one."""
    if np.abs(particular[empty]).max(initial=0.0) > SAME * np.abs(particular).max():
        raise EstimationError(
            "Links without a body cannot be empty with these base values.",
            remedy="identify with --method physical, or give these links a mass in the description.",
        )
    steps = np.zeros((0, basis.shape[1]))
    if anchor is not None:
        there = [own for own in standard.inertial if not np.isin(own, empty).any()]
        particular, basis, steps = _in_even_steps(
            _relative_change(standard, anchor, there), particular, basis, anchor
        )
    z = basis.shape[1]
    cones: list[Cone] = []
    i, j = upper_triangle(4)
    links = iter(pseudo_inertia(room)[:, i, j])
    for cone in consistency_cones(standard, len(particular), epsilon=epsilon):
        matrix, offset = cone.matrix @ basis, cone.matrix @ particular + cone.offset
        touched = np.flatnonzero(cone.matrix.any(axis=0))
        if cone.kind == "semidefinite":
            offset = offset - next(links)
            if np.isin(touched, empty).all():
                continue
        cones.append(Cone(cone.kind, np.pad(matrix, ((0, 0), (0, 1))), offset))
    cost = np.zeros(z + 1)
    if anchor is None:
        cost[:z] = size_of_bodies(standard) @ basis
    else:
        cost[z] = 1.0
        distance = np.pad(steps, ((1, 0), (0, 1)))
        distance[0, z] = 1.0
        cones.append(Cone("norm", distance, np.zeros(1 + len(steps))))
    return particular + basis @ solve_cones(cost, cones).x[:z]


def _in_even_steps(measure: Array, particular: Array, basis: Array, anchor: Array) -> tuple[Array, Array, Array]:
    """Same parameters relative to those nearest to the anchor, in a basis that is orthonormal in the measure.

    Light links make steps a ten-thousandth as long as others, and a solver lose its digits.

    Args:
        measure: Rows whose length is a distance, shape (m, p).
        particular: Shape (p,).
        basis: Shape (p, z).
        anchor: Shape (p,).

    Returns:
        Particular and basis anew; the measure of the steps (z, z), one, or zero where it sees nothing.
    """
    _, sizes, right = np.linalg.svd(measure @ basis)
    sizes = np.pad(sizes, (0, len(right) - len(sizes)))
    seen = sizes > SAME * sizes.max(initial=0.0)
    steps = basis @ (right.T / np.where(seen, sizes, 1.0))
    back = np.linalg.lstsq((measure @ steps)[:, seen], measure @ (anchor - particular), rcond=None)[0]
    return particular + steps[:, seen] @ back, steps, np.diag(seen.astype(np.float64))


def _relative_change(standard: StandardParameters, anchor: Array, there: list[NDArray[np.intp]]) -> Array:
    """Rows whose length is the relative change of the links' pseudo-inertias, shape (16 links, p)."""
    rows = np.zeros((16 * len(there), len(anchor)))
    least = LIGHTEST * max(float(anchor[standard.inertial[:, 0]].mean()), 1.0)
    for k, own in enumerate(there):
        J = pseudo_inertia(_thick(anchor[own], least))
        half = np.linalg.inv(np.linalg.cholesky(J))
        rows[16 * k : 16 * (k + 1), own] = np.einsum("ab,vbc,dc->adv", half, PSEUDO_INERTIA_OF, half).reshape(16, 10)
    return rows


def _thick(vector: Array, least: float) -> Array:
    """Inertial parameters moved inside the cone, so that they can serve as a scale; a ball if all are zero."""
    J = pseudo_inertia(vector)
    mass = float(J[3, 3])
    if mass < least:
        return vector_from_pseudo_inertia(least * np.diag([LENGTH**2, LENGTH**2, LENGTH**2, 1.0]))
    com = J[:3, 3] / mass
    about, vectors = np.linalg.eigh(J[:3, :3] - mass * np.outer(com, com))
    J[:3, :3] = (vectors * np.maximum(about, THINNEST**2 * mass)) @ vectors.T + mass * np.outer(com, com)
    return vector_from_pseudo_inertia(J)


def _fits(remaining: Array) -> bool:
    """True if the links (n, 10) without their attached bodies are physically consistent."""
    return all(is_possible(InertialParameters.from_vector(each)) for each in remaining)


def distance_to_description(run: Run, theta: Array) -> float:
    """Distance of the links from those of the description, which `--nearest` minimises.

    It is the root of the sum over links of ‖J₀^(-1/2) (J - J₀) J₀^(-1/2)‖², with the pseudo-inertias J of the values
    and J₀ of the description: masses, first moments and inertias together, each relative to the described link.

    Args:
        run: The run.
        theta: Standard parameters (p,).

    Returns:
        The distance; NaN where the description gives no masses.
    """
    standard = standard_of(run.model, run.estimate.base)
    if standard.nominal is None:
        return float("nan")
    rows = _relative_change(standard, standard.nominal, list(standard.inertial))
    return float(np.linalg.norm(rows @ (theta - standard.nominal)))


def _reason(run: Run, theta: Array | None, empty: NDArray[np.intp], *, nearest: bool, usable: bool) -> str:
    """Reason in words for other links than those of the estimate."""
    if nearest:
        return "--nearest was asked for"
    if theta is None:
        return f"{run.estimate.method} estimates only base parameters, which do not determine how links share mass"
    if theta[empty].any():
        return "the estimate has mass in links for which the file has no place"
    if usable:
        return "the estimated links cannot contain the bodies that the file attaches to them"
    return "the estimated links are not physically consistent"


def _choice_finding(run: Run, standard: StandardParameters, theta: Array | None, found: Array, why: str) -> Finding:
    what = "the file has the physically consistent links with exactly its base parameters that"
    if standard.nominal is not None:
        change = f"{distance_to_description(run, found):.3g}"
        if theta is not None:
            change += f" ({distance_to_description(run, theta):.3g} for the estimated links)"
        what = (
            f"{what} are nearest to the description: relative to it, the pseudo-inertias (mass, first moment and "
            f"inertia) of all links together change by {change}; the mass of a single link may be further from the "
            "description"
        )
    elif theta is not None:
        what = f"the description gives no masses, so {what} are nearest to the estimate"
    else:
        what = f"the description gives no masses, so {what} have the least mass and extent"
    return Finding("bodies-chosen", "info", "", f"{why}; {what}")


def _none_nearer() -> Finding:
    what = "no physically consistent links nearer to the description were found that have these base parameters"
    return Finding("nearest-not-found", "warning", "", f"{what}; the file has those of the estimate")


def _unphysical(run: Run) -> Finding:
    what = (
        f"no physically consistent links have the base parameters of {run.estimate.method}; the nearest inconsistent "
    )
    what += "ones that have are written"
    return Finding(
        "bodies-unphysical", "warning", "", what, Remedy("identify again with ", setting("method", "physical"))
    )
