"""Information of fleets drawn row by row: joints with random columns, shared parameters, friction and offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.information.information import Information, JointFactors
from armid.kernel import factor_columns

SHARED = 6
"""Number of shared parameters; joint j depends on those from the j-th on."""

MEAN = (3.0, 2.0, 0.5)
"""Mean viscous friction, Coulomb friction and offset of each joint."""

SPREAD, SCALE_SPREAD = 0.15, 0.02
"""Standard deviations between units: own parameters, relative to the mean; torque scales."""


@dataclass(frozen=True, eq=False)
class DrawnFleet:
    """Information of each unit, mask of own parameters, true base parameters and torque scales of each unit."""

    units: dict[str, Information]
    own: NDArray[np.bool_]
    values: dict[str, Array]
    scale: dict[str, Array]


def drawn_fleet(
    count: int,
    seed: int,
    *,
    odd: tuple[int, str, float] | None = None,
    odd_body: tuple[int, int, float] | None = None,
    joints: int = 2,
    noise: float = 0.5,
    scale_spread: float = SCALE_SPREAD,
    rows: int = 20,
    blocks: int = 8,
) -> DrawnFleet:
    """A fleet; `odd` multiplies a parameter of one unit, `odd_body` adds to a shared parameter of one unit."""
    rng = np.random.default_rng(seed)
    names = [f"M_{k + 1}" for k in range(SHARED)]
    names += [f"{symbol}_{j + 1}" for j in range(joints) for symbol in ("FV", "FS", "FO")]
    mean = np.concatenate([rng.normal(0.0, 2.0, SHARED), np.tile(MEAN, joints)])
    fleet = DrawnFleet({}, np.arange(len(names)) >= SHARED, {}, {})
    for u in range(count):
        values = mean.copy()
        values[SHARED:] *= 1.0 + SPREAD * rng.standard_normal(3 * joints)
        if odd is not None and odd[0] == u:
            values[names.index(odd[1])] *= odd[2]
        if odd_body is not None and odd_body[0] == u:
            values[odd_body[1]] += odd_body[2]
        scale = 1.0 + scale_spread * rng.standard_normal(joints)
        factors: list[JointFactors] = []
        for j in range(joints):
            parameters = np.concatenate([np.arange(j, SHARED), SHARED + 3 * j + np.arange(3)])
            R: list[Array] = []
            for _ in range(blocks):
                X = rng.standard_normal((rows, len(parameters)))
                X[:, -2], X[:, -1] = np.sign(X[:, -3]), 1.0
                side = scale[j] * (X @ values[parameters]) + noise * rng.standard_normal(rows)
                R.append(factor_columns(np.ascontiguousarray(np.column_stack([X, side]).T))[0])
            factors.append(JointFactors(parameters.astype(np.int32), np.stack(R)))
        name = f"u{u:02d}"
        number = np.full((blocks, joints), rows)
        fleet.units[name] = Information(
            tuple(names),
            tuple(factors),
            number,
            np.zeros(blocks),
            np.zeros(blocks),  # pyright: ignore
        )
        fleet.values[name], fleet.scale[name] = values, scale
    return fleet
