"""`armid thesis`: complete reproduction of the study of the thesis."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.options import Json, Out, run_folder

if TYPE_CHECKING:
    from armid.thesis.reproduction import Thesis


def thesis(
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Fewer seeds and starts, lower sampling rates: all chapters in half a minute."),
    ] = False,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="Number of noise seeds; results are medians over them.")
    ] = None,
    starts: Annotated[
        int | None,
        typer.Option(
            min=1, help="Number of random starts of the thesis's Algorithm 2, which designs the trajectory."
        ),
    ] = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Repeat the study of the thesis [Halper2024] on a virtual arm, with corrections, and write a page of results.

    The virtual arm hangs. Frames, base parameters, excitation and estimates follow the thesis, first as printed, then
    with each correction in turn; the published tables are checked. The folder contains `thesis.html`, `thesis.json`
    with every number, and the tables as CSV and LaTeX. The command needs the extras lab, nlp and report.

    Examples:
        armid thesis

        armid thesis --quick --out study
    """
    from armid.cli.console import progress
    from armid.report.page import require_extra
    from armid.study.storage.atomic_folder import refuse
    from armid.study.storage.records import to_json
    from armid.thesis.page import KIND, MARKER, PAGE, write_thesis
    from armid.thesis.reproduction import reproduce, thesis_record
    from armid.thesis.setting import extent_of

    folder = run_folder(out, "thesis")
    refuse(folder, MARKER, KIND)
    require_extra()
    with progress(quiet=json) as tell:
        done = reproduce(extent_of(quick=quick, seeds=seeds, starts=starts), progress=tell)
    write_thesis(done, folder)
    if json:
        sys.stdout.write(to_json(thesis_record(done) | {"page": str(folder / PAGE)}) + "\n")
    else:
        _report(done)
        sys.stdout.write(f"\nstudy written to {folder}, page {folder / PAGE}\n")


def _report(done: Thesis) -> None:
    """Print the steps of Algorithm 3 of the thesis, and the main results."""
    from rich.table import Table

    from armid.cli.console import output_console

    console = output_console()
    table = Table(title="Algorithm 3 on the virtual arm", header_style="bold")
    for name in ("step", "variant", "all", "inertial", "friction", "Table A.2", "residual"):
        table.add_column(name, justify="left" if name in ("step", "variant") else "right")
    for step in done.steps.rows:
        found = step.errors
        shares = (f"{100.0 * x:.3g} %" for x in (found.relative, found.inertial, found.friction))
        table.add_row(step.group, step.title, *shares, f"{found.unseen:.4f} N·m", f"{found.residual:.4f} N·m")
    console.print(table)
    ratio, best = done.steps.spread.corrected_ratio, done.designs.best
    certificate = done.audit.base.certificate
    console.print(
        "with filtered columns, the wrong sign of gravity makes the residual at least "
        f"{ratio.min():.1f} times as large ({len(ratio)} seeds)"
    )
    console.print(f"best trajectory: {best.name}, condition number {best.condition:.1f}")
    console.print(
        f"distance of the values of Table 4.1 from the nearest consistent values: {certificate.distance:.3f}; "
        f"errata of the thesis: {len(done.errata)}"
    )
