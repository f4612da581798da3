"""`armid demo`: simulation, identification and validation of a virtual arm."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from armid.cli.commands.report import NoReport, write_page
from armid.cli.options import Json, Out, Threads, Verbose


class ProcessingPreset(StrEnum):
    """Named sets of options for processing and estimation."""

    thesis = "thesis"


def demo(
    preset: Annotated[
        ProcessingPreset | None, typer.Option(help="`thesis`: process and estimate as the thesis does.")
    ] = None,
    edges: Annotated[
        str, typer.Option(help="Treatment of the ends of a recording: periodic, pad or drop.")
    ] = "periodic",
    servo: Annotated[
        bool, typer.Option("--servo", help="A virtual hobby arm with servos, whose logs have no torque, instead.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 1,
    threads: Threads = 1,
    no_report: NoReport = False,
    verbose: Verbose = False,
    out: Out = None,
    json: Json = False,
) -> None:
    """Identify and validate a virtual, hanging KUKA LBR iiwa 14 with the motions of the thesis [Halper2024].

    The motion of Table A.1 of the thesis, with a period of 27 s, is repeated five times and recorded at 8 kHz. The
    arm has the friction of Table 4.1, and noise of 1e-5 rad and 0.3 N·m. The model is validated on Table A.2.

    Examples:
        armid demo --preset thesis

        armid demo --servo
    """
    if servo:
        _demo_of_servos(preset, out, seed, json=json)
    else:
        _demo_of_iiwa(preset, edges, seed, threads, out, no_report=no_report, verbose=verbose, json=json)


def _demo_of_iiwa(
    preset: ProcessingPreset | None,
    edges: str,
    seed: int,
    threads: int,
    out: Path | None,
    *,
    no_report: bool,
    verbose: bool,
    json: bool,
) -> None:
    """Run the demo of the iiwa, print and save its result."""
    from armid.cli.console import output_console, print_findings, progress
    from armid.cli.identification_result import print_next, print_result
    from armid.estimation.link_properties import link_record, link_table
    from armid.measurement.processing.options import ProcessingOptions
    from armid.runs.run import refuse_folder, saved_run
    from armid.study.demo import RECORD, demo_study, run_demo, thesis_processing
    from armid.study.storage.records import estimate_record, to_json, validation_record

    folder = out or Path("runs") / "demo"
    refuse_folder(folder)
    default = ProcessingOptions(edges=edges, average=edges == "periodic")  # pyright: ignore[reportArgumentType]
    study = demo_study(default) if preset is None else demo_study(thesis_processing(edges), "ols")
    with progress(quiet=json) as tell:
        done = run_demo(study, seed=seed, threads=threads, progress=tell)
    run = saved_run(done.result, folder, further_records={RECORD: {"seed": seed}})
    if json:
        record = estimate_record(done.result.estimate)
        record["run"] = str(folder)
        record["validation"] = validation_record(done.result.validation)
        record["links"] = link_record(link_table(done.result.model, done.result.estimate))
        record["truth"] = {
            "base_parameters": done.truth,
            "relative_error": done.relative_error,
            "torque_error": done.torque_error,
        }
        sys.stdout.write(to_json(record) + "\n")
    else:
        print_result(done.result, verbose=verbose)
        output_console().print(
            f"error against the true values: base parameters {100 * done.relative_error:.3f} %, torque on "
            f"Table A.2 {done.torque_error:.4f} N·m RMS"
        )
    print_findings(done.result.estimate.findings, shapes=verbose, whole=verbose)
    page = not no_report and write_page(run, done.result, done.recordings)
    if not json:
        print_next(done.result, folder, page=page)
    if done.result.validation.verdict == "fail":
        raise typer.Exit(1)


def _demo_of_servos(preset: ProcessingPreset | None, out: Path | None, seed: int, *, json: bool) -> None:
    """Run the demo of the hobby arm."""
    from armid.cli.servos.servo_demo import run_servo_demo
    from armid.errors import StudyError

    if preset is not None:
        raise StudyError(
            f"--preset {preset.value} and --servo exclude each other.", remedy="leave out one of the two."
        )
    run_servo_demo(out or Path("runs") / "demo-servo", seed=seed, json=json)
