"""`armid bench`: speed of the kernel on this machine, compared with other packages."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from armid.cli.options import Json


def bench(
    samples: Annotated[int, typer.Option(min=2000, help="Number of samples of the least-squares problem.")] = 216_000,
    json: Json = False,
) -> None:
    """Measure the CPU time of the kernel and of other packages on one thread, in the same run.

    Example:
        armid bench --samples 50000
    """
    from armid.cli.console import output_console, progress
    from armid.runs.kernel_benchmark import run_benchmarks
    from armid.study.storage.records import to_json

    with progress(quiet=json) as tell:
        record = run_benchmarks(samples, progress=tell)
    if json:
        sys.stdout.write(to_json(record) + "\n")
        return
    from rich.table import Table

    table = Table(title=f"{record['isa']}, one thread, CPU time", header_style="bold")
    for name in ("benchmark", "peer", "armid [s]", "peer [s]", "ratio"):
        table.add_column(name, justify="left" if name in ("benchmark", "peer") else "right")
    for row in record["results"]:
        table.add_row(
            row["name"],
            row["peer"],
            f"{row['armid_seconds']:.4g}",
            f"{row['peer_seconds']:.4g}",
            f"{row['ratio']:.1f}",
        )
    output_console().print(table)
