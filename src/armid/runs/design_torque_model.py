"""Torque model of a run, for the torque limits in the design of a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.estimation.estimate_record import torque_parameters
from armid.excitation.limits.torque_limits import EstimatedTorque, TorqueModel
from armid.kernel import Tree
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.memoryless_model import slipping
from armid.robot.robot import Robot
from armid.runs.run import Run

SAME = 1e-6
"""Largest difference of placements [m], joint axes and coefficients with which the geometries of two arms count as
equal. It is not zero, because numbers in files are rounded."""


def estimated_torque(run: Run, robot: Robot) -> EstimatedTorque | None:
    """Torque model of a run with all of its terms, for an arm whose gravity may differ from that of the run.

    Hysteresis depends on the earlier motion. In this model, the elements of hysteresis always slip
    (`armid.model.memoryless_model`).

    Args:
        run: The run.
        robot: The arm.

    Returns:
        Model and values; `None` if the arm of the run has another geometry, or if the run has not determined all
        parameters on which the torque under this gravity depends.
    """
    if not _same_geometry(run.robot.tree, robot.tree):
        return None
    model, known = replace(run.model, robot=robot), run.estimate.base
    base = find_base_parameters(model)
    if not _same_parameters(base, known):
        return None
    values = base.values_of(torque_parameters(known, run.estimate.fit))
    terms = tuple(dict.fromkeys(term.name for term in model.terms))
    return EstimatedTorque(TorqueModel(slipping(model), base), values, f"the run {run.folder}", terms)


def model_with_terms_of(run: Run, robot: Robot) -> DynamicsModel | None:
    """Model of an arm with the terms of a run; `None` if the arm of the run has another geometry.

    Hysteresis elements always slip in the model, as in `estimated_torque`.

    Args:
        run: The run.
        robot: The arm, whose gravity may differ from that of the run.
    """
    return slipping(replace(run.model, robot=robot)) if _same_geometry(run.robot.tree, robot.tree) else None


def _same_geometry(one: Tree, other: Tree) -> bool:
    """True if two arms have the same joints at the same places; gravity may differ."""
    return one.n == other.n and all(
        np.allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=SAME)
        for name in ("parent", "prismatic", "axis", "rotation", "translation")
    )


def _same_parameters(one: BaseParameters, other: BaseParameters) -> bool:
    """True if two sets of base parameters are the same sums of the same standard parameters."""
    return one.names == other.names and np.allclose(one.regrouping, other.regrouping, rtol=0.0, atol=SAME)
