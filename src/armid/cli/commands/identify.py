"""`armid identify`: estimation of a model from recordings, and its validation."""

from __future__ import annotations

import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.commands.report import NoReport, write_page
from armid.cli.fleets.new_unit import Fleet, identified_with_fleet
from armid.cli.log_format_options import PRESET_NAMES, Columns, Period, Rate, TimeUnit, TorqueSign, Units, given
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
    run_folder,
)
from armid.cli.study_arguments import OF_ONE, study_of
from armid.cli.value_completion import among
from armid.estimation.catalogue import ESTIMATORS

if TYPE_CHECKING:
    from armid.errors import Finding
    from armid.runs.run import Run
    from armid.study.compare_methods import MethodTable
    from armid.study.config import Study
    from armid.study.identify import Result
    from armid.study.prepare import Prepared


THESIS_PRESET = "thesis"
"""Name of the set of options for processing and estimation in the thesis."""


Inputs = Annotated[
    list[str],
    typer.Argument(
        metavar="STUDY | ROBOT RECORDING…", help="A study.toml, or an arm and recordings.", autocompletion=known_arms
    ),
]


HeldOut = Annotated[
    list[str] | None,
    typer.Option(
        "--validate",
        metavar="RECORDING…",
        help="Recordings on which the model is validated; they are read with the options of the training recordings.",
    ),
]
Cutoff = Annotated[
    str | None,
    typer.Option(
        metavar="HZ|auto", help="Cut-off frequency of the filter, Hz; 5 by default; auto: computed from the motion."
    ),
]
Edges = Annotated[
    str | None,
    typer.Option(metavar="drop|pad|periodic", help="Treatment of the ends of a recording; drop by default."),
]
Slow = Annotated[
    float | None, typer.Option(help="Smallest speed at which rows of a joint are used, rad/s or m/s; 0 by default.")
]
Standstill = Annotated[
    str | None,
    typer.Option(
        metavar="drop|moving|keep", help="Treatment of rows in which a joint stands still; drop by default."
    ),
]
Method = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Estimator: {', '.join(ESTIMATORS)}; wls by default, ridge with --terms auto. "
        "physical makes every link physically consistent.",
        autocompletion=among(ESTIMATORS),
    ),
]


Presets = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="`thesis`: processing and terms of the thesis, ordinary least squares; or a well-known log: "
        f"{', '.join(PRESET_NAMES)}; repeatable.",
        autocompletion=among((THESIS_PRESET, *PRESET_NAMES)),
    ),
]


def identify(
    inputs: Inputs,
    validate: HeldOut = None,
    preset: Presets = None,
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
    period: Period = None,
    cutoff: Cutoff = None,
    edges: Edges = None,
    slow: Slow = None,
    standstill: Standstill = None,
    method: Method = None,
    compare: Annotated[bool, typer.Option("--compare", help="Also print a table of all methods.")] = False,
    fleet: Fleet = None,
    threads: Threads = 1,
    no_report: NoReport = False,
    verbose: Verbose = False,
    out: Out = None,
    json: Json = False,
) -> None:
    """Identify base parameters and friction from recordings, and validate them on held-out motion.

    A study.toml can describe every kind of recording; the options here cover the simple cases.

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
    processing_preset, log_preset = _presets(preset or [])
    reading = given(columns, rate, torque_sign, units, time_unit, period, log_preset)
    study = study_of(inputs, validate or [], reading, (gravity, lock, only, tip, package), terms)
    processing = {"cutoff": _cutoff(cutoff), "edges": edges, "slow": slow, "standstill": standstill}
    study = _overridden(study, processing_preset, processing, method)
    prepared, result, table = _identified(study, threads, fleet, compare=compare, chosen=method, quiet=json)
    print_findings(_shared_format_finding(study, validate or []))
    run, replaced = _save(result, table, out)
    _print(result, table, Path(run.folder), verbose=verbose, json=json)
    page = not no_report and write_page(run, result, prepared.recordings, table)
    if not json:
        print_next(result, Path(run.folder), page=page, replaced=replaced, inputs=inputs)
    if result.validation.verdict == "fail":
        raise typer.Exit(1)


def _presets(names: list[str]) -> tuple[str | None, str | None]:
    """Preset of the processing and preset of the log format among the values of --preset; `None` if not given.

    Raises:
        StudyError: A name is unknown, or two presets of log formats are given.
    """
    from armid.errors import StudyError, did_you_mean

    known = (THESIS_PRESET, *PRESET_NAMES)
    if unknown := [name for name in names if name not in known]:
        raise StudyError(
            f"Unknown preset {unknown[0]!r}.", possible=", ".join(known), remedy=did_you_mean(unknown[0], known)
        )
    of_logs = [name for name in dict.fromkeys(names) if name != THESIS_PRESET]
    if len(of_logs) > 1:
        raise StudyError(
            f"--preset is given for two log formats: {', '.join(of_logs)}.",
            remedy="give one of them; a study can state the log format of each recording.",
        )
    return (THESIS_PRESET if THESIS_PRESET in names else None), (of_logs[0] if of_logs else None)


def _shared_format_finding(study: Study, validate: list[str]) -> list[Finding]:
    """List with a finding if recordings of --validate are read with the log format of the training recordings.

    The list is empty without such recordings, and if the log format has default values.
    """
    from armid.errors import Finding
    from armid.measurement.log_format import LogFormat
    from armid.measurement.remedy_builders import lines

    shared, default = next(choice.reading for choice in study.recordings if choice.role == "train"), LogFormat()
    keys = {field.name: getattr(shared, field.name) for field in fields(LogFormat) if field.name not in OF_ONE}
    keys = {key: value for key, value in keys.items() if repr(value) != repr(getattr(default, key))}
    if not validate or not keys:
        return []
    options = ", ".join(lines(**{key: value}) for key, value in keys.items())
    names = ", ".join(Path(path).name for path in validate)
    return [
        Finding("reading-shared", "info", "", f"{options} applies to the training recordings and also to {names}.")
    ]


def _identified(
    study: Study, threads: int, fleet: str | None, *, compare: bool, chosen: str | None, quiet: bool
) -> tuple[Prepared, Result, MethodTable | None]:
    """Identify the model with a progress bar; return the prepared data, the result and the comparison of methods.

    `chosen` is the value of --method.
    """
    from armid.cli.console import progress
    from armid.study.compare_methods import compare_methods
    from armid.study.identify import conclude
    from armid.study.prepare import prepare

    if fleet is not None:
        return *identified_with_fleet(study, fleet, threads, compare=compare, method=chosen, quiet=quiet), None
    with progress(quiet=quiet) as tell:
        prepared = prepare(study, threads=threads, progress=tell)
        result = conclude(prepared, progress=tell)
        return prepared, result, compare_methods(prepared, progress=tell) if compare else None


def _save(result: Result, table: MethodTable | None, out: Path | None) -> tuple[Run, bool]:
    """Write the folder of a run; return the run, and true if an earlier run in this folder was replaced."""
    from armid.runs.run import saved_run
    from armid.study.compare_methods import compare_record

    folder = run_folder(out, result.estimate.robot)
    replaced = folder.exists()
    further = {} if table is None else {"compare.json": compare_record(table)}
    return saved_run(result, folder, further_records=further), replaced


def _print(result: Result, table: MethodTable | None, folder: Path, *, verbose: bool, json: bool) -> None:
    """Print the result on standard output, as JSON or as tables, and its findings on standard error."""
    from armid.cli.console import print_findings, print_methods
    from armid.cli.identification_result import print_result
    from armid.estimation.link_properties import link_record, link_table
    from armid.study.compare_methods import compare_record
    from armid.study.storage.records import estimate_record, friction_selection_record, to_json, validation_record

    if json:
        record = estimate_record(result.estimate)
        record["run"] = str(folder)
        record["validation"] = validation_record(result.validation)
        record["links"] = link_record(link_table(result.model, result.estimate))
        if table is not None:
            record["compare"] = compare_record(table)
        if result.friction_selection is not None:
            record["friction"] = friction_selection_record(result.friction_selection, result.robot.joint_names)
        sys.stdout.write(to_json(record) + "\n")
    else:
        print_result(result, verbose=verbose)
        if table is not None:
            print_methods(table, [joint.effort_unit for joint in result.robot.joints])
    print_findings(result.estimate.findings, shapes=verbose, whole=verbose)


def _cutoff(text: str | None) -> float | str | None:
    """Value of the option --cutoff: a frequency [Hz], `auto`, or `None` if the option is not given."""
    from armid.errors import StudyError

    if text is None or text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise StudyError(
            f"--cutoff {text} is not a frequency.",
            possible="a number [Hz], auto",
            remedy="write for instance --cutoff 10.",
        ) from None


def _overridden(study: Study, preset: str | None, given_processing: dict[str, Any], method: str | None) -> Study:
    """Study with the processing and estimation that the command line gives; an option with `None` changes nothing."""
    from armid.measurement.processing.options import THESIS
    from armid.study.config import EstimationChoice

    processing, estimation, model = study.processing, study.estimation, study.model
    if preset == THESIS_PRESET:
        processing = THESIS
        estimation = EstimationChoice("ols")
        model = model if model.terms else model_choice(None, default=BASE_TERMS)
    changes = {key: value for key, value in given_processing.items() if value is not None}
    if "edges" in changes:
        changes["average"] = processing.average and changes["edges"] == "periodic"
    processing = replace(processing, **changes)
    if method is not None:
        estimation = replace(estimation, method=method)
    return replace(study, processing=processing, estimation=estimation, model=model)
