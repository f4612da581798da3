"""`armid preview`: page that shows the arm moving through a plan or a recording in a browser."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.log_format_options import Columns, Data, Rate, given
from armid.cli.options import Gravity, Json, Lock, Only, Package, TipLink, known_arms, robot_choice

if TYPE_CHECKING:
    from armid.errors import Finding
    from armid.measurement.log_format import LogFormat
    from armid.report.preview.inertia_ellipsoids import MassLayer
    from armid.robot import Robot
    from armid.robot.shapes import Shape
    from armid.runs.run import Run

PAGE = "preview.html"

SKELETON = "; it draws the joint axes and the lines between them, because bodies of the arm are missing"


ArmOrRun = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT | RUN",
        help="The arm, or a folder that armid identify or armid servo made.",
        autocompletion=known_arms,
    ),
]


def preview(
    robot: ArmOrRun,
    motion: Annotated[
        str | None,
        typer.Argument(
            metavar="[PLAN | RECORDING | RUN]",
            help="A plan.json or its folder, thesis-a1, a recording or a run; by default the motion of the run.",
        ),
    ] = None,
    floor: Annotated[float | None, typer.Option(help="Height of a floor above the base, m.")] = None,
    environment: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML of boxes, spheres and half-spaces.")
    ] = None,
    rate: Rate = None,
    columns: Columns = None,
    data: Data = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="File of the page.")] = None,
    json: Json = False,
) -> None:
    """Write a page that shows the arm in motion, with position limits, nearest bodies and masses of the links.

    The page is one file that opens without a network. It shows the shapes of the description, with its meshes if they
    are found; otherwise capsules and boxes, or only the joint axes. It can show the masses that a run identified.

    Examples:
        armid preview iiwa14-r820 plans/first --floor -1.5

        armid preview arm.urdf run1.csv --out run1.html

        armid preview arm.urdf runs/today
    """
    from armid.cli.console import print_missing_meshes
    from armid.report.preview.make_preview import preview_of
    from armid.report.preview.page import write_preview
    from armid.report.preview.servo_preview import clip_of_servo, layer_of_servo, servo_in
    from armid.report.rendering import require_extra
    from armid.study.config import load_choice

    require_extra("jinja2")
    run, motion_run, servo = _run(robot), _run(motion), servo_in(robot)
    choice = robot_choice(robot, gravity, lock, only, tip, package)
    known = run or servo
    arm = load_choice(choice) if known is None else _with_meshes(run) if run and package else known.robot
    known_run, default_folder = motion_run or run, Path(robot) if (run or servo) and motion is None else Path()
    with print_missing_meshes(quiet=json):
        made = preview_of(
            arm,
            motion_run or motion or run or (None if servo is None else clip_of_servo(servo, data)),
            reading=_reading(known_run, given(columns, rate)),
            data=data,
            surroundings=_surroundings(arm, floor, environment),
            estimate=_estimate(known_run, arm) if servo is None else layer_of_servo(servo),
        )
        path, missing = write_preview(made, out or default_folder / PAGE)
    _report(path, missing, json=json)


def _report(path: Path, missing: Sequence[Finding], *, json: bool) -> None:
    """Print the path of the page and, on standard error, the bodies that it does not show."""
    from armid.cli.console import print_findings
    from armid.study.storage.records import finding_record, to_json

    findings = [finding_record(each) for each in missing]
    record = {"preview": str(path), "bytes": path.stat().st_size, "findings": findings}
    sys.stdout.write(to_json(record) + "\n" if json else f"page written to {path}{SKELETON if missing else ''}\n")
    print_findings(missing, shapes=True)


def _run(name: str | None) -> Run | None:
    """Run in a folder; `None` if the folder contains no run."""
    from armid.runs.run import MARKER, load_run

    return load_run(name) if name is not None and (Path(name) / MARKER).is_file() else None


def _with_meshes(run: Run) -> Robot:
    """Arm of a run with the shapes of its description; meshes are searched in the packages given by --package."""
    from dataclasses import replace

    from armid.export.input_digest_check import find_source
    from armid.robot.loading import load_robot

    source = find_source(run)
    arm = load_robot(source.path, gravity=run.robot.gravity, lock=source.locked)
    return replace(run.robot, shapes=arm.shapes, visuals=arm.visuals, findings=arm.findings)


def _reading(run: Run | None, arguments: dict[str, Any]) -> LogFormat:
    """Log format of a recording, from the command line if given, otherwise from the run."""
    from armid.measurement.log_format import LogFormat

    return LogFormat(**arguments) if run is None or arguments else run.log_format


def _surroundings(arm: Robot, floor: float | None, environment: Path | None) -> tuple[Shape, ...]:
    """Bodies around the arm: the bodies of the environment file, and the floor."""
    from armid.excitation.collision.distances import floor as floor_at
    from armid.excitation.collision.environment import load_environment

    around = () if environment is None else load_environment(environment, arm)
    return around if floor is None else (*around, floor_at(floor, arm.gravity))


def _estimate(run: Run | None, arm: Robot) -> MassLayer | None:
    """Inertias of the links according to a run; `None` without a run or if the run is of another arm.

    If the run has only base parameters, consistent inertias with these base parameters are used.
    """
    from armid.errors import ArmidError
    from armid.export.standard_values import values_to_write
    from armid.report.preview.make_preview import estimate_layer

    if run is None or run.robot.joint_names != arm.joint_names:
        return None
    notes = {
        "estimated": "",
        "nearest": "base parameters do not determine how the mass is distributed among the links; the page shows the "
        "physically consistent links with these base parameters that are nearest to the description",
        "unphysical": "no physically consistent links have these base parameters; links that are shown without an "
        "ellipsoid are not consistent",
    }
    try:
        theta, kind, _ = values_to_write(run, allow_unphysical=True)
    except ArmidError as error:
        sys.stderr.write(f"masses of the estimate are not shown: {error.problem}\n")
        return None
    return estimate_layer(theta, run, notes[kind])
