"""Loading of robots by the name of a built-in arm or by a path."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from numpy.typing import ArrayLike

from armid.errors import RobotError
from armid.input_boundary import boundary, read_text, within
from armid.robot.angle_rounding import rounded
from armid.robot.joint_selection import JointOutline, held_joints
from armid.robot.packages import forget, give_packages
from armid.robot.readers import READERS, DescriptionFormat, DescriptionReader
from armid.robot.robot import Robot

Locked = Mapping[str, float] | Iterable[str]

DAMAGED = "correct the description, or export it again."
"""Remedy for a description that a reader cannot read."""

ARMS = Path(__file__).parent / "arms"


def builtin_arms() -> tuple[str, ...]:
    """Names of the built-in arms."""
    return tuple(sorted(path.stem for path in ARMS.glob("*.toml")))


def load_robot(
    description: str | Path,
    *,
    gravity: ArrayLike | None = None,
    lock: Locked = (),
    only: str | Sequence[str] = (),
    tip: str | None = None,
    locked: Locked | None = None,
    packages: Mapping[str, str] | None = None,
) -> Robot:
    """Loads the robot that a description defines.

    Angles within 1e-4 rad of a multiple of 15° are set to that multiple, with a finding (see
    `armid.robot.angle_rounding`).

    Args:
        description: Name of a built-in arm, or path to a URDF, xacro, MJCF or DH table in TOML.
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²]; `None` for the gravity of the
            description.
        lock: Joints to be locked: names, `"name=position"` [rad or m], or positions by name. Without a position, a
            joint is locked at the position within its limits that is nearest to zero. Names may be patterns such as
            `leg_*`. Mimic joints, whose position depends on another joint, are always locked, with a finding.
        only: Names or patterns of the joints that move; all others are locked.
        tip: Name of the frame of the tool flange. The joints between the base and this frame move, and all others are
            locked, unless `only` selects joints. If `None`, armid searches the frame, and `tip` locks no joint.
        locked: Former name of the argument `lock`.
        packages: Folders of ROS packages by name, in addition to those that `armid.robot.packages` finds.

    Raises:
        RobotError: The arm or the file does not exist or cannot be read, or no joint matches a pattern. The message
            lists the possible names.
        MissingExtraError: The Python package that this format needs is not installed.
    """
    asked = _values(lock if locked is None else locked)
    given = give_packages(packages or {})
    try:
        with boundary("a robot description", description, RobotError, remedy=DAMAGED):
            text, source, reader = expanded(description)
            held = held_joints(_outline(reader, text, source), source, asked, _names(only), tip)
            robot = reader.read(text, source=source, locked=held.at, tip=tip)
    finally:
        forget(given)
    within("joints", robot.n, source, RobotError)
    sha256 = robot.sha256 or hashlib.sha256(text.encode()).hexdigest()
    robot, _ = rounded(replace(robot, sha256=sha256, findings=(*robot.findings, *held.findings)), held.at)
    robot = robot.lock({name: value for name, value in held.at.items() if name in robot.joint_names})
    return robot if gravity is None else robot.with_gravity(gravity)


def held_of(
    description: str | Path, *, lock: Locked = (), only: str | Sequence[str] = (), tip: str | None = None
) -> dict[str, float]:
    """Positions [rad or m] by name of all joints that `load_robot` would lock with the same arguments."""
    with boundary("a robot description", description, RobotError, remedy=DAMAGED):
        text, source, reader = expanded(description)
        outline = _outline(reader, text, source)
    return dict(held_joints(outline, source, _values(lock), _names(only), tip).at)


def _outline(reader: DescriptionReader, text: str, source: str) -> JointOutline:
    """Joints of a description; raises an error if there are more than the limit `links`."""
    outline = reader.outline(text, source=source)
    within("links", len(outline.joints), source, RobotError)
    return outline


def _values(lock: Locked) -> dict[str, float | None]:
    """Positions [rad or m] by name or pattern of the joints to lock; `None` for a joint without a position."""
    if isinstance(lock, Mapping):
        return {name: float(value) for name, value in lock.items()}
    values: dict[str, float | None] = {}
    for each in _names(lock):
        name, equals, value = each.partition("=")
        try:
            values[name] = float(value) if equals else None
        except ValueError:
            raise RobotError(
                f"--lock {each}: {value!r} is not a number.",
                remedy="write --lock JOINT or --lock JOINT=VALUE, with VALUE in rad or m.",
            ) from None
    return values


def _names(given: str | Iterable[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


def expanded(description: str | Path) -> tuple[str, str, DescriptionReader]:
    """Text, source (path or name of a built-in arm) and reader of a description; xacro is expanded to URDF."""
    text, source, form = _find(description)
    if form is READERS["xacro"]:
        from armid.robot.readers.xacro import expand

        return expand(text, source), source, READERS["urdf"].reader
    return text, source, form.reader


def _find(description: str | Path) -> tuple[str, str, DescriptionFormat]:
    """Text, source (path or name of a built-in arm) and format of a description."""
    if str(description) in builtin_arms():
        path, source = ARMS / f"{description}.toml", str(description)
    else:
        path, source = Path(description), str(description)
    formats = [form for form in READERS.values() if path.suffix.lower() in form.suffixes]
    if not formats or not path.is_file():
        raise _not_found(path)
    text = read_text(path, "a robot description", RobotError, remedy="give a UTF-8 text file.")
    # The later formats are not loaded once one recognises the text; where none does, the first one raises the error.
    known = (form for form in formats if len(formats) == 1 or form.reader.recognises(text))
    return text, source, next(known, formats[0])


def _not_found(path: Path) -> RobotError:
    """Error for a name that is neither a built-in arm nor a readable file."""
    suffixes = sorted({suffix for form in READERS.values() for suffix in form.suffixes})
    neighbours = [str(p) for p in path.parent.iterdir() if p.suffix in suffixes] if path.parent.is_dir() else []
    close = get_close_matches(str(path), [*builtin_arms(), *neighbours], 1)
    if path.exists():
        problem = f"{path} is not a robot description in a format that armid can read."
    else:
        problem = f"There is no robot description {str(path)!r}: neither a built-in arm nor a file."
    return RobotError(
        problem,
        possible=f"{', '.join(builtin_arms())}; a path to a file ending in {', '.join(suffixes)}",
        remedy=f"did you mean {close[0]!r}?" if close else "check the name or the path.",
    )
