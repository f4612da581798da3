"""Samples at a plateau of the torque are not used, unless the study keeps them."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import Finding
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recording
from armid.measurement.processing.saturation import plateaus
from armid.measurement.recording import Recording

RATE, SAMPLES = 100.0, 3000


def log(limit: float, noise: float = 0.2) -> Recording:
    """Two joints whose torque of 10 N·m swings in 5 s; that of the first ends at a limit [N·m]."""
    t = np.arange(SAMPLES) / RATE
    rng = np.random.default_rng(1)
    torque = 10.0 * np.sin(0.4 * np.pi * t)[:, None] + noise * rng.standard_normal((SAMPLES, 2))
    torque[:, 0] = np.clip(torque[:, 0], -limit, limit)
    q = np.sin(0.4 * np.pi * t)[:, None] * [1.0, 0.5]
    return Recording(q=q, time=t, effort=torque, joint_names=("shoulder", "elbow"), consecutive=True)


def told(findings: tuple[Finding, ...]) -> list[Finding]:
    return [each for each in findings if each.code == "saturation"]


def test_rows_near_a_plateau_are_masked_for_its_joint_alone():
    recording = log(8.0)
    assert recording.effort is not None
    (run,), findings = process_recording(recording, ProcessingOptions())
    (found,) = told(findings)
    assert found.severity == "warning" and found.channel == "shoulder" and "8" in found.evidence
    flat = np.abs(recording.effort[:, 0]) == 8.0
    assert found.evidence.split(": ")[1].startswith(f"{int((recording.effort[:, 0] == 8.0).sum())} of {SAMPLES}") or (
        found.evidence.split(": ")[1].startswith(f"{int((recording.effort[:, 0] == -8.0).sum())} of {SAMPLES}")
    )
    assert not run.mask[flat[run.rows], 0].any()
    assert run.mask[:, 0].any() and run.mask[flat[run.rows], 1].any()


def test_keep_uses_every_row_and_tells_nothing():
    (kept,), findings = process_recording(log(8.0), ProcessingOptions(saturation="keep"))
    (sound,), _ = process_recording(log(20.0), ProcessingOptions())
    assert not told(findings) and np.array_equal(kept.mask, sound.mask)


@pytest.mark.parametrize("decimals", [0, 1])
def test_a_coarse_converter_has_no_plateau(decimals: int):
    """Every value of a coarse converter is met often, the largest as the others."""
    recording = log(20.0)
    assert recording.effort is not None
    assert not plateaus(np.round(recording.effort, decimals), recording.valid)
