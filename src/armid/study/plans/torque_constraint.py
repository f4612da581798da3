"""Constraint on the torque of a plan, and findings on the masses that it is computed with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.limits.joint_limits import (
    Limits,
    torque_channel,
)
from armid.excitation.limits.torque_limits import Torque
from armid.excitation.start_pose import Holds, TorqueHolds, any_pose
from armid.model.dynamics import DynamicsModel
from armid.robot.missing_inertia import inertial_key, joints_with_unknown_load, links_without_inertia, massless_joints
from armid.robot.robot import Robot
from armid.study.plans.goals import DesignConstraints
from armid.values import Array

HELD = 0.9
"""Largest share of the torque limits that is needed to hold the arm in an automatically chosen start pose."""


def judged_torque(
    goal: CriterionGoal, limits: Limits, constraints: DesignConstraints
) -> tuple[Torque | None, tuple[Finding, ...]]:
    """Constraint on torque, with findings about the masses with which torque is computed."""
    if constraints.torque_margin is None:
        return None, ()
    unlimited = [limits.joints[j] for j in np.flatnonzero(~np.isfinite(limits.effort))]
    values, findings = constraints.parameters, (() if not unlimited else (_unjudged(unlimited, goal.model.robot),))
    if len(unlimited) == len(limits.joints):
        return None, findings
    if values is None:
        robot = goal.model.robot
        if unknown := [name for name in joints_with_unknown_load(robot) if name in limits.joints]:
            findings = (*findings, _unknown_load(unknown, robot))
            known = ~np.isin(limits.joints, unknown)
            limits = replace(limits, effort=np.where(known, limits.effort, np.inf))
            if not np.isfinite(limits.effort).any():
                return None, findings
        nominal = _described(goal.model)
        values = None if nominal is None or not nominal.any() else goal.base.values_of(nominal)
        evidence = "torque is computed from the masses and inertias of the description, without friction"
        findings = (*findings, Finding("torque-nominal", "info", "", evidence))
        limited = [name for name, limit in zip(limits.joints, limits.effort, strict=True) if np.isfinite(limit)]
        if values is not None and (empty := [name for name in massless_joints(robot) if name in limited]):
            evidence = (
                f"in the description, the links that {', '.join(empty)} move have no mass, so the torque of these "
                "joints is assumed to be zero"
            )
            remedy = (
                f"add {inertial_key(robot)} to the links that they move, or give the folder of an identification "
                "run with --after."
            )
            findings = (*findings, Finding("torque-unknown", "warning", ", ".join(empty), evidence, remedy))
    if values is None:
        evidence = (
            f"torque is not checked and not limited, because the description of {goal.model.robot.name} has no masses"
        )
        remedy = "give the folder of an identification run with --after."
        return None, (Finding("torque-unknown", "warning", "", evidence, remedy), *findings[: bool(unlimited)])
    return torque_channel(limits, values, constraints.torque_margin), findings


def _described(model: DynamicsModel) -> Array | None:
    """Standard parameters (p,) with the inertial parameters that the description gives; `None` if it gives none."""
    inertial = model.robot.inertial_vector
    if inertial is None or not model.has_rigid_bodies:
        return None
    theta = np.zeros(len(model.parameters))
    theta[model.inertial_columns] = inertial.ravel()
    return theta


def _unknown_load(joints: Sequence[str], robot: Robot) -> Finding:
    """Finding that the torque of joints is not checked because they move links of unknown mass."""
    links = ", ".join(robot.links[i].name for i in links_without_inertia(robot))
    evidence = (
        f"the torque of {', '.join(joints)} is not checked, because these joints move links whose mass is unknown: "
        f"{links}"
    )
    remedy = f"add {inertial_key(robot)} to these links, or give the folder of an identification run with --after."
    return Finding("torque-unknown", "warning", ", ".join(joints), evidence, remedy)


def _unjudged(joints: Sequence[str], robot: Robot) -> Finding:
    """Finding that the torque of joints without an effort limit is not checked."""
    which = "any joint" if len(joints) == robot.n else ", ".join(joints)
    masses = ", and no mass is known" if len(massless_joints(robot)) == robot.n else ""
    evidence = f"the torque of {which} is not checked, because no effort limit is given{masses}"
    return Finding("torque-unjudged", "info", "", evidence, "give the limit with --limit JOINT.effort=VALUE.")


def pose_holds(goal: CriterionGoal, torque: Torque | None) -> Holds:
    """Test whether the joints can hold a pose with a reserve of torque."""
    if torque is None:
        return any_pose

    def shares(q: Array) -> Array:
        columns = Columns(goal.source, len(q))
        columns.fill(q, np.zeros_like(q), np.zeros_like(q))
        return np.abs(columns.torque(torque.base)[:, torque.joints]) / torque.limit

    return TorqueHolds(torque.labels, shares, HELD)
