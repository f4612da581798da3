"""MATLAB file with the arrays t, q, dq, ddq, the names of the joints and the coefficients of the series."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np

from armid.excitation.formats.sampled_motion import SampledMotion
from armid.input_boundary import boundary
from armid.model.motion import Motion

SUFFIX = ".mat"
RATE = 250.0

COEFFICIENTS = ("base_frequency", "a", "b", "offset")


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written in this format; always empty, because any motion can be written."""
    del track
    return ""


def write(track: SampledMotion) -> bytes:
    """Writes a MATLAB file of version 5, which all versions of MATLAB can read."""
    from scipy.io import savemat  # slow to import

    motion = track.motion
    values: dict[str, Any] = {"t": motion.time, "q": motion.q, "dq": motion.dq, "ddq": motion.ddq}
    values["joints"] = np.array(track.joints, dtype=object)
    if track.plan:
        values["plan"] = track.plan
        plan = json.loads(track.plan)
        values |= {key: np.array(plan[key]) for key in COEFFICIENTS if key in plan}
    buffer = io.BytesIO()
    savemat(buffer, values, do_compression=True, oned_as="column")
    return buffer.getvalue()


def read(content: bytes) -> SampledMotion:
    """Reads the motion and the plan from a MATLAB file.

    Raises:
        ArmidError: The file is not one that `write` has written.
    """
    from scipy.io import loadmat  # slow to import

    with boundary("a motion of armid excite in MAT", "The file", remedy="give a file that armid excite has written."):
        values: Any = loadmat(io.BytesIO(content), squeeze_me=True)
        time = np.atleast_1d(values["t"])
        states = [np.asarray(values[key], dtype=np.float64).reshape(len(time), -1) for key in ("q", "dq", "ddq")]
        joints = tuple(str(name) for name in np.atleast_1d(values["joints"]))
        plan = str(values["plan"]) if "plan" in values else ""
        return SampledMotion("", joints, (False,) * len(joints), Motion(time, *states), plan)
