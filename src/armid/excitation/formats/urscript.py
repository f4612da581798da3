"""URScript program for Universal Robots: `movej` to the first pose, then `servoj` to each of the other poses."""

from __future__ import annotations

import re

import numpy as np

from armid.errors import ArmidError
from armid.excitation.formats.sampled_motion import (
    PLAN_MARK,
    SampledMotion,
    number_rows,
    plan_in_comments,
    states_of_positions,
)

SUFFIX = ".script"
RATE = 125.0
"""Default sample rate [Hz]: the rate of older controllers, and a fourth of the 500 Hz of newer controllers."""

JOINTS = 6
LOOKAHEAD, GAIN = 0.1, 300
"""Lookahead time [s] and gain of `servoj`: the default values, with which the arm follows the positions closely."""

SERVO = re.compile(r"servoj\(\[(.*?)\], t=([\d.]+)")


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written in this format, which needs six revolute joints; empty if it can."""
    if len(track.joints) != JOINTS or any(track.prismatic):
        return f"URScript needs {JOINTS} revolute joints"
    return ""


def write(track: SampledMotion) -> bytes:
    """Writes one slow `movej`, then one `servoj` for each sample, and a stop at the end."""
    rows = [", ".join(f"{x:.9f}" for x in q) for q in track.motion.q]
    lines = [f"# {PLAN_MARK}{track.plan}"] if track.plan else []
    lines += ["def armid_excitation():", f"  movej([{rows[0]}], a=0.5, v=0.3)", "  sleep(0.5)"]
    lines += [f"  servoj([{row}], t={track.step:.6f}, lookahead_time={LOOKAHEAD}, gain={GAIN})" for row in rows]
    lines += ["  stopj(2.0)", "end"]
    return ("\n".join(lines) + "\n").encode()


def read(content: bytes) -> SampledMotion:
    """Reads the joint positions from the commands `servoj`, and the plan from the comments.

    Raises:
        ArmidError: The text is not a program with `servoj`.
    """
    text = content.decode(errors="replace")
    found = SERVO.findall(text)
    if not found:
        raise ArmidError(
            "The file was read as a URScript program of armid excite, but it has no command servoj.",
            remedy="give a file that armid excite has written.",
        )
    q = number_rows("\n".join(row for row, _ in found), JOINTS)
    motion = states_of_positions(np.arange(float(len(q))) * float(found[0][1]), q)
    joints = tuple(f"joint_{k + 1}" for k in range(JOINTS))
    return SampledMotion("", joints, (False,) * JOINTS, motion, plan_in_comments(text, "#"))
