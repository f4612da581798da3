"""Catalogue `CHECKS` of the doctor: a new check is a new file and one line here."""

from __future__ import annotations

from armid.doctor.check_definition import LogCheck
from armid.lazy_catalogue import Catalogue

CHECKS: Catalogue[LogCheck] = Catalogue(
    {
        "reading-findings": "armid.doctor.checks.signals.reading_findings:CHECK",
        "clock": "armid.doctor.checks.signals.clock:CHECK",
        "rows-not-consecutive": "armid.doctor.checks.signals.rows_not_consecutive:CHECK",
        "channel-dead": "armid.doctor.checks.signals.channel_dead:CHECK",
        "channel-coarse": "armid.doctor.checks.signals.channel_coarse:CHECK",
        "saturation": "armid.doctor.checks.signals.saturation:CHECK",
        "filtered-before-logging": "armid.doctor.checks.signals.filtered_before_logging:CHECK",
        "velocity-mismatch": "armid.doctor.checks.signals.velocity_mismatch:CHECK",
        "period-misaligned": "armid.doctor.checks.signals.period_misaligned:CHECK",
        "motor-side": "armid.doctor.checks.signals.motor_side:CHECK",
        "command-copied": "armid.doctor.checks.servos.command_copied:CHECK",
        "command-order": "armid.doctor.checks.servos.command_order:CHECK",
        "command-exchanged": "armid.doctor.checks.servos.command_exchanged:CHECK",
        "command-units": "armid.doctor.checks.servos.command_units:CHECK",
        "command-delay": "armid.doctor.checks.servos.command_delay:CHECK",
        "servo-dead": "armid.doctor.checks.servos.servo_dead:CHECK",
        "effort-unsigned": "armid.doctor.checks.servos.effort_unsigned:CHECK",
        "degrees": "armid.doctor.checks.signals.degrees:CHECK",
        "position-limits": "armid.doctor.checks.signals.position_limits:CHECK",
        "torque-sign": "armid.doctor.checks.dynamics.torque_sign:CHECK",
        "position-sign": "armid.doctor.checks.dynamics.position_sign:CHECK",
        "joint-order": "armid.doctor.checks.dynamics.joint_order:CHECK",
        "effort-without-gravity": "armid.doctor.checks.servos.effort_without_gravity:CHECK",
        "gravity-direction": "armid.doctor.checks.dynamics.gravity_direction:CHECK",
        "time-scale": "armid.doctor.checks.dynamics.time_scale:CHECK",
        "channel-delay": "armid.doctor.checks.dynamics.channel_delay:CHECK",
        "joint-delay": "armid.doctor.checks.dynamics.joint_delay:CHECK",
        "position-offset": "armid.doctor.checks.dynamics.position_offset:CHECK",
        "cross-talk": "armid.doctor.checks.residuals.cross_talk:CHECK",
        "torque-gain": "armid.doctor.checks.dynamics.torque_gain:CHECK",
        "description-does-not-match": "armid.doctor.checks.dynamics.description_does_not_match:CHECK",
        "rotor-inertia-missing": "armid.doctor.checks.dynamics.rotor_inertia_missing:CHECK",
        "excitation-weak": "armid.doctor.checks.dynamics.excitation_weak:CHECK",
        "temperature-drift": "armid.doctor.checks.dynamics.temperature_drift:CHECK",
        "friction-negative": "armid.doctor.checks.residuals.friction_negative:CHECK",
        "unmodelled-torque": "armid.doctor.checks.residuals.unmodelled_torque:CHECK",
        "contact": "armid.doctor.checks.dynamics.contact:CHECK",
        "changes-midway": "armid.doctor.checks.dynamics.changes_midway:CHECK",
    }
)
"""Checks by name, which is that of the module. Checks of the log alone come before checks that need a model. If two
faults explain a misfit of the model equally well, the first one in this order is reported."""
