"""`armid export`: a run's model as a robot description or as source code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.completion import EXPORTS, among
from armid.cli.options import Json
from armid.cli.reading import Data

if TYPE_CHECKING:
    from armid.export.write import Exported

__all__ = ["export"]

Moved = Annotated[Path | None, typer.Option(metavar="FILE", help="Where the robot description is, if it was moved.")]
Limit = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="JOINT.KIND=VALUE",
        help="Limits for a file of its own: A1.effort=80, '*.velocity=2', A1.position=-1:1; repeatable.",
    ),
]
Nearest = Annotated[
    bool,
    typer.Option("--nearest", help="Share mass between links as the description does where torque does not tell."),
]
Lumped = Annotated[
    bool,
    typer.Option(
        "--lumped",
        help="Give the whole of a link to the body that carries others on fixed or held joints; those are written "
        "without mass.",
    ),
]
Unphysical = Annotated[
    bool, typer.Option("--allow-unphysical", help="Write links that are not physically consistent, too.")
]
Unidentified = Annotated[
    bool,
    typer.Option(
        "--allow-unidentified", help="Write links whose mass neither torque nor the description tells, too."
    ),
]


To = Annotated[
    str,
    typer.Option(
        "--to",
        metavar="FORMAT",
        help="urdf, mjcf, sdf; c, cpp, matlab, python, julia.",
        autocompletion=among(EXPORTS),
    ),
]


def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Folder that armid identify made.")],
    to: To,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Where to write, code into a folder; in the run's if left out."),
    ] = None,
    description: Moved = None,
    data: Data = None,
    limit: Limit = None,
    nearest: Nearest = False,
    lumped: Lumped = False,
    allow_unphysical: Unphysical = False,
    allow_unidentified: Unidentified = False,
    json: Json = False,
) -> None:
    """Write the identified values into a copy of the robot description, or the model as source code, and check it.

    A description of the same format is edited where numbers change and nowhere else; another format gives a file of
    its own, without shapes. What the format has no place for stands in FILE.armid.json beside it.

    Examples:
        armid export runs/today --to urdf --out arm_identified.urdf

        armid export runs/today --to mjcf

        armid export runs/today --to c --out code
    """
    from armid.cli.motion.excite_request import parse_limits
    from armid.codegen import LANGUAGES
    from armid.export.write import export_record, export_run
    from armid.runs.run import load_run
    from armid.study.records import to_json

    if to in LANGUAGES:
        return _code(run, to, out, json=json)
    exported = export_run(
        load_run(run),
        to,
        out,
        description=description,
        data=data,
        limits=parse_limits(limit) if limit else None,
        nearest=nearest,
        lumped=lumped,
        allow_unphysical=allow_unphysical,
        allow_unidentified=allow_unidentified,
    )
    if json:
        sys.stdout.write(to_json(export_record(exported)) + "\n")
    else:
        _report(exported)


def _code(run: str, to: str, out: Path | None, *, json: bool) -> None:
    """Source code of the run's model."""
    from armid.export.code import code_record, export_code
    from armid.runs.run import load_run
    from armid.study.records import to_json

    exported = export_code(load_run(run), to, out)
    written = "".join(f"{path} written\n" for path in exported.files)
    sys.stdout.write(to_json(code_record(exported)) + "\n" if json else written)


def _report(exported: Exported) -> None:
    """Print what was written on standard output, what is to be known of it on standard error."""
    from armid.cli.console import print_findings

    how = f"{exported.edited}, edited" if exported.edited else "a file of its own"
    lines = [f"{exported.path} written ({how}); the whole model in {exported.side}"]
    lines += [
        f"  ok {check.value:8.1e}  {check.name}" for check in exported.checks if not check.name.startswith(PLACES)
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    print_findings(exported.findings)


PLACES = ("viscous", "coulomb", "rotor-inertia")
"""Checks of single numbers, of which there is one for every joint."""
