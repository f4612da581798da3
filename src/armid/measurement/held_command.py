"""Commands with time stamps of their own, held until the next one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.measurement.recording import Recording, select_rows


def last_command(time: NDArray[Any], given: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Finds the last command at or before each sample.

    Args:
        time: Times of the samples, shape (N,).
        given: Times of the commands on the same clock, shape (M,), not decreasing.

    Returns:
        Index of the command of each sample, shape (N,), and the mask (N,) of the samples before the first command,
        which get the first command.
    """
    last = np.searchsorted(given, time, side="right") - 1
    return np.maximum(last, 0), last < 0


def with_held_command(
    recording: Recording, command: Array, before: NDArray[np.bool_], oldest: float, source: str
) -> tuple[Recording, Finding]:
    """Adds a held command to a recording.

    In a recording without effort, the samples before the first command are left out. Beside an effort they stay, so
    that all results of the effort are the same with and without a command, and have the first command.

    Args:
        recording: Recording without a command.
        command: Commands at the samples, shape (N, n).
        before: Mask of the samples before the first command, shape (N,).
        oldest: Longest time between a sample and its command [s].
        source: Name of the topic or file with the command.

    Returns:
        The recording with its command, and the finding that says how they were joined.
    """
    early = int(before.sum())
    evidence = (
        f"The command comes from {source}, which has its own time stamps: each sample has the last command at or "
        f"before it, which is at most {1e3 * oldest:.3g} ms old."
    )
    found = replace(recording, command=command)
    if early and recording.effort is None:
        found = select_rows(found, ~before)
        evidence += f" The {early} samples before the first command are left out."
    elif early:
        evidence += f" The {early} samples before the first command have the first command."
    return found, Finding("command-held", "info", source, evidence)
