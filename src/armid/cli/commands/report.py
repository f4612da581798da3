"""`armid report`: HTML page about a run, or about the changes between two runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.log_format_options import Data
from armid.cli.options import Json, claim_run

if TYPE_CHECKING:
    from armid.runs.run import Run
    from armid.study.compare_methods import MethodTable
    from armid.study.identify import Result
    from armid.study.recordings.processed import ProcessedRecording

PAGE = "report.html"

MISSING_REMEDY = "give the folder of the recording with --data FOLDER; without it the page has tables, but no plots."
"""Remedy if a recording cannot be read again for the plots of a page."""

NoReport = Annotated[bool, typer.Option("--no-report", help=f"Do not write {PAGE} into the folder of the run.")]


def report(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Folder that armid identify or armid servo made.")],
    other: Annotated[
        str | None, typer.Argument(metavar="[RUN]", help="A later run of the same arm; the page shows the changes.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="File to write the page to.")] = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Write a page that needs no network: verdict, torque, residuals, friction, parameters, provenance.

    The plots need the recordings of the run, which are read again; without them the page has only tables. For two
    runs, the page lists the parameters whose change is larger than its interval.

    Examples:
        armid report runs/today

        armid report runs/last_year runs/today --out change.html
    """
    from armid.cli.console import print_findings
    from armid.cli.servos.servo_folder import report_servo
    from armid.errors import Finding
    from armid.report.data.page_data import gather
    from armid.report.page import write_comparison
    from armid.report.page import write_page as write_one
    from armid.report.rendering import require_extra
    from armid.runs.run import load_run
    from armid.runs.servos.stored_servo import is_servo_folder
    from armid.study.storage.records import to_json

    require_extra()
    claim_run(other or run, out)
    missing: tuple[str, ...] = ()
    if other is None and is_servo_folder(run):
        page = out or Path(run) / PAGE
        missing = report_servo(run, page, data)
    elif other is None:
        page_data = gather(load_run(run), data=data)
        page, missing = write_one(page_data, out or Path(run) / PAGE), page_data.missing
    else:
        page = write_comparison(load_run(run), load_run(other), out or Path(other) / "comparison.html")
    if json:
        sys.stdout.write(to_json({"report": str(page), "bytes": page.stat().st_size}) + "\n")
    else:
        sys.stdout.write(f"page written to {page}\n")
    print_findings([Finding("recording-missing", "warning", "", text, MISSING_REMEDY) for text in missing])


def write_page(
    run: Run, result: Result, recordings: Sequence[ProcessedRecording], methods: MethodTable | None = None
) -> bool:
    """Write the page of a run into its folder; if this fails, print the reason on standard error.

    The page is written after the results are printed, so that the results do not wait for the page.

    Args:
        run: The run, as it has just been saved.
        result: Result of the identification.
        recordings: Processed recordings from which the run was identified.
        methods: Comparison of methods, if there was one.

    Returns:
        True if the page was written.
    """
    from armid.report.data.page_data import gather
    from armid.report.page import write_page as write_one
    from armid.report.rendering import require_extra
    from armid.runs.read_records import records_of

    predicted = list(zip(recordings, result.predictions, strict=True))

    def write() -> None:
        require_extra()
        write_one(gather(run, records=records_of(result, methods), recordings=predicted), Path(run.folder) / PAGE)

    return attempt(PAGE, write)


def attempt(page: str, write: Callable[[], object]) -> bool:
    """Call `write` to write a page; if this fails or is interrupted, print the reason and return false."""
    try:
        return try_page(page, write)
    except KeyboardInterrupt:
        sys.stderr.write(f"no {page}: interrupted\n")
    return False


def try_page(page: str, write: Callable[[], object]) -> bool:
    """Call `write` to write a page; if this fails, print the reason and return false.

    Raises:
        KeyboardInterrupt: The user has stopped the writing of the page.
    """
    from armid.errors import ArmidError

    sys.stdout.flush()
    try:
        write()
    except ArmidError as error:
        sys.stderr.write(f"no {page}: {error.problem} {error.remedy}".rstrip() + "\n")
        return False
    return True
