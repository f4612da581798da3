"""Gradients of distances of bodies against those that central differences find."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.limits.constraint_channels import States
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot.robot import Robot

RELATIVE = 1e-6
"""Largest relative error of a gradient."""

STEP = 1e-5
"""Of differences of fourth order; nearest points move by some 1e-5 m meanwhile."""

SMOOTH = 1e-7
"""Largest deviation [m] of nearest points from moving evenly within two steps either way. Their accelerations make it
1e-9 m; where they come to the end of a capsule or the edge of a box, and stay there, it is a share of 1e-5 m; where
they jump from one capsule, or one end of parallel ones, to another, it is millimetres."""

CORNERS = 2e-3
"""Share of pairs and samples that may be at such a place: nearest points rarely come to an end just then."""


def slopes_wrong(robot: Robot, start: Array, clearance: Clearance, size: float) -> tuple[list[str], float]:
    """Pairs whose gradient in any of 40 samples of a random series is not what differences say, and the share of
    pairs and samples without a smooth distance, which are not looked at.

    The distance of two capsules has a corner where their axes are parallel, and the points nearest to each other jump
    from end to end, or meet; that of bodies of several capsules or parts where another part becomes the nearest; and
    its second derivative jumps where a nearest point comes to an end or an edge, which differences feel. Everywhere
    else the law holds.

    Args:
        robot: The arm.
        start: Its pose, shape (n,).
        clearance: What is looked at.
        size: Of random coefficients [rad/s].
    """
    model = DynamicsModel(robot, (RigidBody(),))
    basis = SeriesBasis(1.0, 4, start)
    objective = Objective(CriterionGoal(model, find_base_parameters(model)), basis, 40)
    rng = np.random.default_rng(1)
    x, d = size * rng.normal(size=basis.unknowns), rng.normal(size=basis.unknowns)
    at = {k: States(objective, x + k * STEP * d) for k in (-2, -1, 0, 1, 2)}
    value = {k: clearance.values(states) for k, states in at.items()}
    slope = (8.0 * (value[1] - value[-1]) - (value[2] - value[-2])) / (12.0 * STEP)
    one = np.eye(len(slope))[:, :, None] * np.ones(slope.shape[1])
    found = np.array([clearance.pullback(at[0], weights) @ d for weights in one])
    points = {k: clearance.bodies.nearest(at[k].poses)[1:3] for k in (-2, 0, 2)}
    uneven = [points[2][side] - 2.0 * points[0][side] + points[-2][side] for side in (0, 1)]
    corner = np.linalg.norm(uneven, axis=-1).max(axis=0) > SMOOTH
    error = np.abs(found - slope) / np.maximum(np.abs(slope), 1.0)
    wrong = ((error > RELATIVE) & ~corner).any(axis=0)
    return [label for label, each in zip(clearance.labels, wrong, strict=True) if each], float(corner.mean())
