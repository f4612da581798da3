"""`armid report`: HTML page about a run, or about the changes between two runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.options import Json
from armid.cli.reading import Data

if TYPE_CHECKING:
    from armid.study.processed import ProcessedRecording

__all__ = ["NoReport", "attempt", "report", "write_page"]

PAGE = "report.html"

MISSING_REMEDY = "give its folder with --data FOLDER; the page has its numbers, but not its plots."
"""Remedy for a recording that could not be read for the plots of a page."""

NoReport = Annotated[bool, typer.Option("--no-report", help=f"Do not write {PAGE} into the run's folder.")]


def report(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Folder that armid identify made.")],
    other: Annotated[
        str | None, typer.Argument(metavar="[RUN]", help="A later run of the same arm, to report the changes.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="File to write the page to.")] = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Write a page that opens without a network: verdict, torque, residuals, friction, parameters, provenance.

    The plots need the run's recordings, which are read again; without them the page has only its tables. For two runs
    the page lists the parameters whose change exceeds its interval.

    Examples:
        armid report runs/today

        armid report runs/last_year runs/today --out change.html
    """
    from armid.cli.console import print_findings
    from armid.errors import Finding
    from armid.report.data.page_data import gather
    from armid.report.page import write_comparison
    from armid.report.page import write_page as write_one
    from armid.report.rendering import require_extra
    from armid.runs.run import load_run
    from armid.study.records import to_json

    require_extra()
    first = load_run(run)
    missing: tuple[str, ...] = ()
    if other is None:
        page_data = gather(first, data=data)
        page, missing = write_one(page_data, out or Path(run) / PAGE), page_data.missing
    else:
        page = write_comparison(first, load_run(other), out or Path(other) / "comparison.html")
    if json:
        sys.stdout.write(to_json({"report": str(page), "bytes": page.stat().st_size}) + "\n")
    else:
        sys.stdout.write(f"page written to {page}\n")
    print_findings([Finding("recording-missing", "warning", "", text, MISSING_REMEDY) for text in missing])


def write_page(folder: Path, recordings: Sequence[ProcessedRecording]) -> bool:
    """Write the page of a run that has just been saved; if this fails, print the reason on standard error.

    It is called after the results are printed, so that they do not wait for the page.

    Args:
        folder: The run's folder.
        recordings: Processed recordings that the run was identified from.

    Returns:
        True if the page was written.
    """
    from armid.report.page import write_report
    from armid.runs.run import load_run

    return attempt(PAGE, lambda: write_report(load_run(folder), folder / PAGE, recordings=recordings))


def attempt(page: str, write: Callable[[], object]) -> bool:
    """Write a page that the results do not depend on; if this fails, print the reason and return false."""
    from armid.errors import ArmidError

    sys.stdout.flush()
    try:
        write()
    except ArmidError as error:
        sys.stderr.write(f"no {page}: {error.problem} {error.remedy}".rstrip() + "\n")
    except KeyboardInterrupt:
        sys.stderr.write(f"no {page}: interrupted\n")
    else:
        return True
    return False
