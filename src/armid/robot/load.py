"""From a name or a path to a `Robot`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from numpy.typing import ArrayLike

from armid.errors import RobotError
from armid.robot.readers import READERS, Reader
from armid.robot.robot import Robot
from armid.robot.rounding import rounded

__all__ = ["builtin_arms", "load_robot"]

ARMS = Path(__file__).parent / "arms"


def builtin_arms() -> tuple[str, ...]:
    """Names of the arms that armid brings along."""
    return tuple(sorted(path.stem for path in ARMS.glob("*.toml")))


def load_robot(
    description: str | Path,
    *,
    gravity: ArrayLike | None = None,
    locked: Mapping[str, float] | Iterable[str] = (),
    tip: str | None = None,
) -> Robot:
    """The robot of a description.

    Angles within 1e-4 rad of a multiple of 15° are taken as that multiple (see `armid.robot.rounding`); the
    result's findings say so.

    Args:
        description: Name of a built-in arm, or path to a URDF, xacro, MJCF or DH table in TOML.
        gravity: Acceleration of gravity in the base frame (3,) [m/s²]; what the description says if left out.
        locked: Joints held still: names, or names with positions [rad or m].
        tip: Name of the frame that stands for the tool flange; found if left out.

    Raises:
        RobotError: No such arm or file, or one that cannot be read; the message says what is possible.
        MissingExtraError: A format whose package is not installed.
    """
    held = {locked: 0.0} if isinstance(locked, str) else _values(locked)
    text, source, reader = _find(description)
    robot = reader.read(text, source=source, locked=held, tip=tip)
    robot = replace(robot, sha256=robot.sha256 or hashlib.sha256(text.encode()).hexdigest())
    robot, _ = rounded(robot)
    robot = robot.lock({name: value for name, value in held.items() if name in robot.joint_names})
    return robot if gravity is None else robot.with_gravity(gravity)


def _values(locked: Mapping[str, float] | Iterable[str]) -> dict[str, float]:
    if isinstance(locked, Mapping):
        return {name: float(value) for name, value in locked.items()}
    return dict.fromkeys(locked, 0.0)


def _find(description: str | Path) -> tuple[str, str, Reader]:
    """Text, source and reader of a description."""
    if str(description) in builtin_arms():
        path, source = ARMS / f"{description}.toml", str(description)
    else:
        path, source = Path(description), str(description)
    readers = [reader for reader in READERS.values() if path.suffix.lower() in reader.SUFFIXES]
    if not readers or not path.is_file():
        raise _not_found(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{source} cannot be read: {error}.", remedy="give a UTF-8 text file.") from error
    if len(readers) == 1:
        return text, source, readers[0]
    recognised = [reader for reader in readers if reader.recognises(text)]
    # Where none recognises the text, the first reader says what is wrong with it.
    return text, source, (recognised or readers)[0]


def _not_found(path: Path) -> RobotError:
    """The error for what is neither a built-in arm nor a file that can be read."""
    suffixes = sorted({suffix for reader in READERS.values() for suffix in reader.SUFFIXES})
    beside = [str(p) for p in path.parent.iterdir() if p.suffix in suffixes] if path.parent.is_dir() else []
    close = get_close_matches(str(path), [*builtin_arms(), *beside], 1)
    if path.exists():
        problem = f"{path} is no robot description that armid reads."
    else:
        problem = f"There is no robot description {str(path)!r}: neither a built-in arm nor a file."
    return RobotError(
        problem,
        possible=f"{', '.join(builtin_arms())}; a path to a file ending in {', '.join(suffixes)}",
        remedy=f"did you mean {close[0]!r}?" if close else "check the name or the path.",
    )
