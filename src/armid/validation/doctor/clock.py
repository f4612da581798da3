"""Gaps and unevenness of the clock."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from armid.errors import Finding
from armid.measurement.clock import is_even, jitter, stretches
from armid.measurement.recording import Recording
from armid.validation.doctor.evidence import Evidence

__all__ = ["check"]

CUTOFF = 5.0
"""Band for which a step counts as a gap [Hz]: the one that most studies compare in."""

ROUGH = 0.3
"""Unevenness in steps from which differences of positions are as wrong as the steps."""


def check(evidence: Evidence) -> list[Finding]:
    """Gaps, and steps that are not alike."""
    recording = evidence.recording
    if recording is None or recording.time is None or recording.effort is None or recording.consecutive is False:
        return []
    # Of the clock as logged: rows that repeat and are left out make no gap of it.
    pieces, gaps = stretches(_as_logged(evidence.raw) or recording, CUTOFF)
    findings = [
        Finding(g.code, g.severity, "time", g.evidence, f"exclude = [[{a.time[-1]:.4f}, {b.time[0]:.4f}]]")
        for g, (a, b) in zip(gaps, pairwise(pieces), strict=True)
    ]
    uneven = [piece for piece in pieces if not is_even(piece.time)]
    if uneven:
        steps = np.concatenate([np.diff(piece.time) for piece in uneven])
        off = max(jitter(piece.time) for piece in uneven)
        findings.append(
            Finding(
                "clock-jitter",
                "warning" if off > ROUGH else "info",
                "time",
                f"Steps from {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms, median "
                f"{1e3 * np.median(steps):.3g} ms; samples lie {off:.2g} steps off an even clock.",
                'columns = { time = "" }, rate = …  # where the robot samples evenly and only the stamps jitter',
            )
        )
    return findings


def _as_logged(raw: Recording) -> Recording | None:
    """The clock of a file alone; `None` where it cannot be walked along."""
    if raw.time is None or not np.isfinite(raw.time).all() or not (np.diff(raw.time) > 0.0).all():
        return None
    still = np.zeros_like(raw.q)
    return replace(raw, q=still, dq=None, ddq=None, effort=still)
