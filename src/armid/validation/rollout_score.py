"""Position error of a model's rollout over windows of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.information.hysteresis_states import with_hysteresis_states
from armid.maths.median import median
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics import DynamicsModel
from armid.validation.rollout import Feedback, Windows, roll_out
from armid.values import Array, array

MOST_WINDOWS = 200
"""Largest number of windows of a recording; of more, an evenly spread selection is used."""


@dataclass(frozen=True, slots=True)
class Losses:
    """Numbers of lost windows, by cause.

    Attributes:
        ran_away: Windows that diverged.
        indefinite: Windows that reached a mass matrix that is not positive definite.
        nominal: Windows that the description's inertias without friction lost, by either cause.
    """

    ran_away: int = 0
    indefinite: int = 0
    nominal: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class MotionScore:
    """Position error of the rolled-out model on one recording, joint by joint (n,).

    Attributes:
        path: The recording.
        rms: RMS error over all windows that were not lost [rad or m]; NaN if all were lost.
        peak: Largest error [rad or m].
        held: Median time until the error exceeds the tolerance; the window's length if it never does [s].
        travelled: RMS distance from each window's start, which is the error of a constant position [rad or m].
        prior_rms: `rms` of the description's inertias without friction, NaN if it loses a window; `None` without
            described inertias.
        windows: Number of windows.
        losses: Number of lost windows, by cause.
        seconds: Length of a window [s].
        tolerance: The tolerance [rad or m].
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
        """Number of windows that the model lost."""
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
        parameters: Standard parameters, shape (p,), or any with the same torque.
        observations: The recording, processed.
        seconds: Length of a window [s].
        tolerance: Position error that counts as lost [rad or m].
        feedback: Feedback of the recorded controller; without one the recorded torque acts alone.
        path: The recording.

    Raises:
        ArmidError: No window fits into a contiguous stretch of the recording.
    """
    if not (seconds > 0.0 and tolerance > 0.0):
        raise ArmidError(f"A window and a tolerance must be positive; found {seconds:g} s and {tolerance:g}.")
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
    """Consecutive windows of all runs with consecutive samples."""
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
            f"No stretch of {seconds:g} s without a gap or a masked row is left to roll the model out over.",
            remedy="choose a shorter window, or a recording whose rows follow each other.",
        )
    if len({run.rate for run, _ in parts}) > 1:
        raise ArmidError(
            "The runs of one recording differ in their rate.", remedy="give each rate a recording of its own."
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
    """True if every row of a window counts."""
    inside = (run.rows >= first) & (run.rows < first + length)
    return bool(run.mask[inside].all())


def _stayed(error: Array) -> NDArray[np.bool_]:
    """Flags of windows that were not lost, shape (W,)."""
    return np.asarray(np.isfinite(error).all(axis=(1, 2)))


def _rms(error: Array) -> Array:
    """RMS over the windows that were not lost, joint by joint."""
    there = _stayed(error)
    return np.sqrt((error[there] ** 2).mean(axis=(0, 1))) if there.any() else np.full(error.shape[2], np.nan)


def _peak(error: Array) -> Array:
    there = _stayed(error)
    return np.abs(error[there]).max(axis=(0, 1)) if there.any() else np.full(error.shape[2], np.nan)


def _held(error: Array, tolerance: float, step: float) -> Array:
    """Median over windows of the time until the error exceeds the tolerance, joint by joint [s]."""
    exceeded = ~(np.abs(error) <= tolerance)
    first = np.where(exceeded.any(axis=1), exceeded.argmax(axis=1), error.shape[1] - 1)
    return median(first) * step
