"""Faults of logs; each kind of fault is a class.

Each class of `FAULTS` is a kind of table [[faults]] in a `lab.toml`. A fault changes only the quantities that the
table names; all other quantities remain exactly the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np

from armid.checked_array import Array
from armid.errors import LabError
from armid.hashes import digest
from armid.lab.sensors import interpolate
from armid.lab.timing_faults import (
    QUANTITIES,
    Gap,
    LostRows,
    NoClock,
    RepeatedRows,
    ShuffledRows,
    check_share,
    clock_of,
)
from armid.maths.signals.zero_phase_filters import butterworth
from armid.measurement.recording import Recording


class Fault(Protocol):
    """Interface of the classes of faults."""

    name: ClassVar[str]
    """Name of the fault in a `lab.toml`."""

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Returns the recording with this fault; `rng` gives the random numbers that the fault needs."""
        ...


def spoil(recording: Recording, faults: Sequence[Fault], seed: int) -> Recording:
    """Applies faults to a recording, one after another; the seed determines all random numbers."""
    rng = np.random.default_rng(seed)
    for fault in faults:
        recording = fault.apply(recording, rng)
    parts = [x for x in (recording.q, recording.dq, recording.effort, recording.command) if x is not None]
    return replace(recording, sha256=digest(*parts))


def _column(recording: Recording, quantity: str, joint: int) -> Array:
    """Copy of a quantity of a recording, shape (N, n), after a check that the quantity and the joint exist."""
    values = getattr(recording, quantity, None) if quantity in QUANTITIES else None
    if values is None:
        raise LabError(
            f"The fault needs the quantity {quantity!r}, which the recording does not have.",
            possible=", ".join(QUANTITIES),
            remedy="name a quantity that the simulation logs.",
        )
    if not 0 <= joint < recording.n:
        raise LabError(
            f"The fault is for joint {joint}, but the joints of the recording have the indices 0 to "
            f"{recording.n - 1}.",
            remedy="give an index in this range.",
        )
    return values.copy()


@dataclass(frozen=True, slots=True)
class Delayed:
    """Delay of one quantity relative to all other quantities of the log.

    Attributes:
        seconds: Delay [s].
        quantity: `q`, `dq` or `effort`.
    """

    seconds: float = 0.01
    quantity: str = "effort"
    name: ClassVar[str] = "delayed"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `quantity` is delayed by `seconds`; before that time it has its first value."""
        del rng
        time = clock_of(recording)
        rate = (recording.samples - 1) / (time[-1] - time[0])
        places = np.arange(recording.samples) - self.seconds * rate
        late = interpolate(_column(recording, self.quantity, 0), np.clip(places, 0.0, recording.samples - 1.0))
        return replace(recording, **{self.quantity: late})


@dataclass(frozen=True, slots=True)
class Filtered:
    """Causal low-pass filter that a controller applies before logging.

    Attributes:
        cutoff: Corner frequency [Hz].
        quantity: `q`, `dq` or `effort`.
        order: Order of the Butterworth filter.
    """

    cutoff: float = 20.0
    quantity: str = "effort"
    order: int = 2
    name: ClassVar[str] = "filtered"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `quantity` is filtered with the corner frequency `cutoff`."""
        del rng
        from scipy.signal import sosfilt, sosfilt_zi

        values, time = _column(recording, self.quantity, 0), clock_of(recording)
        sections = butterworth(self.order, self.cutoff, (recording.samples - 1) / (time[-1] - time[0]))
        state = sosfilt_zi(sections)[:, :, None] * values[0]
        return replace(recording, **{self.quantity: sosfilt(sections, values, axis=0, zi=state)[0]})


@dataclass(frozen=True, slots=True)
class DeadChannel:
    """Channel (one quantity of one joint) that is always zero.

    Attributes:
        joint: Index of the joint, from 0.
        quantity: `q`, `dq` or `effort`.
    """

    joint: int = 0
    quantity: str = "effort"
    name: ClassVar[str] = "dead-channel"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `quantity` is zero for the joint `joint` in all rows."""
        del rng
        values = _column(recording, self.quantity, self.joint)
        values[:, self.joint] = 0.0
        return replace(recording, **{self.quantity: values})


@dataclass(frozen=True, slots=True)
class StuckChannel:
    """Channel (one quantity of one joint) whose value does not change any more after some time.

    Attributes:
        joint: Index of the joint, from 0.
        quantity: `q`, `dq` or `effort`.
        start: Time at which the value becomes constant, as a share of the duration of the recording.
        seconds: Time for which the value is constant [s]; infinite for the rest of the recording.
    """

    joint: int = 0
    quantity: str = "effort"
    start: float = 0.5
    seconds: float = math.inf
    name: ClassVar[str] = "stuck-channel"

    def __post_init__(self) -> None:
        check_share("start", self.start)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `quantity` of the joint `joint` is constant for `seconds` from the time `start` on."""
        del rng
        time, values = clock_of(recording), _column(recording, self.quantity, self.joint)
        begin = time[0] + self.start * (time[-1] - time[0])
        stuck = np.flatnonzero((time >= begin) & (time < begin + self.seconds))
        if len(stuck):
            values[stuck, self.joint] = values[stuck[0], self.joint]
        return replace(recording, **{self.quantity: values})


@dataclass(frozen=True, slots=True)
class Saturated:
    """Channel (one quantity of one joint) whose absolute value is limited.

    Attributes:
        joint: Index of the joint, from 0.
        share: Limit divided by the largest absolute value of the channel.
        quantity: `q`, `dq` or `effort`.
    """

    joint: int = 0
    share: float = 0.5
    quantity: str = "effort"
    name: ClassVar[str] = "saturated"

    def __post_init__(self) -> None:
        check_share("share", self.share)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `quantity` of the joint `joint` is limited to `share` of its largest absolute value."""
        del rng
        values = _column(recording, self.quantity, self.joint)
        bound = self.share * np.abs(values[:, self.joint]).max()
        values[:, self.joint] = np.clip(values[:, self.joint], -bound, bound)
        return replace(recording, **{self.quantity: values})


@dataclass(frozen=True, slots=True)
class Scaled:
    """Quantity that is logged in another unit or on the other side of a gear, for instance current instead of torque.

    Attributes:
        factors: Factors by which the values of the joints are multiplied; a single factor is used for all joints.
        quantity: `q`, `dq` or `effort`.
    """

    factors: tuple[float, ...] = (0.1,)
    quantity: str = "effort"
    name: ClassVar[str] = "scaled"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `quantity` is multiplied by `factors`."""
        del rng
        if len(self.factors) not in (1, recording.n):
            raise LabError(
                f"The fault 'scaled' has {len(self.factors)} factors for {recording.n} joints.",
                remedy="give one factor, or one for each joint.",
            )
        return replace(recording, **{self.quantity: _column(recording, self.quantity, 0) * np.array(self.factors)})


@dataclass(frozen=True, slots=True)
class TorqueSign:
    """Torques with the opposite sign.

    Attributes:
        joints: Indices of the joints, from 0; all joints if empty.
    """

    joints: tuple[int, ...] = ()
    name: ClassVar[str] = "torque-sign"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which the torques of the joints `joints` have the opposite sign."""
        del rng
        effort = _column(recording, "effort", max(self.joints, default=0))
        effort[:, list(self.joints) or slice(None)] *= -1.0
        return replace(recording, effort=effort)


@dataclass(frozen=True, slots=True)
class SwappedJoints:
    """Two joints whose values are exchanged, while the names of the channels stay the same.

    Attributes:
        first: Index of a joint, from 0.
        second: Index of another joint.
        quantities: Quantities whose values are exchanged: `q`, `dq` or `effort`.
    """

    first: int = 0
    second: int = 1
    quantities: tuple[str, ...] = ("effort",)
    name: ClassVar[str] = "swapped-joints"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which the values of the joints `first` and `second` are exchanged for all `quantities`."""
        del rng
        swapped: dict[str, Any] = {}
        for quantity in self.quantities:
            values = _column(recording, quantity, max(self.first, self.second))
            values[:, [self.first, self.second]] = values[:, [self.second, self.first]]
            swapped[quantity] = values
        return replace(recording, **swapped)


@dataclass(frozen=True, slots=True)
class Degrees:
    """Angles in degrees instead of radians; only for arms whose joints are all revolute."""

    name: ClassVar[str] = "degrees"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording with positions, velocities, accelerations and commands in degrees."""
        del rng
        present = {name: getattr(recording, name) for name in ("q", "dq", "ddq", "command")}
        return replace(recording, **{name: np.rad2deg(x) for name, x in present.items() if x is not None})


@dataclass(frozen=True, slots=True)
class PositionOffset:
    """Encoder with a wrong zero position.

    Attributes:
        joint: Index of the joint, from 0.
        offset: Error that is added to the position [rad or m].
    """

    joint: int = 1
    offset: float = 0.1
    name: ClassVar[str] = "position-offset"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which `offset` is added to the positions of the joint `joint`."""
        del rng
        q = _column(recording, "q", self.joint)
        q[:, self.joint] += self.offset
        return replace(recording, q=q)


@dataclass(frozen=True, slots=True)
class WrappedPosition:
    """Angles that are shifted by whole turns into an interval of one turn.

    Attributes:
        upper: Upper end of the interval of one turn that contains all logged angles [rad].
    """

    upper: float = math.pi
    name: ClassVar[str] = "wrapped-position"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording with all positions shifted by whole turns into the interval of one turn that ends at `upper`."""
        del rng
        turn = 2.0 * math.pi
        q = recording.q - turn * np.ceil((recording.q - self.upper) / turn)
        return replace(recording, q=q)


FAULTS: Mapping[str, type[Any]] = {
    kind.name: kind
    for kind in (
        LostRows,
        Gap,
        RepeatedRows,
        NoClock,
        ShuffledRows,
        Delayed,
        Filtered,
        DeadChannel,
        StuckChannel,
        Saturated,
        Scaled,
        TorqueSign,
        SwappedJoints,
        Degrees,
        PositionOffset,
        WrappedPosition,
    )
}
"""Classes of faults, by the name that stands in the key `kind` of a table [[faults]] of a `lab.toml`."""
