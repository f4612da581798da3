"""Estimated servos, friction and rotor inertias with intervals, and what shows each of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.servo.identify_servo import ServoEstimate
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import LOGARITHMIC

NORMAL_95 = 1.959963984540054
"""Half width of a 95 % interval in standard deviations."""

IDENTIFIED = 0.9
"""Share of the information from the data from which a parameter counts as identified."""

HARDLY_SEEN = 0.3
"""Share of the information from the data up to which a parameter counts as not identifiable: its interval is at least
0.84 times as wide as that of the prior."""

NARROW = 1.5
"""Factor within which the 95 % interval of an identified positive parameter lies. A wide prior leaves much room, so a
share of the information says little by itself."""

Origin = Literal["identified", "weakly identified", "prior-dominated", "not identifiable", "given"]


@dataclass(frozen=True, slots=True)
class EstimatedValue:
    """One estimated parameter.

    Attributes:
        kind: Field of `ServoParameters`, or the symbol of a friction law.
        joint: Index of the joint.
        value: Value in SI units.
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
        information: Share of the information from the data, 0 to 1; NaN for a given value.
        origin: Where the value comes from.
        reason: Why the data do not show it; empty if they do.
    """

    kind: str
    joint: int
    value: float
    low: float
    high: float
    information: float
    origin: Origin
    reason: str = ""


def estimated_values(estimate: ServoEstimate, runs: list[ServoRun]) -> list[EstimatedValue]:
    """Every gain, friction parameter, rotor inertia, offset and delay, joint by joint.

    Intervals contain prior and residuals, with the correlation of the residuals.
    """
    names, deviation = estimate.unknowns.names(), np.sqrt(np.diag(estimate.fit.covariance))
    load = _load_ranges(estimate, runs)
    sliding = [joint.is_prismatic for joint in estimate.model.robot.joints]
    found: list[EstimatedValue] = []
    fields = ("stiffness", "damping", "limit", "rotor_inertia", "friction", "offset", "delay")
    for field in fields:
        values: Array = getattr(estimate.parameters, field)
        for k, value in enumerate(values):
            law = estimate.model.laws[k] if field == "friction" else None
            joint, kind = (k, field) if law is None else (law.joint, law.symbol)
            if (field, k) not in names:
                if value != 0.0 and np.isfinite(value):
                    found.append(EstimatedValue(kind, joint, value, value, value, np.nan, "given"))
                continue
            at = names.index((field, k))
            half = NORMAL_95 * deviation[at]
            ends = (
                (value * np.exp(-half), value * np.exp(half))
                if field in LOGARITHMIC
                else (value - half, value + half)
            )
            share = float(estimate.fit.information[at])
            stated = float(estimate.unknowns.mean.limit[joint]) if field == "limit" else np.nan
            if share <= HARDLY_SEEN and stated == estimate.model.robot.joints[joint].effort_limit:
                # The servo never reached it, so this is what the description states.
                found.append(EstimatedValue(kind, joint, stated, stated, stated, np.nan, "given"))
                continue
            origin = _origin(share, narrow=field not in LOGARITHMIC or half <= np.log(NARROW))
            reason = "" if origin.endswith("identified") else _reason(field, load[joint], sliding[joint])
            low, high = float(ends[0]), float(ends[1])
            found.append(EstimatedValue(kind, joint, float(value), low, high, share, origin, reason))
    return sorted(found, key=lambda each: each.joint)


def _origin(share: float, *, narrow: bool) -> Origin:
    if share >= IDENTIFIED:
        return "identified" if narrow else "weakly identified"
    return "not identifiable" if share <= HARDLY_SEEN else "prior-dominated"


def _load_ranges(estimate: ServoEstimate, runs: list[ServoRun]) -> Array:
    """Range of the gravity torque of each joint over the runs, shape (n,) [N·m or N]."""
    torque = [kernel.gravity_torque(estimate.model.robot.tree, estimate.parameters.inertial, run.q) for run in runs]
    return np.ptp(np.concatenate(torque), axis=0)


def _reason(field: str, load: float, sliding: bool) -> str:
    """Reason for which recordings do not show a parameter of a joint whose gravity torque changes by `load`."""
    if field == "offset":
        return "an offset and a constant load have the same effect"
    if field == "limit":
        return "the servo hardly reached its largest torque"
    if field == "delay":
        return "the motion is too slow or too small to show a delay"
    unit = "N" if sliding else "N·m"
    scale = (
        f"only a known load shows the scale of torques, and gravity changes that of this joint by {load:.3g} {unit}"
    )
    return scale if field == "stiffness" else f"its ratio to the stiffness may be known, but {scale}"
