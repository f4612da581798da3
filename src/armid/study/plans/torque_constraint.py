"""Constraint on the torque of a plan, and findings about the masses from which the torque is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import (
    Limits,
    torque_channel,
)
from armid.excitation.limits.torque_limits import EstimatedTorque, Torque, TorqueModel
from armid.excitation.start_pose import Holds, TorqueHolds, any_pose
from armid.model.base_parameters import find_base_parameters
from armid.model.described_torque import (
    DRIVE_TERMS,
    described_drives,
    described_torque,
    described_torque_text,
)
from armid.robot.missing_inertia import inertial_key, joints_with_unknown_load, links_without_inertia, massless_joints
from armid.robot.robot import Robot
from armid.study.plans.design_options import DesignConstraints

HELD = 0.9
"""Largest share of its torque limit that a joint may need to hold the arm in an automatically chosen start pose."""


def judged_torque(
    goal: CriterionGoal, limits: Limits, constraints: DesignConstraints
) -> tuple[Torque | None, tuple[Finding, ...]]:
    """Constraint channel of the torque limits, and findings about the masses with which the torque is computed."""
    if constraints.torque_margin is None:
        return None, ()
    unlimited = [limits.joints[j] for j in np.flatnonzero(~np.isfinite(limits.effort))]
    findings = () if not unlimited else (_unjudged(unlimited, goal.model.robot),)
    if len(unlimited) == len(limits.joints):
        return None, findings
    if (estimate := constraints.estimate) is not None:
        described, values = estimate.model, estimate.values
        findings = (*findings, Finding("torque-estimated", "info", "", _contained(estimate)))
    else:
        robot = goal.model.robot
        if unknown := [name for name in joints_with_unknown_load(robot) if name in limits.joints]:
            findings = (*findings, _unknown_load(unknown, robot))
            known = ~np.isin(limits.joints, unknown)
            limits = replace(limits, effort=np.where(known, limits.effort, np.inf))
            if not np.isfinite(limits.effort).any():
                return None, findings
        if stuck := _stuck_joints(robot, limits, constraints.torque_margin):
            findings = (*findings, _beyond_effort(stuck, constraints.torque_margin))
            limits = replace(limits, effort=np.where(np.isin(limits.joints, list(stuck)), np.inf, limits.effort))
            if not np.isfinite(limits.effort).any():
                return None, findings
        described, values = _described(robot)
        findings = (*findings, Finding("torque-nominal", "info", "", described_torque_text(robot)))
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
        return None, (_without_masses(goal.model.robot), *findings[: bool(unlimited)])
    return torque_channel(limits, values, constraints.torque_margin, described), findings


def _described(robot: Robot) -> tuple[TorqueModel | None, Array | None]:
    """Torque model and base parameters (b,) of the robot description; both `None` if it describes no inertia."""
    found = described_torque(robot)
    if found is None:
        return None, None
    model, standard = found
    base = find_base_parameters(model)
    return TorqueModel(model, base), base.values_of(standard)


def _contained(estimate: EstimatedTorque) -> str:
    """Sentence that names the estimate from which torque is computed, and its torque terms."""
    slipping = (
        "; hysteresis is that after a long motion in the same direction" if "hysteresis" in estimate.terms else ""
    )
    return f"torque is computed from {estimate.origin}, with all of its terms: {', '.join(estimate.terms)}{slipping}"


def torque_lacks(robot: Robot, constraints: DesignConstraints, torque: Torque | None) -> str:
    """Names of the contributions (friction, rotor inertia) that the torque of a design lacks; empty if complete.

    Args:
        robot: The arm.
        constraints: Constraints of a design; with `estimate`, torque contains all terms of this estimate.
        torque: Constraint channel of the torque limits; `None` if torque is not checked.
    """
    if torque is None or constraints.estimate is not None:
        return ""
    drives = described_drives(robot)
    missing = [name for term, (name, _) in DRIVE_TERMS.items() if not drives[term].any()]
    if {"viscous friction", "Coulomb friction"} <= set(missing):
        missing = ["friction", *(name for name in missing if "friction" not in name)]
    return " and ".join(missing)


def _stuck_joints(robot: Robot, limits: Limits, margin: float) -> dict[str, str]:
    """Joints whose described Coulomb friction exceeds the torque that a plan may use, with both values as text."""
    friction = described_drives(robot)["coulomb"]
    return {
        joint.name: f"{force:g} of {effort:g} {joint.effort_unit}"
        for joint, force, effort in zip(robot.joints, friction.tolist(), limits.effort.tolist(), strict=True)
        if force >= (1.0 - margin) * effort and force > 0.0
    }


def _beyond_effort(stuck: Mapping[str, str], margin: float) -> Finding:
    """Finding that the torque of joints is not checked, since friction alone needs all torque that a plan may use."""
    texts = ", ".join(f"{name} ({text})" for name, text in stuck.items())
    evidence = (
        f"the torque of {', '.join(stuck)} is not checked: in the description, Coulomb friction is at least as "
        f"large as the {100.0 * (1.0 - margin):.0f} % of the effort limit that a plan may use, so the joint could "
        f"not move: {texts}"
    )
    remedy = "give the real limit with --limit JOINT.effort=VALUE, or correct the friction in the description."
    return Finding("friction-beyond-effort", "warning", ", ".join(stuck), evidence, remedy)


def _unknown_load(joints: Sequence[str], robot: Robot) -> Finding:
    """Finding that the torque of joints is not checked because they move links of unknown mass."""
    links = ", ".join(robot.links[i].name for i in links_without_inertia(robot))
    evidence = (
        f"the torque of {', '.join(joints)} is not checked, because these joints move links whose mass is unknown: "
        f"{links}"
    )
    remedy = f"add {inertial_key(robot)} to these links, or give the folder of an identification run with --after."
    return Finding("torque-unknown", "warning", ", ".join(joints), evidence, remedy)


def _without_masses(robot: Robot) -> Finding:
    """Finding that no torque is checked, because no link of the description has an inertia that is known."""
    remedy = "give the folder of an identification run with --after."
    unknown = next((each for each in robot.findings if each.code == "inertial-missing"), None)
    why = f"the description of {robot.name} has no masses"
    if unknown is not None:
        why, remedy = unknown.evidence, f"{unknown.remedy}; or {remedy}"
    evidence = f"torque is not checked and not limited, because {why}"
    return Finding("torque-unknown", "warning", "" if unknown is None else unknown.channel, evidence, remedy)


def _unjudged(joints: Sequence[str], robot: Robot) -> Finding:
    """Finding that the torque of joints without an effort limit is not checked."""
    unchecked = "no torque is" if len(joints) == robot.n else f"the torque of {', '.join(joints)} is not"
    masses = ", and no mass is known" if len(massless_joints(robot)) == robot.n else ""
    evidence = f"{unchecked} checked, because no effort limit is given{masses}"
    return Finding("torque-unjudged", "info", "", evidence, "give the limit with --limit JOINT.effort=VALUE.")


def pose_holds(goal: CriterionGoal, torque: Torque | None) -> Holds:
    """Function that tests whether the joints can hold poses with at most the share `HELD` of their torque limits."""
    if torque is None:
        return any_pose

    def shares(q: Array) -> Array:
        return torque.along(goal, q, np.zeros_like(q), np.zeros_like(q))

    return TorqueHolds(torque.labels, shares, HELD)
