"""Analysis of column names: quantity, joint, unit, and whether the value is measured or commanded.

A name is split into words at punctuation marks, capital letters and digits. So `Joint1Pos`, `joint_1_pos` and
`/joint_1/pos` have the same words.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

UNITS: Mapping[str, tuple[str, float]] = {
    "rad": ("rad", 1.0),
    "deg": ("deg", 1.0),
    "°": ("deg", 1.0),
    "degree": ("deg", 1.0),
    "degrees": ("deg", 1.0),
    "mrad": ("rad", 1e-3),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "nm": ("torque", 1.0),
    "n": ("torque", 1.0),
    "mnm": ("torque", 1e-3),
    "ncm": ("torque", 1e-2),
    "knm": ("torque", 1e3),
    "a": ("current", 1.0),
    "ma": ("current", 1e-3),
    "amp": ("current", 1.0),
    "amps": ("current", 1.0),
    "ampere": ("current", 1.0),
    "amperes": ("current", 1.0),
    "rpm": ("rad", 2.0 * math.pi / 60.0),
}
"""For each unit: its quantity, and the factor that converts the unit to the unit of armid. The keys are written in
lower case, without signs and powers of time."""

SECONDS: Mapping[str, float] = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "usec": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanosec": 1e-9, "nanoseconds": 1e-9,
}  # fmt: skip
"""Length of each unit of time [s]."""

QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "q": ("q", "pos", "position", "positions", "angle", "angles", "theta", "phi", "winkel"),
    "dq": (
        "dq",
        "qd",
        "qdot",
        "vel",
        "velocity",
        "velocities",
        "speed",
        "speeds",
        "omega",
        "dtheta",
        "geschwindigkeit",
    ),
    "ddq": ("ddq", "qdd", "qddot", "acc", "accel", "acceleration", "accelerations", "ddtheta", "beschleunigung"),
    "effort": (
        "tau",
        "torque",
        "torques",
        "trq",
        "effort",
        "efforts",
        "moment",
        "moments",
        "drehmoment",
        "drehmomente",
        "momente",
    ),
    "current": ("i", "iq", "current", "currents", "cur", "curr", "amp", "amps", "ampere", "amperes", "strom"),
}
"""Words in a column name that indicate each quantity."""

PAIRS: Mapping[tuple[str, str], str] = {
    ("q", "dot"): "dq",
    ("q", "ddot"): "ddq",
    ("angular", "velocity"): "velocity",
    ("angular", "acceleration"): "acceleration",
    ("angular", "position"): "position",
    ("motor", "current"): "current",
    ("time", "stamp"): "timestamp",
    ("axis", "act"): "position",
    ("torque", "axis"): "torque",
    ("vel", "axis"): "vel",
}
"""Pairs of successive words that together have the meaning of one word. The pairs with `axis` occur in variables of
KUKA's language, such as `$AXIS_ACT` and `$TORQUE_AXIS_ACT`."""

MEASURED = frozenset("actual act measured meas msr feedback fbk fb real is ai encoder enc sensor".split())
COMMANDED = frozenset(
    "target tgt cmd command commanded desired des d ref reference setpoint set goal sp ipo as".split()
)
OTHER = frozenset(
    "error err ext external filtered residual temp temperature limit max min model gravity grav coriolis inertia "
    "ff feedforward tcp ee tool cart cartesian pose wrench force std var cov voltage power brake mode status contact "
    "collision hat window dot nominal x y z roll pitch yaw".split()
)
"""Words in a column name that indicate a quantity that armid does not use, or a derived quantity."""

MOTOR = frozenset("motor mot theta phi".split())
"""Words that may indicate the motor side of a gear. In libfranka, theta is the motor angle and q the joint angle."""

COMMANDS = frozenset("command cmd commanded target tgt desired des ref reference setpoint goal action".split())
"""Words that alone indicate a commanded position, if no word of the name indicates a quantity."""

BESIDE_COMMAND = frozenset({"*", "joint", "joints", "j", "axis", "axes", "motor"}) | COMMANDS
"""Words that may be combined with a word of `COMMANDS` in the name of a commanded position."""

BESIDE_JOINT = frozenset({"*", "joint"}) | MEASURED | COMMANDED | MOTOR
"""Words that may be combined with the name of the joint if only the unit indicates the quantity of a column: for
instance, `turn_meas_rad` is a position."""

CLOCKS: Mapping[str, int] = {
    **dict.fromkeys(("t", "time", "timestamp", "elapsed", "clock", "zeit", "zeitstempel", "tiempo", "tempo"), 1),
    **{"stamp": 0, "rosbag": 2},
}
"""Rank of each word that indicates a clock; the lower the rank, the closer the time of the clock is to the instant of
measurement."""

BESIDE_CLOCK = frozenset(
    "ros header field joint states since start robot controller system unix relative s sec secs".split()
)
"""Words that may be combined with a word that indicates a clock."""

INDEX = re.compile(r"[\[({](\d+)[\])}]")
BRACKET = re.compile(r"(.+?)\s*[\[({]\s*([^\[\](){}]*?)\s*[\])}]")
TAIL = re.compile(
    r"(.+?)[_\s.-]((?:m?rad|deg|degrees)(?:[_/]?s(?:\^?2|²)?)?|m?nm|n[_.·]m|mm|rpm|ma|amp(?:s|eres?)?"
    r"|[mµμun]s(?:ec)?|nanosec|nsecs?)",
    re.IGNORECASE,
)
"""Pattern of a name with a unit after the last separator. Single letters are not accepted as units there, because
they would be ambiguous. `BRACKET` is the pattern of a name with a unit in brackets."""

QUOTIENT = re.compile(r"(.*\d.*?|.+\s)/\s*((?:m?rad|deg|°)(?:/s(?:\^?2|²)?)?|[mck]?N[·.]?m|[cm]?m|rpm|m?A)")
"""Pattern of a name with a unit after a slash, as in tables of physics: `i1/A`, `tau 1 / N·m`. In the name of a ROS
topic, a word follows the slash, not a unit."""

TIME_TAIL = re.compile(rf"(.+?)(?:\s+in\s+|\s*/\s*|[_\s.-])({'|'.join(SECONDS)})", re.IGNORECASE)
"""Pattern of a name with a unit of time after a separator; this unit may be a single letter."""

ANGLES = ("deg", "degree", "degrees", "rad", "mrad")
"""Units of angle that may occur anywhere in a name."""

PER_SECOND = re.compile(r"(m?rad|deg|degrees?|°)(?:ps|s|persec)?\d?[2²]?")
PER_TIME = re.compile(r"(?:rpm|(?:/|_|p|per)\s*s(?:ec)?\W*(?P<square>2|²)?)$")
"""Pattern of the unit of a velocity or, if the group `square` matches, of an acceleration."""

WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+|[^\W\d_]+")
GREEK = {"q\u0308": "ddq", "q\u0307": "dq", "τ": "tau", "θ": "theta", "φ": "phi", "ω": "omega"}


@dataclass(frozen=True, slots=True)
class ColumnName:
    """Interpretation of a column name.

    Attributes:
        column: Full name of the column.
        quantity: `q`, `dq`, `ddq`, `effort` or `current`; `command` if the name indicates a commanded value without
            its quantity, so that it is probably a position.
        channel: Name or number of the joint; empty if the name of the column contains neither.
        form: Words of the name, in which `*` replaces the channel.
        rank: Two numbers; the column with the smallest numbers is preferred. First number: 0 or 1 for measured, 2 for
            commanded values. Second number: smaller for the joint side than for the motor side.
        unit: Quantity of the unit in the name, and factor that converts the unit to the unit of armid; `None` without
            a unit.
    """

    column: str
    quantity: str
    channel: str | int
    form: tuple[str, ...]
    rank: tuple[int, int]
    unit: tuple[str, float] | None

    @property
    def commanded(self) -> bool:
        """True if the column contains a commanded value."""
        return self.rank[0] == 2


@dataclass(frozen=True, slots=True)
class Clock:
    """Column that contains times.

    Attributes:
        column: Name of the column.
        rank: Rank of the column; the smallest is preferred, because its time is closest to the instant of
            measurement.
        unit: Length of the unit in the name [s]; `None` without a unit.
    """

    column: str
    rank: int
    unit: float | None


def words(text: str) -> list[str]:
    """Splits a name into its words and numbers, in lower case."""
    for sign, word in GREEK.items():
        text = text.replace(sign, f" {word} ")
    found = [word.lower() for word in WORDS.findall(text)]
    joined: list[str] = []
    for word in found:
        pair = PAIRS.get((joined[-1], word)) if joined else None
        joined = [*joined[:-1], pair] if pair else [*joined, word]
    return joined


def split_unit(column: str) -> tuple[str, str]:
    """Splits a column name into the name without unit, and the unit, which is empty if the name contains none.

    The unit may be in brackets, after the last separator or after a slash.
    """
    text = INDEX.sub(r"_\1", column.strip())
    hit = BRACKET.fullmatch(text) or TAIL.fullmatch(text) or QUOTIENT.fullmatch(text)
    return (hit[1], hit[2]) if hit else (text, "")


def named(column: str, labels: Sequence[str]) -> list[ColumnName]:
    """Possible interpretations of a column name: none, or one for each number in it that may be the channel.

    Args:
        column: Name of the column.
        labels: Names of the joints in the file, longer names first.
    """
    text, unit = split_unit(column)
    found: list[ColumnName] = []
    for channel, form in _channels(words(text), labels, unit):
        measured = unit_of(unit) if unit else next((UNITS[word] for word in form if word in ANGLES), None)
        if unit and measured is None:
            return []  # another quantity
        quantity = quantity_of(form)
        of_joint = (isinstance(channel, str) and channel != "") or _q_is_joint(form)
        of_unit = _quantity_of_unit(unit, form) if of_joint else None
        by_unit = of_unit is not None and (quantity is None or (quantity == "q" and of_unit == "effort"))
        quantity = of_unit if by_unit else quantity
        if quantity is None and is_command(form):
            quantity = "command"
        if quantity is None or OTHER & set(form) or (quantity == "current" and channel == ""):
            continue
        if measured is not None and not _fits(quantity, measured[0]):
            continue
        if quantity == "effort" and measured is not None and measured[0] == "current":
            quantity = "current"
        role = 0 if MEASURED & set(form) else 2 if COMMANDED & set(form) or quantity == "command" else 1
        # A name that states the quantity is preferred to one whose unit alone does.
        rank = (max(role, 1), 2) if by_unit else (role, int(bool(MOTOR & set(form))))
        found.append(ColumnName(column, quantity, channel, tuple(form), rank, measured))
    return found


def clock_of(column: str) -> Clock | None:
    """Interpretation of a column name as a clock; `None` if the name is not that of a clock."""
    text, unit = split_time(column)
    parts = words(text)
    ranks = [CLOCKS[word] for word in parts if word in CLOCKS]
    if not ranks or any(word not in CLOCKS and word not in BESIDE_CLOCK for word in parts):
        return None
    unit = unit.strip().lower() or next((word for word in parts if word in SECONDS), "")
    if unit and unit not in SECONDS:
        return None
    return Clock(column, max(ranks) if "rosbag" in parts else min(ranks), SECONDS.get(unit))


def time_unit(column: str) -> float | None:
    """Length of the unit of time in a column name [s]; `None` if the name has no such unit."""
    return SECONDS.get(split_time(column)[1].strip().lower())


def split_time(column: str) -> tuple[str, str]:
    """Splits a column name into the name without unit, and its unit of time, which may be a single letter."""
    text, unit = split_unit(column)
    hit = None if unit else TIME_TAIL.fullmatch(text)
    return (hit[1], hit[2]) if hit else (text, unit)


def _quantity_of_unit(unit: str, form: Sequence[str]) -> str | None:
    """Quantity that the unit of a column indicates: `effort`, `q`, `dq`, `ddq`, or `None` if it is unknown.

    A quantity of motion is returned only if all other words of the name are in `BESIDE_JOINT`.

    Args:
        unit: Unit in the name; may be empty.
        form: Words of the name, in which `*` replaces the joint.
    """
    kind = unit_of(unit) if unit else None
    if kind is None:
        return None
    if kind[0] in ("torque", "current"):
        return "effort"
    if not set(form) <= BESIDE_JOINT:
        return None
    power = PER_TIME.search(unit.strip().lower())
    return "q" if power is None else "ddq" if power["square"] else "dq"


def _q_is_joint(form: Sequence[str]) -> bool:
    """Checks whether the letter q is directly before the number, so that both may name a joint, as in `q1_trq`."""
    return any(pair == ("q", "*") for pair in itertools.pairwise(form))


def _channels(parts: Sequence[str], labels: Sequence[str], unit: str) -> list[tuple[str | int, list[str]]]:
    """Possible channels in a name, each with the words of the name in which `*` replaces the channel.

    The channel is the longest joint name in the name, otherwise each number. It is empty if the name contains
    neither.

    Args:
        parts: Words of the name.
        labels: Names of the joints, longer names first.
        unit: Unit in the name. If the name contains the name of a joint, the unit may indicate the quantity, and no
            other word is needed.
    """
    for label in labels:
        name = words(label)
        for k in range(len(parts) - len(name) + 1):
            form = [*parts[:k], "*", *parts[k + len(name) :]]
            known = quantity_of(form) or _quantity_of_unit(unit, form) or is_command(form)
            if list(parts[k : k + len(name)]) == name and known:
                return [(label, form)]
    numbers = [k for k, word in enumerate(parts) if word.isdigit()]
    if not numbers:
        return [("", list(parts))]
    return [(int(parts[k]), [*parts[:k], "*", *parts[k + 1 :]]) for k in numbers]


def quantity_of(form: Sequence[str]) -> str | None:
    """Quantity that the words of a name indicate; `None` if they indicate none or several."""
    found = {quantity for quantity, known in QUANTITIES.items() if set(known) & set(form)}
    if len(found) == 2 and "q" in found and set(QUANTITIES["q"]) & set(form) == {"q"} and _q_is_joint(form):
        found.remove("q")
    if "dot" in form and found == {"q"}:
        return "dq"
    return found.pop() if len(found) == 1 else None


def is_command(form: Sequence[str]) -> bool:
    """Checks whether the words of a name indicate a commanded value and nothing else but the joint."""
    return bool(COMMANDS & set(form)) and set(form) <= BESIDE_COMMAND


def unit_of(unit: str) -> tuple[str, float] | None:
    """Quantity of a unit, and factor that converts the unit to the unit of armid; `None` if it is unknown.

    Powers of time are ignored, so `rad/s` is treated as `rad`.
    """
    text = re.sub(r"[\s_·*.⋅^\-]", "", unit.split("/")[0]).lower()
    per_second = PER_SECOND.fullmatch(text)
    return UNITS.get(per_second[1] if per_second else text)


def unit_kind(unit: str) -> tuple[str, float] | None:
    """Quantity of a unit (also time), and factor that converts it to the unit of armid; `None` if it is unknown."""
    seconds = SECONDS.get(unit.strip().lower())
    return ("time", seconds) if seconds is not None else unit_of(unit)


def column_unit(column: str) -> tuple[str, float] | None:
    """Quantity of the unit in a column name, and factor that converts it to the unit of armid; `None` if unknown."""
    text, unit = split_unit(column)
    if unit:
        return unit_of(unit)
    return next((UNITS[word] for word in words(text) if word in ANGLES), None)


def _fits(quantity: str, kind: str) -> bool:
    """Checks whether a quantity (`q`, `effort`, …) can have a unit of the given kind (`rad`, `torque`, …)."""
    if quantity in ("q", "dq", "ddq", "command"):
        return kind in ("rad", "deg", "m")
    return kind == "current" if quantity == "current" else kind in ("torque", "current")
