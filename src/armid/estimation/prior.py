"""Priors of the standard parameters: penalty functions, and the unit in which their weights are given.

- `log-det`: for each link the divergence tr(J₀⁻¹J) - log det(J₀⁻¹J) - 4 between the pseudo-inertia J and the
  pseudo-inertia J₀ of the description [Lee2020]. The divergence does not depend on frames and units, and tends to
  infinity at the boundary of the set of physically consistent bodies. For small changes it is half the squared
  relative change.
- `euclidean`: half the squared change of the parameters. Changes are divided by the mean mass of the links in the
  description and, for moments, by powers of their radius of gyration.
- `mass`: the size of all bodies (sum of masses and of second moments / LENGTH²), divided by ten kilograms. If the
  data determine a parameter with a standard deviation of s kg, this prior changes it by s / 10 standard deviations,
  which is little. If the data do not determine a parameter, the body becomes as small as possible.

In these three priors, a parameter that is not inertial has the mean zero. Its standard deviation is the value with
which the torque of this parameter alone is as large as the whole torque of the joint.

The unit of the weight is one independent sample: with weight 1 a change of 100 % costs as much as a residual of one
standard deviation in one independent row of a joint. The weight applies to the links. The prior of friction and of
other parameters that a description does not contain keeps the weight 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding
from armid.estimation.problem import StandardParameters
from armid.estimation.whitened_system import WhitenedSystem
from armid.maths.barrier_function import LogDet
from armid.maths.inertia import (
    PSEUDO_INERTIA_OF,
    com_inertia_to_vector,
    pseudo_inertia,
    vector_from_pseudo_inertia,
)

LENGTH = 0.3
"""Length that converts first moments and inertias of an arm to masses, so that they are comparable [m]: half the
length of a usual link."""

THINNEST = 0.01
"""Smallest radius of gyration about a plane through the centre of mass that is accepted from the description of an
arm of usual size [m]. Some descriptions contain bodies without thickness, such as rods and points."""

SLIMMEST = 0.05
"""Smallest accepted radius of gyration on small arms, divided by the size of the arm. The size is the radius of
gyration of the links about their joints: bodies of a hobby arm with a size of 70 mm have radii of 5 mm."""

FLAT = 1e-6
"""Ratio below which the smallest second moment of a body is a rounding error, so that the body has no thickness. The
ratio is relative to the largest second moment of the body or to the smallest accepted one, whichever is larger."""

MASS = 10.0
"""Standard deviation of an unknown mass [kg]; it covers the links of all arms with which armid was tested."""

BODY = com_inertia_to_vector(5.0, np.zeros(3), 0.1 * np.eye(3))
"""Inertial parameters of a physically consistent body, from which a search starts."""

ROOM = 0.1
"""Start value of parameters that cannot be negative, in standard deviations of the prior."""

HIGHEST = 0.1
"""Largest amount by which an eigenvalue is raised from the boundary of the cone, divided by the trace of a body
inside the cone; it is used if the slope of the cost is zero."""

INFORMED = ("log-det", "euclidean")
"""Kinds of prior whose mean is the inertial parameters of the description."""

GIVEN, CHOSEN = "given", "chosen with the friction"
"""Texts for the origin of the weight of a prior: an option of the method, or the selection of friction."""


def weight_finding(prior: str, weight: float, origin: str) -> Finding:
    """Finding that states the weight of a prior and the origin of this weight.

    Args:
        prior: Name of the prior, for instance `log-det prior`.
        weight: Weight of the prior [independent samples].
        origin: Origin of the weight, for instance `GIVEN`.
    """
    samples = "one independent sample" if weight == 1.0 else f"{weight:.3g} independent samples"
    text = {GIVEN: "set with the option `weight`"}.get(origin, origin)
    return Finding("prior-weight", "info", "", f"The {prior} counts as much as {samples} ({text}).")


def shrinkage_option(shrinkage: float) -> float:
    """Checks the option `shrinkage` of an estimator and returns it.

    Raises:
        EstimationError: The shrinkage is negative or not finite.
    """
    if not 0.0 <= shrinkage < np.inf:
        raise EstimationError(
            f"The option `shrinkage` must be at least 0; found {shrinkage!r}.",
            remedy="leave the option out, which gives 0.",
        )
    return float(shrinkage)


OF_WHOLE = 0.05
"""Share of the squared length of a column of added friction in the unit of its shrinkage, in addition to the squared
length of the part that the other columns do not explain. Without this share, the error of a joint of the LWR4+ on a
left-out recording was 1.37 times that of plain least squares (0.93 times with it); with 0.15, quadratic friction of a
simulated arm was shrunk by a third."""

CLEAR = 1e-3
"""Smallest ratio of a singular value of the other columns to the largest one with which the data determine the
direction of the singular value; the prior determines all other directions."""


@dataclass(frozen=True, eq=False, slots=True)
class Prior:
    """Prior of the p standard parameters, as a penalty function for weight 1.

    Attributes:
        mean: Values that the prior prefers, shape (p,).
        precision: Second derivative of the penalty at the mean, shape (p, p).
        links: Inverses of the pseudo-inertias in the description, shape (links, 4, 4), for `log-det`; shape (0, 4, 4)
            for other kinds of prior.
        findings: Findings about values of the description that were changed for the prior.
    """

    mean: Array
    precision: Array
    links: Array
    findings: tuple[Finding, ...] = ()

    def curvature(self, standard: StandardParameters, values: Array, weight: float) -> Array:
        """Second derivative of the penalty at given values, for a weight of the links' prior, shape (p, p)."""
        result = self.precision.copy()
        for own in standard.inertial:
            result[np.ix_(own, own)] *= weight
        if not len(self.links):
            return result
        for own, precision in zip(
            standard.inertial, relative_precision(pseudo_inertia(values[standard.inertial])), strict=True
        ):
            result[np.ix_(own, own)] = weight * precision
        return result

    def inside(self, standard: StandardParameters) -> Array:
        """Standard parameters inside the cone, shape (p,): bodies of the description or `BODY`, and some friction."""
        values = self.mean.copy()
        if not values[standard.inertial].any():
            values[standard.inertial] = BODY
        free = standard.nonnegative & (values <= 0.0)
        values[free] = ROOM / np.sqrt(np.diag(self.precision)[free])
        return values

    def lifted(
        self, standard: StandardParameters, values: Array, pull: Array, weight: float, *, bodies: bool = True
    ) -> Array:
        """Moves standard parameters (p,) from the boundary of the cone into its interior, as a barrier would do.

        If a barrier is added to the cost, an eigenvalue that was zero at the minimum becomes about the weight of the
        barrier divided by the slope of the cost.

        Args:
            standard: The standard parameters.
            values: The best values in the cone, shape (p,).
            pull: Slope of the cost at these values, shape (p,).
            weight: Weight of the barrier.
            bodies: False if all bodies are already inside the cone, so that only the other parameters are moved.
        """
        result, inside = values.copy(), self.inside(standard)
        bounded = standard.nonnegative
        least = weight / np.maximum(pull[bounded], weight / inside[bounded])
        result[bounded] = np.maximum(values[bounded], least)
        if not bodies:
            return result
        for own in standard.inertial:
            eigenvalues, vectors = np.linalg.eigh(pseudo_inertia(values[own]))
            parts = vector_from_pseudo_inertia(np.einsum("ik,jk->kij", vectors, vectors))
            furthest = HIGHEST * float(np.trace(pseudo_inertia(inside[own])))
            least = weight / np.maximum(parts @ pull[own], weight / furthest)
            result[own] += np.maximum(least - eigenvalues, 0.0) @ parts
        return result

    def log_det(self, standard: StandardParameters, origin: Array, basis: Array, weight: float) -> tuple[LogDet, ...]:
        """Log-det divergences of the links, as functions of the unknowns x with the parameters origin + basis · x.

        Links that do not depend on the unknowns are left out.
        """
        units = PSEUDO_INERTIA_OF.transpose(1, 2, 0)
        terms: list[LogDet] = []
        for own, inverse in zip(standard.inertial, self.links, strict=True):
            if basis[own].any():
                matrix, offset = units @ basis[own], pseudo_inertia(origin[own])
                constant = float(np.sum(inverse * offset)) - float(np.linalg.slogdet(inverse)[1]) - 4.0
                cost = np.einsum("ab,bav->v", inverse, matrix)
                terms.append(LogDet(matrix, offset, cost, constant, weight))
        return tuple(terms)


def make_prior(kind: str, standard: StandardParameters, weighted: WhitenedSystem, *, shrinkage: float = 0.0) -> Prior:
    """Makes a prior of a given kind.

    The kinds `log-det` and `euclidean` use the inertial parameters of the description; `mass` and `none` do not.

    Args:
        kind: The kind.
        standard: Standard parameters.
        weighted: The whitened data.
        shrinkage: Precision of the friction that was added to the model, as a share of the information of the data
            about it.

    Raises:
        EstimationError: The kind of prior needs masses that the description does not contain.
    """
    p = len(standard.names)
    precision = np.zeros((p, p))
    others = np.setdiff1d(np.arange(p), standard.inertial)
    precision[others, others] = _others(standard, weighted, others)
    if shrinkage and standard.added is not None:
        added = np.flatnonzero(standard.added)
        precision[added, added] += shrinkage / weighted.correlation * _own_information(standard, weighted, added)
    mean = np.zeros(p)
    none = np.zeros((0, 4, 4))
    if kind in ("mass", "none"):
        _fill(precision, standard, MASS, LENGTH)
        return Prior(mean, precision, none)
    nominal, findings = _nominal(standard)
    mean[standard.inertial] = nominal
    J = pseudo_inertia(nominal)
    if kind == "euclidean":
        mass = float(nominal[:, 0].mean())
        radius = float(np.sqrt(np.trace(J[:, :3, :3], axis1=1, axis2=2).sum() / nominal[:, 0].sum()))
        _fill(precision, standard, mass, radius)
        return Prior(mean, precision, none, findings)
    for own, relative in zip(standard.inertial, relative_precision(J), strict=True):
        precision[np.ix_(own, own)] = relative
    return Prior(mean, precision, np.asarray(np.linalg.inv(J), dtype=np.float64), findings)


def size_of_bodies(standard: StandardParameters) -> Array:
    """Coefficients (p,) with which the sum over the parameters is the size of all bodies [kg].

    The size is the sum of masses and of second moments / LENGTH².
    """
    result = np.zeros(len(standard.names))
    traces = np.trace(PSEUDO_INERTIA_OF[:, :3, :3], axis1=1, axis2=2) / LENGTH**2
    for own in standard.inertial:
        result[own] = traces
        result[own[0]] += 1.0
    return result


def _fill(precision: Array, standard: StandardParameters, mass: float, length: float) -> None:
    """Sets the precision of the inertial parameters of all links in the matrix `precision` (p, p).

    The standard deviations are `mass` for masses, `mass` · `length` for first moments, and `mass` · `length`² for
    inertias.
    """
    scale = mass * np.concatenate([[1.0], np.full(3, length), np.full(6, length**2)])
    for own in standard.inertial:
        precision[own, own] = 1.0 / scale**2


def relative_precision(J: Array) -> Array:
    """Second derivatives (…, 10, 10) of -log det J by the ten inertial parameters, at pseudo-inertias J (…, 4, 4)."""
    values, vectors = np.linalg.eigh(J)
    # Where an eigenvalue is lost in rounding, what is smaller cannot be told from it.
    values = np.maximum(values, np.finfo(np.float64).eps * values[..., -1:])
    half = np.swapaxes(vectors, -1, -2) / np.sqrt(values)[..., None]
    white = half[..., None, :, :] @ PSEUDO_INERTIA_OF @ np.swapaxes(half, -1, -2)[..., None, :, :]
    flat = white.reshape(*J.shape[:-2], 10, 16)
    return flat @ np.swapaxes(flat, -1, -2)


def _others(standard: StandardParameters, weighted: WhitenedSystem, others: NDArray[np.intp]) -> Array:
    """Precisions (o,) of the o parameters that are not inertial.

    With a value of one standard deviation, the torque of a parameter alone is as large as the whole torque of the
    joint.
    """
    precision = np.zeros(len(others))
    for joint, rows in zip(weighted.whole.joints, weighted.whole.rows[0], strict=True):
        torque = float(np.sum(joint.R[0, :, -1] ** 2))
        if rows and torque > 0.0:
            columns = joint.R[0, :, :-1] @ standard.regrouping[joint.parameters][:, others]
            precision += np.sum(columns**2, axis=0) / torque
    return np.where(precision > 0.0, precision, 1.0)


def _own_information(standard: StandardParameters, weighted: WhitenedSystem, added: NDArray[np.intp]) -> Array:
    """Information of the data about each added friction parameter, in units of which its shrinkage is given.

    It is the squared length of the part of the column that the other columns do not explain, plus `OF_WHOLE` times
    the squared length of the whole column.

    Args:
        standard: Standard parameters.
        weighted: The whitened data.
        added: Positions of the added friction parameters.

    Returns:
        Squared lengths, shape (added,).
    """
    rows = [
        weight * joint.R[0, :, :-1] @ standard.regrouping[joint.parameters]
        for joint, weight in zip(weighted.whole.joints, weighted.weights, strict=True)
    ]
    columns = np.concatenate(rows)
    others = np.delete(columns, added, axis=1)
    used = others[:, np.any(others != 0.0, axis=0)]
    left = columns[:, added]
    if used.size:
        U, s, _ = np.linalg.svd(used / np.linalg.norm(used, axis=0), full_matrices=False)
        basis = U[:, s > CLEAR * s[0]]
        left = left - basis @ (basis.T @ left)
    return np.sum(left**2, axis=0) + OF_WHOLE * np.sum(columns[:, added] ** 2, axis=0)


def _nominal(standard: StandardParameters) -> tuple[Array, tuple[Finding, ...]]:
    """Inertial parameters (links, 10) of the description, made physically consistent, and findings about changes."""
    if standard.nominal is None:
        raise EstimationError(
            "A prior towards the description needs inertial parameters, but the description contains none.",
            possible='prior = "mass" or "none"',
            remedy="choose one of these priors, or write mass and inertia of every link into the description.",
        )
    result, findings = standard.nominal[standard.inertial].copy(), list[Finding]()
    for link, mass in zip(standard.links, result[:, 0], strict=True):
        if not mass > 0.0:
            raise EstimationError(
                f"In the description, the link {link} has the mass {mass:g} kg, so no prior can be computed from "
                "this mass.",
                possible='prior = "mass" or "none"',
                remedy="choose one of these priors, or write mass and inertia of this link into the description.",
            )
    thinnest = smallest_radius(standard)
    result, replaced = _without_placeholders(standard, result)
    findings.extend(replaced)
    for k, link in enumerate(standard.links):
        J = pseudo_inertia(result[k])
        mass = J[3, 3]
        com = J[:3, 3] / mass
        about, vectors = np.linalg.eigh(J[:3, :3] - mass * np.outer(com, com))
        least = thinnest**2 * mass
        if about[0] < least:
            J[:3, :3] = (vectors * np.maximum(about, least)) @ vectors.T + mass * np.outer(com, com)
            result[k] = vector_from_pseudo_inertia(J)
            radius = 1000 * float(np.sqrt(max(about[0], 0.0) / mass))
            if about[0] < 0.0:
                what = "no real body can have the inertia of this link"
            elif about[0] <= FLAT * max(about[-1], least):
                what = "the inertia of this link is that of a body without thickness: a plate, a rod or a point"
            else:
                what = f"this link has a radius of gyration of {radius:.2g} mm, less than real links have"
            findings.append(
                Finding(
                    "nominal-projected",
                    "warning" if about[0] < 0.0 else "info",
                    link,
                    f"In the description, {what} (smallest second moment {about[0]:.2g} kg·m²); the prior uses the "
                    f"nearest inertia with a radius of gyration of {1000 * thinnest:.3g} mm.",
                )
            )
    return result, tuple(findings)


def smallest_radius(standard: StandardParameters) -> float:
    """Smallest radius of gyration about a plane through the centre of mass that the prior accepts [m]."""
    if standard.nominal is None:
        return THINNEST
    bodies = standard.nominal[standard.inertial][~standard.placeholders]
    mass = float(bodies[:, 0].sum())
    second = float(np.trace(pseudo_inertia(bodies)[:, :3, :3], axis1=1, axis2=2).sum())
    return min(THINNEST, SLIMMEST * float(np.sqrt(max(second, 0.0) / mass))) if mass > 0.0 else THINNEST


def _without_placeholders(standard: StandardParameters, nominal: Array) -> tuple[Array, tuple[Finding, ...]]:
    """Replaces each body with a placeholder mass by the lightest real body.

    Returns:
        Inertial parameters, shape (links, 10), and findings about the changes.
    """
    masses = nominal[:, 0]
    empty = standard.placeholders
    if not empty.any():
        return nominal, ()
    lightest = int(np.argmin(np.where(empty, np.inf, masses)))
    second_moment = float(np.trace(pseudo_inertia(nominal[lightest])[:3, :3])) / 3.0
    result = nominal.copy()
    result[empty] = vector_from_pseudo_inertia(np.diag([second_moment] * 3 + [masses[lightest]]))
    findings = tuple(
        Finding(
            "nominal-projected",
            "info",
            standard.links[k],
            f"The mass of this link in the description, {masses[k]:.2g} kg, is a placeholder and not the real mass; "
            f"the prior uses the body of the lightest other link instead, with {masses[lightest]:.3g} kg.",
            "write mass and inertia of the link into the description if they are known.",
        )
        for k in np.flatnonzero(empty)
    )
    return result, findings
