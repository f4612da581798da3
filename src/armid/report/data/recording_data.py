"""Measured and predicted torque, prediction intervals and friction for the recordings of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimate_record import torque_parameters
from armid.information.residuals import compare
from armid.maths.signals.fourier_transform import spectrum
from armid.measurement.observations import ObservedRun
from armid.model.dynamics_model import DynamicsModel
from armid.model.torque_law_expression import symbols
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.recordings.processed import ProcessedRecording
from armid.validation.torque_validation import PredictedRecording, predict_recording

SPECTRUM_SAMPLES = 1 << 17
"""Largest number of samples from which a spectrum is computed: 16 s of a log at 8 kHz, two minutes at 1 kHz."""

SEGMENT_SECONDS = 8.0
"""Length of the segments of a spectrum [s]; the resolution, 1/8 Hz, is finer than most base frequencies of
motions."""


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Amplitude density of the torque of n joints at K frequencies.

    Attributes:
        frequency: The frequencies, shape (K,) [Hz].
        measured: Amplitude density of the recorded torque, shape (K, n) [N·m/√Hz].
        residual: Amplitude density of measured minus predicted torque without filter, shape (K, n) [N·m/√Hz].
    """

    frequency: Array
    measured: Array
    residual: Array


@dataclass(frozen=True, eq=False, slots=True)
class RecordingData:
    """Data of a recording on its output grid (M rows), in the band of the study.

    Attributes:
        choice: Path and role of the recording, and the part of it that is used.
        time: Time since the first row, shape (M,) [s]; the number of the row if rows are not consecutive.
        q: Positions, shape (M, n) [rad or m].
        dq: Velocities, shape (M, n) [rad/s or m/s].
        measured: Measured torque, shape (M, n) [N·m or N]; NaN in masked rows.
        predicted: Torque predicted by the estimate, shape (M, n) [N·m or N]; NaN in masked rows.
        friction: Torque of all laws of the model that do not depend on the acceleration, that is, friction and
            offset, shape (M, n) [N·m or N].
        half_band: Half width of the 95 % prediction interval, shape (M, n) [N·m or N].
        starts: First row of each contiguous run, followed by M.
        spectrum: Spectrum of the longest run; `None` if rows are not consecutive.
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
        """Measured minus predicted torque, shape (M, n) [N·m or N]; NaN in masked rows."""
        return self.measured - self.predicted

    @property
    def is_consecutive(self) -> bool:
        """True if the rows are consecutive in time."""
        return self.spectrum is not None

    @property
    def clock(self) -> str:
        """Title of the time axis: `time [s]`, or `row` for separate rows."""
        return "time [s]" if self.is_consecutive else "row"

    def gapped(self, values: Array) -> tuple[Array, Array]:
        """Time and values for a line, with a NaN between contiguous runs, at which the line is interrupted."""
        cuts = self.starts[1:-1]
        return np.insert(self.time, cuts, np.nan), np.insert(values, cuts, np.nan, axis=0)


def concatenated(
    recordings: Sequence[RecordingData], what: Literal["q", "dq", "measured", "friction", "residual"], j: int
) -> Array:
    """Values of one quantity of joint `j`, concatenated over the rows of several recordings, shape (M,)."""
    return np.concatenate([np.zeros(0), *(getattr(each, what)[:, j] for each in recordings)])


def evaluate_recording(
    run: Run, recording: ProcessedRecording, prediction: PredictedRecording | None = None
) -> RecordingData:
    """Computes the data of a processed recording for a page; `prediction` is computed if it is not given."""
    observations = recording.observations
    model, estimate, runs, band = run.model, run.estimate, observations.runs, observations.band
    theta = torque_parameters(estimate.base, estimate.fit)
    only_friction = np.where(friction_columns(model), theta, 0.0)
    prediction = prediction or predict_recording(model, estimate, observations)
    compared = prediction.runs
    friction = [compare(model, only_friction, each, band).predicted for each in runs]
    grid = [each.motion[slice(each.offset, None, each.step)] for each in runs]
    time = np.concatenate([motion.time for motion in grid])
    mask = np.concatenate([each.mask for each in compared])
    longest = max(runs, key=lambda each: each.motion.samples)
    return RecordingData(
        recording.choice,
        time - time[0],
        np.concatenate([motion.q for motion in grid]),
        np.concatenate([motion.dq for motion in grid]),
        np.where(mask, np.concatenate([each.measured for each in compared]), np.nan),
        np.where(mask, np.concatenate([each.predicted for each in compared]), np.nan),
        np.concatenate(friction),
        _half_band(prediction),
        tuple(int(k) for k in np.cumsum([0, *(motion.samples for motion in grid)])),
        _spectrum(model, theta, longest) if longest.consecutive else None,
    )


def friction_columns(model: DynamicsModel) -> Array:
    """Mask (p,) of the friction and offset parameters: 1 for laws that do not depend on acceleration, else 0."""
    chosen = np.zeros(len(model.parameters))
    for column, (_, law) in zip(model.law_columns, model.laws, strict=True):
        chosen[column] = "ddq" not in symbols(law.expression)
    return chosen


def _half_band(prediction: PredictedRecording) -> Array:
    """Half width (M, n) of the 95 % prediction interval, interpolated between the rows for which it was computed."""
    counts = [len(run.mask) for run in prediction.runs]
    known = [np.arange(0, count, prediction.every) for count in counts]
    half_widths = np.split(prediction.half_widths, np.cumsum([len(rows) for rows in known])[:-1])
    return np.concatenate(
        [
            np.stack([np.interp(np.arange(count), rows, of_joint) for of_joint in widths.T], axis=1)
            for count, rows, widths in zip(counts, known, half_widths, strict=True)
        ]
    )


def _spectrum(model: DynamicsModel, theta: Array, run: ObservedRun) -> Spectrum:
    """Spectra of measured torque and residual at the full rate of the recording, without the band's filter."""
    part = slice(0, SPECTRUM_SAMPLES)
    measured = run.torque[part]
    both = np.hstack([measured, measured - model.torque(run.motion[part], theta)])
    frequency, density = amplitude_density(both, run.rate)
    return Spectrum(frequency, density[:, : model.n], density[:, model.n :])


def amplitude_density(signals: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (K,) above zero [Hz], and one-sided amplitude density (K, c) of signals by Welch's method.

    Args:
        signals: N samples of c signals, shape (N, c).
        rate: Sample rate [Hz].
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
    """Index of the first sample of each segment of a spectrum; consecutive segments overlap by half."""
    return range(0, total - samples + 1, max(1, samples // 2))
