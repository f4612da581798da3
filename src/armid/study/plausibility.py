"""Does what was measured look like the arm that the description tells of? Questions worth asking before any fit."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.estimation.fit import Fit
from armid.estimation.uncertainty import FEWEST_BLOCKS
from armid.information.information import Information, stack, total
from armid.maths.linalg import unit_columns
from armid.model.dynamics import DynamicsModel
from armid.robot import Robot
from armid.validation.doctor.excitation_weak import WEAK_CONDITION, hardly_told

__all__ = [
    "excitation_finding",
    "few_blocks_finding",
    "gravity_finding",
    "negative_finding",
]

STRONGEST_GRAVITY = 15.0
"""Accelerations above this are no gravity on any planet that arms stand on, but a slip of the pen [m/s²]."""

NAMED = 4


def excitation_finding(information: Information) -> Finding | None:
    """A motion that hardly tells some parameters apart, with their names, or `None`."""
    _, values, directions = np.linalg.svd(unit_columns(stack(total(information))[0])[0], full_matrices=False)
    condition = float(values[0] / values[-1])
    if condition <= WEAK_CONDITION:
        return None
    return Finding(
        "excitation-weak",
        "warning",
        "",
        hardly_told(information.names, directions[-1], condition),
        "record a motion that moves all joints together, fast and wide; on other motion the estimate may fail.",
    )


def gravity_finding(robot: Robot) -> Finding | None:
    """A gravity that no arm stands in, or `None`."""
    strength = float(np.linalg.norm(robot.gravity))
    if strength <= STRONGEST_GRAVITY:
        return None
    return Finding(
        "gravity-direction",
        "warning",
        "",
        f"Gravity is {strength:.4g} m/s².",
        "correct gravity: it is in m/s², for instance [0, 0, -9.81]",
    )


def few_blocks_finding(fit: Fit) -> Finding | None:
    """Intervals that take residuals as white without a test having said so, or `None`."""
    if fit.covariance_kind != "white" or fit.report.whiteness is not None:
        return None
    return Finding(
        "few-blocks",
        "warning",
        "",
        f"Fewer than {FEWEST_BLOCKS} blocks of rows: intervals take residuals as white and are too narrow.",
        "record longer.",
    )


def negative_finding(model: DynamicsModel, fit: Fit) -> Finding | None:
    """Friction or rotor inertia whose whole interval lies where physics forbids it, or `None`."""
    forbidden = {parameter.name for parameter in model.parameters if parameter.nonnegative}
    names = [
        name
        for name, (_, high) in zip(fit.names, fit.intervals, strict=True)
        if name.split("[", 1)[0] in forbidden and high < 0.0
    ]
    if not names:
        return None
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return Finding(
        "not-physical",
        "warning",
        "",
        f"No real arm has {', '.join(names[:NAMED])}{more}: negative with their whole intervals. The model lacks "
        "something that the motion shows, or the motion does not tell these parameters from others.",
        'use method = "physical" (--method physical), and look at what the report says is left.',
    )
