"""Moments in which the arm touched something: bursts of what the model leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.validation.doctor.bursts import JOINTS, LONGEST, WINDOW, local_size
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.state import State

__all__ = ["check"]

BURST = 8.0
"""Residual of several joints over its usual size that no friction explains on recorded arms."""


def check(evidence: Evidence) -> list[Finding]:
    """One finding for the strongest burst."""
    state, before = evidence.understood, evidence.whole
    if state is None or before is None or state.log.band.is_open:
        return []
    # All rows, those too that were kept out of the fit, as the log is understood now.
    pairs = zip(state.log.runs, before.log.runs, strict=True)
    log = replace(state.log, runs=tuple(replace(now, mask=then.mask) for now, then in pairs))
    every = State(state.model, state.base, log).rows
    size = local_size(every, state.fit.values, state.rows.mask)
    level = np.sort(size, axis=1)[:, -min(JOINTS, every.n)]
    hit = level > BURST
    if not hit.any() or hit.mean() > LONGEST:
        return []
    peak = int(np.argmax(level))
    time = every.motion.time
    inside = hit & (np.abs(time - time[peak]) < 4 * WINDOW)
    low, high = float(time[inside].min()), float(time[inside].max())
    felt = np.flatnonzero(size[peak] > BURST / 2)
    names = evidence.robot.joint_names
    return [
        Finding(
            "contact",
            "warning",
            ", ".join(names[j] for j in felt),
            f"At t = {time[peak]:.2f} s the model leaves {size[peak].max():.0f} times what it usually leaves, on "
            f"{len(felt)} joints together.",
            f"exclude = [[{low - WINDOW:.2f}, {high + WINDOW:.2f}]]",
        )
    ]
