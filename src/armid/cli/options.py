"""Options shared by commands, and their conversion to robots and models."""

from __future__ import annotations

import re
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.value_completion import joints, known_arms, links, terms
from armid.errors import ArmidError, StudyError

if TYPE_CHECKING:
    from armid.study.config import ModelChoice, RobotChoice

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
        help="Gravity in the base frame, m/s²; by default that of the description (URDF: 0 0 -9.81); 0 0 9.81 for "
        "a hanging arm.",
    ),
]
Lock = Annotated[
    list[str] | None,
    typer.Option(
        "--lock",
        metavar="JOINT[=VALUE]",
        help="Joints to lock, at 0 or at a value: names or patterns such as leg_*, separated by commas; repeatable.",
        autocompletion=joints,
    ),
]
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="JOINT,…",
        help="Joints that move: names or patterns such as arm_left_*; all others are locked.",
        autocompletion=joints,
    ),
]
TipLink = Annotated[
    str | None,
    typer.Option(
        "--tip",
        metavar="LINK",
        help="Last link of the arm; joints that are not between base and LINK are locked.",
        autocompletion=links,
    ),
]
Package = Annotated[
    list[str] | None,
    typer.Option("--package", metavar="NAME=DIR", help="Folder of a ROS package, for meshes and xacro; repeatable."),
]
Terms = Annotated[
    str | None,
    typer.Option(
        "--terms",
        metavar="A,B,…",
        help="Torque terms, for instance rigid-body,viscous,coulomb or default,rotor-inertia; with `auto`, "
        "`identify` selects friction for each joint.",
        autocompletion=terms,
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print only one JSON object on standard output, also if there is an error.")
]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder to write to.")]
Verbose = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Also print every parameter with its interval, and all guessed columns."),
]
Threads = Annotated[int, typer.Option("--threads", min=1, help="Number of threads of the compiled kernel.")]


def robot_choice(
    description: str,
    gravity: tuple[float, float, float] | None,
    lock: list[str] | None,
    only: list[str] | None = None,
    tip: str | None = None,
    package: list[str] | None = None,
) -> RobotChoice:
    """Choice of the robot and its moving joints, from the command line."""
    from armid.study.config import RobotChoice

    if tip is not None and BOX.fullmatch(tip):
        raise ArmidError(
            f"--tip {tip} is not a link.",
            remedy="if you mean the box in which the tip must stay, give it with --tip-box.",
        )
    if package:
        from armid.robot.packages import give_packages

        give_packages(_packages(package))
    return RobotChoice(description, gravity, _separate(lock), tip, _separate(only))


def _packages(given: list[str] | None) -> dict[str, str]:
    """Folder of each ROS package, by the name of the package, from texts of the form `NAME=DIR`."""
    result: dict[str, str] = {}
    for each in given or ():
        name, _, folder = each.partition("=")
        if not name or not folder:
            raise ArmidError(
                f"--package {each}: a package name or its folder is missing.", remedy="write --package NAME=DIR."
            )
        result[name] = str(Path(folder).resolve())
    return result


BOX = re.compile(r"[-+.\deE]+(,[-+.\deE]+){5}")
"""Pattern of six numbers separated by commas."""


def _separate(given: list[str] | None) -> tuple[str, ...]:
    """Entries of a repeatable option whose values may contain several entries, separated by commas."""
    parts = (part.strip() for each in given or () for part in each.split(","))
    return tuple(part for part in parts if part)


def model_choice(terms: str | None, *, default: tuple[str, ...] = ()) -> ModelChoice:
    """Choice of the torque terms that the command line names, with the default options of the terms.

    Args:
        terms: Names separated by commas, or `auto`.
        default: Terms that are used if none are named; for commands without recordings, which cannot select terms.

    Raises:
        StudyError: The list is empty, or it is `auto` for a command without recordings.
    """
    from armid.study.config import ModelChoice

    if terms == "auto":
        if default:
            raise StudyError(
                "--terms auto needs recordings to select terms, and this command has none.",
                remedy="give the names of the terms.",
            )
        return ModelChoice(automatic=True)
    if terms is None:
        names = default
    else:
        names = tuple(name.strip() for name in terms.split(",") if name.strip())
        if not names:
            raise StudyError(
                "--terms is given without the name of a term.",
                remedy="write for instance --terms rigid-body,viscous,coulomb.",
            )
    return ModelChoice(names)


def claim_run(run: str, out: Path | None) -> None:
    """Lock the folder of a run, if a command without --out writes into it.

    So the files do not get into another run that a second process writes to the same folder meanwhile.

    Raises:
        OutputError: Another process writes the folder, or it cannot be written.
    """
    from armid.output.locks import claim

    if out is None and Path(run).is_dir():
        claim(run)


def run_folder(out: Path | None, robot: str) -> Path:
    """Folder of the run: `out`, or else `runs/` and the name of the arm, with a number if that folder exists."""
    if out is not None:
        return out
    default = Path("runs") / (re.sub(r"[^\w.+-]+", "-", robot).strip(".-") or "robot")
    numbered = (default.with_name(f"{default.name}-{number}") for number in count(2))
    return next(folder for folder in chain((default,), numbered) if not folder.exists())


BASE_TERMS = ("rigid-body", "viscous", "coulomb")
"""Default torque terms of all commands except `identify`; the smoothing width of Coulomb friction is zero."""
