"""`armid monitor`: alarms when the external torque of a recording exceeds thresholds for a rate of false alarms."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.log_format_options import Columns, Data, Rate, ReadingLines, TorqueSign, changed_reading
from armid.cli.options import Json
from armid.cli.value_completion import among
from armid.errors import ArmidError

if TYPE_CHECKING:
    from rich.console import Console

    from armid.runs.monitoring.monitor import Alarm, Monitor, Watched

MAX_ALARMS = 30
"""Largest number of alarms in the printed table."""

OBSERVER_KINDS = ("momentum", "residual")

Observer = Annotated[
    str,
    typer.Option(
        "--observer",
        metavar="KIND",
        help="momentum: observer of the generalised momentum; residual: inverse dynamics of the filtered motion.",
        autocompletion=among(OBSERVER_KINDS),
    ),
]
Gain = Annotated[
    float | None,
    typer.Option(
        "--gain",
        metavar="K",
        help="Gain K of the observer, 1/s; its output is delayed by 2/K; by default 100, or half the sample rate if "
        "this is less.",
    ),
]
References = Annotated[
    list[str] | None,
    typer.Option(
        "--reference",
        metavar="RECORDING",
        help="Recording without contact, made after the run, from which the thresholds are computed; by default the "
        "recordings of the run, each predicted by an estimate without it; repeatable.",
    ),
]


FalseAlarms = Annotated[
    float | None,
    typer.Option(
        "--false-alarms",
        metavar="PER_HOUR",
        help="False alarms per hour of the whole arm; by default the smallest rate that can be promised, but at "
        "least 1.",
    ),
]
OutFile = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FILE", help="File to write: .csv for torque and thresholds over time, .json for alarms."
    ),
]
PageFile = Annotated[
    Path | None,
    typer.Option("--page", metavar="FILE.html", help="Page to write, with plots of external torque and thresholds."),
]
Code = Annotated[
    Path | None,
    typer.Option("--code", metavar="FOLDER", help="Folder to write the monitor to, as C code for a controller."),
]


def monitor(
    run: Annotated[str, typer.Argument(help="Folder that armid identify made.")],
    recording: Annotated[str, typer.Argument(metavar="RECORDING", help="Recording made after the run.")],
    false_alarms: FalseAlarms = None,
    observer: Observer = "momentum",
    gain: Gain = None,
    reference: References = None,
    data: Data = None,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    reading_lines: ReadingLines = None,
    out: OutFile = None,
    page: PageFile = None,
    code: Code = None,
    json: Json = False,
) -> None:
    """Find external torque, as by pushes and collisions, in a recording; this is no safety function.

    The external torque is that of the model of the run minus the measured torque. An alarm is given where it exceeds
    a threshold, which is computed from the errors of the model on motion without contact for a rate of false alarms.
    The command is neither certified nor redundant: do not protect people with it.

    Examples:
        armid monitor runs/today shift.csv --false-alarms 10

        armid monitor runs/today shift.csv --reference free_1.csv --reference free_2.csv --out external.csv
    """
    from armid.cli.console import print_findings, progress
    from armid.report.rendering import require_extra
    from armid.runs.monitoring.monitor import make_monitor, watch
    from armid.runs.monitoring.observer import ObserverOptions
    from armid.runs.new_recordings import read_new_recordings
    from armid.runs.run import load_run

    if out is not None and out.suffix not in (".csv", ".json"):
        raise ArmidError(
            f"{out} cannot be written, because its suffix is neither .csv nor .json.",
            remedy="give a file with one of these suffixes.",
        )
    if page is not None:
        require_extra()
    loaded = load_run(run)
    options = ObserverOptions(observer, gain)  # pyright: ignore[reportArgumentType]
    reading = changed_reading(loaded.log_format, rate, torque_sign, columns, reading_lines)
    read, findings = read_new_recordings(loaded, [recording, *(reference or [])], reading)
    (_, watched_recording), *references = read
    given = [each for _, each in references]
    with progress(quiet=json) as tell:
        made = make_monitor(
            loaded, false_alarms=false_alarms, options=options, references=given, data=data, progress=tell
        )
    watched = watch(made, watched_recording)
    written = [*_written(made, recording, watched, out, code), *_written_page(made, recording, watched, page)]
    print_findings([*(finding for each in findings for finding in each), *made.findings, *watched.findings])
    _show(made, recording, watched, written, json=json)


def _written(made: Monitor, path: str, watched: Watched, out: Path | None, code: Path | None) -> list[Path]:
    """Write the files of --out and --code, if given; return the paths of the written files."""
    from armid.atomic_file import replace_file
    from armid.export.monitor import export_monitor
    from armid.runs.monitoring.monitor_record import monitor_record, monitor_table
    from armid.study.storage.records import to_json

    written: list[Path] = []
    if out is not None:
        if out.suffix == ".csv":
            text = monitor_table(watched, made.run.robot.joint_names)
        else:
            text = to_json(monitor_record(made, [(path, watched)])) + "\n"
        written.append(replace_file(out, text))
    return written if code is None else [*written, *export_monitor(made, code)]


def _written_page(made: Monitor, path: str, watched: Watched, page: Path | None) -> list[Path]:
    """Write the page `page` with plots, if it is given; return a list with its path, or an empty list."""
    if page is None:
        return []
    from armid.report.monitor_page import write_monitor_page

    return [write_monitor_page(made, watched, Path(path).name, page)]


def _show(made: Monitor, path: str, watched: Watched, written: list[Path], *, json: bool) -> None:
    """Print thresholds, alarms and written files; if `json`, print one JSON object with thresholds and alarms."""
    from armid.cli.console import output_console
    from armid.runs.monitoring.monitor_record import monitor_record
    from armid.study.storage.records import to_json

    if json:
        sys.stdout.write(to_json(monitor_record(made, [(path, watched)])) + "\n")
        return
    _report(output_console(), made, watched)
    sys.stdout.write("".join(f"{each} written\n" for each in written))


def _report(console: Console, made: Monitor, watched: Watched) -> None:
    """Print the thresholds and the alarms."""
    from rich.markup import escape
    from rich.table import Table

    from armid.notebook_display import plural
    from armid.runs.monitoring.monitor import NO_SAFETY

    found, robot = made.thresholds, made.run.robot
    table = Table(title=f"{escape(robot.name)}: thresholds for {found.rate:.3g} false alarms per hour")
    for name in ("joint", "mean threshold", "unit", "follows the motion", "more at rest"):
        table.add_column(name, justify="left" if name in ("joint", "unit") else "right")
    for j, joint in enumerate(robot.joints):
        follows = "yes" if found.follows[j] else "no"
        unit = "N" if joint.is_prismatic else "N·m"
        table.add_row(escape(joint.name), f"{found.mean[j]:.3g}", unit, follows, f"{found.friction[j]:.3g}")
    console.print(table)
    least = f"smallest rate that can be promised: {found.smallest:.3g} per hour"
    if found.smallest == float("inf"):
        least = "no rate can be promised"
    console.print(
        f"from {found.seconds / 60.0:.1f} min of unseen motion; {least}; observer {made.options.kind}, delayed by "
        f"{2000.0 / made.options.gain_at(made.rate):.0f} ms"
    )
    count = plural(len(watched.alarms), "alarm")
    console.print(f"\n{count} in {watched.seconds:.1f} s")
    if watched.alarms:
        console.print(_alarm_table(made, watched.alarms))
    if len(watched.alarms) > MAX_ALARMS:
        console.print(f"and {len(watched.alarms) - MAX_ALARMS} more; --json lists all")
    console.print(NO_SAFETY)


def _alarm_table(made: Monitor, alarms: tuple[Alarm, ...]) -> object:
    """Table of alarms: time, duration, joint, size, threshold, and force and moment at the tip."""
    from rich.markup import escape
    from rich.table import Table

    units = {joint.name: "N" if joint.is_prismatic else "N·m" for joint in made.run.robot.joints}
    table = Table(title="Alarms")
    for name in ("t [s]", "duration [s]", "joint", "external torque", "threshold", *WRENCH):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for alarm in alarms[:MAX_ALARMS]:
        table.add_row(
            f"{alarm.start:.3f}",
            f"{alarm.duration:.3f}",
            escape(alarm.joint),
            f"{alarm.size:.3g} {units[alarm.joint]}",
            f"{alarm.threshold:.3g}",
            *_wrench_texts(alarm),
        )
    return table


WRENCH = ("force at the tip [N]", "moment at the tip [N·m]")


def _wrench_texts(alarm: Alarm) -> list[str]:
    """Force and moment at the tip in x, y and z, each with the half width of its 95 % interval."""
    from armid.report.data.number_format import with_half_width

    if alarm.wrench is None:
        return ["–", "–"]
    texts = [
        "?" if spread == float("inf") else with_half_width(float(value), 1.96 * float(spread))
        for value, spread in zip(alarm.wrench.value, alarm.wrench.deviation, strict=True)
    ]
    return [", ".join(texts[:3]), ", ".join(texts[3:])]
