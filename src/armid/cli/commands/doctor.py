"""`armid doctor`: what is wrong with a log, before anyone trusts it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

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
from armid.cli.reading import Columns, Rate, TimeUnit, TorqueSign, Units, given
from armid.errors import ArmidError, StudyError

if TYPE_CHECKING:
    from armid.study.config import Study
    from armid.study.diagnosis import Diagnosis

__all__ = ["doctor"]


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
    period: Annotated[float | None, typer.Option(help="The motion repeats with this period, s.")] = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    terms: Terms = None,
    json: Json = False,
) -> None:
    """Examine recordings: signs, order, units, zeros, gravity, clock, delays, channels, motion.

    Nothing is repaired. Each finding has its evidence and the line of a study that takes care of it; without a
    study, the option that does, or a study to write. Exit code 1 says that there is an error among them.

    Examples:
        armid doctor study.toml

        armid doctor panda monday.csv tuesday.csv
    """
    from armid.measurement.log_format import LogFormat
    from armid.study.config import RecordingChoice, Study, load_study
    from armid.study.diagnosis import diagnose, diagnosis_record, has_errors
    from armid.study.records import to_json

    said = given(columns, rate, torque_sign, units, time_unit, period)
    if not recordings:
        if Path(subject).suffix != ".toml":
            raise ArmidError(f"{subject} is no study, and no recording is given.", remedy="give a recording of it.")
        if said or any((gravity, lock, only, tip, package, terms)):
            raise StudyError(
                f"{subject} says all by itself; options are for an arm and recordings.",
                remedy="write it into the study.",
            )
        study = load_study(subject)
    else:
        reading = LogFormat(**said)
        choices = tuple(RecordingChoice(path, reading=reading) for path in recordings)
        study = Study(robot_choice(subject, gravity, lock, only, tip, package), model_choice(terms), choices)
    found = diagnose(study)
    if json:
        sys.stdout.write(to_json(diagnosis_record(found)) + "\n")
    else:
        _report(_without_study(found, study, said) if recordings else found)
    if has_errors(found):
        raise typer.Exit(1)


def _without_study(found: tuple[Diagnosis, ...], study: Study, said: dict[str, Any]) -> tuple[Diagnosis, ...]:
    """The findings with remedies for somebody who has no study: an option, or the study that is needed."""
    from dataclasses import replace

    from armid.cli.hints import options_of_command
    from armid.study.remedies import as_option, as_study, tables_of

    def told(remedy: str, path: str) -> str:
        if not tables_of(remedy):
            return remedy
        option = as_option(remedy, options_of_command())
        return option or f"in a study.toml:\n{as_study(remedy, study, path, said)}"

    return tuple(
        replace(each, findings=tuple(replace(f, remedy=told(f.remedy, each.path)) for f in each.findings))
        for each in found
    )


def _report(found: tuple[Diagnosis, ...]) -> None:
    """A table for each recording."""
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console
    from armid.doctor import EFFECTS

    console = output_console()
    colours = {"error": "red", "warning": "yellow", "info": "dim"}
    for each in found:
        if not each.findings:
            console.print(f"{escape(each.path)}: [green]nothing found[/]")
            continue
        table = Table(title=escape(each.path), title_justify="left", header_style="bold", show_lines=True)
        for name in ("", "finding", "channel", "evidence, effect and remedy"):
            table.add_column(name, overflow="fold")
        for f in each.findings:
            parts = [escape(f.evidence), f"[dim]{escape(EFFECTS.get(f.code, ''))}[/]", f"[bold]{escape(f.remedy)}[/]"]
            text = "\n".join(part for part in parts if part and not part.startswith("[bold][/]"))
            table.add_row(f"[{colours[f.severity]}]{f.severity}[/]", f.code, escape(f.channel), text)
        console.print(table)
