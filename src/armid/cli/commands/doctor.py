"""`armid doctor`: check of recordings for faults before they are used."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.log_format_options import Columns, Period, Preset, Rate, TimeUnit, TorqueSign, Units, given
from armid.cli.options import (
    Gravity,
    Json,
    Lock,
    Only,
    Package,
    Terms,
    TipLink,
    known_arms,
    model_choice,
    robot_choice,
)
from armid.errors import ArmidError, StudyError

if TYPE_CHECKING:
    from armid.study.config import Study
    from armid.study.diagnosis import Diagnosis


def doctor(
    subject: Annotated[
        str,
        typer.Argument(metavar="STUDY | ROBOT", help="A study.toml, or an arm.", autocompletion=known_arms),
    ],
    recordings: Annotated[
        list[str] | None, typer.Argument(metavar="[RECORDING…]", help="Recordings of the arm.")
    ] = None,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    units: Units = None,
    columns: Columns = None,
    time_unit: TimeUnit = None,
    period: Period = None,
    preset: Preset = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    terms: Terms = None,
    json: Json = False,
) -> None:
    """Examine recordings for faults: signs, order, units, zeros, gravity, clock, delays, channels, motion.

    The recordings are not changed. Each finding gives its evidence and its remedy. With a study, the remedy is a line
    for this study; without a study, it is an option of the command line or the text of a study. Exit code 1: there is
    at least one error.

    Examples:
        armid doctor study.toml

        armid doctor panda monday.csv tuesday.csv
    """
    from armid.measurement.log_format import LogFormat
    from armid.study.config import RecordingChoice, Study, load_study
    from armid.study.diagnosis import diagnose, diagnosis_record, has_errors
    from armid.study.storage.records import to_json

    reading_options = given(columns, rate, torque_sign, units, time_unit, period, preset)
    if not recordings:
        _require_study(subject, options=bool(reading_options) or any((gravity, lock, only, tip, package, terms)))
        study = load_study(subject)
    else:
        reading = LogFormat(**reading_options)
        choices = tuple(RecordingChoice(path, reading=reading) for path in recordings)
        study = Study(robot_choice(subject, gravity, lock, only, tip, package), model_choice(terms), choices)
    diagnoses = diagnose(study)
    if json:
        sys.stdout.write(to_json(diagnosis_record(diagnoses)) + "\n")
    else:
        _report(_without_study(diagnoses, study, reading_options) if recordings else diagnoses)
    if has_errors(diagnoses):
        raise typer.Exit(1)


def _require_study(subject: str, *, options: bool) -> None:
    """Raises an error if `subject`, given without recordings, is no study, or if there are options with a study."""
    if Path(subject).suffix != ".toml":
        raise ArmidError(
            f"{subject} is an arm and not a study, but no recording is given.",
            remedy="give at least one recording of this arm, or a study.toml.",
        )
    if options:
        problem = f"{subject} is a study, but options are only possible with an arm and recordings."
        raise StudyError(problem, remedy="write these options into the study.")


def _without_study(
    diagnoses: tuple[Diagnosis, ...], study: Study, reading_options: dict[str, Any]
) -> tuple[Diagnosis, ...]:
    """Diagnoses with remedies that need no study: each remedy becomes an option, or the text of a new study."""
    from dataclasses import replace

    from armid.cli.remedy_hints import hint, options_of_command
    from armid.study.remedy_translation import as_option, as_study, tables_of

    def without_study(remedy: str, path: str) -> str:
        if not tables_of(remedy):
            return hint(remedy)
        option = as_option(remedy, options_of_command())
        return option or f"in a study.toml:\n{as_study(remedy, study, path, reading_options)}"

    return tuple(
        replace(each, findings=tuple(replace(f, remedy=without_study(f.remedy, each.path)) for f in each.findings))
        for each in diagnoses
    )


def _report(diagnoses: tuple[Diagnosis, ...]) -> None:
    """Print a table of findings for each recording, and below it the remedies to copy, without wrapping."""
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console, print_to_paste, to_paste
    from armid.doctor import effects

    console, effect_of = output_console(), effects()
    colours = {"error": "red", "warning": "yellow", "info": "dim"}
    for each in diagnoses:
        if not each.findings:
            console.print(f"{escape(each.path)}: [green]nothing found[/]")
            continue
        table = Table(title=escape(each.path), title_justify="left", header_style="bold", show_lines=True)
        for name in ("", "finding", "channel", "evidence, effect and remedy"):
            table.add_column(name, overflow="fold")
        below = [f for f in each.findings if to_paste(f.remedy)]
        for f in each.findings:
            remedy = "remedy: below the table" if f in below else f.remedy
            effect = effect_of.get(f.code, "")
            parts = [escape(f.evidence), f"[dim]{escape(effect)}[/]", f"[bold]{escape(remedy)}[/]"]
            text = "\n".join(part for part in parts if part and not part.startswith("[bold][/]"))
            table.add_row(f"[{colours[f.severity]}]{f.severity}[/]", f.code, escape(f.channel), text)
        console.print(table)
        for remedy in dict.fromkeys(f.remedy for f in below):
            of = [f"{f.code}{f' ({escape(f.channel)})' if f.channel else ''}" for f in below if f.remedy == remedy]
            console.print(f"remedy of {', '.join(of)}:")
            print_to_paste(console, remedy)
