"""Findings that the readers of recording and description have made already."""

from __future__ import annotations

from armid.doctor.check_input import LogEvidence
from armid.doctor.log_check import LogCheck
from armid.errors import Finding

EFFECTS = {
    "position-wrapped": "Differences across the jumps would be velocities of hundreds of rad/s; they are unwrapped.",
    "clock-missing": "Velocities and accelerations, and all parameters that depend on them, have no scale.",
    "columns-guessed": "With wrong columns the estimate is useless: check the names.",
    "units-of-header": "No effect if the names are right. In a study, these lines state the same units.",
    "clock-received": "Jitter of network and recorder becomes noise of velocity and acceleration.",
    "joints-extra": "None: channels of joints that the model does not have are not used.",
    "joints-merged": "Interpolated values are smoother than measured ones, and shifted by a fraction of a step.",
    "locked-joint": "Gravity torques and inertias of all links that it carries are computed at a wrong pose.",
    "clock-unit": "Velocities and accelerations are too small by powers of a thousand.",
    "clock-rate": "Velocities and accelerations are too large or too small by the ratio of the two rates.",
    "rows-repeated": "Velocity would be zero at every repeated row; these rows are excluded.",
    "rows-not-consecutive": "Nothing can be filtered or differentiated, and terms with hysteresis cannot be used.",
    "effort-missing": "Without torque or current there is nothing to identify.",
    "value-missing": "Nothing can be computed from it.",
    "description-rounded": "Without the rounding to multiples of 15° there would be spurious base parameters.",
    "topic-chosen": "None: the others have no joints of the arm, or are commands.",
    "rests-left-out": "None: friction at rest is any torque up to its bound, and the rows beside the rest remain.",
    "sticking": "No law of the velocity describes dry friction at rest, which is any torque up to its bound.",
    "standstill": "At standstill, static friction and gravity cannot be separated, yet such rows have full weight.",
}
"""By code of findings that readers alone make: effect of the fault on an estimate."""

OF_OTHERS = (
    "clock-gap",
    "clock-jitter",
    "channel-dead",
    "current-without-gain",
    "degrees",
    "gravity-direction",
    "motor-side",
    "position-offset",
)
"""Codes of readers that other checks have, too; further ones are about processing, which the doctor checks itself."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the findings of these codes, each once."""
    return list(dict.fromkeys(finding for finding in evidence.noted if finding.code in {*EFFECTS, *OF_OTHERS}))


CHECK = LogCheck(
    look=check,
    scope="command",
    effects=EFFECTS,
    untested={
        "clock-missing": "without it the log cannot be read",
        "clock-unit": "without it the log cannot be read",
        "clock-rate": "without it the log cannot be read",
        "rows-not-consecutive": "rows that do not follow each other leave no motion out",
        "value-missing": "without it the log cannot be read",
        "standstill": "rows at rest are little of any error",
    },
)
