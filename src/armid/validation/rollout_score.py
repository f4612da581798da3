"""Position error of the rollout of a model over windows of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.maths.median import median
from armid.validation.simulated_windows import SimulatedWindows


@dataclass(frozen=True, slots=True)
class Losses:
    """Numbers of lost windows, by cause; a window is lost if its simulation ended early.

    Attributes:
        ran_away: Number of windows that diverged.
        indefinite: Number of windows in which the mass matrix was not positive definite.
        nominal: Number of windows that are lost for either cause in another simulation, with the inertial parameters
            of the description and without friction.
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
        """Number of windows that are lost in the simulation with the estimated model."""
        return self.losses.ran_away + self.losses.indefinite

    def __post_init__(self) -> None:
        for name in ("rms", "peak", "held", "travelled", "prior_rms"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, array(value, (None,), name, finite=False))


def score_motion(simulated: SimulatedWindows, *, tolerance: float = 0.01, path: str = "") -> MotionScore:
    """Computes the position error of a rollout over the windows of one recording.

    Args:
        simulated: The rollout.
        tolerance: Position error up to which the time `held` is counted [rad or m].
        path: The recording.

    Raises:
        ArmidError: The tolerance is not positive.
    """
    if not tolerance > 0.0:
        raise ArmidError(
            f"The tolerance of the position error must be positive; found {tolerance:g}.",
            remedy="give, for instance, 0.01 rad or m.",
        )
    windows, found, nominal = simulated.windows, simulated.found, simulated.nominal
    error = found.q - windows.q
    losses = Losses(int(found.ran_away.sum()), int(found.indefinite.sum()))
    prior_rms = None
    if nominal is not None:
        losses = replace(losses, nominal=int((~nominal.stayed).sum()))
        # Without lost windows only: of a diverging model only the beginnings would count.
        prior_rms = _rms(nominal.q - windows.q) if nominal.stayed.all() else np.full(error.shape[2], np.nan)
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


def _stayed(error: Array) -> NDArray[np.bool_]:
    """Mask of windows that are not lost, shape (W,), from position errors (W, S, n) that are NaN after a loss."""
    return np.asarray(np.isfinite(error).all(axis=(1, 2)))


def _rms(error: Array) -> Array:
    """RMS of position errors (W, S, n) over the windows that are not lost, for each joint, shape (n,) [rad or m]."""
    there = _stayed(error)
    return np.sqrt((error[there] ** 2).mean(axis=(0, 1))) if there.any() else np.full(error.shape[2], np.nan)


def _peak(error: Array) -> Array:
    there = _stayed(error)
    return np.abs(error[there]).max(axis=(0, 1)) if there.any() else np.full(error.shape[2], np.nan)


def _held(error: Array, tolerance: float, step: float) -> Array:
    """Median over the windows of the time until the error exceeds the tolerance, for each joint, shape (n,) [s].

    Args:
        error: Position errors, shape (W, S, n) [rad or m].
        tolerance: Tolerance of the position error [rad or m].
        step: Sample time [s].
    """
    exceeded = ~(np.abs(error) <= tolerance)
    first = np.where(exceeded.any(axis=1), exceeded.argmax(axis=1), error.shape[1] - 1)
    return median(first) * step
