"""Motion that is sampled at the rate of a controller, and the interface of the modules that write it to files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.model.motion import Motion

PLAN_MARK = "armid-plan "
"""Text before the plan in files whose format has comments; the plan is one line of JSON in a comment."""


DECIMALS = 9
"""Number of decimals in tables. A nanoradian or a nanometre is far below the resolution of encoders."""


@dataclass(frozen=True, eq=False, slots=True)
class SampledMotion:
    """Motion sampled at the rate of a controller.

    Attributes:
        name: Name of the arm.
        joints: Names of the joints.
        prismatic: For each joint, true if it is prismatic.
        motion: Samples of the motion.
        plan: The plan as one line of JSON; empty if it is not known.
    """

    name: str
    joints: tuple[str, ...]
    prismatic: tuple[bool, ...]
    motion: Motion
    plan: str = ""

    def __post_init__(self) -> None:
        if len(self.joints) != self.motion.n or len(set(self.joints)) != len(self.joints):
            raise ArmidError(
                f"A motion of {self.motion.n} joints must name each of them once; found {', '.join(self.joints)}.",
                remedy="correct the names of the joints in the file, or write it again with armid excite.",
            )

    @property
    def step(self) -> float:
        """Time from one sample to the next [s]."""
        return float(self.motion.time[1] - self.motion.time[0]) if self.motion.samples > 1 else 0.0


class Format(Protocol):
    """Interface of a module that writes and reads one format.

    Attributes:
        SUFFIX: Suffix of the file name.
        RATE: Default sample rate [Hz].
    """

    SUFFIX: str
    RATE: float

    def problem(self, track: SampledMotion) -> str:
        """Reason why a motion cannot be written in this format; empty if it can."""
        ...

    def write(self, track: SampledMotion) -> bytes:
        """Writes a motion as bytes."""
        ...

    def read(self, content: bytes) -> SampledMotion:
        """Reads a motion that `write` has written; data that the format cannot represent are missing."""
        ...


def plan_in_comments(text: str, comment: str) -> str:
    """Plan, as one line of JSON, in the comments of a file; empty if no comment contains a plan."""
    mark = f"{comment} {PLAN_MARK}"
    return next((line[len(mark) :] for line in text.splitlines() if line.startswith(mark)), "")


def number_rows(text: str, columns: int | None = None) -> Array:
    """Reads comma-separated rows of numbers into an array, shape (N, columns).

    Raises:
        ArmidError: The text contains something else, or the number of columns is wrong.
    """
    try:
        rows = np.array([[float(x) for x in line.split(",")] for line in text.splitlines() if line.strip()])
    except ValueError as error:
        raise ArmidError(
            "The file was read as a motion of armid excite, but a row contains something other than numbers: "
            f"{error}.",
            remedy="give a file that armid excite has written.",
        ) from error
    if rows.ndim != 2 or not len(rows) or (columns is not None and rows.shape[1] != columns):
        found = f"{len(rows)} rows of {rows.shape[1]}" if rows.ndim == 2 else "none"
        raise ArmidError(
            f"The file must contain rows of {columns or 'several'} comma-separated numbers; found {found}.",
            remedy="give a file that armid excite has written.",
        )
    return rows


def states_of_positions(time: Array, q: Array) -> Motion:
    """Motion from positions alone; velocities and accelerations are computed as differences."""
    dq = np.gradient(q, time, axis=0)
    return Motion(time, q, dq, np.gradient(dq, time, axis=0))
