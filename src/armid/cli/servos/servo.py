"""`armid servo`: servos, friction and links from commands and measured positions, for arms without torque."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.commands.identify import HeldOut, Inputs
from armid.cli.commands.report import NoReport
from armid.cli.log_format_options import Columns, Rate, TimeUnit, Units, given
from armid.cli.options import Gravity, Json, Lock, Only, Out, Package, TipLink, run_folder

if TYPE_CHECKING:
    from armid.runs.servos.stored_servo import StoredServo
    from armid.study.config import Study
    from armid.study.servos.identification import ServoResult

Gains = Annotated[
    str | None,
    typer.Option(
        metavar="K[,K…]",
        help="Known stiffness of the servos, N·m/rad: one value, or one for each joint; estimated if not given.",
    ),
]
Damping = Annotated[
    str | None,
    typer.Option(
        metavar="D[,D…]",
        help="Known damping of the servos, N·m·s/rad; part of the viscous friction if not given.",
    ),
]


def servo(
    inputs: Inputs,
    validate: HeldOut = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    stiffness: Gains = None,
    damping: Damping = None,
    rate: Rate = None,
    units: Units = None,
    columns: Columns = None,
    time_unit: TimeUnit = None,
    out: Out = None,
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Identify servos, friction and links of an arm from commands and measured positions, without any torque.

    The result is a closed loop: gains, delays and offsets of the servos, friction, rotor inertias and links. It is
    judged by the position error of the simulated arm under the recorded commands.

    Examples:
        armid servo so101.xml chirp.parquet sweep.parquet --validate other.parquet

        armid servo go2.xml stand.csv --lock base --stiffness 20 --damping 1.5
    """
    from armid.cli.console import progress
    from armid.runs.servos.stored_servo import refuse_servo_folder
    from armid.study.servos.identification import identify_servo_study

    reading = given(columns, rate, None, units, time_unit, None, None)
    study = _study(inputs, validate or [], reading, (gravity, lock, only, tip, package), stiffness, damping)
    folder = run_folder(out, "servo") if out is None else out
    refuse_servo_folder(folder)
    with progress(quiet=json) as tell:
        result = identify_servo_study(study, progress=tell)
    if _deliver(result, folder, page=not no_report, json=json) == "fail":
        raise typer.Exit(1)


def _deliver(result: ServoResult, folder: Path, *, page: bool, json: bool) -> str:
    """Write the folder with the files for other programs and the page, print the result, and return the verdict."""
    from armid.cli.commands.report import PAGE, attempt
    from armid.cli.console import print_findings
    from armid.cli.servos.servo_result import print_servo_result
    from armid.export.servos.deliver import delivered
    from armid.runs.servos.stored_servo import save_servo, stored_servo_of
    from armid.study.servos.record import servo_record
    from armid.study.storage.records import to_json

    stored = stored_servo_of(result, folder)
    save_servo(result, stored, {}, {})  # before other programs, which may fail, look at the files for them
    delivery = delivered(stored, result.validation or result.training)
    stored = replace(stored, findings=(*stored.findings, *delivery.findings))
    save_servo(result, stored, delivery.files, delivery.check)
    if json:
        record = servo_record(replace(result, findings=stored.findings))
        sys.stdout.write(to_json({**record, "run": str(folder)}) + "\n")
    else:
        print_servo_result(stored)
    print_findings(list(stored.findings))
    written = ["servo.json", *delivery.files]
    if page and attempt(PAGE, lambda: _write_page(result, stored)):
        written.append(PAGE)
    if not json:
        if delivery.check and delivery.check["total"] <= delivery.check["bound"]:
            sys.stdout.write(
                f"MuJoCo {delivery.check['mujoco']} moves model.xml like armid, within "
                f"{1e3 * delivery.check['total']:.2g} mrad (mm) RMS\n"
            )
        sys.stdout.write(f"result written to {folder}: {', '.join(written)}\n")
    return "fail" if any(each.severity == "error" for each in stored.findings) else stored.errors.verdict


def _study(
    inputs: list[str],
    validate: list[str],
    reading: dict[str, Any],
    arm: tuple[Any, ...],
    stiffness: str | None,
    damping: str | None,
) -> Study:
    """Study in a file, or a new one of the arm and the recordings; options of the servos replace those of a file."""
    from armid.cli.study_arguments import study_of

    gains = {"stiffness": _numbers(stiffness, "--stiffness"), "damping": _numbers(damping, "--damping")}
    study = study_of(inputs, validate, reading, arm, None)
    return replace(
        study, servo=replace(study.servo, **{key: value for key, value in gains.items() if value is not None})
    )


def _numbers(text: str | None, option: str) -> tuple[float, ...] | None:
    """Numbers of an option, separated by commas; `None` if the option is not given."""
    from armid.errors import StudyError

    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise StudyError(
            f"{option} {text} is not a list of numbers.", remedy=f"write for instance {option} 20,20,15."
        ) from None


def _write_page(result: ServoResult, stored: StoredServo) -> None:
    """Write the page of a result into its folder, with the recordings that are in memory."""
    from armid.cli.commands.report import PAGE
    from armid.report.servos.page import write_servo_page
    from armid.report.servos.page_data import gather_servo

    write_servo_page(gather_servo(stored, result.validation or result.training), Path(stored.folder) / PAGE)
