"""Choice of the standard parameters that are written: those of the estimate, or ones with equal base parameters.

Base parameters do not determine how the mass is distributed among the links. All standard parameters with given base
parameters are θ = particular + basis · z, where `particular` is one solution and z is any vector. Of all physically
consistent solutions, the one whose links are nearest to the description is taken; the distance is relative to the
pseudo-inertias of the description. If the description contains no masses, the solution with the smallest links is
taken.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, OutputError
from armid.estimation.consistency.cones import consistency_cones
from armid.estimation.estimate_record import collapse, torque_parameters
from armid.estimation.prior import LENGTH, size_of_bodies, smallest_radius
from armid.estimation.problem import StandardParameters, standard_of
from armid.export.fixed_body_inertias import is_possible
from armid.maths.conic_solver import Cone, solve_cones, upper_triangle
from armid.maths.inertia import PSEUDO_INERTIA_OF, pseudo_inertia, vector_from_pseudo_inertia
from armid.remedy import Remedy, setting
from armid.robot.robot import InertialParameters
from armid.runs.run import Run

EPSILONS = (1e-6, 1e-8)
"""Smallest eigenvalues that the pseudo-inertias are required to have; the second value is tried if the first one
is impossible."""

LIGHTEST = 0.01
"""Smallest mass relative to which changes of a link are measured, divided by the mean mass of the links, or by 1 kg
if that is larger."""

SAME = 1e-9
"""Largest allowed change of a base parameter by rounding in the regrouping, divided by the largest base parameter."""


AGAIN = Remedy("identify again with ", setting("method", "physical"), ".")


def values_to_write(
    run: Run,
    placeless: Collection[int] = (),
    carried: Array | None = None,
    *,
    nearest: bool = False,
    allow_unphysical: bool = False,
) -> tuple[Array, str, tuple[Finding, ...]]:
    """Chooses the standard parameters (p,) of a run that are written into a file.

    Args:
        run: The run.
        placeless: Indices of links that have no body in the file, as a link between two joints of one body.
        carried: Sum of the inertial parameters of the attached bodies of each link, shape (n, 10), if there are any.
        nearest: True to take the links nearest to the description, even if those of the estimate could be written.
        allow_unphysical: True to take inconsistent links near the description if no consistent links exist.

    Returns:
        The parameters; their kind: `estimated`, `nearest` or `unphysical`; and findings about the choice.

    Raises:
        OutputError: No consistent parameters exist, or the model has no rigid bodies.
    """
    if not run.model.has_rigid_bodies:
        problem = "The model of the run has no rigid bodies, so no bodies can be written."
        raise OutputError(problem, remedy="add rigid-body to the key `terms` or the option --terms; identify again.")
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
        f"No physically consistent links have exactly the base parameters that the method {run.estimate.method} "
        "estimated. Nothing was written.",
        possible="armid certify, which gives the distance to the nearest consistent parameters",
        remedy=AGAIN if theta is None else "use a description with a body for each link.",
    )


def _all_with(
    standard: StandardParameters, values: Array, kept: NDArray[np.intp], empty: NDArray[np.intp]
) -> tuple[Array, Array]:
    """All standard parameters with given base parameters: one solution (p,), and a basis (p, k) of all changes.

    In the regrouping matrix, the kept columns form an identity matrix. The parameters of the other columns can
    therefore be chosen freely, and the kept parameters follow from this choice. If parameters must be zero (`empty`),
    the choice is restricted.
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
    """Consistent standard parameters with given base parameters; `None` if there are none.

    Args:
        standard: Standard parameters of the model, and their regrouping.
        every: Particular solution and basis of all parameters with the base parameters.
        anchor: Parameters of the description, shape (p,); `None` if it has no masses.
        empty: Indices of the parameters that must be zero.
        room: Inertial parameters of the attached bodies, shape (n, 10), which each link must be able to contain.
    """
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
    """Consistent parameters with given base parameters that are nearest to the anchor.

    If the anchor is `None`, the parameters with the smallest links are returned. The arguments are those of
    `_search`; `epsilon` is the required smallest eigenvalue of the pseudo-inertias.
    """
    if np.abs(particular[empty]).max(initial=0.0) > SAME * np.abs(particular).max():
        raise EstimationError(
            "Links that have no body in the file must have no mass, which is impossible with these base parameters.",
            remedy="identify with --method physical, or give these links a mass in the description.",
        )
    steps = np.zeros((0, basis.shape[1]))
    if anchor is not None:
        there = [own for own in standard.inertial if not np.isin(own, empty).any()]
        particular, basis, steps = _in_even_steps(relative_change(standard, anchor, there), particular, basis, anchor)
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
    """Changes the basis of the solutions so that equal steps in it change the distance to the anchor equally.

    The new particular solution is the one nearest to the anchor. Without this change, the distances for unit steps
    would differ by a factor of 10⁴ if links are very light, and a solver would be inaccurate.

    Args:
        measure: Matrix M for which the length of M θ is the distance, shape (m, p).
        particular: Particular solution, shape (p,).
        basis: Basis of the solutions, shape (p, z).
        anchor: Parameters to which the distance is measured, shape (p,).

    Returns:
        New particular solution and basis; and the measure in this basis (z, z), diagonal with ones, or zeros for
        directions that do not change the distance.
    """
    _, sizes, right = np.linalg.svd(measure @ basis)
    sizes = np.pad(sizes, (0, len(right) - len(sizes)))
    seen = sizes > SAME * sizes.max(initial=0.0)
    steps = basis @ (right.T / np.where(seen, sizes, 1.0))
    back = np.linalg.lstsq((measure @ steps)[:, seen], measure @ (anchor - particular), rcond=None)[0]
    return particular + steps[:, seen] @ back, steps, np.diag(seen.astype(np.float64))


def relative_change(standard: StandardParameters, anchor: Array, there: list[NDArray[np.intp]]) -> Array:
    """Matrix (16 n, p) that maps a change of θ to the relative changes of the pseudo-inertias of n links.

    Args:
        standard: Standard parameters of the model.
        anchor: Parameters relative to which changes are measured, shape (p,).
        there: For each of the n links, the indices of its ten inertial parameters.
    """
    rows = np.zeros((16 * len(there), len(anchor)))
    least = LIGHTEST * max(float(anchor[standard.inertial[:, 0]].mean()), 1.0)
    thinnest = smallest_radius(standard)
    for k, own in enumerate(there):
        J = pseudo_inertia(_thick(anchor[own], least, thinnest))
        half = np.linalg.inv(np.linalg.cholesky(J))
        rows[16 * k : 16 * (k + 1), own] = np.einsum("ab,vbc,dc->adv", half, PSEUDO_INERTIA_OF, half).reshape(16, 10)
    return rows


def _thick(vector: Array, least: float, thinnest: float) -> Array:
    """Inertial parameters (10,) of a link, made physically consistent, relative to which changes can be measured.

    Below the mass `least` [kg], the parameters of a ball of this mass are returned. Radii of gyration about planes
    through the centre of mass are raised to `thinnest` [m].
    """
    J = pseudo_inertia(vector)
    mass = float(J[3, 3])
    if mass < least:
        return vector_from_pseudo_inertia(least * np.diag([LENGTH**2, LENGTH**2, LENGTH**2, 1.0]))
    com = J[:3, 3] / mass
    about, vectors = np.linalg.eigh(J[:3, :3] - mass * np.outer(com, com))
    J[:3, :3] = (vectors * np.maximum(about, thinnest**2 * mass)) @ vectors.T + mass * np.outer(com, com)
    return vector_from_pseudo_inertia(J)


def _fits(remaining: Array) -> bool:
    """True if links are physically consistent after their attached bodies are subtracted.

    `remaining` has shape (n, 10).
    """
    return all(is_possible(InertialParameters.from_vector(each)) for each in remaining)


def distance_to_description(run: Run, theta: Array) -> float:
    """Distance between the links of a run and those of the description; the option `--nearest` minimises it.

    The distance is the root of the sum over the links of ‖J₀^(-1/2) (J - J₀) J₀^(-1/2)‖², where J is the
    pseudo-inertia of a link with the given values and J₀ its pseudo-inertia in the description. Changes of masses,
    first moments and inertias are measured together, relative to the described link.

    Args:
        run: The run.
        theta: Standard parameters (p,).

    Returns:
        The distance; NaN if the description contains no masses.
    """
    standard = standard_of(run.model, run.estimate.base)
    if standard.nominal is None:
        return float("nan")
    rows = relative_change(standard, standard.nominal, list(standard.inertial))
    return float(np.linalg.norm(rows @ (theta - standard.nominal)))


def _reason(run: Run, theta: Array | None, empty: NDArray[np.intp], *, nearest: bool, usable: bool) -> str:
    """Text that states why the links of the file are not those of the estimate."""
    if nearest:
        return "the option --nearest was given"
    if theta is None:
        return f"{run.estimate.method} estimates only base parameters, which do not determine single masses"
    if theta[empty].any():
        return "the estimate has mass in links that have no body in the file"
    if usable:
        return "the estimated links are too small to contain the bodies that the file attaches to them"
    return "the estimated links are not physically consistent"


def _choice_finding(run: Run, standard: StandardParameters, theta: Array | None, found: Array, why: str) -> Finding:
    what = "of all physically consistent links with exactly the estimated base parameters, the file has those that"
    if standard.nominal is not None:
        change = f"{distance_to_description(run, found):.3g}"
        if theta is not None:
            change += f" ({distance_to_description(run, theta):.3g} for the estimated links)"
        what = (
            f"{what} are nearest to the description; their distance from it, as the relative change of mass, first "
            f"moment and inertia (pseudo-inertia) over all links, is {change}; the mass of a single link may be "
            "further from the description"
        )
    elif theta is not None:
        what = f"the description contains no masses, so {what} are nearest to the estimate"
    else:
        what = f"the description contains no masses, so {what} have the smallest mass and extent"
    return Finding("bodies-chosen", "info", "", f"{why}; {what}")


def _none_nearer() -> Finding:
    what = (
        "no physically consistent links with these base parameters were found that are nearer to the description "
        "than those of the estimate; the file has the inertial parameters of the estimate"
    )
    remedy = "use single masses of the file with care; the torque of the arm in free motion is right"
    return Finding("nearest-not-found", "warning", "", what, remedy)


def _unphysical(run: Run) -> Finding:
    what = f"no physically consistent links have the base parameters of the method {run.estimate.method}; "
    what += "inconsistent links with these base parameters, which are nearest to the description, are written"
    return Finding(
        "bodies-unphysical", "warning", "", what, Remedy("identify again with ", setting("method", "physical"))
    )
