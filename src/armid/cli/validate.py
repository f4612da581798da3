"""`armid validate`: a run's torque error on motion that it has not seen."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer

from armid.cli.options import Json

__all__ = ["changed_reading", "validate"]


def validate(
    run: Annotated[str, typer.Argument(help="Folder that armid identify made.")],
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING…", help="Recordings of the same arm.")],
    rate: Annotated[float | None, typer.Option(help="Samples a second, Hz, where there is no clock.")] = None,
    torque_sign: Annotated[int | None, typer.Option(help="-1 where the torque is measured against the URDF.")] = None,
    json: Json = False,
) -> None:
    """Check a run on unseen recordings, read and processed as the run's own were.

    Example:
        armid validate runs/today next_week.csv
    """
    from armid.cli.console import output_console, print_findings, print_verdict, validation_table
    from armid.study.apply import validate_run
    from armid.study.records import to_json, validation_record
    from armid.study.run import load_run

    loaded = load_run(run)
    found, findings = validate_run(loaded, recordings, changed_reading(rate, torque_sign))
    print_findings(findings)
    if json:
        sys.stdout.write(to_json(validation_record(found)) + "\n")
    else:
        console = output_console()
        units = [joint.effort_unit for joint in loaded.robot.joints]
        console.print(validation_table(found, (), units))
        print_verdict(console, found)
    if found.verdict == "fail":
        raise typer.Exit(1)


def changed_reading(rate: float | None, torque_sign: int | None) -> dict[str, Any]:
    """What the command line says of reading beyond the run."""
    said = {"rate": rate, "torque_sign": torque_sign}
    return {key: value for key, value in said.items() if value is not None}
