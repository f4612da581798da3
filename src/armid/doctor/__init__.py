"""The doctor: checks of a log for faults before an estimate is made from it.

`CHECKS` is the catalogue: a new check is a new file and one line here. A check examines the evidence and returns
findings with numbers; it repairs nothing. Checks that can `explain` a misfit compete: each computes by how much the
residual falls once its fault is corrected. The best explanation is accepted, and the others are then tried on the
corrected log.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from armid.doctor.checks.dynamics import (
    channel_delay,
    contact,
    excitation_weak,
    gravity_direction,
    joint_order,
    position_offset,
    position_sign,
    rotor_inertia_missing,
    temperature_drift,
    torque_sign,
)
from armid.doctor.checks.signals import (
    channel_dead,
    clock,
    degrees,
    filtered_before_logging,
    motor_side,
    period_misaligned,
    reading_findings,
    saturation,
    velocity_mismatch,
)
from armid.doctor.effects import EFFECTS
from armid.doctor.evidence import Explain, LogEvidence
from armid.doctor.remedy_trial import with_reason
from armid.errors import Finding

__all__ = ["CHECKS", "CONSEQUENCES", "EFFECTS", "EXPLAINS", "SEVERITIES", "LogEvidence", "examine"]

Check = Callable[[LogEvidence], list[Finding]]

CHECKS: dict[str, Check] = {
    "reading-findings": reading_findings.check,
    "clock": clock.check,
    "channel-dead": channel_dead.check,
    "saturation": saturation.check,
    "filtered-before-logging": filtered_before_logging.check,
    "velocity-mismatch": velocity_mismatch.check,
    "period-misaligned": period_misaligned.check,
    "motor-side": motor_side.check,
    "degrees": degrees.check,
    "torque-sign": torque_sign.check,
    "position-sign": position_sign.check,
    "joint-order": joint_order.check,
    "gravity-direction": gravity_direction.check,
    "channel-delay": channel_delay.check,
    "position-offset": position_offset.check,
    "rotor-inertia-missing": rotor_inertia_missing.check,
    "excitation-weak": excitation_weak.check,
    "temperature-drift": temperature_drift.check,
    "contact": contact.check,
}
"""Checks by the name of their file, those of the log itself before those that need a model."""

EXPLAINS: tuple[Explain, ...] = (
    motor_side.explain,
    degrees.explain,
    torque_sign.explain,
    position_sign.explain,
    joint_order.explain,
    gravity_direction.explain,
    channel_delay.explain,
    position_offset.explain,
    contact.explain,
)
"""Explanations that compete."""

SEVERITIES = ("error", "warning", "info")
"""Severities of findings, worst first."""

CONSEQUENCES: dict[str, tuple[str, ...]] = {
    "channel-dead": (
        "contact",
        "temperature-drift",
        "excitation-weak",
        "rotor-inertia-missing",
        "channel-delay",
        "position-offset",
        "velocity-mismatch",
        "period-misaligned",
    ),
    "joint-order": ("saturation", "velocity-mismatch"),
    "motor-side": ("saturation",),
    "saturation": ("contact", "temperature-drift"),
    "period-misaligned": ("contact", "velocity-mismatch", "rotor-inertia-missing", "temperature-drift"),
}
"""By code: findings that follow from that fault and are therefore not reported beside it."""


def examine(evidence: LogEvidence, checks: Collection[str] = tuple(CHECKS)) -> tuple[Finding, ...]:
    """Runs checks on a log and returns their findings, errors first, each once."""
    found = [with_reason(f) for name, check in CHECKS.items() if name in checks for f in check(evidence)]
    known = {code for f in found if f.severity != "info" for code in CONSEQUENCES.get(f.code, ())}
    noted = {with_reason(f) for f in evidence.noted}
    reported = [f for f in dict.fromkeys(found) if f.code not in known or f in noted]
    return tuple(sorted(reported, key=lambda f: SEVERITIES.index(f.severity)))
