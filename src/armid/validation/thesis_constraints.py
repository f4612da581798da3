"""Constraints (3.52) and (3.53) of the thesis on physical parameters, checked for each link.

These constraints are heuristic. In contrast to a positive definite pseudo-inertia, they do not guarantee that a body
with these parameters exists, and a published model of the arm violates some of them. Therefore they are reported, but
never enforced.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array, array

ROUNDING = 5e-4
"""Largest rounding error of values that are printed with three decimals."""

LONG_ALONG_Z = (1, 3, 5)
LONG_ALONG_Y = (2, 4)


@dataclass(frozen=True, slots=True)
class Constraint:
    """One constraint on one link, of the form value ≥ bound.

    Attributes:
        constraint: Number of the constraint in the thesis.
        link: Number of the link, from 1.
        value: Left-hand side of the constraint.
        bound: Right-hand side of the constraint.
        ok: True if the constraint holds.
        rounding: True if the constraint could hold for exact values that are rounded to the printed values.
    """

    constraint: str
    link: int
    value: float
    bound: float
    ok: bool
    rounding: bool


def thesis_constraints(mass: Array, inertia: Array, rounding: float = ROUNDING) -> tuple[Constraint, ...]:
    """Checks the constraints (3.52c), (3.52d) and (3.53a) to (3.53f) of the thesis.

    Args:
        mass: Masses, shape (n,) [kg].
        inertia: Inertia tensors about the centres of mass, shape (n, 3, 3) [kg·m²].
        rounding: Half of one unit of the last printed digit.
    """
    mass, inertia = array(mass, (None,), "mass"), array(inertia, (len(mass), 3, 3), "inertia")
    result: list[Constraint] = []
    for k in range(len(mass)):
        link = k + 1
        xx, yy, zz = np.diag(inertia[k])
        low, high = min(xx, yy, zz), max(xx, yy, zz)
        off = max(abs(inertia[k][0, 1]), abs(inertia[k][0, 2]), abs(inertia[k][1, 2]))
        checks = [
            ("(3.52c)", float(mass[k]), 0.0, 1.0),
            ("(3.52d)", float(np.linalg.eigvalsh(inertia[k])[0]), 0.0, 3.0),  # an entry each of three rows
            ("(3.53a)", low + (xx + yy + zz - low - high), high, 3.0),
            ("(3.53b)", 100.0 * low, high, 101.0),
            ("(3.53c)", 0.1 * abs(low), off, 1.1),
            ("(3.53d)", low, 1e-4, 1.0),
        ]
        if link in LONG_ALONG_Z:
            checks.append(("(3.53e)", min(xx, yy), 3.0 * zz, 4.0))
        if link in LONG_ALONG_Y:
            checks.append(("(3.53f)", min(xx, zz), 3.0 * yy, 4.0))
        for name, value, bound, weight in checks:
            strict = name in ("(3.52c)", "(3.52d)")
            ok = value > bound if strict else value >= bound
            result.append(
                Constraint(name, link, float(value), float(bound), bool(ok), bool(value >= bound - weight * rounding))
            )
    return tuple(result)
