"""Options that commands share, and the robots and models they choose."""

from __future__ import annotations

import re
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.completion import joints, known_arms, links, terms
from armid.errors import ArmidError, StudyError

if TYPE_CHECKING:
    from armid.study.config import ModelChoice, RobotChoice

__all__ = [
    "Gravity",
    "Json",
    "Lock",
    "Only",
    "Out",
    "Package",
    "RobotName",
    "Terms",
    "Threads",
    "TipLink",
    "Verbose",
    "known_arms",
    "model_choice",
    "robot_choice",
    "run_folder",
]


RobotName = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT",
        help="Built-in name or path to a URDF, xacro, MJCF or a DH table in TOML (docs/dh.md).",
        autocompletion=known_arms,
    ),
]
Gravity = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--gravity",
        metavar="X Y Z",
        help="Gravity in the base frame, m/s²; the description's by default (URDF: 0 0 -9.81); hanging: 0 0 9.81.",
    ),
]
Lock = Annotated[
    list[str] | None,
    typer.Option(
        "--lock",
        metavar="JOINT[=VALUE]",
        help="Hold joints still, at 0 or a value: names or patterns as leg_*, with commas between; repeatable.",
        autocompletion=joints,
    ),
]
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="JOINT,…",
        help="Joints that move, names or patterns as arm_left_*; others are held still.",
        autocompletion=joints,
    ),
]
TipLink = Annotated[
    str | None,
    typer.Option(
        "--tip",
        metavar="LINK",
        help="Where the arm ends: joints not between base and LINK are held still.",
        autocompletion=links,
    ),
]
Package = Annotated[
    list[str] | None,
    typer.Option("--package", metavar="NAME=DIR", help="Where a ROS package is, for meshes and xacro; repeatable."),
]
Terms = Annotated[
    str | None,
    typer.Option(
        "--terms",
        metavar="A,B,…",
        help="Torque terms, as rigid-body,viscous,coulomb; `auto`: `identify` chooses friction joint by joint.",
        autocompletion=terms,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else on standard output.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Where to write.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Also print every parameter with its interval.")]
Threads = Annotated[int, typer.Option("--threads", min=1, help="Threads of the kernel.")]


def robot_choice(
    description: str,
    gravity: tuple[float, float, float] | None,
    lock: list[str] | None,
    only: list[str] | None = None,
    tip: str | None = None,
    package: list[str] | None = None,
) -> RobotChoice:
    """The robot that the command line names, and which of its joints move."""
    from armid.study.config import RobotChoice

    if tip is not None and BOX.fullmatch(tip):
        raise ArmidError(f"--tip {tip}: this is no link.", remedy="the box that the tip keeps to is --tip-box.")
    if package:
        from armid.robot.packages import give_packages

        give_packages(_packages(package))
    return RobotChoice(description, gravity, _separate(lock), tip, _separate(only))


def _packages(given: list[str] | None) -> dict[str, str]:
    """Folders by package, of `NAME=DIR`."""
    result: dict[str, str] = {}
    for each in given or ():
        name, _, folder = each.partition("=")
        if not name or not folder:
            raise ArmidError(f"--package {each}: no package and folder.", remedy="write --package NAME=DIR.")
        result[name] = str(Path(folder).resolve())
    return result


BOX = re.compile(r"[-+.\deE]+(,[-+.\deE]+){5}")
"""Six numbers."""


def _separate(given: list[str] | None) -> tuple[str, ...]:
    """Return what repeated options with commas list."""
    parts = (part.strip() for each in given or () for part in each.split(","))
    return tuple(part for part in parts if part)


def model_choice(terms: str | None, *, default: tuple[str, ...] = ()) -> ModelChoice:
    """The terms that the command line names, with their default shapes.

    Args:
        terms: Names with commas between them, or `auto`.
        default: Terms where none are named, of commands that have no recordings to choose by.

    Raises:
        StudyError: An empty list, or `auto` without recordings.
    """
    from armid.study.config import ModelChoice

    if terms == "auto":
        if default:
            raise StudyError("--terms auto chooses by recordings, and there are none.", remedy="name the terms.")
        return ModelChoice(automatic=True)
    if terms is None:
        names = default
    else:
        names = tuple(name.strip() for name in terms.split(",") if name.strip())
        if not names:
            raise StudyError(
                "--terms names no term.", remedy="write for instance --terms rigid-body,viscous,coulomb."
            )
    return ModelChoice(names)


def run_folder(out: Path | None, robot: str) -> Path:
    """Choose the run's folder: what the command line says, else `runs/` and the arm's name, numbered where taken."""
    if out is not None:
        return out
    usual = Path("runs") / (re.sub(r"[^\w.+-]+", "-", robot).strip(".-") or "robot")
    numbered = (usual.with_name(f"{usual.name}-{number}") for number in count(2))
    return next(folder for folder in chain((usual,), numbered) if not folder.exists())


BASE_TERMS = ("rigid-body", "viscous", "coulomb")
"""Terms of every command but `identify`, Coulomb friction with a width of zero."""
