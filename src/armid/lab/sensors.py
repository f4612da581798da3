"""Model of the sensors of a log: each channel is filtered, delayed, sampled, disturbed and rounded, in this order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from armid.checked_array import Array
from armid.errors import LabError
from armid.hashes import digest
from armid.lab.simulated_motion import MARGIN, TrueMotion
from armid.maths.signals.zero_phase_filters import butterworth
from armid.measurement.recording import Recording

NEIGHBOURS = 4
"""Number of samples from which the cubic interpolation computes one logged value."""

HIGHEST_RATE = 8000.0
"""Largest rate of a log [Hz]."""


@dataclass(frozen=True, slots=True)
class SensorChannel:
    """Sensor of one quantity; values are in the unit of the quantity and equal for all joints.

    Attributes:
        noise: Standard deviation of white noise.
        resolution: Quantisation step; 0 for no quantisation.
        bias: Constant error.
        drift: Change of the constant error per second.
        delay: Delay [s].
        cutoff: Corner frequency of the controller's low-pass filter, a causal Butterworth filter [Hz]; 0 for no
            filter.
        order: Order of this filter.
    """

    noise: float = 0.0
    resolution: float = 0.0
    bias: float = 0.0
    drift: float = 0.0
    delay: float = 0.0
    cutoff: float = 0.0
    order: int = 2

    def __post_init__(self) -> None:
        for name in ("noise", "resolution", "delay", "cutoff"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise LabError(
                    f"The key `{name}` of a sensor must be finite and not negative; found {getattr(self, name)}.",
                    remedy=f"correct `{name}` in [sensing.position], [sensing.velocity] or [sensing.effort].",
                )
        if self.delay > MARGIN:
            raise LabError(
                f"The key `delay` of a sensor must be at most {MARGIN:g} s; found {self.delay:g} s.",
                remedy="give a smaller `delay` in [sensing.position], [sensing.velocity] or [sensing.effort].",
            )


@dataclass(frozen=True, slots=True)
class Sensing:
    """Sensors, rate and clock of a log.

    Attributes:
        rate: Rows per second [Hz].
        position: Sensors of positions.
        effort: Sensors of torques.
        velocity: Sensors of velocities; `None` if velocities are not logged.
        side: Side on which positions and torques are measured: `drive` (the torque includes friction and rotors) or
            `link`.
        jitter: Standard deviation of the error of the sample times [s]; an error is at most a fifth of the sample
            time.
        stamps: Content of the time column: `true` times, `even` (uniform) times, or `none`.
    """

    rate: float = 1000.0
    position: SensorChannel = field(default_factory=lambda: SensorChannel(noise=1e-5))
    effort: SensorChannel = field(default_factory=lambda: SensorChannel(noise=0.3))
    velocity: SensorChannel | None = None
    side: Literal["drive", "link"] = "drive"
    jitter: float = 0.0
    stamps: Literal["true", "even", "none"] = "true"

    def __post_init__(self) -> None:
        if not 0.0 < self.rate <= HIGHEST_RATE:
            raise LabError(
                f"The rate of a log must be above 0 and at most {HIGHEST_RATE:g} Hz; found {self.rate:g} Hz.",
                remedy="correct the key `rate` of the table [sensing].",
            )
        if self.side not in ("drive", "link"):
            raise LabError(
                f"The key `side` has the unknown value {self.side!r}.",
                possible="drive, link",
                remedy="write one of these values.",
            )
        if self.stamps not in ("true", "even", "none"):
            raise LabError(
                f"The key `stamps` has the unknown value {self.stamps!r}.",
                possible="true, even, none",
                remedy="write one of these values.",
            )
        if not 0.0 <= self.jitter < math.inf:
            raise LabError(
                f"The key `jitter` must be finite and not negative; found {self.jitter}.",
                remedy="give a `jitter` of 0 or more seconds in the table [sensing].",
            )


MOST_JITTER = 0.2
"""Largest error of a sample time, divided by the time between two rows; with larger errors, rows could change their
order."""


def sense(
    trace: TrueMotion, sensing: Sensing, joint_names: tuple[str, ...], source: str, rng: np.random.Generator
) -> Recording:
    """Recording that sensors make of a simulated motion.

    Args:
        trace: True motion, at a rate that is not below that of the log.
        sensing: Sensors, rate and clock of the log.
        joint_names: Names of the channels.
        source: Name of the recording.
        rng: Random generator of noise and jitter.
    """
    even = np.arange(round((trace.time[-1] + trace.time[1] - trace.time[0]) * sensing.rate)) / sensing.rate
    taken = even
    if sensing.jitter:
        most = MOST_JITTER / sensing.rate
        taken = even + np.clip(rng.normal(0.0, sensing.jitter, len(even)), -most, most)
        taken = np.minimum(taken, trace.time[-1])
    links = sensing.side == "link" or trace.drive_q is None
    q = trace.q if links else trace.drive_q
    dq = trace.dq if links else trace.drive_dq
    effort = trace.effort if sensing.side == "drive" else trace.transmitted
    assert q is not None and dq is not None
    logged: dict[str, Any] = {
        "q": logged_values(trace.time, q, taken, sensing.position, rng),
        "effort": logged_values(trace.time, effort, taken, sensing.effort, rng),
    }
    if sensing.velocity is not None:
        logged["dq"] = logged_values(trace.time, dq, taken, sensing.velocity, rng)
    return Recording(
        time={"true": taken, "even": even, "none": None}[sensing.stamps],
        **logged,
        rate=sensing.rate if sensing.stamps == "none" else None,
        joint_names=joint_names,
        consecutive=True,
        source=source,
        sha256=digest(*logged.values()),
    )


def logged_values(
    time: Array, values: Array, taken: Array, channel: SensorChannel, rng: np.random.Generator
) -> Array:
    """Values (M, n) that the sensors of one quantity log at times `taken` (M,) [s], from its true values (N, n)."""
    rate = 1.0 / (time[1] - time[0])
    if channel.cutoff:
        from scipy.signal import sosfilt, sosfilt_zi

        sections = butterworth(channel.order, channel.cutoff, rate)
        state = sosfilt_zi(sections)[:, :, None] * values[0]
        values = sosfilt(sections, values, axis=0, zi=state)[0]
    result = interpolate(values, (taken - channel.delay - time[0]) * rate)
    result += channel.bias + channel.drift * taken[:, None]
    if channel.noise:
        result += channel.noise * rng.standard_normal(result.shape)
    return np.round(result / channel.resolution) * channel.resolution if channel.resolution else result


def interpolate(values: Array, places: Array) -> Array:
    """Values (N, n) at fractional indices (M,), by cubic polynomials through four neighbours; exact at samples."""
    whole = np.round(places)
    if np.abs(places - whole).max(initial=0.0) < 1e-6:  # times on the grid, to rounding
        return values[np.clip(whole.astype(np.intp), 0, len(values) - 1)].copy()
    first = np.clip(np.floor(places).astype(np.intp) - 1, 0, max(len(values) - NEIGHBOURS, 0))
    s = np.clip(places - first, 0.0, NEIGHBOURS - 1.0)
    result = np.zeros((len(places), values.shape[1]))
    for k in range(NEIGHBOURS):
        others = [m for m in range(NEIGHBOURS) if m != k]
        weight = np.prod([(s - m) / (k - m) for m in others], axis=0)
        result += weight[:, None] * values[first + k]
    return result
