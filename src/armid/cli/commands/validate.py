"""`armid validate`: torque error of a run on held-out motion."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.log_format_options import (
    Columns,
    Edges,
    Period,
    Preset,
    Rate,
    ReadingLines,
    TorqueSign,
    changed_reading,
)
from armid.cli.options import Json

if TYPE_CHECKING:
    from armid.runs.rollout import RunRollout
    from armid.runs.run import Run
    from armid.validation.torque_validation import Validation

Controller = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="JSON file with the gains of the controller, such as a truth.json; it then controls the simulated arm.",
    ),
]

Simulate = Annotated[
    bool,
    typer.Option(
        "--simulate",
        help="Also simulate the motion that the recorded torque causes, in short windows, and compare it with the "
        "recorded motion.",
    ),
]

Window = Annotated[float, typer.Option(metavar="S", help="Length of a simulated window, s.")]

Tolerance = Annotated[float, typer.Option(help="Largest tolerated position error of a simulated joint, rad or m.")]

Out = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="File for simulated and recorded motion and torque, .csv or .npz; implies --simulate."
    ),
]

Page = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.html", help="Page with plots of simulated and recorded motion and torque; implies --simulate."
    ),
]


def validate(
    run: Annotated[str, typer.Argument(help="Folder that armid identify or armid servo made.")],
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING…", help="Recordings of the same arm.")],
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    reading_lines: ReadingLines = None,
    period: Period = None,
    preset: Preset = None,
    edges: Edges = None,
    simulate: Simulate = False,
    window: Window = 0.5,
    tolerance: Tolerance = 0.01,
    controller: Controller = None,
    out: Out = None,
    page: Page = None,
    json: Json = False,
) -> None:
    """Validate a run on held-out recordings, which are read and processed like those of the run.

    Example:
        armid validate runs/today next_week.csv

        armid validate runs/today next_week.csv --simulate --window 0.3

        armid validate runs/today next_week.csv --controller gains.json --window 10 --page simulation.html
    """
    from armid.cli.commands.validate_rollout import check_files, roll_out, write_files
    from armid.cli.console import print_findings
    from armid.runs.rollout import judged_by_motion
    from armid.runs.run import load_run, with_edges
    from armid.runs.servos.stored_servo import is_servo_folder
    from armid.runs.validation_and_prediction import validate_run
    from armid.study.plausibility.recording_errors import contradictions

    if is_servo_folder(run):
        refused = simulate or controller is not None or out is not None
        changes = rate, torque_sign, columns, reading_lines, period, preset
        raise typer.Exit(_validate_servo(run, recordings, changes, page, refused=refused, json=json))
    loaded = with_edges(load_run(run), edges)
    reading = changed_reading(loaded.log_format, rate, torque_sign, columns, reading_lines, period, preset)
    check_files(out, page)
    validation, findings = validate_run(loaded, recordings, reading)
    torque_verdict = validation.verdict
    simulate |= any(each is not None for each in (controller, out, page))
    rollout = roll_out(loaded, recordings, reading, window, tolerance, controller) if simulate else None
    written: list[Path] = []
    if rollout is not None:
        validation = judged_by_motion(validation, rollout.scores, closed=rollout.closed)
        written = write_files(loaded, rollout, out, page)
    if json:
        sys.stdout.write(_json(validation, rollout, written))
    else:
        _print(loaded, validation, rollout, written)
    print_findings(findings)
    if validation.verdict == "fail":
        if torque_verdict == "fail" and not json and not contradictions(findings):
            _advise_recalibration(run, recordings)
        raise typer.Exit(1)


def _validate_servo(
    folder: str, recordings: Sequence[str], changes: tuple[Any, ...], page: Path | None, *, refused: bool, json: bool
) -> int:
    """Validate a result of `armid servo`, and return the exit code; `changes` are arguments of `changed_reading`."""
    from armid.cli.servos.servo_folder import validate_servo_folder
    from armid.errors import ArmidError
    from armid.measurement.log_format import LogFormat

    if refused:
        raise ArmidError(
            f"{folder} is a result of armid servo, which is always validated by simulated motion.",
            remedy="leave out --simulate, --controller and --out; --page FILE.html plots the motion.",
        )
    reading = changed_reading(LogFormat(), *changes)
    return 0 if validate_servo_folder(folder, recordings, reading, page, json=json) else 1


def _json(validation: Validation, rollout: RunRollout | None, written: Sequence[Path]) -> str:
    """Validation and rollout as one JSON object."""
    from armid.runs.rollout import motion_record
    from armid.study.storage.records import to_json, validation_record

    record = validation_record(validation)
    if rollout is not None:
        record["motion"] = motion_record(rollout.scores, closed=rollout.closed)
        record["files"] = [str(path) for path in written]
    return to_json(record) + "\n"


def _advise_recalibration(run: str, recordings: Sequence[str]) -> None:
    """Print the command that finds the parameters that have changed since a run."""
    command = shlex.join(["armid", "recalibrate", run, *recordings])
    sys.stdout.write(
        f"if the arm has changed since the run, {command} (with the same options) finds the changed parameters\n"
    )


def _print(run: Run, validation: Validation, rollout: RunRollout | None, written: Sequence[Path]) -> None:
    """Print the tables, the verdict and the written files."""
    from armid.cli.commands.validate_rollout import motion_table
    from armid.cli.console import output_console, print_verdict, validation_table

    console = output_console()
    console.print(validation_table(validation, (), [joint.effort_unit for joint in run.robot.joints]))
    if rollout is not None:
        console.print(motion_table(run.robot, rollout.scores, closed=rollout.closed))
    print_verdict(console, validation)
    for path in written:
        sys.stdout.write(f"simulated motion and torque written to {path}\n")
