"""Recording of measured motion and effort, and of the commanded motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import Finding, RecordingError
from armid.notebook_display import Displayed, Summary, spans


def _all_valid() -> NDArray[np.bool_]:
    """Default mask of valid samples: a single true value, which is broadcast to all samples and channels."""
    return np.ones((), dtype=np.bool_)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Recording(Displayed):
    """Measured motion and effort, and commanded positions, N samples of n channels.

    A reader returns the recording as it is in the file. `to_robot_convention` returns a recording in the joint order
    of the robot, in SI units, on the joint side, and with the signs of the URDF.

    Attributes:
        time: Sample times on the clock of the recording, shape (N,) [s]; `None` if there is no clock.
        q: Positions, shape (N, n) [rad or m].
        dq: Velocities, shape (N, n) [rad/s or m/s]; `None` if not recorded.
        ddq: Accelerations, shape (N, n) [rad/s² or m/s²]; `None` if not recorded.
        effort: Torques, forces or motor currents, shape (N, n) [N·m, N or A]; `None` if not recorded.
        command: Commanded positions at the times of the samples, shape (N, n) [rad or m]; `None` if not recorded.
        joint_names: Names of the n channels; empty if the file only numbers its channels.
        rate: Sample rate [Hz], from the log format, if there is no clock.
        consecutive: True if the rows are consecutive in time; `None` if this is not known.
        valid: Mask of the samples in use, shape (N, n), or (N,) for all channels; all samples if not given.
        effort_is_current: True if the effort is a motor current, which has not yet been converted to torque.
        columns: Names of the columns of each quantity, if the file has columns.
        number: Number of each sample in the original log, shape (N,), if some samples have been left out.
        logged_rate: Sample rate of the log [Hz], if the samples were reduced to a lower rate; otherwise `None`.
        guessed: Fields of the log format that the reader has detected, for instance the columns.
        findings: Findings of the reader.
        source: Path of the file.
        sha256: SHA-256 of the file; empty without a file.
    """

    time: Array | None
    q: Array
    dq: Array | None = None
    ddq: Array | None = None
    effort: Array | None = None
    command: Array | None = None
    joint_names: tuple[str, ...] = ()
    rate: float | None = None
    consecutive: bool | None = None
    valid: NDArray[np.bool_] = field(default_factory=_all_valid)
    effort_is_current: bool = False
    columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, "tuple[str, ...]"])
    number: NDArray[np.int64] | None = None
    logged_rate: float | None = None
    guessed: Mapping[str, Any] = field(default_factory=dict[str, Any])
    findings: tuple[Finding, ...] = ()
    source: str = ""
    sha256: str = ""

    def __post_init__(self) -> None:
        q = array(self.q, (None, None), "q", finite=False)
        samples, n = q.shape
        object.__setattr__(self, "q", q)
        for name in ("dq", "ddq", "effort", "command"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, self._fitting(values, q.shape, name))
        if self.time is not None:
            object.__setattr__(self, "time", self._fitting(self.time, (samples,), "time"))
        if self.number is not None and len(self.number) != samples:
            raise RecordingError(
                f"{self.source or 'The recording'} has {samples} samples, but `number` has {len(self.number)} "
                "entries.",
                remedy="give one number for each sample, or leave `number` out.",
            )
        object.__setattr__(self, "joint_names", tuple(str(name) for name in self.joint_names))
        if self.joint_names and len(self.joint_names) != n:
            raise RecordingError(
                f"{self.source or 'The recording'} has {n} channels, but `joint_names` has {len(self.joint_names)} "
                "entries.",
                remedy="give one name for each channel, or leave `joint_names` out.",
            )
        valid = np.array(self.valid, dtype=np.bool_)
        if valid.shape not in ((), (samples,), (samples, n)):
            raise RecordingError(f"`valid` must have the shape {(samples, n)} or {(samples,)}; found {valid.shape}.")
        valid = np.broadcast_to(valid[:, None] if valid.ndim == 1 else valid, (samples, n)).copy()
        valid.setflags(write=False)
        object.__setattr__(self, "valid", valid)

    def _fitting(self, values: Array, shape: tuple[int, ...], name: str) -> Array:
        """Converts values to an array and checks that its shape agrees with the shape of the positions q."""
        found = np.shape(values)
        if found != shape:
            raise RecordingError(
                f"{self.source or 'The recording'}: {name} has shape {found}, but it must have shape {shape}, "
                f"because q has shape {self.q.shape}.",
                remedy="give every quantity one row for each sample and one column for each joint.",
            )
        return array(values, shape, name, finite=False)

    def summary(self) -> Summary:
        """Table with the range of each quantity in each channel."""
        effort = "current" if self.effort_is_current else "effort"
        named = {"q": self.q, "dq": self.dq, "ddq": self.ddq, effort: self.effort, "command": self.command}
        known = {name: values for name, values in named.items() if values is not None}
        rows = tuple((name, *row) for name, row in zip(self.channels, spans(*known.values()), strict=True))
        long = "no clock" if self.time is None else f"{float(np.ptp(self.time)):.4g} s"
        title = f"{self.source or 'recording'}: {self.samples} samples, {long}"
        return Summary(title, ("joint", *known), rows, f"{self.valid.mean():.1%} of the samples are in use")

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return self.q.shape[0]

    @property
    def n(self) -> int:
        """Number of channels."""
        return self.q.shape[1]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels; if the file has no names, their numbers, counted from 1."""
        return self.joint_names or tuple(str(i + 1) for i in range(self.n))


def recording_error(code: str, recording: Recording, problem: str, remedy: str, possible: str = "") -> RecordingError:
    """Error about a recording, with the code of the corresponding finding of the doctor."""
    return RecordingError(problem, possible=possible, remedy=remedy, source=recording.source, code=code)


def select_rows(recording: Recording, keep: NDArray[np.bool_]) -> Recording:
    """Recording with only those rows that a mask of shape (N,) selects."""
    if keep.all():
        return recording
    names = ("time", "q", "dq", "ddq", "effort", "command", "valid")
    quantities = {name: values[keep] for name in names if (values := getattr(recording, name)) is not None}
    number = np.arange(recording.samples) if recording.number is None else recording.number
    return replace(recording, number=number[keep], **quantities)
