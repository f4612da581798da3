"""`armid report`: one HTML page about a run, or about what changed between two."""

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

MISSING = "say with --data FOLDER where it is; the page has its numbers but not its pictures."
"""What to do about a recording that a page could not be drawn from."""

NoReport = Annotated[bool, typer.Option("--no-report", help=f"Do not write {PAGE} into the run's folder.")]


def report(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Folder that armid identify made.")],
    other: Annotated[
        str | None, typer.Argument(metavar="[RUN]", help="A later run of the same arm: what changed since the first.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Where to write the page.")] = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Write a page that opens without a network: verdict, torque, residuals, friction, parameters, provenance.

    Pictures are made from the run's recordings, which are read again; without them the page has its tables. Of two
    runs the page says what changed beyond the intervals.

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
        material = gather(first, data=data)
        page, missing = write_one(material, out or Path(run) / PAGE), material.missing
    else:
        page = write_comparison(first, load_run(other), out or Path(other) / "comparison.html")
    if json:
        sys.stdout.write(to_json({"report": str(page), "bytes": page.stat().st_size}) + "\n")
    else:
        sys.stdout.write(f"page written to {page}\n")
    print_findings([Finding("recording-missing", "warning", "", text, MISSING) for text in missing])


def write_page(folder: Path, recordings: Sequence[ProcessedRecording]) -> bool:
    """The page of a run that has just been saved; where it cannot be made, a line on standard error says why.

    The results are on the screen by then, so nobody waits for it.

    Args:
        folder: The run's folder.
        recordings: What it was made from.

    Returns:
        Whether it is there.
    """
    from armid.report.page import write_report
    from armid.runs.run import load_run

    return attempt(PAGE, lambda: write_report(load_run(folder), folder / PAGE, recordings=recordings))


def attempt(page: str, write: Callable[[], object]) -> bool:
    """Write a page beside results that are whole without it; whether it is there, and a line if not."""
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
