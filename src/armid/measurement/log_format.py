"""Log format: properties of a recording that its file does not contain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError, RecordingError, did_you_mean

QUANTITIES = ("time", "q", "dq", "ddq", "effort", "command")
"""Quantities that columns of a recording can contain."""

SINGULAR = 1e-12
"""Ratio of the smallest to the largest singular value of a transmission matrix below which it counts as singular.
Rounding of gear ratios causes a ratio of 1e-16; for real gears the ratio is above 1e-4."""

LONGEST_DELAY = 1.0
"""Largest accepted delay between channels [s]; a larger value was probably given in another unit."""


SLOWEST_RATE = 10.0
"""Lowest rate to which a recording may be reduced [Hz]."""


@dataclass(frozen=True, slots=True)
class FormatPreset:
    """Names of the columns and unit of time in a well-known log format.

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
            "command": ("target_q_{0}",),
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
            "command": ("state.q_d[{0}]",),
        },
        time_unit=1e-3,
    ),
}
"""Well-known log formats, by their names."""


@dataclass(frozen=True, eq=False, slots=True)
class LogFormat:
    """Description of how to read a recording; the defaults are SI units, joint side and the signs of the URDF.

    Lists with one entry for each joint are in the joint order of the robot, not in the order of the file.

    Attributes:
        rate: Sample rate [Hz]; given only if the file has no time column.
        consecutive: True if the rows are consecutive in time; if `None`, this is detected.
        torque_sign: +1 or -1, one value for all joints or one for each joint: measured torque = sign · torque in the
            convention of the URDF.
        position_sign: +1 or -1, one value for all joints or one for each joint: logged position, velocity and
            acceleration = sign · value in the convention of the URDF.
        drive_gain: Joint torque per ampere of current, if the effort is a current; one value or shape (n,) [N·m/A or
            N/A].
        drive_gain_deviation: Relative standard deviation of the drive gains, one value or shape (n,).
        transmission: Matrix N, shape (n, n), if the log is on the motor side: q_motor = N (q - joint_offset) and
            torque_joint = Nᵀ torque_motor.
        joint_offset: Joint position at which the logged position is zero, shape (n,) [rad or m].
        position_zero_deviation: Standard deviation of the zero errors of the positions, one value or shape (n,) [rad
            or m]; by default 0.001 rad or 0.0005 m.
        delay: Delay of the logged torque relative to the positions, negative if the torque comes earlier; one value
            or shape (n,) [s].
        columns: For `time`, `q`, `dq`, `ddq`, `effort`, `command` (the commanded position): a pattern in which `{}`
            counts from 1 and `{0}` from 0, the name of one column or matrix, or a list of names. An empty name leaves
            the quantity out.
        units: Unit of the logged angles, `rad` or `deg` (also in velocities and accelerations), one for all joints or
            one for each joint. If it is not given, the unit in the names of the columns is used; without such a unit,
            radians.
        time_unit: Length of one unit of the time column [s], for instance 0.001 if it counts milliseconds.
        joints: Robot joint for each channel name of the file. If the file only numbers its channels, a list of robot
            joints in the order of the file. An empty name leaves the channel out.
        topic: ROS topic; needed if a bag has several topics with joint states.
        preset: Name of a well-known log format, see `PRESETS`; `columns` overrides its columns.
        exclude: Intervals [t0, t1] on the clock of the recording [s] that are not used, for instance because of
            contact.
        period: Period of the motion [s], or `none` if the motion does not repeat; detected from the positions if not
            given.
        start: Start of the first period on the recording's clock [s].
        calibration: Calibration file of a LeRobot robot (JSON), which converts normalised positions of a LeRobot data
            set to angles. It is looked for in the folder of the data set and in the folders above it.
        spikes: With `keep`, spikes are used like other samples. If not given, they are left out. Spikes are isolated
            samples of positions, velocities and torques that no arm can produce, such as zeros of a lost packet.
        highest_rate: Sample rate [Hz] to which a faster recording is reduced by a low-pass filter and decimation; the
            rate is then between this and twice this. 0 keeps all samples. If not given, 1000 Hz, and down to 200 Hz
            for more than 250 000 samples (`armid.measurement.reduction`).
    """

    rate: float | None = None
    consecutive: bool | None = None
    torque_sign: ArrayLike = 1.0
    position_sign: ArrayLike = 1.0
    drive_gain: ArrayLike | None = None
    drive_gain_deviation: ArrayLike | None = None
    transmission: ArrayLike | None = None
    joint_offset: ArrayLike | None = None
    position_zero_deviation: ArrayLike | None = None
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
    calibration: str | None = None
    spikes: Literal["keep"] | None = None
    highest_rate: float | None = None

    def __post_init__(self) -> None:
        for name in ("rate", "time_unit"):
            _set(self, name, _positive(getattr(self, name), name))
        if self.highest_rate is not None:
            _set(self, "highest_rate", _highest_rate(self.highest_rate))
        if self.period != "none":
            _set(self, "period", _positive(self.period, "period", "a number above 0, or none"))
        if self.start is not None:
            _set(self, "start", float(_numbers(self.start, (), "start")))
        if self.consecutive not in (None, True, False):
            raise _wrong("consecutive", self.consecutive, "true, false, or nothing for detection")
        _set(self, "units", _units(self.units))
        if self.calibration is not None and type(self.calibration) is not str:
            raise _wrong("calibration", self.calibration, "the path of a JSON file")
        if self.spikes not in (None, "keep"):
            raise _wrong("spikes", self.spikes, "keep, or nothing to leave them out")
        if self.preset is not None and self.preset not in PRESETS:
            raise _wrong("preset", self.preset, ", ".join(PRESETS))
        if self.start is not None and self.stated_period is None:
            raise RecordingError(
                "The key `start` is given without the key `period`.",
                remedy="give `period`, too, or leave `start` out.",
            )
        self._check_joint_side()
        _set(self, "columns", _columns(self.columns))
        _set(self, "joints", _joints(self.joints))
        _set(self, "exclude", _intervals(self.exclude))

    @property
    def joint_map(self) -> dict[str, str]:
        """Robot joint to which each channel of the file is assigned; unnamed channels are called 1, 2, …."""
        return _joints(self.joints)

    @property
    def joints_numbered(self) -> bool:
        """True if `joints` is a list of joints in the order of the channels, without names of channels."""
        return bool(self.joints) and all(name.isdigit() for name in self.joint_map)

    @property
    def stated_period(self) -> float | None:
        """Period that the log format states [s]; `None` if it must be detected or the motion does not repeat."""
        return None if self.period == "none" else self.period

    @property
    def clock_unit(self) -> float:
        """Length of one unit of the time column [s]: `time_unit` if given, otherwise the unit of the preset."""
        if self.time_unit is not None or self.preset is None or "time" in self.columns:
            return self.time_unit or 1.0
        return PRESETS[self.preset].time_unit

    @property
    def repeats(self) -> float | Literal["find"] | None:
        """Period [s]; `find` if it must be detected; `None` if the motion does not repeat."""
        return "find" if self.period is None else self.stated_period

    def with_all_samples(self) -> LogFormat:
        """Log format with which the rate of a recording is not reduced, unless a highest rate is stated."""
        return self if self.highest_rate is not None else replace(self, highest_rate=0.0)

    def degrees(self, n: int) -> NDArray[np.bool_]:
        """Mask of the joints whose angles are logged in degrees, shape (n,), for n joints."""
        units = (self.units,) * n if self.units is None or isinstance(self.units, str) else self.units
        return np.array([unit == "deg" for unit in units], dtype=np.bool_)

    def _check_joint_side(self) -> None:
        """Checks the fields with values for each joint, and that all these fields have the same length."""
        lengths: dict[str, int] = (
            {} if self.units is None or isinstance(self.units, str) else {"units": len(self.units)}
        )
        given = {name: _signs(getattr(self, name), name) for name in ("torque_sign", "position_sign")}
        given["delay"] = _delays(self.delay)
        if self.position_zero_deviation is not None:
            given["position_zero_deviation"] = _zero_deviations(self.position_zero_deviation)
        for name, value in given.items():
            _set(self, name, value)
            lengths |= {name: value.size} if value.size > 1 else {}
        if self.joint_offset is not None:
            _set(self, "joint_offset", _numbers(self.joint_offset, (None,), "joint_offset"))
            lengths["joint_offset"] = np.size(self.joint_offset)
        if self.drive_gain is not None:
            gain = _gains(self.drive_gain)
            _set(self, "drive_gain", gain)
            lengths |= {"drive_gain": gain.size} if gain.size > 1 else {}
        if self.drive_gain_deviation is not None:
            deviation = np.atleast_1d(_numbers(self.drive_gain_deviation, None, "drive_gain_deviation"))
            if deviation.ndim != 1 or (deviation < 0).any():
                raise _wrong(
                    "drive_gain_deviation", self.drive_gain_deviation, "numbers that are 0 or larger; 0.1 means 10 %"
                )
            if self.drive_gain is None:
                raise RecordingError(
                    "`drive_gain_deviation` is given without `drive_gain`.",
                    remedy="give `drive_gain`, too, or leave `drive_gain_deviation` out.",
                )
            _set(self, "drive_gain_deviation", array(deviation, (None,), "drive_gain_deviation"))
            lengths |= {"drive_gain_deviation": deviation.size} if deviation.size > 1 else {}
        if self.transmission is not None:
            _set(self, "transmission", _transmission(self.transmission))
            lengths["transmission"] = np.shape(self.transmission)[0]
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise RecordingError(
                f"Lists with one value for each joint must have the same length; found {listed}.",
                remedy="list one value for each joint of the robot, in its order.",
            )


def _set(log_format: LogFormat, name: str, value: Any) -> None:
    object.__setattr__(log_format, name, value)


def _wrong(name: str, value: object, possible: str) -> RecordingError:
    return RecordingError(
        f"{name} = {value!r} is not a valid value of the log format.",
        possible=possible,
        remedy=f"correct the value of {name}.",
    )


def _numbers(value: object, shape: tuple[int | None, ...] | None, name: str) -> Array:
    """Converts a value to an array of finite numbers; if a shape is given, it is checked."""
    try:
        plain = np.asarray(value, dtype=np.float64)
        return array(plain, plain.shape if shape is None else shape, name)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"`{name}` must be a number or a list of numbers; found {value!r:.80}.") from error
    except ArmidError as error:
        raise RecordingError(error.problem) from error


def _positive(value: Any, name: str, possible: str = "a number above 0") -> float | None:
    if value is None:
        return None
    number = float(_numbers(value, (), name))
    if not 0 < number < math.inf or isinstance(value, bool):
        raise _wrong(name, value, possible)
    return number


def _highest_rate(value: Any) -> float:
    rate = float(_numbers(value, (), "highest_rate"))
    if isinstance(value, bool) or (rate != 0.0 and rate < SLOWEST_RATE):
        raise _wrong("highest_rate", value, f"0 for all samples, or a rate from {SLOWEST_RATE:g} Hz on")
    return rate


def _transmission(value: ArrayLike) -> Array:
    matrix = _numbers(value, (None, None), "transmission")
    if matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise RecordingError(
            "`transmission` must be a square matrix, with one row for each motor and one column for "
            f"each joint; found shape {matrix.shape}.",
            remedy="give the matrix N of q_motor = N (q - joint_offset).",
        )
    scale = np.linalg.svd(matrix, compute_uv=False)
    if scale[-1] <= SINGULAR * scale[0]:
        raise RecordingError(
            "The matrix `transmission` is singular: some motion of the joints does not move any motor.",
            remedy="check the rows of the matrix N; N[i, j] is the ratio of motor i to joint j.",
        )
    return matrix


def _signs(value: object, name: str) -> Array:
    sign = np.atleast_1d(_numbers(value, None, name))
    if sign.ndim != 1 or not np.isin(sign, (-1.0, 1.0)).all():
        raise _wrong(name, value, "1, -1, or a list of these")
    return array(sign, (None,), name)


def _gains(value: object) -> Array:
    gain = np.atleast_1d(_numbers(value, None, "drive_gain"))
    if gain.ndim != 1 or not gain.all():
        raise _wrong(
            "drive_gain",
            value,
            "numbers other than zero, one for all joints or one for each joint; a negative sign is given by "
            "torque_sign",
        )
    return array(gain, (None,), "drive_gain")


def _zero_deviations(value: object) -> Array:
    deviation = np.atleast_1d(_numbers(value, None, "position_zero_deviation"))
    if deviation.ndim != 1 or (deviation < 0).any():
        raise _wrong("position_zero_deviation", value, "numbers that are 0 or larger, in rad or m")
    return array(deviation, (None,), "position_zero_deviation")


def _delays(value: object) -> Array:
    delay = np.atleast_1d(_numbers(value, None, "delay"))
    if delay.ndim != 1 or (np.abs(delay) > LONGEST_DELAY).any():
        raise _wrong(
            "delay", value, f"seconds, at most {LONGEST_DELAY:g}; one value for all joints or one for each joint"
        )
    return array(delay, (None,), "delay")


def _units(value: Any) -> str | tuple[str, ...] | None:
    """Checks the key `units`: one unit for all joints, one for each joint, or `None` for the unit in the file."""
    if value is None:
        return None
    listed = tuple(value) if isinstance(value, list | tuple) else (value,)
    if not listed or any(unit not in ("rad", "deg") for unit in listed):
        raise _wrong("units", value, "rad, deg, or a list of these")
    return listed if isinstance(value, list | tuple) else listed[0]


def _columns(value: Any) -> dict[str, tuple[str, ...]]:
    """Checks the key `columns`: names or one pattern for each quantity; an empty name leaves a quantity out."""
    if not isinstance(value, Mapping):
        raise _wrong("columns", value, f"a table with names for {', '.join(QUANTITIES)}")
    columns: dict[str, tuple[str, ...]] = {}
    for quantity, names in value.items():
        if quantity not in QUANTITIES:
            raise RecordingError(
                f"The table `columns` cannot have the key {quantity!r}.",
                possible=", ".join(QUANTITIES),
                remedy=did_you_mean(quantity, QUANTITIES),
            )
        listed = tuple(names) if isinstance(names, list | tuple) else (names,)
        if not all(isinstance(name, str) for name in listed):
            raise _wrong(f"columns.{quantity}", names, 'a name, a pattern such as "q{}", or a list of names')
        columns[quantity] = () if listed == ("",) else listed
    if columns.get("q") == ():
        raise RecordingError(
            "The key `q` of the table `columns` is empty, but positions are required.",
            remedy='give the names of the position columns, for instance q = ["pos1", "pos2"], or a pattern '
            'such as q = "pos{}".',
        )
    return columns


def _joints(value: Any) -> dict[str, str]:
    """Checks the key `joints`, and returns the robot joint of each channel; unnamed channels are called 1, 2, …."""
    listed = {str(i + 1): name for i, name in enumerate(value)} if isinstance(value, list | tuple) else value
    pairs: dict[Any, Any] = dict(listed) if isinstance(listed, Mapping) else {"": None}
    if not all(isinstance(name, str) for pair in pairs.items() for name in pair):
        raise _wrong("joints", value, "a list of robot joints, or {name in the recording = name of the robot joint}")
    taken = [name for name in pairs.values() if name]
    twice = sorted({name for name in taken if taken.count(name) > 1})
    if twice:
        raise RecordingError(
            f"The key `joints` assigns {', '.join(twice)} to more than one channel.",
            remedy="assign each joint to one channel.",
        )
    return pairs


def _intervals(value: Any) -> tuple[tuple[float, float], ...]:
    if not np.size(value):
        return ()
    intervals = _numbers(value, (None, 2), "exclude")
    if (intervals[:, 0] > intervals[:, 1]).any():
        raise _wrong("exclude", value, "intervals [t0, t1] in seconds with t0 ≤ t1")
    return tuple((float(t0), float(t1)) for t0, t1 in intervals)
