"""A run's recordings once more: torque measured and predicted, with its band, and friction by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.estimation.estimate import Estimate, torque_parameters
from armid.information.residuals import compare
from armid.maths.spectrum import spectrum
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics import DynamicsModel
from armid.model.expression import symbols
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.processed import ProcessedRecording
from armid.validation.prediction_interval import band_of_rows
from armid.values import Array

__all__ = ["RecordingData", "Spectrum", "evaluate_recording", "friction_columns", "joined"]

BAND_ROWS = 5000
"""Rows, or up to twice as many, at which the band is worked out; it varies as slowly as the motion does."""

SPECTRUM_SAMPLES = 1 << 17
"""Samples that a spectrum is made of at most: 16 s of an 8 kHz log, two minutes of a 1 kHz one."""

SEGMENT_SECONDS = 8.0
"""Length of a spectrum's segments: lines an eighth of a hertz apart, below most base frequencies."""


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Amplitude density at K frequencies.

    Attributes:
        frequency: Shape (K,) [Hz].
        measured: Of the torque as recorded, shape (K, n) [N·m/√Hz].
        residual: Of measured less predicted as recorded, shape (K, n).
    """

    frequency: Array
    measured: Array
    residual: Array


@dataclass(frozen=True, eq=False, slots=True)
class RecordingData:
    """One recording on its output grid, M rows, in the study's band.

    Attributes:
        choice: Path, role and part.
        time: Since the recording's first row, shape (M,) [s]; the row's number where rows are separate.
        q: Positions, shape (M, n) [rad or m].
        dq: Velocities, shape (M, n).
        measured: Torque, shape (M, n) [N·m or N]; NaN where a row does not count.
        predicted: Torque of the estimate, shape (M, n); NaN as well.
        friction: The part of `predicted` that depends on no acceleration and no link, shape (M, n).
        half_band: Half width of the 95 % band about the prediction, shape (M, n).
        starts: First row of each contiguous run, and M.
        spectrum: Of the longest run; `None` where rows do not follow each other.
    """

    choice: RecordingChoice
    time: Array
    q: Array
    dq: Array
    measured: Array
    predicted: Array
    friction: Array
    half_band: Array
    starts: tuple[int, ...]
    spectrum: Spectrum | None

    @property
    def residual(self) -> Array:
        """Measured less predicted, shape (M, n); NaN where a row does not count."""
        return self.measured - self.predicted

    @property
    def is_consecutive(self) -> bool:
        """Tell whether rows follow each other in time."""
        return self.spectrum is not None

    @property
    def clock(self) -> str:
        """Return what `time` is, for the title of an axis."""
        return "time [s]" if self.is_consecutive else "row"

    def gapped(self, values: Array) -> tuple[Array, Array]:
        """Time and values with a gap between contiguous runs, for lines."""
        cuts = self.starts[1:-1]
        return np.insert(self.time, cuts, np.nan), np.insert(values, cuts, np.nan, axis=0)


def joined(
    evidence: Sequence[RecordingData], what: Literal["q", "dq", "measured", "friction", "residual"], j: int
) -> Array:
    """One quantity of one joint over several recordings, one after another."""
    return np.concatenate([np.zeros(0), *(getattr(each, what)[:, j] for each in evidence)])


def evaluate_recording(run: Run, recording: ProcessedRecording) -> RecordingData:
    """Torque of a recording, processed as the run's own, beside that of the estimate."""
    observations = recording.observations
    model, estimate, runs, band = run.model, run.estimate, observations.runs, observations.band
    theta = torque_parameters(estimate.base, estimate.fit)
    only_friction = np.where(friction_columns(model), theta, 0.0)
    found = [compare(model, theta, each, band) for each in runs]
    friction = [compare(model, only_friction, each, band).predicted for each in runs]
    grid = [each.motion[slice(each.offset, None, each.step)] for each in runs]
    time = np.concatenate([motion.time for motion in grid])
    mask = np.concatenate([each.mask for each in found])
    longest = max(runs, key=lambda each: each.motion.samples)
    return RecordingData(
        recording.choice,
        time - time[0],
        np.concatenate([motion.q for motion in grid]),
        np.concatenate([motion.dq for motion in grid]),
        np.where(mask, np.concatenate([each.measured for each in found]), np.nan),
        np.where(mask, np.concatenate([each.predicted for each in found]), np.nan),
        np.concatenate(friction),
        _half_band(model, estimate, observations),
        tuple(int(k) for k in np.cumsum([0, *(motion.samples for motion in grid)])),
        _spectrum(model, theta, longest) if longest.consecutive else None,
    )


def friction_columns(model: DynamicsModel) -> Array:
    """1 for each standard parameter of a law without acceleration, friction and offsets, else 0; shape (p,)."""
    chosen = np.zeros(len(model.parameters))
    for column, (_, law) in zip(model.law_columns, model.laws, strict=True):
        chosen[column] = "ddq" not in symbols(law.expression)
    return chosen


def _half_band(model: DynamicsModel, estimate: Estimate, observations: Observations) -> Array:
    """Half width (M, n) of the 95 % band of a measurement, between rows at which it is worked out."""
    counts = [len(run.rows) for run in observations.runs]
    step = max(1, sum(counts) // BAND_ROWS)
    looked = [np.arange(0, count, step) for count in counts]
    found = np.split(
        band_of_rows(model, estimate, observations, step), np.cumsum([len(seen) for seen in looked])[:-1]
    )
    return np.concatenate(
        [
            np.stack([np.interp(np.arange(count), seen, of_joint) for of_joint in widths.T], axis=1)
            for count, seen, widths in zip(counts, looked, found, strict=True)
        ]
    )


def _spectrum(model: DynamicsModel, theta: Array, run: ObservedRun) -> Spectrum:
    """Spectra of torque and residual at full rate, as recorded: what the band leaves out is in them."""
    part = slice(0, SPECTRUM_SAMPLES)
    measured = run.torque[part]
    both = np.hstack([measured, measured - model.torque(run.motion[part], theta)])
    frequency, density = amplitude_density(both, run.rate)
    return Spectrum(frequency, density[:, : model.n], density[:, model.n :])


def amplitude_density(signals: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (K,) above zero [Hz] and one-sided amplitude density (K, c) by Welch's averaged segments.

    Args:
        signals: Shape (N, c).
        rate: Samples a second [Hz].
    """
    samples = min(len(signals), max(8, round(SEGMENT_SECONDS * rate)))
    window = np.hanning(samples)[:, None]
    power: list[Array] = []
    for start in _segments(len(signals), samples):
        segment = signals[start : start + samples]
        power.append(np.abs(spectrum((segment - segment.mean(axis=0)) * window)) ** 2)
    density = np.sqrt(2.0 * np.mean(power, axis=0) / (rate * np.sum(window**2)))
    return np.arange(1, len(density)) * rate / samples, density[1:]


def _segments(total: int, samples: int) -> Sequence[int]:
    """Starts of segments that overlap by half."""
    return range(0, total - samples + 1, max(1, samples // 2))
