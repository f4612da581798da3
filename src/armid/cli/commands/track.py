"""`armid track`: what changes while an arm works, over time."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.options import Json, Out
from armid.cli.reading import Columns, Rate, TorqueSign, changed_reading
from armid.errors import StudyError

if TYPE_CHECKING:
    from armid.runs.recalibration import Changed
    from armid.runs.run import Run
    from armid.runs.tracking import TrackedRun

__all__ = ["track"]

SHOWN = 20
"""Most rows of the table over time."""

NAMED = 12
"""Most parameters that are listed as changed."""


def track(
    run: Annotated[str, typer.Argument(help="The run to begin with.")],
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING…", help="Later recordings, in order.")],
    memory: Annotated[float, typer.Option(metavar="S", help="Time constant of forgetting, s; inf for none.")] = 30.0,
    block: Annotated[float, typer.Option(metavar="S", help="Time from one estimate to the next, s.")] = 1.0,
    tool: Annotated[bool, typer.Option("--tool", help="Follow a load at the tip, too.")] = False,
    everything: Annotated[bool, typer.Option("--all", help="Every parameter may change.")] = False,
    rate: Rate = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Follow friction, and with --tool a load, through recordings made after a run, forgetting what is old.

    Examples:
        armid track runs/spring shift.csv --memory 60 --out shift

        armid track runs/spring picking.csv --tool --memory 5
    """
    from armid.cli.console import print_findings, progress
    from armid.runs.run import load_run
    from armid.runs.tracking import track as stage
    from armid.runs.tracking import track_record, track_table
    from armid.study.atomic_folder import refuse, whole_folder
    from armid.study.records import to_json
    from armid.values import replace_file

    if tool and everything:
        raise StudyError("--tool and --all are given.", remedy="give one: with --all a load is in every parameter.")
    changed: Changed = "tool" if tool else "all" if everything else "friction"
    earlier = load_run(run)
    if out is not None:
        refuse(out, "track.json", "track")
    how = changed_reading(earlier.reading, rate, torque_sign, columns)
    with progress() as tell:
        found = stage(earlier, recordings, how, memory=memory, block=block, changed=changed, progress=tell)
    print_findings(found.findings)
    record = {"run": run, "memory": memory, "block": block, "changed": changed, **track_record(found)}
    if out is not None:
        with whole_folder(out, "track.json", "track") as draft:
            replace_file(draft / "track.csv", track_table(found))
            replace_file(draft / "track.json", to_json(record) + "\n")
    if json:
        sys.stdout.write(to_json(record) + "\n")
        return
    _report(earlier, found, tool=tool)
    if out is not None:
        sys.stdout.write(f"\ntrack written to {out}\n")


def _report(run: Run, found: TrackedRun, *, tool: bool) -> None:
    """The track over time, what happened, and what has changed by its end, on standard output."""
    import numpy as np
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console

    console = output_console()
    table = Table(title=f"{escape(run.robot.name)}: torque error, all joints, and what was found")
    shown = ["M", "MX", "MY", "MZ"] if tool else _most_changed(run, found, 4)
    at = [found.names.index(name) for name in shown]
    for name in ("t [s]", "by the run", "before each block", "surprise", *(escape(name) for name in shown)):
        table.add_column(name, justify="right")
    for k in np.unique(np.linspace(0, len(found.time) - 1, SHOWN).round().astype(int)):
        numbers = [f"{found.values[k, i]:.3f} ± {1.96 * found.deviation[k, i]:.3f}" for i in at]
        errors = [f"{np.linalg.norm(each[k]):.3f}" for each in (found.before, found.error)]
        table.add_row(f"{found.time[k]:.2f}", *errors, f"{found.surprise[k].max():.1f}", *numbers)
    console.print(table)
    for event in found.events[:SHOWN]:
        console.print(
            f"{event.time:.2f} s: {escape(event.joint)} has {event.surprise:.1f} times its usual torque error"
        )
    names = _most_changed(run, found, NAMED)
    last = Table(title="changed most by the end")
    for name in ("parameter", "before", "after", "unit", "change / σ"):
        last.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for name in names:
        k = found.names.index(name)
        before, ratio = _before(run, found, k)
        last.add_row(escape(name), f"{before:.4f}", f"{found.values[-1, k]:.4f}", found.units[k], f"{ratio:.1f}")
    console.print(last)


def _before(run: Run, found: TrackedRun, k: int) -> tuple[float, float]:
    """A parameter's value in the run, and its change since, over the deviation of both."""
    from armid.estimation.estimate import averaged

    fit = averaged(run.estimate.base.names, run.estimate.fit)
    value, variance = (float(fit.values[k]), float(fit.covariance[k, k])) if k < len(fit.values) else (0.0, 0.0)
    deviation = (variance + float(found.deviation[-1, k]) ** 2) ** 0.5
    return value, abs(float(found.values[-1, k]) - value) / deviation if deviation > 0.0 else 0.0


def _most_changed(run: Run, found: TrackedRun, count: int) -> list[str]:
    """Names of the parameters that have changed most by the end, over their deviations."""
    ratio = [_before(run, found, k)[1] for k in range(len(found.names))]
    return [found.names[k] for k in sorted(range(len(ratio)), key=lambda k: -ratio[k])[:count]]
