"""`armid track`: changes of the parameters over time while an arm works."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.log_format_options import Columns, Rate, ReadingLines, TorqueSign, changed_reading
from armid.cli.options import Json, Out
from armid.errors import StudyError

if TYPE_CHECKING:
    from armid.runs.recalibration import Changed
    from armid.runs.run import Run
    from armid.runs.tracking import TrackedRun

MAX_TABLE_ROWS = 20
"""Largest number of rows of the printed table of estimates over time."""

MAX_CHANGED = 12
"""Largest number of parameters in the printed table of the largest changes."""


def track(
    run: Annotated[str, typer.Argument(help="Run with the initial values.")],
    recordings: Annotated[
        list[str], typer.Argument(metavar="RECORDING…", help="Recordings made after the run, in the order of time.")
    ],
    memory: Annotated[
        float, typer.Option(metavar="S", help="Time constant of forgetting, s; inf: nothing is forgotten.")
    ] = 30.0,
    block: Annotated[float, typer.Option(metavar="S", help="Time from one estimate to the next, s.")] = 1.0,
    tool: Annotated[bool, typer.Option("--tool", help="Also track a payload at the tip.")] = False,
    everything: Annotated[bool, typer.Option("--all", help="Track all parameters.")] = False,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    reading_lines: ReadingLines = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Track friction, and with --tool a payload, through recordings made after a run; old data are forgotten.

    Examples:
        armid track runs/spring shift.csv --memory 60 --out shift

        armid track runs/spring picking.csv --tool --memory 5
    """
    from armid.atomic_file import replace_file
    from armid.cli.console import print_findings, progress
    from armid.runs.run import load_run
    from armid.runs.tracking import track as stage
    from armid.runs.tracking import track_record, track_table
    from armid.study.plausibility.recording_errors import contradictions
    from armid.study.storage.atomic_folder import refuse, whole_folder
    from armid.study.storage.records import to_json

    if tool and everything:
        raise StudyError(
            "--tool and --all are both given.", remedy="give only one of them; --all includes the payload."
        )
    changed: Changed = "tool" if tool else "all" if everything else "friction"
    earlier = load_run(run)
    if out is not None:
        refuse(out, "track.json", "track")
    reading = changed_reading(earlier.log_format, rate, torque_sign, columns, reading_lines)
    with progress() as tell:
        tracked = stage(earlier, recordings, reading, memory=memory, block=block, changed=changed, progress=tell)
    print_findings(tracked.findings)
    record = {"run": run, "memory": memory, "block": block, "changed": changed, **track_record(tracked)}
    if out is not None:
        with whole_folder(out, "track.json", "track") as draft:
            replace_file(draft / "track.csv", track_table(tracked))
            replace_file(draft / "track.json", to_json(record) + "\n")
    if json:
        sys.stdout.write(to_json(record) + "\n")
    else:
        _report(earlier, tracked, tool=tool)
        if out is not None:
            sys.stdout.write(f"\nestimates over time written to {out}\n")
    if contradictions(tracked.findings):
        raise typer.Exit(1)


def _report(run: Run, tracked: TrackedRun, *, tool: bool) -> None:
    """Print the estimates over time, the sudden changes, and the largest changes at the end."""
    import numpy as np
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console, print_contradictions
    from armid.study.plausibility.recording_errors import contradictions

    console = output_console()
    print_contradictions(console, contradictions(tracked.findings))
    table = Table(title=f"{escape(run.robot.name)}: RMS torque error of all joints, and estimates")
    shown = ["M", "MX", "MY", "MZ"] if tool else _most_changed(run, tracked, 4)
    at = [tracked.names.index(name) for name in shown]
    for name in (
        "t [s]",
        "error of the run",
        "error before update",
        "innovation ratio",
        *(escape(name) for name in shown),
    ):
        table.add_column(name, justify="right")
    for k in np.unique(np.linspace(0, len(tracked.time) - 1, MAX_TABLE_ROWS).round().astype(int)):
        numbers = [f"{tracked.values[k, i]:.3f} ± {1.96 * tracked.deviation[k, i]:.3f}" for i in at]
        # A block in which all joints rest has no rows, so its error is exactly zero.
        errors = [f"{np.linalg.norm(x[k]):.3f}" if x[k].any() else "–" for x in (tracked.before, tracked.error)]
        table.add_row(f"{tracked.time[k]:.2f}", *errors, f"{tracked.normalized_innovation[k].max():.1f}", *numbers)
    console.print(table)
    for event in tracked.events[:MAX_TABLE_ROWS]:
        console.print(
            f"{event.time:.2f} s: the error of {escape(event.joint)} is {event.normalized_innovation:.1f} times the "
            "expected error"
        )
    names = _most_changed(run, tracked, MAX_CHANGED)
    last = Table(title="Largest changes at the end")
    for name in ("parameter", "before", "after", "unit", "change / σ"):
        last.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for name in names:
        k = tracked.names.index(name)
        before, ratio = _before(run, tracked, k)
        last.add_row(escape(name), f"{before:.4f}", f"{tracked.values[-1, k]:.4f}", tracked.units[k], f"{ratio:.1f}")
    console.print(last)


def _before(run: Run, tracked: TrackedRun, k: int) -> tuple[float, float]:
    """Value of a parameter in the run, and its change since then divided by the standard deviation of the change."""
    from armid.estimation.estimate_record import averaged

    fit = averaged(run.estimate.base.names, run.estimate.fit)
    value, variance = (float(fit.values[k]), float(fit.covariance[k, k])) if k < len(fit.values) else (0.0, 0.0)
    deviation = (variance + float(tracked.deviation[-1, k]) ** 2) ** 0.5
    return value, abs(float(tracked.values[-1, k]) - value) / deviation if deviation > 0.0 else 0.0


def _most_changed(run: Run, tracked: TrackedRun, count: int) -> list[str]:
    """Names of the parameters with the largest changes at the end, in standard deviations of the change."""
    ratio = [_before(run, tracked, k)[1] for k in range(len(tracked.names))]
    return [tracked.names[k] for k in sorted(range(len(ratio)), key=lambda k: -ratio[k])[:count]]
