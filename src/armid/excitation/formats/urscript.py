"""URScript program for Universal Robots that moves to the first pose and streams the others by `servoj`."""

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
"""A whole fraction of the controller's 500 Hz, and the 125 Hz of older ones."""

JOINTS = 6
LOOKAHEAD, GAIN = 0.1, 300
"""Of `servoj`: its defaults, which smooth a little and follow closely."""

SERVO = re.compile(r"servoj\(\[(.*?)\], t=([\d.]+)")


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written: these arms have six revolute joints."""
    if len(track.joints) != JOINTS or any(track.prismatic):
        return f"URScript moves {JOINTS} joints that turn"
    return ""


def write(track: SampledMotion) -> bytes:
    """Writes one slow `movej`, then one `servoj` for each sample, then a stop."""
    rows = [", ".join(f"{x:.9f}" for x in q) for q in track.motion.q]
    lines = [f"# {PLAN_MARK}{track.plan}"] if track.plan else []
    lines += ["def armid_excitation():", f"  movej([{rows[0]}], a=0.5, v=0.3)", "  sleep(0.5)"]
    lines += [f"  servoj([{row}], t={track.step:.6f}, lookahead_time={LOOKAHEAD}, gain={GAIN})" for row in rows]
    lines += ["  stopj(2.0)", "end"]
    return ("\n".join(lines) + "\n").encode()


def read(content: bytes) -> SampledMotion:
    """Reads positions and plan.

    Raises:
        ArmidError: No program of `servoj`.
    """
    text = content.decode(errors="replace")
    found = SERVO.findall(text)
    if not found:
        raise ArmidError("This is no program of servoj.", remedy="give a file that armid excite wrote.")
    q = number_rows("\n".join(row for row, _ in found), JOINTS)
    motion = states_of_positions(np.arange(float(len(q))) * float(found[0][1]), q)
    joints = tuple(f"joint_{k + 1}" for k in range(JOINTS))
    return SampledMotion("", joints, (False,) * JOINTS, motion, plan_in_comments(text, "#"))
