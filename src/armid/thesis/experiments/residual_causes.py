"""Search for causes of the residual of the thesis: simulation and identification of candidate causes.

There are three observations. The printed standard deviations imply the size of the residual. The moment of inertia
ZZR_1 in Table 4.1 is far larger than that of the description. The thesis states that its simulation overestimates the
oscillations of the torque between the jumps of friction. Each candidate changes the virtual arm or its recording in
one way. The recording is then identified by Algorithm 3 as printed, and the result is compared with the observations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.hashes import digest
from armid.information.filtering import filtered_torque
from armid.lab.friction import ToothRipple
from armid.lab.known_arms import KnownArm, truth_of, with_effects
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing
from armid.lab.simulation import simulate
from armid.maths.signals.fourier_transform import frequencies, inverse, spectrum
from armid.maths.signals.zero_phase_filters import butterworth
from armid.measurement.processing.options import THESIS, ProcessingOptions
from armid.measurement.recording import Recording
from armid.thesis.algorithm import Fitted, estimate, observed
from armid.thesis.published import published
from armid.thesis.setting import Setting

RATE = 1000.0
"""Sample rate of the simulated recordings [Hz]. At 8 kHz the residuals of the filtered torque are the same."""

ENDS, SHORTEST = 0.3, 0.5
"""Time that is left out on both sides of each reversal, and shortest remaining interval that is used [s]. The filter
spreads the jump of friction over the left-out time: with a cut-off of 3.5 Hz, over one period of this frequency,
0.29 s."""

WINDOW, DEGREE = 0.6, 4
"""Window [s] and degree of the polynomial that separates fast from slow oscillation. The window contains two periods
of 3.5 Hz. The deviation of the motion's torque from the polynomial is below 0.001 N·m without oscillation."""

CLOSE, MORE = 0.25, 1.05
"""Largest relative difference of ZZR_1 from Table 4.1 with which a candidate reproduces ZZR_1, and smallest ratio of
predicted to measured oscillation with which the prediction counts as too large. The ratio is 1.03 without any cause
added."""

SHIFTS = (-0.05, -0.1, -0.2, 0.1, 0.2)
"""Delays of the torque relative to the positions that are tried [s]; for negative values the positions are
delayed."""

UNALIGNED = 0.3
"""Standard deviation of the start times of repetitions that are averaged without alignment [s]."""

SLOW_RIPPLE = (0.2, 20.0)
"""Amplitude (divided by FS) and number of waves per radian of a ripple that is slow enough to pass the filter."""

FORWARD = ProcessingOptions(
    family="none", columns=False, decimate=0.0, derivatives="central", edges="periodic", trim=0.0, standstill="keep"
)
"""Processing of a recording that is already filtered."""

EFFECTS = {
    "rotor": "rotor inertia of the drives",
    "stribeck": "Stribeck friction, 30 % of FS",
    "asymmetric": "friction that differs by direction, 10 % of FS",
    "load": "friction in proportion to load, 3 %",
    "hysteresis": "hysteresis at reversals, 40 % of FS",
    "ripple": "torque ripple of gear or current loop, 5 % of FS, 200 waves per radian",
    "temperature": "viscous friction that falls with warmth",
}
"""Titles of the simulated effects that need no closed loop, by the name of the effect in the lab; the sizes are from
the documentation of the lab."""


FRICTION = tuple(key for key in EFFECTS if key != "rotor")
"""Names of the effects in `EFFECTS` that concern friction."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Candidate cause, with the result of Algorithm 3 as printed.

    Attributes:
        key: Unique name of the candidate.
        title: Description of the candidate.
        residual: Root mean square of the filtered residuals, over all joints [N·m].
        inertia: Identified ZZR_1 and ZZR_2 [kg·m²].
        second_moments: Norm of the difference between identified and published moments and products of inertia,
            divided by the norm of the published ones.
        beyond: Share of samples, over all joints, outside the lines of Figure 4.3 of the thesis.
        oscillation: Ratio of predicted to measured oscillation between jumps of friction, median over the joints.
    """

    key: str
    title: str
    residual: float
    inertia: tuple[float, float]
    second_moments: float
    beyond: float
    oscillation: float


@dataclass(frozen=True, eq=False, slots=True)
class CauseSearch:
    """Result of the search for causes.

    Attributes:
        rows: The candidates, first the virtual arm without any cause added.
        lag: Delay of the positions relative to the torque with which ZZR_1 of Table 4.1 is identified, without and
            with rotor inertia [s].
        forward_lag: Difference of the low-frequency delays of two Butterworth filters of order 20 that run forwards
            only, with cut-offs of 3 and 3.5 Hz [s].
        typical: RMS residual over all joints if the RMS of each joint is half the distance of the lines of Figure 4.3
            from zero, so that a twentieth of normally distributed samples is outside the lines [N·m].
    """

    rows: tuple[Cause, ...]
    lag: tuple[float, float]
    forward_lag: float
    typical: float


def causes(setting: Setting, processing: ProcessingOptions, tell: Callable[[float], None]) -> CauseSearch:
    """Simulates every candidate cause, and identifies the virtual arm from the recording.

    Args:
        setting: Arm, true parameters and motions.
        processing: Processing of Algorithm 3 as printed.
        tell: Callback with the share that is done.
    """
    trial = _Trial(setting, processing)
    plain, rotor = trial.recorded(), trial.recorded("rotor")
    trial.add("none", "none: as printed, on the virtual arm", plain)
    tell(0.1)
    for effect, title in EFFECTS.items():
        trial.add(effect, title, rotor if effect == "rotor" else trial.recorded(effect))
    trial.add("slow-ripple", "ripple of 20 % of FS, 20 waves per radian", trial.recorded(change=_slow_ripple))
    trial.add("all", "all of these effects", trial.recorded(*EFFECTS))
    tell(0.4)
    trial.add("elastic", "elastic joints, in closed loop", trial.recorded("elastic", mode="closed-loop"))
    tell(0.8)
    trial.add("unaligned", "repetitions averaged without alignment, 0.3 s", _unaligned(plain))
    for shift in SHIFTS:
        trial.add(f"delay-{shift:g}", _late(shift), _shifted(plain, shift))
    lag = tuple(trial.lag(recording) for recording in (plain, rotor))
    for name, recording, time in (("lag", plain, lag[0]), ("rotor-lag", rotor, lag[1])):
        also = " and rotor inertia" if recording is rotor else ""
        trial.add(name, f"{_late(-time)}{also}, chosen for ZZR_1", _shifted(recording, -time))
    for name, recording in (("forward", plain), ("rotor-forward", rotor)):
        also = " and rotor inertia" if recording is rotor else ""
        title = f"both filters of order 20 run forwards only{also}"
        trial.add(name, title, _forward(recording), FORWARD)
    tell(1.0)
    cutoffs = (THESIS.motion_cutoff or THESIS.band.cutoff, THESIS.band.cutoff)
    delays = [_delay(THESIS.order, cutoff) for cutoff in cutoffs]
    return CauseSearch(tuple(trial.rows), (lag[0], lag[1]), delays[0] - delays[1], trial.typical)


class _Trial:
    """Builder of the table of candidates."""

    def __init__(self, setting: Setting, processing: ProcessingOptions) -> None:
        self.setting, self.processing = setting, processing
        self.truth = truth_of(setting.hanging.dynamics.robot)
        self.rows: list[Cause] = []
        self.typical = 0.0

    def recorded(
        self, *effects: str, mode: str = "inverse-dynamics", change: Callable[[KnownArm], KnownArm] | None = None
    ) -> Recording:
        """Simulates a recording of one period of Table A.1 of the thesis by an arm with additional effects.

        Args:
            effects: Names of the effects in the lab.
            mode: Mode of the simulation in the lab.
            change: Function that changes the simulated arm.
        """
        truth = with_effects(self.truth, effects) if change is None else change(self.truth)
        physics = self.setting.extent.physics_rate
        options = LabOptions(mode=mode, physics_rate=physics, sensing=Sensing(RATE))  # pyright: ignore[reportArgumentType]
        return simulate(truth, self.setting.train, options, seed=1).recording

    def identified(self, recording: Recording, processing: ProcessingOptions | None = None) -> Fitted:
        chosen = processing or self.processing
        period = self.setting.train.period if chosen.edges == "periodic" else None
        return estimate(self.setting.literal, observed(self.setting, recording, chosen, period))

    def lag(self, recording: Recording) -> float:
        """Delay of the positions relative to the torque with which ZZR_1 of Table 4.1 is identified [s].

        It is computed from two delays, since ZZR_1 is a linear function of the delay.
        """
        ends = [_value(self.identified(_shifted(recording, -time)), "ZZR_1") for time in (0.0, 0.1)]
        return float(0.1 * (published().base["ZZR_1"][0] - ends[0]) / (ends[1] - ends[0]))

    def add(self, key: str, title: str, recording: Recording, processing: ProcessingOptions | None = None) -> None:
        """Identifies the arm from a recording, and adds the result to the table of candidates."""
        fitted = self.identified(recording, processing)
        (run,) = fitted.observations.runs
        rows = run.rows
        measured = filtered_torque(run, fitted.observations.band)[rows]
        predicted = fitted.model.dynamics.torque(run.motion, fitted.model.theta(fitted.fit.values))[rows]
        lines = 0.1 * np.ptp(measured, axis=0)
        if not self.rows:
            self.typical = float(np.sqrt(np.mean((0.5 * lines) ** 2)))
        off = measured - predicted
        time, dq = run.motion.time[rows], run.motion.dq[rows]
        ratio = oscillation(predicted, dq, time) / oscillation(measured, dq, time)
        self.rows.append(
            Cause(
                key,
                title,
                fitted.residual,
                (_value(fitted, "ZZR_1"), _value(fitted, "ZZR_2")),
                _second_moments(fitted),
                float(np.mean(np.abs(off) > lines)),
                float(np.nanmedian(ratio)),
            )
        )


def oscillation(torque: Array, dq: Array, time: Array) -> Array:
    """Oscillation of a torque between jumps of friction, shape (n,) [N·m].

    It is the RMS deviation from the mean of each interval between two reversals of the joint, without the time near
    the reversals; NaN for a joint without such an interval.

    Args:
        torque: Torque, shape (N, n) [N·m].
        dq: Velocities, shape (N, n) [rad/s].
        time: Time of each sample, shape (N,) [s].
    """
    found = np.full(torque.shape[1], np.nan)
    for j, values in enumerate(torque.T):
        parts = [values[rows] - values[rows].mean() for rows in between_jumps(dq[:, j], time)]
        if parts:
            found[j] = np.sqrt(np.mean(np.concatenate(parts) ** 2))
    return found


def ringing(torque: Array, dq: Array, time: Array) -> Array:
    """Fast oscillation of a torque between jumps of friction, shape (n,) [N·m].

    It is the RMS deviation from a polynomial of fourth degree that is fitted in a moving window of 0.6 s. The
    polynomial follows the torque of the motion, but not the oscillation next to a jump that was filtered at 3.5 Hz.

    Args:
        torque: Torque, shape (N, n) [N·m].
        dq: Velocities, shape (N, n) [rad/s].
        time: Time of each sample, shape (N,) [s].
    """
    half = round(0.5 * WINDOW / (time[1] - time[0]))
    powers = np.vander(np.arange(-half, half + 1) / half, DEGREE + 1, increasing=True)
    middle = np.linalg.pinv(powers)[0]
    found = np.full(torque.shape[1], np.nan)
    for j, values in enumerate(torque.T):
        stretches = [values[rows] for rows in between_jumps(dq[:, j], time)]
        parts = [x[half:-half] - np.convolve(x, middle, "valid") for x in stretches if len(x) > 2 * half]
        if parts:
            found[j] = np.sqrt(np.mean(np.concatenate(parts) ** 2))
    return found


def between_jumps(dq: Array, time: Array) -> list[slice]:
    """Rows of each interval between two reversals of a joint, without the time near the reversals.

    Args:
        dq: Velocity of the joint, shape (N,) [rad/s].
        time: Time of each sample, shape (N,) [s].
    """
    cuts = time[np.flatnonzero(np.diff(np.sign(dq)))]
    ends = zip(cuts[:-1] + ENDS, cuts[1:] - ENDS, strict=True)
    return [slice(*np.searchsorted(time, (a, b))) for a, b in ends if b - a >= SHORTEST]


def _value(fitted: Fitted, name: str) -> float:
    values: dict[str, float] = dict(zip(fitted.fit.names, fitted.fit.values.tolist(), strict=True))
    return values[name]


def _second_moments(fitted: Fitted) -> float:
    names = fitted.model.base.names
    which = [k for k, name in enumerate(names) if name.symbol in {"XX", "XY", "XZ", "YY", "YZ", "ZZ"}]
    printed = np.array([published().base[names[k]][0] for k in which])
    return float(np.linalg.norm(fitted.fit.values[which] - printed) / np.linalg.norm(printed))


def _late(shift: float) -> str:
    return f"torque {shift:.2g} s late" if shift > 0.0 else f"positions {-shift:.2g} s late"


def _shifted(recording: Recording, shift: float) -> Recording:
    """Recording of one period in which the torque is delayed by `shift` [s], rounded to whole samples."""
    assert recording.effort is not None  # the lab logs torque
    return _changed(recording, recording.q, np.roll(recording.effort, round(shift * RATE), axis=0))


def _unaligned(recording: Recording) -> Recording:
    """Mean of five copies of a recorded period, each shifted by a random time, as if averaged without alignment."""
    assert recording.effort is not None  # the lab logs torque
    starts = np.round(UNALIGNED * RATE * np.random.default_rng(0).standard_normal(5)).astype(int)
    q, effort = (np.mean([np.roll(x, k, axis=0) for k in starts], axis=0) for x in (recording.q, recording.effort))
    return _changed(recording, q, effort)


def _forward(recording: Recording) -> Recording:
    """Recording of one period after the filters of the thesis in forward direction only; the motion is periodic."""
    assert recording.effort is not None  # the lab logs torque
    cutoffs = (THESIS.motion_cutoff or THESIS.band.cutoff, THESIS.band.cutoff)
    signals = (recording.q, recording.effort)
    q, effort = (_causal(x, butterworth(THESIS.order, f, RATE)) for x, f in zip(signals, cutoffs, strict=True))
    return _changed(recording, q, effort)


def _causal(x: Array, sections: Array) -> Array:
    """Response (N, n) of a filter to a periodic signal (N, n), applied forwards.

    Args:
        x: One period of the signal, shape (N, n).
        sections: Second-order sections of the filter, shape (k, 6).
    """
    delay = np.exp(-2j * np.pi * frequencies(len(x)))[:, None] ** np.arange(3)
    response = np.prod((delay @ sections[:, :3].T) / (delay @ sections[:, 3:].T), axis=1)
    return inverse(spectrum(x) * response[:, None], len(x))


def _delay(order: int, cutoff: float) -> float:
    """Delay of a Butterworth low-pass filter at low frequency [s]: 1 / (2 π f_c sin(π / 2n)) for order n."""
    return float(1.0 / (2.0 * np.pi * cutoff * np.sin(0.5 * np.pi / order)))


def _changed(recording: Recording, q: Array, effort: Array) -> Recording:
    return replace(recording, q=q, effort=effort, sha256=digest(q, effort))


def _slow_ripple(truth: KnownArm) -> KnownArm:
    share, waves = SLOW_RIPPLE
    law = truth.friction
    ripple = ToothRipple(share * law.coulomb, np.full(law.n, waves), np.zeros(law.n))
    return replace(truth, friction=replace(law, ripple=ripple))


def reproduced(row: Cause, implied: Sequence[float]) -> tuple[bool, bool, bool]:
    """Tests which observations a candidate reproduces: size of the residual, ZZR_1 of Table 4.1, and oscillations.

    Oscillations are reproduced if the prediction overestimates them.

    Args:
        row: The candidate.
        implied: Smallest and largest residual that the printed standard deviations imply [N·m].
    """
    printed = published().base["ZZR_1"][0]
    return (
        implied[0] <= row.residual <= implied[1],
        abs(row.inertia[0] - printed) <= CLOSE * printed,
        row.oscillation >= MORE,
    )
