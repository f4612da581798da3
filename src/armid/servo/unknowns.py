"""Unknowns of a servo identification: coordinates in which every value is physically possible, with their prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.inertia import pseudo_inertia, vector_from_pseudo_inertia
from armid.servo.closed_loop import columns_of
from armid.servo.parameters import ServoModel, ServoParameters

LOWER = tuple((i, j) for i in range(4) for j in range(i + 1))
"""Row and column of the ten entries of a lower triangular matrix."""

DIAGONAL = [k for k, (i, j) in enumerate(LOWER) if i == j]
"""Numbers of the entries on the diagonal."""

LOGARITHMIC = ("friction", "rotor_inertia", "stiffness", "damping", "limit")
"""Fields of `ServoParameters` that are positive; their coordinates are logarithms of the ratio to the prior mean."""

ADDITIVE = ("offset", "delay")
"""Fields whose coordinates are differences from the prior mean."""


@dataclass(frozen=True, eq=False, slots=True)
class PriorDeviations:
    """Standard deviations of the prior; 0 for a value that is known.

    Attributes:
        friction: Of the logarithm of each friction parameter, shape (l,).
        rotor_inertia: Of the logarithm of each rotor inertia, shape (n,).
        stiffness: Of the logarithm of each stiffness, shape (n,).
        damping: Of the logarithm of each damping of a servo, shape (n,).
        limit: Of the logarithm of each largest torque, shape (n,).
        offset: Of each offset, shape (n,) [rad or m].
        delay: Of each delay, shape (n,) [s].
        bodies: Of the relative changes of the links. A link with the pseudo-inertia J = L Lᵀ has the factor L E with
            a lower triangular matrix E; the logarithms of the lengths of its rows, and its other entries relative to
            the diagonal of their row, have this deviation. So the description is the median of the prior: with
            independent entries, a link whose centre of mass moves in either direction would become heavier.
    """

    friction: Array
    rotor_inertia: Array
    stiffness: Array
    damping: Array
    limit: Array
    offset: Array
    delay: Array
    bodies: float


class Unknowns:
    """Coordinates x of the parameters that are not known, all 0 at the prior mean."""

    def __init__(self, model: ServoModel, mean: ServoParameters, deviations: PriorDeviations) -> None:
        self.model, self.mean, self.deviations = model, mean, deviations
        positive = pseudo_inertia(mean.inertial)
        self._factors: Array = np.asarray(np.linalg.cholesky(positive + 1e-12 * np.eye(4)), dtype=np.float64)
        columns, fields = columns_of(model), (*LOGARITHMIC, *ADDITIVE)
        self._sizes = {name: columns[name].stop - columns[name].start for name in fields}
        given = np.concatenate([getattr(deviations, name) for name in fields])
        # A logarithm leaves neither zero nor infinity, so what is zero or unlimited in the mean stays so.
        moves = np.concatenate(
            [
                _moves(getattr(mean, name)) if name in LOGARITHMIC else np.ones(self._sizes[name], bool)
                for name in fields
            ]
        )
        bodies = np.full(10 * model.n, deviations.bodies)
        every = np.concatenate([np.where(moves, given, 0.0), bodies])
        self.free: NDArray[np.intp] = np.flatnonzero(every > 0.0)
        self.deviation: Array = every[self.free]

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.free)

    def names(self) -> list[tuple[str, int]]:
        """Field of `ServoParameters` and index in it of each unknown; `inertial` has ten unknowns for each link."""
        every = [(name, k) for name in (*LOGARITHMIC, *ADDITIVE) for k in range(self._sizes[name])]
        every += [("inertial", k) for k in range(10 * self.model.n)]
        return [every[k] for k in self.free]

    def parameters(self, x: Array) -> ServoParameters:
        """Parameters at coordinates x, shape (count,)."""
        parts, bodies = self._split(x)
        values = {name: getattr(self.mean, name) * np.exp(parts[name]) for name in LOGARITHMIC}
        values |= {name: getattr(self.mean, name) + parts[name] for name in ADDITIVE}
        return replace(self.mean, inertial=self._bodies(bodies), **values)

    def near(self, parameters: ServoParameters, links: Array | None = None) -> Array:
        """Coordinates (count,) of gains, friction, offsets and delays of other parameters.

        Args:
            parameters: The other parameters.
            links: Coordinates of the links, shape (10 n,); those of the prior links if not given.
        """
        parts: list[Array] = []
        for name, size in self._sizes.items():
            own, mean = getattr(parameters, name), getattr(self.mean, name)
            ratio = np.divide(own, mean, out=np.ones(size), where=(own > 0.0) & _moves(mean) & np.isfinite(own))
            parts.append(np.log(ratio) if name in LOGARITHMIC else own - mean)
        return np.concatenate([*parts, np.zeros(10 * self.model.n) if links is None else links])[self.free]

    def links(self, x: Array) -> Array:
        """Coordinates of the links at coordinates x (count,), shape (10 n,)."""
        return self._split(x)[1].ravel()

    def chain(self, x: Array) -> Array:
        """Derivatives of the parameters, in the columns of `columns_of`, by the unknowns, shape (columns, count)."""
        parts, bodies = self._split(x)
        columns = columns_of(self.model)
        found = np.zeros((columns["delay"].stop, sum(self._sizes.values()) + 10 * self.model.n))
        at = 0
        for name, size in self._sizes.items():
            rows, mean = np.arange(columns[name].start, columns[name].stop), getattr(self.mean, name)
            value = np.where(_moves(mean), mean, 0.0) * np.exp(parts[name])
            found[rows, at + np.arange(size)] = value if name in LOGARITHMIC else 1.0
            at += size
        if self.deviations.bodies > 0.0:
            for link, slopes in enumerate(self._body_slopes(bodies)):
                rows = columns["inertial"].start + 10 * link
                found[rows : rows + 10, at + 10 * link : at + 10 * link + 10] = slopes
        return found[:, self.free]

    def _split(self, x: Array) -> tuple[dict[str, Array], Array]:
        """Coordinates of each field, and those of the links, shape (n, 10)."""
        every = np.zeros(sum(self._sizes.values()) + 10 * self.model.n)
        every[self.free] = x
        ends = np.cumsum(list(self._sizes.values()))
        parts = dict(zip(self._sizes, np.split(every, ends)[:-1], strict=True))
        return parts, every[ends[-1] :].reshape(self.model.n, 10)

    def _triangles(self, coordinates: Array) -> Array:
        """Matrices E of the links, shape (n, 4, 4)."""
        triangles = np.zeros((self.model.n, 4, 4))
        for k, (i, j) in enumerate(LOWER):
            triangles[:, i, j] = 1.0 if i == j else coordinates[:, k]
        return triangles * (np.exp(coordinates[:, DIAGONAL]) / np.linalg.norm(triangles, axis=2))[:, :, None]

    def _bodies(self, coordinates: Array) -> Array:
        """Inertial parameters of the links, shape (n, 10)."""
        if self.deviations.bodies == 0.0:
            return self.mean.inertial
        factors = self._factors @ self._triangles(coordinates)
        return vector_from_pseudo_inertia(factors @ np.swapaxes(factors, 1, 2))

    def _body_slopes(self, coordinates: Array) -> Array:
        """Derivatives of the inertial parameters of each link by its coordinates, shape (n, 10, 10)."""
        triangles = self._triangles(coordinates)
        shrunk = triangles[:, range(4), range(4)] / np.exp(coordinates[:, DIAGONAL])  # 1 / length of (entries, 1)
        factors = self._factors @ triangles
        slopes = np.empty((self.model.n, 10, 10))
        for k, (i, j) in enumerate(LOWER):
            change = np.zeros_like(triangles)
            change[:, i] = triangles[:, i]
            if i != j:
                change[:, i] *= (-coordinates[:, k] * shrunk[:, i] ** 2)[:, None]
                change[:, i, j] += triangles[:, i, i]
            half = self._factors @ change @ np.swapaxes(factors, 1, 2)
            slopes[:, :, k] = vector_from_pseudo_inertia(half + np.swapaxes(half, 1, 2))
        return slopes


def _moves(value: Array) -> NDArray[np.bool_]:
    """Mask of the values that a factor changes: all but zero and infinity."""
    return (value > 0.0) & np.isfinite(value)
