"""`armid payload`: payload or tool of an identified arm, or drive gains of the arm from a known payload."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.log_format_options import Columns, Rate, ReadingLines, TorqueSign, changed_reading
from armid.cli.options import Json, Out, claim_run
from armid.cli.value_completion import among, moving_links
from armid.export.load.catalogue import CONTROLLERS

if TYPE_CHECKING:
    from rich.table import Table

    from armid.checked_array import Array
    from armid.errors import Finding, OutputError
    from armid.export.load.write import WrittenLoad
    from armid.runs.payload import Payload


PayloadLinkName = Annotated[
    str | None,
    typer.Option(
        "--link",
        metavar="NAME",
        help="Link that carries the payload; the results are in its frame. By default the link of the tip frame, "
        "with results in the tip frame.",
        autocompletion=moving_links,
    ),
]


CentreOfMass = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--com",
        metavar="X Y Z",
        help="Known centre of mass of the payload, m, in the tip frame or the frame of --link.",
    ),
]


To = Annotated[
    list[str] | None,
    typer.Option(
        "--to",
        metavar="CONTROLLER",
        help=f"Also write the payload for controllers: {', '.join(CONTROLLERS)}; repeatable, or a list with commas.",
        autocompletion=among(tuple(CONTROLLERS)),
    ),
]


Flange = Annotated[
    str | None,
    typer.Option(
        "--flange",
        metavar="FRAME",
        help="Frame of the flange for --to: a frame of the description, or x,y,z,roll,pitch,yaw of the flange in the "
        "tip frame, m and rad; by default the tip frame.",
    ),
]


Run = Annotated[
    str, typer.Argument(help="Run of the arm without the payload; or a stored payload.json, to convert by --to.")
]
Recordings = Annotated[list[str] | None, typer.Argument(metavar="RECORDING…", help="Recordings with the payload.")]
Mass = Annotated[
    float | None,
    typer.Option(metavar="KG", help="Known mass of the payload, kg; the drive gains are then estimated."),
]
GainDeviation = Annotated[
    float | None, typer.Option(min=0.0, help="Relative standard deviation of the drive gains, for instance 0.1.")
]
SameFriction = Annotated[
    bool, typer.Option("--same-friction", help="Keep the friction of the run; by default it is estimated again.")
]


def payload(
    run: Run,
    recordings: Recordings = None,
    mass: Mass = None,
    com: CentreOfMass = None,
    link: PayloadLinkName = None,
    gain_deviation: GainDeviation = None,
    same_friction: SameFriction = False,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    reading_lines: ReadingLines = None,
    to: To = None,
    flange: Flange = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Estimate the ten inertial parameters of a payload; recordings are processed like those of the run.

    With --to, mass, centre of mass and inertia are also written in the form in which robot controllers take them.
    None of these forms was tried on a robot.

    Examples:
        armid payload runs/arm with_load.csv

        armid payload runs/arm with_load.csv --mass 2.805

        armid payload runs/arm with_load.csv --link forearm_link

        armid payload runs/arm with_load.csv --to ur --out load

        armid payload load/payload.json --to kuka,abb
    """
    from armid.output.locks import claim
    from armid.runs.payload import find_payload
    from armid.runs.run import load_run

    _refuse_options(recordings, to, flange)
    if not recordings:
        others = (mass, com, link, gain_deviation, rate, torque_sign, columns, reading_lines)
        _refuse_estimation(given=same_friction or any(option is not None for option in others))
        return _converted(run, to or (), flange, out, json=json)
    if out is not None:
        claim(out)
    elif to:
        claim_run(run, out)
    loaded = load_run(run)
    found = find_payload(
        loaded,
        recordings,
        changed_reading(loaded.log_format, rate, torque_sign, columns, reading_lines),
        mass=mass,
        com=com,
        gain_deviation=gain_deviation,
        same_friction=same_friction,
        link=link,
    )
    _estimated(found, to or (), flange, out, json=json)


PAYLOAD = "payload.json"
"""Name of the file with an estimated payload."""


def _estimated(found: Payload, to: Sequence[str], flange: str | None, out: Path | None, *, json: bool) -> None:
    """Write an estimated payload to `payload.json` and to files for controllers, if requested, and print it."""
    from armid.cli.console import print_error, print_findings
    from armid.cli.json_errors import BAD_INPUT

    refused = [_not_written()] if to and found.contradictions else []
    written, error, record = _write(found, () if refused else to, flange, out, asked=bool(to))
    if json:
        sys.stdout.write(record)
    else:
        _report(found)
    if out is not None and not json:
        sys.stdout.write(f"\nwritten to {out / PAYLOAD}\n")
    _report_written(written, json=json)
    print_findings([*found.findings, *refused, *(finding for each in written for finding in each.findings)])
    if error is not None and json:  # standard output has its one JSON document already
        print_error(error)
        raise typer.Exit(BAD_INPUT)
    if error is not None:
        raise error
    if found.contradictions:
        raise typer.Exit(1)


def _write(
    found: Payload, to: Sequence[str], flange: str | None, out: Path | None, *, asked: bool
) -> tuple[tuple[WrittenLoad, ...], OutputError | None, str]:
    """Write `payload.json`, if --out is given, and the files for controllers, all of them or none.

    Returns:
        Files for controllers, the error for which there are none, and the text of `payload.json`.
    """
    from armid.errors import OutputError
    from armid.export.load.flange_load import load_at_flange
    from armid.export.load.write import write_load, written_record
    from armid.output.file_group import replace_files
    from armid.runs.payload import payload_record
    from armid.study.storage.records import to_json

    def further(files: tuple[WrittenLoad, ...], problem: str = "") -> dict[str, str]:
        more: dict[str, object] = {"controllers": written_record(files)} if asked else {}
        more |= {"controllers_refused": problem} if problem else {}
        return {PAYLOAD: to_json(payload_record(found) | more) + "\n"}

    error = None
    if to:
        folder = Path(found.new_recordings.run.folder) / "load" if out is None else out
        try:
            written = write_load(load_at_flange(found, flange), to, folder, further=None if out is None else further)
            return written, None, further(written)[PAYLOAD]
        except OutputError as unwritten:  # the caller raises it, so that the estimate is not lost
            error = unwritten
    text = further((), error.problem if error else "")
    if out is not None:
        replace_files(out, text)
    return (), error, text[PAYLOAD]


def _refuse_estimation(*, given: bool) -> None:
    """Raise an error if options of an estimate are given although a stored payload.json is only converted."""
    from armid.errors import OutputError

    if given:
        raise OutputError(
            "Options of the estimate have no effect when a stored payload.json is converted.",
            possible="--to, --flange, --out, --json",
            remedy="leave the other options out, or give recordings with the payload.",
        )


def _refuse_options(recordings: Sequence[str] | None, to: Sequence[str] | None, flange: str | None) -> None:
    """Raise an error without recordings and --to, for unknown controllers, and for --flange without --to."""
    from armid.errors import OutputError
    from armid.export.load.write import controller_names

    if not recordings and not to:
        raise typer.BadParameter("give recordings with the payload, or --to to convert a stored payload.json")
    if flange is not None and not to:
        raise OutputError("--flange has no effect without --to.", remedy="name a controller with --to.")
    if to:
        controller_names(to)


def _not_written() -> Finding:
    """Finding that a load from recordings with errors is not written for a controller."""
    from armid.errors import Finding

    evidence = "The recordings have errors, which make the load wrong, so it is not written for a controller."
    return Finding("load-not-written", "warning", "", evidence, "correct the errors and estimate the load again.")


def _converted(stored: str, to: Sequence[str], flange: str | None, out: Path | None, *, json: bool) -> None:
    """Write the payload of a stored `payload.json` to files for controllers, and print the names of the files."""
    from armid.cli.console import print_findings
    from armid.export.load.flange_load import read_load
    from armid.export.load.write import write_load, written_record
    from armid.study.storage.records import to_json

    beside = Path(stored) if Path(stored).is_dir() else Path(stored).parent
    written = write_load(read_load(stored, flange), to, beside if out is None else out)
    if json:
        sys.stdout.write(to_json({"payload": stored, "controllers": written_record(written)}) + "\n")
    _report_written(written, json=json)
    print_findings([finding for each in written for finding in each.findings])


def _report_written(written: Sequence[WrittenLoad], *, json: bool) -> None:
    """Print the names of the files written for controllers; nothing is printed if `json` is true."""
    if json or not written:
        return
    lines = [f"{path} written" for each in written for path in each.files]
    lines.append(f"flange: {written[0].flange}; none of these forms was tried on a robot")
    sys.stdout.write("\n".join(lines) + "\n")


def _report(payload: Payload) -> None:
    """Print the load, its parameters and the drive gains on standard output, each as a table."""
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console, print_contradictions
    from armid.cli.identification_result import intervals_text
    from armid.runs.payload import payload_record

    console, record = output_console(), payload_record(payload)
    print_contradictions(console, payload.contradictions)
    console.print(_body(payload))
    if payload.place.frame == payload.new_recordings.run.robot.tip.name:
        link, frame = escape(payload.place.link), escape(payload.place.frame)
        console.print(
            f"the load is on the link {link}, which carries the tip frame {frame}; --link selects another link"
        )
    if payload.load.distance > 0.0:
        console.print(
            "the load is the nearest physically consistent body; its distance from the unconstrained estimate is "
            f"{payload.load.distance:.2f} standard deviations"
        )
    console.print(_parameters(record))
    deviation = payload.new_recordings.new.scale_deviation
    keys = "drive_gain_deviation, --gain-deviation"
    console.print(escape(intervals_text(payload.load.solution.fit, deviation, keys)))
    if record["gains"] is None:
        return
    if deviation.any():
        console.print(
            "if the load hardly affects the torque of a joint, the drive gain of this joint keeps nearly its whole "
            "standard deviation"
        )
    table = Table(title="Drive gains")
    for name in ("joint", "given", "found", "correction", "95 % interval"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for each in record["gains"]:
        determined = each["gain"] is not None
        table.add_row(
            escape(each["joint"]),
            f"{each['given']:.3f}",
            f"{each['gain']:.3f}" if determined else "-",
            f"{100 * each['correction']:+.1f} %" if determined else "-",
            _interval(100 * each["interval95"], 1) if determined else "-",
        )
    console.print(table)


def _body(payload: Payload) -> Table:
    """Table of mass, centre of mass and inertia about the centre of mass, which robot controllers need."""
    from rich.markup import escape
    from rich.table import Table

    from armid.maths.inertia import INERTIA_INDEX

    load, frame = payload.load, escape(payload.place.frame)
    table = Table(
        title=f"{escape(payload.new_recordings.run.robot.name)}: load in the frame {frame}", header_style="bold"
    )
    for name in ("load", "value", "unit", "95 % interval"):
        table.add_column(name, justify="left" if name in ("load", "unit") else "right")
    table.add_row("mass", f"{load.values[0]:.4f}", "kg", _interval(load.intervals[0]))
    for name, value, ends in zip("xyz", load.com, load.com_intervals, strict=True):
        table.add_row(f"centre of mass {name}", f"{value:.4f}", "m", _interval(ends))
    inertia, pairs = load.inertia_about_com, ("xx", "yy", "zz", "xy", "xz", "yz")
    for pair in pairs:
        i, j = ("xyz".index(axis) for axis in pair)
        ends = load.inertia_intervals[INERTIA_INDEX.index((i, j))]
        table.add_row(f"inertia about this centre I{pair}", f"{inertia[i, j]:.5f}", "kg·m²", _interval(ends, 5))
    return table


def _parameters(record: dict[str, Any]) -> Table:
    """Table of the ten inertial parameters of the load about the origin of its frame, with 95 % intervals.

    A further column contains the intervals for exact drive gains, if these differ from the other intervals.
    """
    import numpy as np
    from rich.table import Table

    parameters = record["parameters"]
    differs = any(not np.array_equal(p["interval95"], p["statistical95"], equal_nan=True) for p in parameters)
    table = Table(
        title="Inertial parameters about the origin of the frame; the torques determine these", header_style="bold"
    )
    names = ["parameter", "value", "unit", "95 % interval", *(["if gains are exact"] if differs else []), "status"]
    for name in names:
        table.add_column(name, justify="left" if name in ("parameter", "unit", "status") else "right")
    for each in parameters:
        table.add_row(
            each["name"],
            f"{each['value']:.4f}",
            each["unit"],
            _interval(each["interval95"]),
            *([_interval(each["statistical95"])] if differs else []),
            "known" if each["known"] else each["status"],
        )
    return table


def _interval(ends: Array, decimals: int = 4) -> str:
    """Text with both ends of an interval; a dash if there is no interval."""
    from armid.notebook_display import interval_text

    return interval_text(*map(float, ends), decimals=decimals)
