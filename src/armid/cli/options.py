"""Options that commands share, and the robots and models they choose."""

from __future__ import annotations

import re
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import armid
from armid.cli.next_step import DESCRIPTIONS
from armid.errors import ArmidError, StudyError

if TYPE_CHECKING:
    from armid.study.study import ModelChoice, RobotChoice

__all__ = [
    "Gravity",
    "Json",
    "Lock",
    "Out",
    "RobotName",
    "Terms",
    "Threads",
    "Verbose",
    "known_arms",
    "model_choice",
    "robot_choice",
    "run_folder",
]


def known_arms(incomplete: str) -> list[str]:
    """Built-in arms and descriptions in this folder that begin so; where none does, shells go on with files."""
    arms = (path.stem for path in (Path(armid.__file__).parent / "robot" / "arms").glob("*.toml"))
    files = (path.name for path in Path().iterdir() if path.suffix in DESCRIPTIONS)
    return sorted(name for name in chain(arms, files) if name.startswith(incomplete))


RobotName = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="Built-in name or path to a URDF, xacro, MJCF or DH table.", autocompletion=known_arms
    ),
]
Gravity = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--gravity", metavar="X Y Z", help="Gravity in the base frame in m/s²; a hanging arm is 0 0 9.81."),
]
Lock = Annotated[
    list[str] | None,
    typer.Option("--lock", metavar="JOINT[=VALUE]", help="Hold a joint still, at 0 or a value; repeatable."),
]
Terms = Annotated[
    str | None,
    typer.Option(
        "--terms",
        metavar="A,B,…",
        help="Torque terms, as rigid-body,viscous,coulomb; `auto`: `identify` chooses friction joint by joint.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else on standard output.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Where to write.")]
Rate = Annotated[float | None, typer.Option(help="Samples a second, Hz, where there is no clock.")]
TorqueSign = Annotated[int | None, typer.Option(help="-1 where the torque is measured against the URDF.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Also print every parameter with its interval.")]
Threads = Annotated[int, typer.Option("--threads", min=1, help="Threads of the kernel.")]


def robot_choice(description: str, gravity: tuple[float, float, float] | None, lock: list[str] | None) -> RobotChoice:
    """The robot that the command line names."""
    from armid.study.study import RobotChoice

    locked: dict[str, float] = {}
    for each in lock or ():
        name, equals, value = each.partition("=")
        try:
            locked[name] = float(value) if equals else 0.0
        except ValueError:
            raise ArmidError(
                f"--lock {each}: {value!r} is no number.", remedy="write --lock JOINT or --lock JOINT=VALUE."
            ) from None
    return RobotChoice(description, gravity, locked)


def model_choice(terms: str | None, *, default: tuple[str, ...] = ()) -> ModelChoice:
    """The terms that the command line names, with their default shapes.

    Args:
        terms: Names with commas between them, or `auto`.
        default: Terms where none are named, of commands that have no recordings to choose by.

    Raises:
        StudyError: An empty list, or `auto` without recordings.
    """
    from armid.study.study import ModelChoice

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
    """Where a run goes: what the command line says, else `runs/` and the arm's name, numbered where that is taken."""
    if out is not None:
        return out
    usual = Path("runs") / (re.sub(r"[^\w.+-]+", "-", robot).strip(".-") or "robot")
    numbered = (usual.with_name(f"{usual.name}-{number}") for number in count(2))
    return next(folder for folder in chain((usual,), numbered) if not folder.exists())


BASE_TERMS = ("rigid-body", "viscous", "coulomb")
"""Terms of every command but `identify`, Coulomb friction with a width of zero."""
