"""Rollout of a model over the windows of one recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics_model import DynamicsModel
from armid.validation.rollout import Feedback, RolledOut, Windows, roll_out

MOST_WINDOWS = 200
"""Largest number of windows of a recording; if there are more, an evenly spaced selection is used."""


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedWindows:
    """Windows of a recording, with the motion and the torque of the model in them.

    Attributes:
        time: Times of the samples, as in the recording, shape (W, S) [s].
        windows: Recorded motion and torque.
        found: Simulated motion and torque with the given parameters.
        nominal: Simulated motion and torque with the inertial parameters of the description, without friction; `None`
            if the description has no inertial parameters.
    """

    time: Array
    windows: Windows
    found: RolledOut
    nominal: RolledOut | None


def simulate_windows(
    model: DynamicsModel,
    parameters: Array,
    observations: Observations,
    *,
    seconds: float = 0.5,
    feedback: Feedback | None = None,
) -> SimulatedWindows:
    """Simulates a model over the windows of one recording.

    Args:
        model: Arm and torque terms.
        parameters: Standard parameters, or other values that give the same torque, shape (p,).
        observations: The processed recording.
        seconds: Length of a window [s].
        feedback: Feedback of the controller of the recording; if not given, only the recorded torque acts.

    Raises:
        ArmidError: The length is not positive, no window fits into a contiguous segment of the recording, or the
            sample rates of its runs differ.
    """
    if not seconds > 0.0:
        raise ArmidError(
            f"The length of a window must be positive; found {seconds:g} s.", remedy="give, for instance, 0.5 s."
        )
    time, windows = _cut(model, observations, seconds)
    prior = model.nominal_parameters()
    nominal = None if prior is None else roll_out(model, prior, windows, feedback)
    return SimulatedWindows(time, windows, roll_out(model, parameters, windows, feedback), nominal)


def _cut(model: DynamicsModel, observations: Observations, seconds: float) -> tuple[Array, Windows]:
    """Cuts the runs with consecutive samples into consecutive windows of a given length [s].

    Returns:
        Times of the samples of each window [s], shape (W, S), and the windows.
    """
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
    windows = Windows(
        *(np.stack([getattr(run.motion, name)[s : s + length] for run, s in parts]) for name in ("q", "dq", "ddq")),
        torque=np.stack([run.torque[s : s + length] for run, s in parts]),
        memory=np.stack(memory),
        step=step,
    )
    return np.stack([run.motion.time[s : s + length] for run, s in parts]), windows


def _whole(run: ObservedRun, first: int, length: int) -> bool:
    """True if all rows of a window of a run are in use.

    Args:
        run: The run.
        first: Index of the first sample of the window.
        length: Number of samples of the window.
    """
    inside = (run.rows >= first) & (run.rows < first + length)
    return bool(run.mask[inside].all())
