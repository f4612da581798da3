"""The doctor: what is wrong with a log, before anyone trusts it.

`CHECKS` is the catalogue: a new check is a new file and one line here. A check looks at the evidence and says what
it found, with numbers; it repairs nothing. Those that `explain` take part in a contest: each says how much less a
model would leave of the torque if its fault were the log's, the best is believed, and the rest look at the log
without it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

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
from armid.doctor.remedy_trial import needs_reason
from armid.errors import Finding

__all__ = ["CHECKS", "EFFECTS", "EXPLAINS", "FOLLOW", "SEVERITIES", "LogEvidence", "examine"]

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
"""What takes part in the contest."""

SEVERITIES = ("error", "warning", "info")
"""Worst first."""

FOLLOW: dict[str, tuple[str, ...]] = {
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
"""What a model says of a log because of another fault that is known: it is not said twice."""


def _with_reason(finding: Finding) -> Finding:
    """The finding, and why its remedy was not tried where that is so."""
    reason = needs_reason(finding.code, finding.evidence, finding.remedy)
    return replace(finding, evidence=finding.evidence + reason) if reason else finding


def examine(evidence: LogEvidence, checks: Collection[str] = tuple(CHECKS)) -> tuple[Finding, ...]:
    """All findings of some checks on a log, errors first, each said once."""
    found = [_with_reason(f) for name, check in CHECKS.items() if name in checks for f in check(evidence)]
    known = {code for f in found if f.severity != "info" for code in FOLLOW.get(f.code, ())}
    noted = {_with_reason(f) for f in evidence.noted}
    kept = [f for f in dict.fromkeys(found) if f.code not in known or f in noted]
    return tuple(sorted(kept, key=lambda f: SEVERITIES.index(f.severity)))
