"""Table for KUKA's Fast Robot Interface (FRI): one row of seven joint positions [rad] for each cycle, without header.

A client reads one row in each cycle and sends it as the commanded position. The cycle time is set in the FRI session.
"""

from __future__ import annotations

import io

import numpy as np

from armid.excitation.formats.sampled_motion import DECIMALS, SampledMotion, number_rows, states_of_positions

SUFFIX = ".fri.csv"
RATE = 200.0

JOINTS = 7


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written in this format, which needs seven revolute joints; empty if it can."""
    if len(track.joints) != JOINTS or any(track.prismatic):
        return f"FRI needs {JOINTS} revolute joints"
    return ""


def write(track: SampledMotion) -> bytes:
    """Writes one row of joint positions for each cycle; the file does not contain the cycle time."""
    text = io.StringIO()
    np.savetxt(text, track.motion.q, delimiter=",", fmt=f"%.{DECIMALS}f")
    return text.getvalue().encode()


def read(content: bytes) -> SampledMotion:
    """Reads the joint positions; the cycle time is assumed to be 5 ms, which is usual."""
    q = number_rows(content.decode(errors="replace"), JOINTS)
    motion = states_of_positions(np.arange(len(q)) / RATE, q)
    return SampledMotion("", tuple(f"A{k + 1}" for k in range(JOINTS)), (False,) * JOINTS, motion)
