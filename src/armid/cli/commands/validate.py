"""`armid validate`: torque error of a run on held-out motion."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

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

Controller = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="JSON file with the gains of the controller, such as a truth.json; the simulation has this feedback.",
    ),
]


def validate(
    run: Annotated[str, typer.Argument(help="Folder that armid identify made.")],
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING…", help="Recordings of the same arm.")],
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    reading_lines: ReadingLines = None,
    period: Period = None,
    preset: Preset = None,
    edges: Edges = None,
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate", help="Also simulate the model from the torque in short windows, and compare the motion."
        ),
    ] = False,
    window: Annotated[float, typer.Option(metavar="S", help="Length of a simulated window, s.")] = 0.5,
    tolerance: Annotated[
        float, typer.Option(help="Largest tolerated position error of a simulated joint, rad or m.")
    ] = 0.01,
    controller: Controller = None,
    json: Json = False,
) -> None:
    """Validate a run on held-out recordings, which are read and processed like those of the run.

    Example:
        armid validate runs/today next_week.csv

        armid validate runs/today next_week.csv --simulate --window 0.3
    """
    from armid.cli.commands.validate_rollout import motion_table, roll_out
    from armid.cli.console import output_console, print_findings, print_verdict, validation_table
    from armid.runs.rollout import judged_by_motion, motion_record
    from armid.runs.run import load_run, with_edges
    from armid.runs.validation_and_prediction import validate_run
    from armid.study.storage.records import to_json, validation_record

    loaded = with_edges(load_run(run), edges)
    reading = changed_reading(loaded.log_format, rate, torque_sign, columns, reading_lines, period, preset)
    closed = controller is not None
    validation, findings = validate_run(loaded, recordings, reading)
    simulate |= closed
    motion = roll_out(loaded, recordings, reading, window, tolerance, controller) if simulate else ()
    if motion:
        validation = judged_by_motion(validation, motion, closed=closed)
    if json:
        record = validation_record(validation)
        if motion:
            record["motion"] = motion_record(motion, closed=closed)
        sys.stdout.write(to_json(record) + "\n")
    else:
        console = output_console()
        units = [joint.effort_unit for joint in loaded.robot.joints]
        console.print(validation_table(validation, (), units))
        if motion:
            console.print(motion_table(loaded.robot, motion, closed=closed))
        print_verdict(console, validation)
    print_findings(findings)
    if validation.verdict == "fail":
        raise typer.Exit(1)
