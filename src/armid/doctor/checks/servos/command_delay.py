"""Check for a large or changing delay of commands."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.command_response import CommandResponse
from armid.errors import Finding
from armid.measurement.remedy_builders import lines

FOLLOWS, IN_PART = 0.8, 0.9
"""Correlation from which the lag of a joint counts, in the whole log and in a part."""

LARGE = 0.2
"""Lag of all joints that is reported [s]. The lag of a servo by friction and inertia is below 0.1 s."""

OF_A_SERVO = 0.05
"""Lag that a servo has without any delay of its command [s]."""

WINDOW, FEWEST = 3.0, 5
"""Length of the parts whose lags are compared [s], and the smallest number of them."""

ACTIVE = 0.3
"""Share of the usual RMS speed of the command from which a part counts."""

CHANGE, ROWS, RELATIVE = 0.04, 1.5, 0.75
"""Change of the lag, common to the joints, that is reported [s], in rows, and over the smallest lag: that of a soft
servo depends on the speed."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a lag of all joints that is large, and a lag that changes during the recording."""
    response = evidence.response
    if response is None:
        return []
    counted = np.flatnonzero(response.moves & (np.diag(response.table) > FOLLOWS))
    if not len(counted):
        return []
    findings: list[Finding] = []
    lag = float(np.median(response.lags[counted]))
    if lag > LARGE:
        what = f"The joints follow their commands {lag:.2f} s later; a servo alone needs less than {LARGE:g} s."
        remedy = lines("or log the time at which a command is sent", table="servo", delay=round(lag - OF_A_SERVO, 3))
        findings.append(Finding("command-delay", "warning", "command", what, remedy))
    levels = _levels(response, counted)
    spread = float(np.ptp(levels)) if len(levels) >= 2 else 0.0
    if spread > max(CHANGE, ROWS / evidence.rate, RELATIVE * float(np.abs(levels).min(initial=np.inf))):
        what = (
            f"The joints follow their commands between {1e3 * levels.min():.3g} and {1e3 * levels.max():.3g} ms "
            "later at different times of the recording."
        )
        remedy = "log commands and positions with one clock, at the times at which they are sent and read."
        findings.append(Finding("command-delay-changes", "warning", "command", what, remedy))
    return findings


def _levels(response: CommandResponse, joints: np.ndarray) -> np.ndarray:
    """Lag of the joints in the three thirds of the recording [s]; empty if there are too few parts with motion."""
    size = round(WINDOW * response.rate)
    parts = [slice(k, k + size) for k in range(0, len(response.q) - size + 1, size)]
    if len(parts) < FEWEST:
        return np.zeros(0)
    speed = np.gradient(response.command, axis=0)
    usual = np.sqrt(np.mean(speed**2, axis=0))
    lags = np.full((len(parts), len(joints)), np.nan)
    for k, part in enumerate(parts):
        for m, j in enumerate(joints):
            value, lag = response.correlation(int(j), int(j), part)
            if value > IN_PART and np.sqrt(np.mean(speed[part, j] ** 2)) > ACTIVE * usual[j]:
                lags[k, m] = lag
    lags = lags[:, np.isfinite(lags).any(axis=0)]
    if not lags.size:
        return np.zeros(0)
    # The lag of a joint differs between slow and fast motion, so the change that most joints share counts.
    changes = lags - np.nanmedian(lags, axis=0)
    common = [np.nanmedian(row) for row in changes if np.isfinite(row).sum() * 2 > len(joints)]
    if len(common) < FEWEST:
        return np.zeros(0)
    thirds = [np.median(third) for third in np.array_split(np.array(common), 3)]
    return np.median(response.lags[joints]) + np.array(thirds)


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "command-delay": "The search for the delay starts far from it, and damping is mistaken for delay.",
        "command-delay-changes": "One delay fits no part of the recording, so inertia and damping are wrong.",
    },
    untested=dict.fromkeys(("command-delay", "command-delay-changes"), "the lag shows it without a model"),
    needs_torque=False,
    needs_command=True,
)
