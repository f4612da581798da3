"""`armid fleet`: friction, offsets and torque scales of many units of one type of arm, and which unit is odd."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.options import Json, Out, run_folder
from armid.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from armid.runs.fleet.fleet_change import UnitChange
    from armid.study.fleet.fleet_file import FleetChoice
    from armid.study.fleet.identify_fleet import FleetIdentification

MAX_CHANGES = 30
"""Largest number of changes in the printed table."""


def fleet(
    file: Annotated[
        str, typer.Argument(metavar="FLEET.toml", help="Arm, and recordings of each unit (docs/fleet.md).")
    ],
    since: Annotated[
        str | None, typer.Option("--since", metavar="DIR", help="Earlier fleet, with which this one is compared.")
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", min=1, help="Number of processes in which the units are processed; 1 by default.")
    ] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="ADDRESS",
            help="Process the units on a Dask cluster: tcp://HOST:PORT, or `local` for --jobs processes here.",
        ),
    ] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Do not write the HTML page.")] = False,
    out: Out = None,
    json: Json = False,
) -> None:
    """Identify many units of one type of arm together: common bodies, and friction, offsets and gains of each unit.

    A unit that differs from the others is named with its joint. Each unit also gets a run for the other commands.

    Examples:
        armid fleet FLEET.toml --out fleets/march

        armid fleet FLEET.toml --since fleets/march --jobs 2

        armid fleet FLEET.toml --scheduler tcp://cell-controller:8786
    """
    from armid.cli.console import print_findings
    from armid.runs.fleet.fleet_change import changes_since
    from armid.runs.fleet.stored_fleet import fleet_record, load_fleet, refuse_fleet_folder, save_fleet
    from armid.study.fleet.fleet_file import load_fleet_file
    from armid.study.storage.records import to_json

    choice = load_fleet_file(file if scheduler is None else str(Path(file).resolve()))  # workers have other folders
    earlier = None if since is None else load_fleet(since)
    folder = run_folder(out, f"{Path(choice.units[0].study.robot.description).stem}-fleet")
    if since is not None and folder.resolve() == Path(since).resolve():
        raise OutputError(
            f"The result cannot be written to {folder}, because this is the folder of the earlier fleet.",
            remedy="choose another folder with --out.",
        )
    refuse_fleet_folder(folder)
    found = _identified(choice, jobs, scheduler, quiet=json)
    changes = None if earlier is None else changes_since(earlier.estimate, found.estimate)
    save_fleet(found, folder, changes=changes, since=since or "")
    page = not no_report and _write_page(found, changes, since or "", folder)
    if json:
        record: dict[str, Any] = {"fleet": str(folder), **fleet_record(found, changes=changes, since=since or "")}
        sys.stdout.write(to_json(record) + "\n")
    else:
        _print(found, changes, since or "")
        sys.stdout.write(f"\nfleet written to {folder}\n" + (f"page: {folder / 'report.html'}\n" if page else ""))
    print_findings(found.findings)


def _identified(choice: FleetChoice, jobs: int, scheduler: str | None, *, quiet: bool) -> FleetIdentification:
    """Identify the fleet in one or more processes or on a cluster, with a progress bar."""
    from armid.cli.console import progress
    from armid.study.fleet.identify_fleet import identify_fleet

    with _workers(jobs, scheduler) as executor, progress(quiet=quiet) as tell:
        return identify_fleet(choice, executor=executor, progress=tell)


def _workers(jobs: int, scheduler: str | None) -> AbstractContextManager[Executor | None]:
    """Executor of the units: a cluster, processes of this machine, or none."""
    if scheduler is not None:
        from armid.cluster import cluster_executor

        return cluster_executor(scheduler, jobs)
    if jobs == 1:
        return nullcontext()
    from armid.excitation.design.multistart import single_threaded_pool

    return single_threaded_pool(jobs)


def _write_page(found: FleetIdentification, changes: Sequence[UnitChange] | None, since: str, folder: Path) -> bool:
    """Write the page of the fleet into its folder; false if the packages for pages are not installed."""
    from armid.errors import MissingExtraError
    from armid.report.fleet_page import write_fleet_page

    try:
        write_fleet_page(found, folder / "report.html", changes=changes, since=since)
    except MissingExtraError:
        return False
    return True


def _print(found: FleetIdentification, changes: Sequence[UnitChange] | None, since: str) -> None:
    """Print units, own parameters and changes on standard output."""
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console
    from armid.notebook_display import plural
    from armid.report.data.number_format import short, with_half_width
    from armid.study.fleet.fleet_table import fleet_rows

    console, rows = output_console(), fleet_rows(found)
    odd = {row.of for row in rows if row.odd} | {each.unit for each in found.estimate.odd_bodies}
    title = f"{escape(found.robot.name)}: {plural(len(found.results), 'unit')}, {len(odd)} odd"
    table = Table(title=title, show_edge=False, pad_edge=False)
    for name in ("unit", "odd in", "most apart", "value ± 95 %", "verdict"):
        table.add_column(name, overflow="fold")
    for name, result in zip(found.estimate.units, found.results, strict=True):
        own = [row for row in rows if row.of == name]
        most = max(own, key=lambda row: abs(row.score) if row.score == row.score else -1.0)
        joints = list(dict.fromkeys(row.joint for row in own if row.odd))
        joints += ["bodies"] * any(each.unit == name for each in found.estimate.odd_bodies)
        apart = f"{most.parameter}: {short(most.score, 2)} σ" if most.score == most.score else "–"
        value = f"{with_half_width(most.value, most.half)} {most.unit}".strip()
        table.add_row(escape(name), escape(", ".join(joints)) or "–", escape(apart), value, result.validation.verdict)
    console.print(table)
    if changes is None:
        return
    beyond = [each for each in changes if each.beyond]
    if not beyond:
        console.print(f"no parameter of any unit has changed since {escape(since)}")
        return
    table = Table(title=f"changed since {escape(since)}", show_edge=False, pad_edge=False)
    for name in ("unit", "parameter", "before", "after", "change ± 95 %"):
        table.add_column(name, overflow="fold")
    for each in beyond[:MAX_CHANGES]:
        values = short(each.before, 4), short(each.after, 4), with_half_width(each.change, each.half)
        table.add_row(escape(each.unit), each.parameter, *values)
    console.print(table)
    if len(beyond) > MAX_CHANGES:
        console.print(f"and {len(beyond) - MAX_CHANGES} more in fleet.json")
