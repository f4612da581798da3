"""Position error of the rollout of a model over windows of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.information.hysteresis_states import with_hysteresis_states
from armid.maths.median import median
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics_model import DynamicsModel
from armid.validation.rollout import Feedback, Windows, roll_out

MOST_WINDOWS = 200
"""Largest number of windows of a recording; if there are more, an evenly spaced selection is used."""


@dataclass(frozen=True, slots=True)
class Losses:
    """Numbers of lost windows, by cause; a window is lost if its simulation ended early.

    Attributes:
        ran_away: Number of windows that diverged.
        indefinite: Number of windows in which the mass matrix was not positive definite.
        nominal: Number of windows that are lost in the simulation with the inertial parameters of the description,
            without friction.
    """

    ran_away: int = 0
    indefinite: int = 0
    nominal: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class MotionScore:
    """Position error of the rollout on one recording, for each joint, shape (n,).

    Attributes:
        path: Path of the recording.
        rms: RMS error over all windows that are not lost [rad or m]; NaN if all are lost.
        peak: Largest absolute error in these windows [rad or m].
        held: Median over the windows of the time until the error exceeds `tolerance` [s]; the length of the window if
            the error never exceeds it.
        travelled: RMS distance of the recorded position from the start of its window [rad or m], which is the error
            of a model that predicts no motion.
        prior_rms: RMS error over all windows with the inertial parameters of the description, without friction; NaN
            if a window is lost with these parameters; `None` if the description has no inertial parameters.
        windows: Number of windows.
        losses: Number of lost windows, by cause.
        seconds: Length of a window [s].
        tolerance: Tolerance of the position error [rad or m].
    """

    path: str
    rms: Array
    peak: Array
    held: Array
    travelled: Array
    prior_rms: Array | None
    windows: int
    losses: Losses
    seconds: float
    tolerance: float

    @property
    def lost(self) -> int:
        """Number of windows that are lost with the model."""
        return self.losses.ran_away + self.losses.indefinite

    def __post_init__(self) -> None:
        for name in ("rms", "peak", "held", "travelled", "prior_rms"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, array(value, (None,), name, finite=False))


def score_motion(
    model: DynamicsModel,
    parameters: Array,
    observations: Observations,
    *,
    seconds: float = 0.5,
    tolerance: float = 0.01,
    feedback: Feedback | None = None,
    path: str = "",
) -> MotionScore:
    """Simulates a model over the windows of one recording and computes its position error.

    Args:
        model: Arm and torque terms.
        parameters: Standard parameters, or other values that give the same torque, shape (p,).
        observations: The processed recording.
        seconds: Length of a window [s].
        tolerance: Position error up to which the time `held` is counted [rad or m].
        feedback: Feedback of the controller of the recording; if not given, only the recorded torque acts.
        path: The recording.

    Raises:
        ArmidError: Length or tolerance is not positive, no window fits into a contiguous segment of the recording, or
            the sample rates of its runs differ.
    """
    if not (seconds > 0.0 and tolerance > 0.0):
        raise ArmidError(
            f"The length of a window and the tolerance must be positive; found {seconds:g} s and {tolerance:g}.",
            remedy="give, for instance, seconds=0.5 and a tolerance of 0.01 rad or m.",
        )
    windows = _cut(model, observations, seconds)
    found = roll_out(model, parameters, windows, feedback)
    error = found.q - windows.q
    losses = Losses(int(found.ran_away.sum()), int(found.indefinite.sum()))
    prior = model.nominal_parameters()
    prior_rms = None
    if prior is not None:
        nominal_rollout = roll_out(model, prior, windows, feedback)
        losses = replace(losses, nominal=int((~nominal_rollout.stayed).sum()))
        # Without lost windows only: of a diverging model only the beginnings would count.
        prior_rms = _rms(nominal_rollout.q - windows.q) if nominal_rollout.stayed.all() else np.full(model.n, np.nan)
    return MotionScore(
        path,
        _rms(error),
        _peak(error),
        _held(error, tolerance, windows.step),
        _rms(windows.q - windows.q[:, :1]),
        prior_rms,
        len(error),
        losses,
        (error.shape[1] - 1) * windows.step,
        tolerance,
    )


def _cut(model: DynamicsModel, observations: Observations, seconds: float) -> Windows:
    """Cuts the runs with consecutive samples into consecutive windows of a given length [s]."""
    parts: list[tuple[ObservedRun, int]] = []
    length, step = 0, 0.0
    for given in observations.runs:
        if not given.consecutive:
            continue
        run = with_hysteresis_states(model, given, observations.band)
        length, step = round(seconds * run.rate) + 1, 1.0 / run.rate
        count_from = run.rows[np.flatnonzero(run.mask.any(axis=1))[:1]]
        first = int(count_from[0]) if len(count_from) else run.motion.samples
        parts += [
            (run, s)
            for s in range(first, run.motion.samples - length + 1, max(length - 1, 1))
            if _whole(run, s, length)
        ]
    if not parts or length < 2:
        raise ArmidError(
            f"The rollout needs a segment of {seconds:g} s without a gap or a masked row, but the recording has "
            "none.",
            remedy="choose a shorter window, or a recording with consecutive rows.",
        )
    if len({run.rate for run, _ in parts}) > 1:
        raise ArmidError(
            "The runs of one recording have different sample rates.",
            remedy="split the recording into one recording for each sample rate.",
        )
    if len(parts) > MOST_WINDOWS:
        parts = [parts[k] for k in np.linspace(0, len(parts) - 1, MOST_WINDOWS).astype(int)]
    nodes = len(model.nodes)
    memory = [run.motion.memory[s] if run.motion.memory is not None else np.zeros(nodes) for run, s in parts]
    return Windows(
        *(np.stack([getattr(run.motion, name)[s : s + length] for run, s in parts]) for name in ("q", "dq", "ddq")),
        torque=np.stack([run.torque[s : s + length] for run, s in parts]),
        memory=np.stack(memory),
        step=step,
    )


def _whole(run: ObservedRun, first: int, length: int) -> bool:
    """True if no row of a window is masked."""
    inside = (run.rows >= first) & (run.rows < first + length)
    return bool(run.mask[inside].all())


def _stayed(error: Array) -> NDArray[np.bool_]:
    """Mask of windows that are not lost, shape (W,)."""
    return np.asarray(np.isfinite(error).all(axis=(1, 2)))


def _rms(error: Array) -> Array:
    """RMS error over the windows that are not lost, for each joint, shape (n,)."""
    there = _stayed(error)
    return np.sqrt((error[there] ** 2).mean(axis=(0, 1))) if there.any() else np.full(error.shape[2], np.nan)


def _peak(error: Array) -> Array:
    there = _stayed(error)
    return np.abs(error[there]).max(axis=(0, 1)) if there.any() else np.full(error.shape[2], np.nan)


def _held(error: Array, tolerance: float, step: float) -> Array:
    """Median over the windows of the time until the error exceeds the tolerance, for each joint, shape (n,) [s]."""
    exceeded = ~(np.abs(error) <= tolerance)
    first = np.where(exceeded.any(axis=1), exceeded.argmax(axis=1), error.shape[1] - 1)
    return median(first) * step
