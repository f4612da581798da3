"""A motion that hardly tells some parameters apart: which, and what to move."""

from __future__ import annotations

from typing import Literal

import numpy as np

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import LogState
from armid.doctor.quick_fit import products
from armid.errors import Finding
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.terms import RotorInertia
from armid.robot import Robot
from armid.values import Array

__all__ = ["WEAK_CONDITION", "check", "excitation_severity", "poorly_determined"]

WEAK_CONDITION = 100.0
"""Condition number with columns of unit length above which an estimate holds for the motion that it was made from
and hardly for another: well recorded arms have 8 to 42, those whose estimates fail elsewhere 200 and more."""

POOR_CONDITION = 500.0
"""The same from which it is a warning: motions drawn at random, joints all moving, have up to 400."""

COMPUTED = 1e7
"""Condition number beyond which it is rounding: products of columns lose it from the root of ε on."""

TIMID = 0.25
"""Share of its largest speed that no joint reaches in a motion too slow for inertias to show beside friction."""

NAMED = 4

LITTLE = 0.35
"""Share of a joint's range or speed below which there is room to move it more."""


def check(evidence: LogEvidence) -> list[Finding]:
    """One finding with the parameters that are hardest to tell apart."""
    state = evidence.understood
    if state is None:
        return _too_short(evidence)
    model = evidence.model
    if model is None:
        model = DynamicsModel(evidence.robot, tuple(t for t in state.model.terms if not isinstance(t, RotorInertia)))
    if model.nodes:
        return []
    own = LogState(model, find_base_parameters(model), state.log)
    names, rows = own.base.names, own.rows
    G = np.zeros((rows.count, rows.count))
    for j, P in enumerate(products(rows)):
        G[np.ix_(rows.parameters[j], rows.parameters[j])] += P[:-1, :-1]
    scale = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    powers, directions = np.linalg.eigh(G / np.outer(scale, scale))
    condition = float(np.sqrt(powers[-1] / max(powers[0], 1e-18 * powers[-1])))
    if condition <= WEAK_CONDITION:
        return []
    return [
        Finding(
            "excitation-weak",
            excitation_severity(condition, own.model.robot, np.abs(own.rows.motion.dq).max(axis=0)),
            "",
            poorly_determined(names, directions[:, 0], condition),
            _advice(own),
        )
    ]


def poorly_determined(names: tuple[str, ...], direction: Array, condition: float) -> str:
    """That a condition number is too large, with the parameters (b,) that its weakest direction is made of."""
    worst = ", ".join(names[k] for k in np.argsort(-np.abs(direction))[:NAMED])
    if condition > COMPUTED:
        return f"The motion does not tell {worst} apart at all, as far as numbers can show."
    return (
        f"The motion hardly tells {worst} apart (condition number {condition:.0f} with columns of unit length, where "
        f"{WEAK_CONDITION:.0f} is much)."
    )


def _too_short(evidence: LogEvidence) -> list[Finding]:
    """One finding where there is no model to look at, because there is too little of the log."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    return [
        Finding(
            "excitation-weak",
            "warning",
            "",
            f"{recording.samples} samples, {recording.samples / evidence.rate:.3g} s, are too little to compare with "
            "a model; signs, order, zeros, gravity and delays were not looked at.",
            "record longer, at 20 Hz or more",
        )
    ]


def excitation_severity(condition: float, robot: Robot, fastest: Array) -> Literal["warning", "info"]:
    """Severity of a weak excitation: a warning where it is poor, or every joint stays slow.

    Args:
        condition: Condition number with columns of unit length.
        robot: The arm.
        fastest: Largest speed of each joint, shape (n,) [rad/s or m/s].
    """
    limits = np.array([joint.velocity_limit for joint in robot.joints])
    known = np.isfinite(limits) & (limits > 0.0)
    timid = bool(known.all() and (fastest < TIMID * limits).all())
    return "warning" if condition > POOR_CONDITION or timid else "info"


def _advice(state: LogState) -> str:
    """Tell which joints have room to move more."""
    motion, parts = state.rows.motion, []
    for j, joint in enumerate(state.model.robot.joints):
        low, high = joint.position_limits
        span, speed = float(np.ptp(motion.q[:, j])), float(np.abs(motion.dq[:, j]).max())
        room = min(high - low, 2 * np.pi) if np.isfinite(high - low) else 2 * np.pi
        narrow = span < LITTLE * room
        slow = 0.0 < joint.velocity_limit < np.inf and speed < LITTLE * joint.velocity_limit
        if narrow and slow:
            parts.append(f"{joint.name} wider than {span:.2g} and faster than {speed:.2g} {joint.unit}/s")
        elif narrow or slow:
            parts.append(
                f"{joint.name} {'wider than' if narrow else 'faster than'} "
                f"{span if narrow else speed:.2g} {joint.unit}{'' if narrow else '/s'}"
            )
    moves = "; ".join(parts) if parts else "all joints together, fast and wide"
    return f"record another motion, as armid excite designs it; move {moves}"
