"""Ellipsoids of uniform density with the mass and inertia of each link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.maths.inertia import vector_to_com_inertia
from armid.robot.robot import Robot

LIGHTEST = 1e-4
"""Mass below which a link counts as massless [kg]."""


@dataclass(frozen=True, eq=False, slots=True)
class MassLayer:
    """Inertias of all links from one source.

    Attributes:
        name: Name of the source on the page.
        links: Ten inertial parameters of each link in its frame, shape (n, 10).
        note: Remark on the values.
    """

    name: str
    links: Array
    note: str = ""

    def record(self, names: Sequence[str]) -> dict[str, Any]:
        """JSON object of this layer for the script of the page; links without mass are left out."""
        bodies: list[dict[str, Any]] = []
        for k, (vector, name) in enumerate(zip(self.links, names, strict=True)):
            if not vector[0] > LIGHTEST:
                continue
            ellipsoid = ellipsoid_of(vector)
            body = {"link": k, "name": name, "mass": float(vector[0]), "com": (vector[1:4] / vector[0]).tolist()}
            if ellipsoid is not None:
                body |= {"axes": ellipsoid[0].tolist(), "turn": ellipsoid[1].T.ravel().tolist()}
            bodies.append(body)
        return {"name": self.name, "note": self.note, "bodies": bodies}


def layer_of_description(robot: Robot) -> MassLayer | None:
    """Layer of the inertias of the description; `None` if the description has no inertias."""
    vector = robot.inertial_vector
    return None if vector is None else MassLayer("description", vector)


def ellipsoid_of(vector: Array) -> tuple[Array, Array] | None:
    """Ellipsoid of uniform density with the mass and inertia of a link.

    For the mass m and the half axes a_i, a_j and a_k, the moment of inertia about the axis i is m (a_j² + a_k²) / 5.

    Returns:
        Half axes, shape (3,) [m], and their directions, the columns of a matrix (3, 3); `None` if no body can have
        this inertia.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        mass, _, about = vector_to_com_inertia(vector)
        if not mass > 0.0 or not np.isfinite(about).all():
            return None
        inertia, turn = np.linalg.eigh(about)
        squares = 2.5 / mass * (inertia.sum() - 2.0 * inertia)
    if not np.isfinite(squares).all() or (squares < -1e-9 * abs(squares).max()).any():
        return None
    if np.linalg.det(turn) < 0.0:
        turn[:, 0] *= -1.0
    return np.sqrt(np.maximum(squares, 0.0)), turn
