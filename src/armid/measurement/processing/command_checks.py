"""Checks of the commanded positions of a recording, and their whole turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.measurement.recording import Recording

WRAP_TOLERANCE = 0.5
"""Largest difference between a jump of a commanded angle and a whole number of turns at which the jump counts as a
wrap [rad], as for measured angles."""


def without_incomplete_command(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """Leaves out a command with values that are not finite, if the recording has an effort.

    Results from the effort do not need the command. In a recording without effort, the command is needed, and such
    values are refused or excluded like those of other channels.
    """
    command = recording.command
    if command is None or recording.effort is None or np.isfinite(command).all():
        return recording, ()
    missing = ~np.isfinite(command)
    rows = np.flatnonzero(missing.any(axis=1))
    names = ", ".join(recording.channels[j] for j in np.flatnonzero(missing.any(axis=0)))
    finding = Finding(
        "command-incomplete",
        "info",
        names,
        f"The command has no number in {len(rows)} of {recording.samples} rows, first in row {rows[0] + 1}. It is "
        "left out; the effort is used.",
        "log the command in all rows if it is to be used.",
    )
    return replace(recording, command=None), (finding,)


def still_commands(recording: Recording) -> tuple[Finding, ...]:
    """Findings about joints that move although their command is constant, in a recording without effort."""
    if recording.command is None or recording.effort is not None:
        return ()
    still = (np.ptp(recording.command, axis=0) == 0) & (np.ptp(recording.q, axis=0) > 0)
    return tuple(
        Finding(
            "command-still",
            "info",
            recording.channels[j],
            f"The command of the joint is {recording.command[0, j]:g} in all rows, and the joint moves by "
            f"{np.ptp(recording.q[:, j]):.4g}.",
            "check that this column is the command of the joint; a joint that only holds its position shows neither "
            "its inertia nor its friction.",
        )
        for j in np.flatnonzero(still)
    )


def unwrapped_command(command: Array, logged: Array, q: Array, turns: NDArray[np.bool_]) -> Array:
    """Shifts commanded angles by whole turns to the side of the measured angles, where one of the two wraps.

    Args:
        command: Commanded positions, shape (N, n) [rad or m].
        logged: Measured positions at the same times, shape (N, n) [rad or m].
        q: The same positions after they were made continuous, shape (N, n) [rad or m].
        turns: Mask of the joints whose angles may wrap, shape (n,).

    Returns:
        Commands, shape (N, n). If the command or the measured angle of a joint wraps, or if the two differ by the
        same number of turns throughout, all commands of the joint are within half a turn of the positions; all
        others are unchanged.
    """
    command = command.copy()
    turn = 2.0 * np.pi
    for j in np.flatnonzero(turns):
        away = np.round((q[:, j] - command[:, j]) / turn)
        if not away.any():
            continue
        step = np.diff(command[:, j])
        whole = np.round(step / turn)
        jumps = (whole != 0) & (np.abs(step - turn * whole) < WRAP_TOLERANCE)
        if jumps.any() or (q[:, j] != logged[:, j]).any() or np.ptp(away) == 0:
            command[:, j] += turn * away
    return command
