"""`armid export`: the model of a run as a robot description or as source code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.log_format_options import Data
from armid.cli.options import Json
from armid.cli.value_completion import among
from armid.codegen.catalogue import LANGUAGES
from armid.export.catalogue import EXPORTERS
from armid.export.ros.catalogue import ROS_FILES

if TYPE_CHECKING:
    from armid.export.write import Exported

Moved = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Robot description of the run, if the file was moved.")
]
Limit = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="JOINT.KIND=VALUE",
        help="Joint limits for a new file, for instance A1.effort=80, '*.velocity=2', A1.position=-1:1; repeatable.",
    ),
]
Nearest = Annotated[
    bool,
    typer.Option(
        "--nearest",
        help="If the torques do not determine the masses of the links, write the masses nearest to the description.",
    ),
]
Lumped = Annotated[
    bool,
    typer.Option(
        "--lumped",
        help="Give all mass of a link to its main body; bodies on fixed or locked joints are written without mass.",
    ),
]
Unphysical = Annotated[bool, typer.Option("--allow-unphysical", help="Also write physically inconsistent links.")]
Unidentified = Annotated[
    bool,
    typer.Option(
        "--allow-unidentified", help="Also write links whose mass neither torque nor the description determines."
    ),
]


To = Annotated[
    str,
    typer.Option(
        "--to",
        metavar="FORMAT",
        help=f"{', '.join(EXPORTERS)}; {', '.join(ROS_FILES)}; {', '.join(LANGUAGES)}.",
        autocompletion=among((*EXPORTERS, *ROS_FILES, *LANGUAGES)),
    ),
]


def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Folder that armid identify made.")],
    to: To,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="File to write, or folder for source code and ROS packages; by default in the folder of the run.",
        ),
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

    In a description of the same format, only the numbers that change are edited. For another format, a new file
    without shapes is written. FILE.armid.json next to the file contains the whole model, also what the format cannot
    store. For ROS, --to xacro writes a macro of the arm, --to ur-description and --to franka-description the YAML
    files of these packages, and --to ros2 a package with a plugin of inverse_dynamics_solver.

    Examples:
        armid export runs/today --to urdf --out arm_identified.urdf

        armid export runs/today --to ur-description --out config/ur5e

        armid export runs/today --to c --out code

        armid export runs/today --to ros2 --out src/my_arm
    """
    from armid.cli.motion.number_options import parse_limits
    from armid.export.ros.write import export_for_ros
    from armid.export.write import export_record, export_run
    from armid.runs.run import load_run
    from armid.study.storage.records import to_json

    if to in LANGUAGES:
        return _code(run, to, out, json=json)
    exported = (export_for_ros if to in ROS_FILES else export_run)(
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
    """Write the model of a run as source code and print the names of the written files."""
    from armid.export.code import code_record, export_code
    from armid.runs.run import load_run
    from armid.study.storage.records import to_json

    exported = export_code(load_run(run), to, out)
    written = "".join(f"{path} written\n" for path in exported.files)
    sys.stdout.write(to_json(code_record(exported)) + "\n" if json else written)


def _report(exported: Exported) -> None:
    """Print the written files and checks on standard output, and the findings on standard error."""
    from armid.cli.console import print_findings
    from armid.validation.torque_validation import JointCheck

    origin = f"{exported.edited}, edited" if exported.edited and not exported.files else "a new file"
    lines = [f"{path} written" for path in exported.files[1:]]
    lines.append(f"{exported.path} written ({origin}); {exported.side} contains the whole model")
    lines += [
        f"  ok {check.value:8.1e}  {check.name}"
        for check in exported.checks
        if not isinstance(check, JointCheck)  # too many to read: one for every term of every joint
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    print_findings(exported.findings)
