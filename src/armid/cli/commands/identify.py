"""`armid identify`: the main job."""

from __future__ import annotations

import sys
from dataclasses import fields, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.commands.report import NoReport, write_page
from armid.cli.completion import METHODS, among
from armid.cli.options import (
    BASE_TERMS,
    Gravity,
    Json,
    Lock,
    Only,
    Out,
    Package,
    Terms,
    Threads,
    TipLink,
    Verbose,
    known_arms,
    model_choice,
    robot_choice,
    run_folder,
)
from armid.cli.reading import Columns, Rate, TimeUnit, TorqueSign, Units, given

if TYPE_CHECKING:
    from armid.errors import Finding
    from armid.study.compare import MethodTable
    from armid.study.config import Study
    from armid.study.identify import Prepared, Result

__all__ = ["identify"]


PERIOD_HELP = "Period of the motion, s; found in the positions where it is left out."


class LogPreset(StrEnum):
    """Ways of processing and estimating under one name."""

    thesis = "thesis"


Inputs = Annotated[
    list[str],
    typer.Argument(
        metavar="STUDY | ROBOT RECORDING…", help="A study.toml, or an arm and recordings.", autocompletion=known_arms
    ),
]


HeldOut = Annotated[
    list[str] | None,
    typer.Option(
        "--validate", metavar="RECORDING…", help="Recordings to check the model on; options hold for them, too."
    ),
]
Cutoff = Annotated[
    str | None, typer.Option(metavar="HZ|auto", help="Cut-off of the filter, Hz; 5 by default; auto: by the motion.")
]
Edges = Annotated[str | None, typer.Option(metavar="drop|pad|periodic", help="Ends of a recording; drop by default.")]
Slow = Annotated[
    float | None, typer.Option(help="Rows count for a joint only while it is as fast as this, rad/s or m/s; 0.")
]
Standstill = Annotated[
    str | None, typer.Option(metavar="drop|keep", help="Rows of a joint that stands among others; drop by default.")
]
Method = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Estimator: {', '.join(METHODS)}; wls by default, ridge with --terms auto. "
        "physical gives every link a body.",
        autocompletion=among(METHODS),
    ),
]


def identify(
    inputs: Inputs,
    validate: HeldOut = None,
    preset: Annotated[
        LogPreset | None, typer.Option(help="`thesis`: its processing, terms and ordinary least squares.")
    ] = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    terms: Terms = None,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    units: Units = None,
    columns: Columns = None,
    time_unit: TimeUnit = None,
    period: Annotated[str | None, typer.Option(metavar="S|none", help=PERIOD_HELP)] = None,
    cutoff: Cutoff = None,
    edges: Edges = None,
    slow: Slow = None,
    standstill: Standstill = None,
    method: Method = None,
    compare: Annotated[bool, typer.Option("--compare", help="Also try every other method; one table.")] = False,
    threads: Threads = 1,
    no_report: NoReport = False,
    verbose: Verbose = False,
    out: Out = None,
    json: Json = False,
) -> None:
    """Identify base parameters and friction from recordings, and check them on unseen motion.

    Everything that a recording needs to be understood fits in a study.toml; the options here cover the plain cases.

    Examples:
        armid identify study.toml --out runs/today

        armid identify ur10e.urdf run1.csv run2.csv --validate run3.csv --rate 125

        armid identify study.toml --compare
    """
    from armid.cli.console import print_findings
    from armid.cli.identification_result import print_next
    from armid.runs.run import refuse_folder

    if out is not None:
        refuse_folder(out)
    said = given(columns, rate, torque_sign, units, time_unit, _period(period))
    study = _study(inputs, validate or [], said, (gravity, lock, only, tip, package), terms)
    how = {"cutoff": _cutoff(cutoff), "edges": edges, "slow": slow, "standstill": standstill}
    study = _overridden(study, preset, how, method)
    prepared, result, table = _identified(study, threads, compare=compare, quiet=json)
    print_findings(_shared(study, validate or []))
    folder, replaced = _save(result, table, out)
    _print(result, table, folder, verbose=verbose, json=json)
    page = not no_report and write_page(folder, prepared.recordings)
    if not json:
        print_next(result, folder, page=page, replaced=replaced, asked=inputs)
    if result.validation.verdict == "fail":
        raise typer.Exit(1)


def _shared(study: Study, validate: list[str]) -> list[Finding]:
    """That recordings to check the model on were read as those that train, where that says anything."""
    from armid.errors import Finding
    from armid.measurement.log_format import LogFormat
    from armid.measurement.remedy import lines

    how, plain = next(choice.reading for choice in study.recordings if choice.role == "train"), LogFormat()
    keys = {field.name: getattr(how, field.name) for field in fields(LogFormat) if field.name != "exclude"}
    keys = {key: value for key, value in keys.items() if repr(value) != repr(getattr(plain, key))}
    if not validate or not keys:
        return []
    told = ", ".join(lines(**{key: value}) for key, value in keys.items())
    names = ", ".join(Path(path).name for path in validate)
    return [Finding("reading-shared", "info", "", f"{told} holds for {names} as for the recordings that train.")]


def _identified(
    study: Study, threads: int, *, compare: bool, quiet: bool
) -> tuple[Prepared, Result, MethodTable | None]:
    """The work itself, under a bar: what was prepared, the result, and every method beside it if asked."""
    from armid.cli.console import progress
    from armid.study import identify as stage
    from armid.study.compare import compare_methods

    with progress(quiet=quiet) as tell:
        prepared = stage.prepare(study, threads=threads, progress=tell)
        result = stage.conclude(prepared, progress=tell)
        return prepared, result, compare_methods(prepared, progress=tell) if compare else None


def _save(result: Result, table: MethodTable | None, out: Path | None) -> tuple[Path, bool]:
    """Write the run; its folder, and whether another run was there."""
    from armid.runs.run import save_run
    from armid.study.compare import compare_record

    folder = run_folder(out, result.estimate.robot)
    replaced = folder.exists()
    save_run(result, folder, further_records={} if table is None else {"compare.json": compare_record(table)})
    return folder, replaced


def _print(result: Result, table: MethodTable | None, folder: Path, *, verbose: bool, json: bool) -> None:
    """The result on standard output, one JSON object or tables, and its findings on standard error."""
    from armid.cli.console import print_findings, print_methods
    from armid.cli.identification_result import print_result
    from armid.estimation.link_properties import link_record, link_table
    from armid.study.compare import compare_record
    from armid.study.records import estimate_record, friction_selection_record, to_json, validation_record

    if json:
        record = estimate_record(result.estimate)
        record["run"] = str(folder)
        record["validation"] = validation_record(result.validation)
        record["links"] = link_record(link_table(result.model, result.estimate))
        if table is not None:
            record["compare"] = compare_record(table)
        if result.ladder is not None:
            record["friction"] = friction_selection_record(result.ladder, result.robot.joint_names)
        sys.stdout.write(to_json(record) + "\n")
    else:
        print_result(result, verbose=verbose)
        if table is not None:
            print_methods(table, [joint.effort_unit for joint in result.robot.joints])
    print_findings(result.estimate.findings)


def _study(
    inputs: list[str],
    validate: list[str],
    said: dict[str, Any],
    arm: tuple[Any, ...],
    terms: str | None,
) -> Study:
    """The study that the arguments name or describe, with what they say of a reading."""
    from armid.measurement.log_format import LogFormat
    from armid.study.config import RecordingChoice, Study, default_estimation

    if len(inputs) == 1:
        return _changed_study(inputs[0], validate, said, arm, terms)
    how = LogFormat(**said)
    recordings = tuple(RecordingChoice(path, reading=how) for path in inputs[1:])
    recordings += tuple(RecordingChoice(path, "validate", how) for path in validate)
    model = model_choice(terms)
    robot = robot_choice(inputs[0], *arm)
    return Study(robot, model, recordings, estimation=default_estimation(model))


def _period(text: str | None) -> float | str | None:
    """Return what --period says."""
    from armid.errors import StudyError

    if text is None or text == "none":
        return text
    try:
        return float(text)
    except ValueError:
        raise StudyError(f"--period {text} is no time.", possible="a number [s], none") from None


ARM = ("gravity", "lock", "tip", "only")
"""What the command line may say of an arm, beside a study."""


def _changed_study(
    path: str,
    validate: list[str],
    reading: dict[str, Any],
    arm: tuple[Any, ...],
    terms: str | None,
) -> Study:
    """The study of a file with what the command line says beside it; more recordings are read as its first one."""
    from armid.errors import StudyError
    from armid.study.config import RecordingChoice, default_estimation, load_study

    if not path.endswith(".toml"):
        raise StudyError(
            f"{path} alone is no study, and an arm needs recordings.",
            remedy="give a study.toml, or an arm followed by its recordings.",
        )
    if reading:
        options = ", ".join("--" + name.replace("_", "-") for name in reading)
        raise StudyError(
            f"{path} says itself how its recordings are to be read; found {options}.",
            remedy="write it into the [[recording]] tables of the study.",
        )
    study = load_study(path)
    said = robot_choice(study.robot.description, *arm)
    given = {key: value for key in ARM if (value := getattr(said, key))}
    robot = replace(study.robot, **given)
    first = next(choice.reading for choice in study.recordings if choice.role == "train")
    alike = replace(first, exclude=())
    extra = tuple(RecordingChoice(str(Path(path).absolute()), "validate", alike) for path in validate)
    model = study.model if terms is None else model_choice(terms)
    estimation = default_estimation(model) if model.automatic and not study.model.automatic else study.estimation
    return replace(study, robot=robot, model=model, recordings=(*study.recordings, *extra), estimation=estimation)


def _cutoff(text: str | None) -> float | str | None:
    """Return what --cutoff says."""
    from armid.errors import StudyError

    if text is None or text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise StudyError(f"--cutoff {text} is no frequency.", possible="a number [Hz], auto") from None


def _overridden(study: Study, preset: LogPreset | None, how: dict[str, Any], method: str | None) -> Study:
    """The study with what the command line says of processing and estimation; of `how` counts what is not `None`."""
    from armid.measurement.processing.options import THESIS
    from armid.study.config import EstimationChoice

    processing, estimation, model = study.processing, study.estimation, study.model
    if preset is LogPreset.thesis:
        processing = THESIS
        estimation = EstimationChoice("ols")
        model = model if model.terms else model_choice(None, default=BASE_TERMS)
    changes = {key: value for key, value in how.items() if value is not None}
    if "edges" in changes:
        changes["average"] = processing.average and changes["edges"] == "periodic"
    processing = replace(processing, **changes)
    if method is not None:
        estimation = replace(estimation, method=method)
    return replace(study, processing=processing, estimation=estimation, model=model)
