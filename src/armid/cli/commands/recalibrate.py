"""`armid recalibrate`: update of a run after a change of friction or tool."""

from __future__ import annotations

import sys
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
from armid.cli.options import Json, Out, run_folder
from armid.errors import OutputError, StudyError

if TYPE_CHECKING:
    from armid.runs.recalibration import Changed, Recalibration
    from armid.study.identify import Result


def recalibrate(
    run: Annotated[str, typer.Argument(help="Earlier run.")],
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING…", help="New recordings of the same arm.")],
    validate: Annotated[
        list[str] | None,
        typer.Option("--validate", metavar="RECORDING…", help="Validation recordings, also made after the change."),
    ] = None,
    tool: Annotated[
        bool, typer.Option("--tool", help="Also estimate the tool, that is, the last link, again.")
    ] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Estimate all parameters again, from the new recordings only.")
    ] = False,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    reading_lines: ReadingLines = None,
    period: Period = None,
    preset: Preset = None,
    edges: Edges = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Estimate friction and offsets again, take other parameters from an earlier run, and list the changes.

    Examples:
        armid recalibrate runs/spring autumn.csv --out runs/autumn

        armid recalibrate runs/spring other_tool.csv --tool
    """
    from armid.cli.console import print_findings
    from armid.runs.recalibration import recalibrate as stage
    from armid.runs.recalibration_record import CHANGES, changes_record
    from armid.runs.run import load_run, refuse_folder, save_run, with_edges

    if tool and everything:
        raise StudyError("--tool and --all are both given.", remedy="give only one of them; --all includes the tool.")
    let_change: Changed = "tool" if tool else "all" if everything else "friction"
    earlier = with_edges(load_run(run), edges)
    folder = run_folder(out, f"{earlier.robot.name}-recalibrated")
    if folder.resolve() == Path(run).resolve():
        raise OutputError(
            f"The result cannot be written to {folder}, because this is the folder of the earlier run.",
            remedy="choose another folder with --out.",
        )
    refuse_folder(folder)
    reading = changed_reading(earlier.log_format, rate, torque_sign, columns, reading_lines, period, preset)
    recalibration = stage(earlier, recordings, reading, changed=let_change, held_out=validate or [])
    changes = changes_record(recalibration)
    save_run(recalibration.result, folder, further_records={CHANGES: changes})
    if json:
        sys.stdout.write(_record(recalibration.result, folder, changes) + "\n")
    else:
        _report(recalibration, len(recordings))
        sys.stdout.write(f"\nrun written to {folder}\n")
    print_findings(recalibration.result.estimate.findings)
    if recalibration.result.validation.verdict == "fail":
        raise typer.Exit(1)


def _record(result: Result, folder: Path, changes: dict[str, Any]) -> str:
    """JSON object that `armid recalibrate --json` prints."""
    from armid.study.storage.records import estimate_record, to_json, validation_record

    record = estimate_record(result.estimate)
    record["run"] = str(folder)
    record["validation"] = validation_record(result.validation)
    return to_json({**record, **changes})


def _report(recalibration: Recalibration, recordings: int) -> None:
    """Print the changed parameters and the torque error on standard output."""
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console, print_verdict, validation_table
    from armid.cli.identification_result import intervals_text
    from armid.estimation.update.parameter_change import changed
    from armid.notebook_display import plural
    from armid.report.data.number_format import decimals_of

    console, result = output_console(), recalibration.result
    base = result.estimate.base
    units: dict[str, str] = dict(zip(base.names, base.units, strict=True))
    beyond = changed(recalibration.changes)
    table = Table(
        title=f"{escape(result.robot.name)}: changed beyond their 95 % intervals since {recalibration.earlier}"
    )
    for name in ("parameter", "before", "after", "unit", "change", "± 95 %"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for each in beyond:
        digits = decimals_of(each.half or abs(each.change))
        values = [f"{value:.{digits}f}" for value in (each.before, each.after, each.change, each.half)]
        table.add_row(escape(each.name), *values[:2], units[each.name], *values[2:])
    total = plural(len(recalibration.changes), "parameter")
    if beyond:
        console.print(table)
        console.print(
            f"not changed beyond their 95 % intervals: {len(recalibration.changes) - len(beyond)} of {total}"
        )
    else:
        console.print(f"none of {total} has changed beyond its 95 % interval since {escape(recalibration.earlier)}")
    joint_units = [joint.effort_unit for joint in result.robot.joints]
    console.print(
        validation_table(result.validation, result.training[:recordings], joint_units, recalibration.before)
    )
    console.print(escape(intervals_text(result.estimate.fit, result.information.scale_deviation)))
    print_verdict(console, result.validation)
