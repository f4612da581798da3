"""Table for KUKA's Fast Robot Interface: one row of seven joint positions [rad] for each cycle, no header.

A client reads a row in each cycle and sends it as the commanded position; the rate is that of the FRI session.
"""

from __future__ import annotations

import io

import numpy as np

from armid.excitation.formats.sampled_motion import SampledMotion, number_rows, states_of_positions

SUFFIX = ".fri.csv"
RATE = 200.0

JOINTS = 7


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written: arms with FRI have seven revolute joints."""
    if len(track.joints) != JOINTS or any(track.prismatic):
        return f"FRI moves {JOINTS} joints that turn"
    return ""


def write(track: SampledMotion) -> bytes:
    """Writes one row for each cycle; the cycle time is not in the file."""
    text = io.StringIO()
    np.savetxt(text, track.motion.q, delimiter=",", fmt="%.9f")
    return text.getvalue().encode()


def read(content: bytes) -> SampledMotion:
    """Reads the positions, with the usual cycle of 5 ms."""
    q = number_rows(content.decode(errors="replace"), JOINTS)
    motion = states_of_positions(np.arange(len(q)) / RATE, q)
    return SampledMotion("", tuple(f"A{k + 1}" for k in range(JOINTS)), (False,) * JOINTS, motion)
