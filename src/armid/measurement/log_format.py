"""Log format: properties of a recording that its file does not contain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ArmidError, RecordingError
from armid.values import Array, array

QUANTITIES = ("time", "q", "dq", "ddq", "effort")
"""Quantities that columns can hold."""

SINGULAR = 1e-12
"""Smallest over largest singular value below which a transmission counts as singular: rounding of gear ratios
leaves 1e-16, real gears stay above 1e-4."""

LONGEST_DELAY = 1.0
"""Largest accepted delay between channels; a larger one was surely not given in seconds [s]."""


@dataclass(frozen=True, slots=True)
class FormatPreset:
    """Columns of a well-known log.

    Attributes:
        columns: Column name or pattern for each quantity.
        time_unit: Length of one unit of the time column [s].
    """

    columns: Mapping[str, tuple[str, ...]]
    time_unit: float = 1.0


PRESETS: Mapping[str, FormatPreset] = {
    # RTDE recorders of Universal Robots name a vector's elements name_0 … name_5. The effort is the motor
    # current [A]; the controller's model torque is there as target_moment_{0}.
    "ur-rtde": FormatPreset(
        {
            "time": ("timestamp",),
            "q": ("actual_q_{0}",),
            "dq": ("actual_qd_{0}",),
            "effort": ("actual_current_{0}",),
        }
    ),
    # CSV of pyfri's collect_data: controller clock in seconds and nanoseconds, measured position and torque; FRI has
    # no velocity. KUKA's torque mostly has the opposite sign to the URDF.
    "kuka-fri": FormatPreset({"time": ("tsec", "tnsec"), "q": ("mp{}",), "effort": ("mt{}",)}),
    # CSV of franka::logToCSV; its time is in milliseconds.
    "libfranka": FormatPreset(
        {
            "time": ("time",),
            "q": ("state.q[{0}]",),
            "dq": ("state.dq[{0}]",),
            "effort": ("state.tau_J[{0}]",),
        },
        time_unit=1e-3,
    ),
}
"""Known logs by name."""


@dataclass(frozen=True, eq=False, slots=True)
class LogFormat:
    """Description of how to read one recording; the defaults suit SI units, joint side and the URDF's signs.

    Lists with one entry for each joint are in the robot's joint order, not in the file's.

    Attributes:
        rate: Samples per second [Hz]; only where there is no clock.
        consecutive: Whether rows are consecutive in time; detected when `None`.
        torque_sign: +1 or -1, one for all joints or one each: measured = sign · (URDF convention).
        position_sign: Likewise for positions, velocities and accelerations.
        drive_gain: Torque per ampere where the effort is a current, shape (n,) [N·m/A].
        drive_gain_deviation: Relative standard deviation of the gains, one or shape (n,).
        transmission: Where the log is motor-side: N, shape (n, n), with q_motor = N (q - joint_offset) and
            torque_joint = Nᵀ torque_motor.
        joint_offset: Joint position where the logged one is zero, shape (n,) [rad or m].
        delay: Delay of the logged torque relative to the positions, negative where it leads; one or shape (n,) [s].
        columns: For `time`, `q`, `dq`, `ddq`, `effort`: a pattern in which `{}` counts from 1 and `{0}` from 0,
            the name of one column or matrix, or a list of names. An empty name leaves the quantity out.
        units: Unit of the logged angles, `rad` or `deg` (velocities and accelerations alike), one for all joints or
            one each; what the names of the columns say, else radians, where not given.
        time_unit: Length of one unit of the time column [s], as 0.001 where it counts milliseconds.
        joints: Robot joint for each channel name of the file, or a list of robot joints in the order of a file
            that only numbers its channels. An empty name leaves the channel out.
        topic: ROS topic; needed where a bag has several with joint states.
        preset: Columns of a well-known log, see `PRESETS`; `columns` overrides it.
        exclude: Intervals [t0, t1] on the recording's clock that must not count, for instance contact [s].
        period: Period of the motion [s]; detected from the positions where not given; `none` for no repetition.
        start: Time of the first period on the recording's clock [s].
    """

    rate: float | None = None
    consecutive: bool | None = None
    torque_sign: ArrayLike = 1.0
    position_sign: ArrayLike = 1.0
    drive_gain: ArrayLike | None = None
    drive_gain_deviation: ArrayLike | None = None
    transmission: ArrayLike | None = None
    joint_offset: ArrayLike | None = None
    delay: ArrayLike = 0.0
    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict[str, "str | Sequence[str]"])
    units: Literal["rad", "deg"] | Sequence[str] | None = None
    time_unit: float | None = None
    joints: Mapping[str, str] | Sequence[str] = field(default_factory=dict[str, str])
    topic: str | None = None
    preset: str | None = None
    exclude: Sequence[Sequence[float]] = ()
    period: float | Literal["none"] | None = None
    start: float | None = None

    def __post_init__(self) -> None:
        for name in ("rate", "time_unit"):
            _set(self, name, _positive(getattr(self, name), name))
        if self.period != "none":
            _set(self, "period", _positive(self.period, "period", "a number above 0, or none"))
        if self.start is not None:
            _set(self, "start", float(_numbers(self.start, (), "start")))
        if self.consecutive not in (None, True, False):
            raise _wrong("consecutive", self.consecutive, "true, false, or nothing for detection")
        _set(self, "units", _units(self.units))
        if self.preset is not None and self.preset not in PRESETS:
            raise _wrong("preset", self.preset, ", ".join(PRESETS))
        if self.start is not None and self.stated_period is None:
            raise RecordingError(
                "start is given, but no period.",
                remedy="give period as well, or leave start out.",
            )
        self._check_joint_side()
        _set(self, "columns", _columns(self.columns))
        _set(self, "joints", _joints(self.joints))
        _set(self, "exclude", _intervals(self.exclude))

    @property
    def joint_map(self) -> dict[str, str]:
        """Robot joint of each channel; unnamed channels are called 1, 2, …."""
        return _joints(self.joints)

    @property
    def joints_numbered(self) -> bool:
        """True if `joints` names the joints of channels by their order."""
        return bool(self.joints) and all(name.isdigit() for name in self.joint_map)

    @property
    def stated_period(self) -> float | None:
        """Given period [s]; `None` where it is to be found or there is none."""
        return None if self.period == "none" else self.period

    @property
    def repeats(self) -> float | Literal["find"] | None:
        """Period [s], `find` where it is to be found, or `None` where the motion does not repeat."""
        return "find" if self.period is None else self.stated_period

    def degrees(self, n: int) -> NDArray[np.bool_]:
        """Mask of the joints among n that are logged in degrees, shape (n,)."""
        units = (self.units,) * n if self.units is None or isinstance(self.units, str) else self.units
        return np.array([unit == "deg" for unit in units], dtype=np.bool_)

    def _check_joint_side(self) -> None:
        """Checks the lengths of the fields with one entry per joint."""
        lengths: dict[str, int] = (
            {} if self.units is None or isinstance(self.units, str) else {"units": len(self.units)}
        )
        given = {name: _signs(getattr(self, name), name) for name in ("torque_sign", "position_sign")}
        for name, value in (given | {"delay": _delays(self.delay)}).items():
            _set(self, name, value)
            lengths |= {name: value.size} if value.size > 1 else {}
        for name in ("drive_gain", "joint_offset"):
            if getattr(self, name) is not None:
                value = _numbers(getattr(self, name), (None,), name)
                _set(self, name, value)
                lengths[name] = value.size
        if self.drive_gain is not None and not np.all(self.drive_gain):
            raise _wrong("drive_gain", self.drive_gain, "gains other than zero; the sign belongs to torque_sign")
        if self.drive_gain_deviation is not None:
            deviation = np.atleast_1d(_numbers(self.drive_gain_deviation, None, "drive_gain_deviation"))
            if deviation.ndim != 1 or (deviation < 0).any():
                raise _wrong("drive_gain_deviation", self.drive_gain_deviation, "numbers from 0 on, 0.1 is 10 %")
            if self.drive_gain is None:
                raise RecordingError(
                    "drive_gain_deviation is given without drive_gain.", remedy="give drive_gain as well."
                )
            _set(self, "drive_gain_deviation", array(deviation, (None,), "drive_gain_deviation"))
            lengths |= {"drive_gain_deviation": deviation.size} if deviation.size > 1 else {}
        if self.transmission is not None:
            _set(self, "transmission", _transmission(self.transmission))
            lengths["transmission"] = np.shape(self.transmission)[0]
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise RecordingError(
                f"Entries by joint must have one value for each joint; found {listed}.",
                remedy="list one value for each joint of the robot, in its order.",
            )


def _set(log_format: LogFormat, name: str, value: Any) -> None:
    object.__setattr__(log_format, name, value)


def _wrong(name: str, value: object, possible: str) -> RecordingError:
    return RecordingError(f"{name} = {value!r} is not a way to read a recording.", possible=possible)


def _numbers(value: object, shape: tuple[int | None, ...] | None, name: str) -> Array:
    """Array of finite numbers, of a given shape if any."""
    try:
        plain = np.asarray(value, dtype=np.float64)
        return array(plain, plain.shape if shape is None else shape, name)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{name} must be a number or a list of numbers; found {value!r:.80}.") from error
    except ArmidError as error:
        raise RecordingError(error.problem) from error


def _positive(value: Any, name: str, possible: str = "a number above 0") -> float | None:
    if value is None:
        return None
    number = float(_numbers(value, (), name))
    if not 0 < number < math.inf or isinstance(value, bool):
        raise _wrong(name, value, possible)
    return number


def _transmission(value: ArrayLike) -> Array:
    matrix = _numbers(value, (None, None), "transmission")
    if matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise RecordingError(
            f"transmission must be square, with one row for each motor and one column for each joint; found "
            f"{matrix.shape}."
        )
    scale = np.linalg.svd(matrix, compute_uv=False)
    if scale[-1] <= SINGULAR * scale[0]:
        raise RecordingError(
            "transmission is singular: some motion of the joints moves no motor.",
            remedy="check its rows; N[i, j] is the ratio of motor i to joint j.",
        )
    return matrix


def _signs(value: object, name: str) -> Array:
    sign = np.atleast_1d(_numbers(value, None, name))
    if sign.ndim != 1 or not np.isin(sign, (-1.0, 1.0)).all():
        raise _wrong(name, value, "1, -1, or a list of these")
    return array(sign, (None,), name)


def _delays(value: object) -> Array:
    delay = np.atleast_1d(_numbers(value, None, "delay"))
    if delay.ndim != 1 or (np.abs(delay) > LONGEST_DELAY).any():
        raise _wrong("delay", value, f"seconds, at most {LONGEST_DELAY:g}; one for all joints or one each")
    return array(delay, (None,), "delay")


def _units(value: Any) -> str | tuple[str, ...] | None:
    """Units of angles: one for all joints, one for each, or `None` for that of the file."""
    if value is None:
        return None
    listed = tuple(value) if isinstance(value, list | tuple) else (value,)
    if not listed or any(unit not in ("rad", "deg") for unit in listed):
        raise _wrong("units", value, "rad, deg, or a list of these")
    return listed if isinstance(value, list | tuple) else listed[0]


def _columns(value: Any) -> dict[str, tuple[str, ...]]:
    """Names or one pattern for each quantity; an empty name leaves it out."""
    if not isinstance(value, Mapping):
        raise _wrong("columns", value, f"names for {', '.join(QUANTITIES)}")
    columns: dict[str, tuple[str, ...]] = {}
    for quantity, names in value.items():
        if quantity not in QUANTITIES:
            raise RecordingError(f"columns has no {quantity!r}.", possible=", ".join(QUANTITIES))
        listed = tuple(names) if isinstance(names, list | tuple) else (names,)
        if not all(isinstance(name, str) for name in listed):
            raise _wrong(f"columns.{quantity}", names, 'a name, a pattern such as "q{}", or a list of names')
        columns[quantity] = () if listed == ("",) else listed
    if columns.get("q") == ():
        raise RecordingError("columns leaves q out, but positions are required.", remedy="name the columns of q.")
    return columns


def _joints(value: Any) -> dict[str, str]:
    """Robot joint of each channel; unnamed channels are called by their numbers."""
    listed = {str(i + 1): name for i, name in enumerate(value)} if isinstance(value, list | tuple) else value
    pairs: dict[Any, Any] = dict(listed) if isinstance(listed, Mapping) else {"": None}
    if not all(isinstance(name, str) for pair in pairs.items() for name in pair):
        raise _wrong("joints", value, "a list of robot joints, or {file name = robot joint}")
    taken = [name for name in pairs.values() if name]
    twice = sorted({name for name in taken if taken.count(name) > 1})
    if twice:
        raise RecordingError(
            f"joints gives {', '.join(twice)} to more than one channel.", remedy="name each joint once."
        )
    return pairs


def _intervals(value: Any) -> tuple[tuple[float, float], ...]:
    if not np.size(value):
        return ()
    intervals = _numbers(value, (None, 2), "exclude")
    if (intervals[:, 0] > intervals[:, 1]).any():
        raise _wrong("exclude", value, "intervals [t0, t1] in seconds with t0 ≤ t1")
    return tuple((float(t0), float(t1)) for t0, t1 in intervals)
