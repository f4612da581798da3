"""CSV table of time, positions, velocities and accelerations of all joints in SI units."""

from __future__ import annotations

import io

import numpy as np

from armid.errors import ArmidError
from armid.excitation.formats.sampled_motion import DECIMALS, SampledMotion, number_rows
from armid.model.motion import Motion

SUFFIX = ".csv"
RATE = 250.0


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written in this format; always empty, because any motion can be written."""
    del track
    return ""


def write(track: SampledMotion) -> bytes:
    """Writes a header with the joints' names, then one row for each sample."""
    header = ",".join(["time", *(f"{kind}_{joint}" for kind in ("q", "dq", "ddq") for joint in track.joints)])
    motion = track.motion
    text = io.StringIO()
    rows = np.column_stack([motion.time, motion.q, motion.dq, motion.ddq])
    np.savetxt(text, np.round(rows, DECIMALS), delimiter=",", header=header, comments="", fmt="%.12g")
    return text.getvalue().encode()


def read(content: bytes) -> SampledMotion:
    """Reads the motion from a CSV table, which does not contain the plan.

    Raises:
        ArmidError: The table is not one that `write` has written.
    """
    header, _, rows = content.decode(errors="replace").partition("\n")
    names = [name.strip().removeprefix("q_") for name in header.split(",") if name.startswith("q_")]
    if not names:
        raise ArmidError(
            "The file was read as a motion of armid excite in CSV, but its header has no column q_JOINT.",
            remedy="give a file that armid excite has written.",
        )
    values = number_rows(rows, 1 + 3 * len(names))
    states = np.split(values[:, 1:], 3, axis=1)
    return SampledMotion("", tuple(names), (False,) * len(names), Motion(values[:, 0], *states))
