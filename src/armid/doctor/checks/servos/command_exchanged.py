"""Check for commands and positions whose columns are exchanged: what is called the position moves first."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.remedy_builders import naming

FOLLOWS = 0.8
"""Correlation from which the lag of a joint counts."""

LEADS, ROWS = 8e-3, 0.75
"""Lead of the positions from which columns are exchanged [s], and in rows: a log may pair a position with the
command of the row before."""

MOST = 0.7
"""Share of the moving joints that must lead."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports positions that lead their commands."""
    response = evidence.response
    if response is None or not response.moves.any():
        return []
    counted = response.moves & (np.diag(response.table) > FOLLOWS)
    lags = response.lags[counted]
    least = max(LEADS, ROWS / evidence.rate)
    if not counted.any() or np.median(lags) > -least or np.mean(lags < -least) < MOST:
        return []
    what = (
        f"The positions move {-1e3 * np.median(lags):.3g} ms before the commands ({int((lags < -least).sum())} of "
        f"{int(counted.sum())} joints): commands and positions are exchanged."
    )
    columns = evidence.raw.columns
    if columns.get("q") and columns.get("command"):
        remedy = naming(evidence.reading, {"q": list(columns["command"]), "command": list(columns["q"])})
        return [Finding("command-exchanged", "error", "command", what, remedy)]
    return [Finding("command-exchanged", "error", "command", what, "exchange the columns of command and position.")]


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={"command-exchanged": "The position is taken for the cause of the command, so all gains are wrong."},
    untested={"command-exchanged": "the lag shows it without a model"},
    hides=("command-delay", "command-delay-changes"),
    needs_torque=False,
    needs_command=True,
)
