"""A known periodic motion of two joints and recordings of it, shared by the tests of processing."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.measurement.observations import ObservedRun
from armid.measurement.processing.pipeline import ProcessingOptions, process_recording
from armid.measurement.recording import Recording

PERIOD = 10.0
OMEGA = 2 * np.pi / PERIOD * np.array([1.0, 2.0, 5.0])
A = np.array([[0.5, -0.3, 0.1], [0.2, 0.4, -0.2]])


def motion(t: np.ndarray):
    """Two joints with harmonics at 0.1, 0.2 and 0.5 Hz; positions and exact derivatives, shapes (N, 2)."""
    s, c = np.sin(np.outer(t, OMEGA)), np.cos(np.outer(t, OMEGA))
    return s @ A.T, (c * OMEGA) @ A.T, -(s * OMEGA**2) @ A.T


def recording(t: np.ndarray, *, noise: float = 0.0, seed: int = 0, **more: object) -> Recording:
    """A recording of the motion at times t; the effort is the velocity in all its sharpness."""
    rng = np.random.default_rng(seed)
    q, dq, _ = motion(t)
    effort = 10.0 * np.sign(dq)
    values = {"time": t, "q": q, "effort": effort, "source": "log.csv"} | more
    values["q"] = values["q"] + noise * rng.normal(size=q.shape)
    return Recording(**values)  # pyright: ignore[reportArgumentType]


def clock(seconds: float, rate: float = 100.0) -> np.ndarray:
    """Times of an even clock from 0 on."""
    return np.arange(round(seconds * rate)) / rate


def one(log: Recording, processing: ProcessingOptions, **more: object) -> tuple[ObservedRun, tuple[Finding, ...]]:
    """The only run of a recording, and the findings."""
    runs, findings = process_recording(log, processing, **more)  # pyright: ignore[reportArgumentType]
    assert len(runs) == 1
    return runs[0], findings


def codes(findings: tuple[Finding, ...] | list[Finding]) -> list[str]:
    return [finding.code for finding in findings]
