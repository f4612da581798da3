"""Check that passes on findings of the readers of the recording and of the description."""

from __future__ import annotations

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding

EFFECTS = {
    "position-wrapped": "Differences across the jumps would give velocities of hundreds of rad/s, so the positions "
    "are unwrapped.",
    "clock-missing": "Velocities and accelerations, and all parameters that depend on them, have no scale.",
    "columns-guessed": "If the columns are wrong, the estimate is useless; check their names.",
    "units-of-header": "No effect if the units in the column names are right. In a study, the lines of the remedy "
    "state these units.",
    "units-guessed": "No effect if the positions are degrees: normalised positions cannot be larger than 100.",
    "clock-received": "Jitter of the network and the recorder becomes noise of velocity and acceleration.",
    "joints-extra": "No effect: channels of joints that the model does not have are not used.",
    "joints-merged": "Interpolated values are smoother than measured values, and they are shifted by a fraction of a "
    "step.",
    "locked-joint": "Gravity torques and inertias of all links that the joint carries are computed at a wrong pose.",
    "clock-unit": "Velocities and accelerations are too small by powers of a thousand.",
    "clock-rate": "Velocities and accelerations are too large or too small by the ratio of the two rates.",
    "row-incomplete": "No effect, but one sample is missing at the end.",
    "rate-reduced": "No effect in the band of the estimation: samples above it only cost time and memory.",
    "rows-repeated": "Velocity would be zero at every repeated row; these rows are excluded.",
    "rows-not-consecutive": "Nothing can be filtered or differentiated, and terms with hysteresis cannot be used.",
    "effort-missing": "Without torque or current, only `armid servo` identifies an arm, from its commands.",
    "command-incomplete": "No effect on results from the effort; the command cannot be used.",
    "command-still": "A joint that only holds its position shows neither its inertia nor its friction.",
    "command-held": "A command that is held longer than a sample is late by up to that time.",
    "switched-off": "No harm: these states are left out, because no command acts on a drive that is switched off.",
    "command-possible": "The command cannot be used until its columns are named; nothing else changes.",
    "value-missing": "Nothing can be computed from a recording with missing values.",
    "description-rounded": "Angles that miss a multiple of 15° by rounding only would add base parameters that the "
    "real arm does not have.",
    "topic-chosen": "No effect: the other topics contain no joints of the arm, or they are commands.",
    "rests-left-out": "No harm: static friction at rest is unknown, so these rows are left out; all other rows are "
    "used.",
    "sticking": "At rest, static friction can have any value up to its bound, so no function of the velocity "
    "describes it.",
    "spikes": "A filter would spread each spike over the rows around it; single zeros among positions can make the "
    "error of an estimate forty times as large. These samples are left out.",
    "standstill": "At standstill, static friction can have any value up to its bound, which can bias the estimate.",
}
"""Effects on an estimate, by code, of the faults that only readers find."""

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
"""Codes of findings of the readers that belong to other checks. Findings about processing are not listed, because
the doctor checks processing itself."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports each finding of the readers once, if its code is in `EFFECTS` or in `OF_OTHERS`."""
    return list(dict.fromkeys(finding for finding in evidence.noted if finding.code in {*EFFECTS, *OF_OTHERS}))


CHECK = LogCheck(
    look=check,
    scope="command",
    effects=EFFECTS,
    untested={
        "clock-missing": "without the remedy, the log cannot be read",
        "clock-unit": "without the remedy, the log cannot be read",
        "clock-rate": "without the remedy, the log cannot be read",
        "row-incomplete": "the row is left out already",
        "rows-not-consecutive": "no motion can be left out if rows are not consecutive",
        "value-missing": "without the remedy, the log cannot be read",
        "spikes": "the samples are left out already",
        "standstill": "rows at rest contribute little to the error",
    },
)
