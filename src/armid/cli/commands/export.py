"""`armid export`: the model of a run as a robot description or as source code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.log_format_options import Data
from armid.cli.options import Json, claim_run
from armid.cli.value_completion import among
from armid.codegen.catalogue import LANGUAGES
from armid.export.catalogue import EXPORTERS
from armid.export.ros.catalogue import ROS_FILES

if TYPE_CHECKING:
    from armid.export.preparation import ExportChoices
    from armid.export.write import Exported

Out = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="File to write, or folder for source code, ROS packages and ensembles; by default in the folder of the "
        "run.",
    ),
]
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
PLAN_RATE = 100.0
"""Sampling rate of the plan of --motion [Hz], that of `armid predict`."""

Unphysical = Annotated[bool, typer.Option("--allow-unphysical", help="Also write physically inconsistent links.")]
Unidentified = Annotated[
    bool,
    typer.Option(
        "--allow-unidentified", help="Also write links whose mass neither torque nor the description determines."
    ),
]

Ensemble = Annotated[
    int | None,
    typer.Option(
        "--ensemble",
        metavar="N",
        help="Write N robot descriptions, with parameters drawn from the distribution of the estimate, to --out.",
    ),
]
Seed = Annotated[int, typer.Option("--seed", help="Seed of the draws of --ensemble.")]
Along = Annotated[
    str | None,
    typer.Option(
        "--motion",
        metavar="RECORDING | PLAN",
        help="Motion for which --ensemble draws torque errors; by default one like the training motion.",
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
    out: Out = None,
    description: Moved = None,
    data: Data = None,
    limit: Limit = None,
    nearest: Nearest = False,
    lumped: Lumped = False,
    allow_unphysical: Unphysical = False,
    allow_unidentified: Unidentified = False,
    ensemble: Ensemble = None,
    seed: Seed = 0,
    motion: Along = None,
    json: Json = False,
) -> None:
    """Write the identified values into a copy of the robot description, or the model as source code, and check it.

    In the same format, only changed numbers are edited; another format gives a new file without shapes. The file
    FILE.armid.json contains the whole model. For ROS, --to xacro writes a macro of the arm, ur-description and
    franka-description the YAML files of these packages, and ros2 a package with a plugin of inverse_dynamics_solver.

    Examples:
        armid export runs/today --to urdf --out arm_identified.urdf

        armid export runs/today --to ur-description --out config/ur5e

        armid export runs/today --to c --out code

        armid export runs/today --to mjcf --ensemble 100 --out arms
    """
    from armid.cli.motion.number_options import parse_limits
    from armid.errors import OutputError
    from armid.export.ros.write import export_for_ros
    from armid.export.write import export_run
    from armid.runs.run import load_run

    choices: ExportChoices = {
        "limits": parse_limits(limit) if limit else None,
        "nearest": nearest,
        "lumped": lumped,
        "allow_unphysical": allow_unphysical,
        "allow_unidentified": allow_unidentified,
    }
    claim_run(run, out)
    if ensemble is not None:
        return _ensemble(run, to, ensemble, out, seed, motion, description, choices, json=json)
    if motion is not None:
        raise OutputError(
            "--motion has an effect only together with --ensemble, which is not given.",
            remedy="give --ensemble N too; armid predict writes the torque of one model along a motion.",
        )
    if to in LANGUAGES:
        return _code(run, to, out, json=json)
    write = export_for_ros if to in ROS_FILES else export_run
    exported = write(load_run(run), to, out, description=description, data=data, **choices)
    _report(exported, json=json)


def _ensemble(
    run: str,
    to: str,
    count: int,
    out: Path | None,
    seed: int,
    motion: str | None,
    description: Path | None,
    choices: ExportChoices,
    *,
    json: bool,
) -> None:
    """Write `count` possible arms, drawn from the estimate; print the folder and the share of replaced draws."""
    import numpy as np

    from armid.cli.console import print_findings, progress
    from armid.errors import OutputError
    from armid.export.ensemble.write import PARAMETERS, ensemble_record, export_ensemble
    from armid.runs.run import load_run
    from armid.runs.validation_and_prediction import motion_of
    from armid.study.storage.records import finding_record, to_json

    if to not in EXPORTERS:
        raise OutputError(
            f"--ensemble writes robot descriptions; {to!r} is not a format of one.",
            possible=", ".join(EXPORTERS),
            remedy="name one of these formats with --to.",
        )
    loaded = load_run(run)
    along, found = (None, ()) if motion is None else motion_of(loaded, motion, rate=PLAN_RATE, reading={})
    with progress(quiet=json) as told:
        made = export_ensemble(
            loaded, to, count, out, seed=seed, description=description, motion=along, progress=told, **choices
        )
    if json:
        record = ensemble_record(loaded, made)
        record["findings"] += [finding_record(finding) for finding in found]
        sys.stdout.write(to_json(record) + "\n")
        return
    low, high = made.draws.spread
    sizes = np.sqrt(np.mean(made.draws.torque_error**2, axis=0))
    errors = ", ".join(f"{x:.3g} {joint.effort_unit}" for x, joint in zip(sizes, loaded.robot.joints, strict=True))
    sys.stdout.write(
        f"{len(made.files)} possible arms written to {made.folder}, their parameters to {PARAMETERS} there\n"
        f"  {made.draws.replaced:.0%} of the draws were no real bodies; the nearest ones are written\n"
        f"  the base parameters spread {low:.2f} to {high:.2f} times as far as the estimate says\n"
        f"  torque_error in {PARAMETERS} has an RMS of {errors} on the joints; add the\n"
        "  torque_error of a draw to its torques in the simulation: then they spread as armid predict --band says\n"
    )
    print_findings([*found, *made.findings])


def _code(run: str, to: str, out: Path | None, *, json: bool) -> None:
    """Write the model of a run as source code and print the names of the written files."""
    from armid.export.code import code_record, export_code
    from armid.runs.run import load_run
    from armid.study.storage.records import to_json

    exported = export_code(load_run(run), to, out)
    written = "".join(f"{path} written\n" for path in exported.files)
    sys.stdout.write(to_json(code_record(exported)) + "\n" if json else written)


def _report(exported: Exported, *, json: bool) -> None:
    """Print the written files and checks on standard output, and the findings on standard error."""
    from armid.cli.console import print_findings
    from armid.export.write import export_record
    from armid.study.storage.records import to_json
    from armid.validation.torque_validation import JointCheck

    if json:
        sys.stdout.write(to_json(export_record(exported)) + "\n")
        return
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
