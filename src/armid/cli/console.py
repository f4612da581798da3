"""Output for people: tables on standard output, progress and messages on standard error."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from armid.cli.hints import hint
from armid.errors import ArmidError, Finding
from armid.notebook import names_apart
from armid.study.compare import MethodTable
from armid.study.identify import Progress as Tell
from armid.validation.prediction import Score, Validation
from armid.values import Array

__all__ = [
    "error_console",
    "output_console",
    "print_error",
    "print_findings",
    "print_methods",
    "print_missing_meshes",
    "print_verdict",
    "progress",
    "validation_table",
]

WIDTH_IN_A_PIPE = 120
"""Columns of what is no terminal, where `COLUMNS` does not say."""

SHAPES = ("bodies-from-visuals", "mesh-missing", "visual-left-out", "visual-missing")
"""Findings about the shapes of an arm, which say nothing of its dynamics."""

SHORT = {"validation": "valid.", "earlier run": "earlier"}
"""Titles where there is a column for each of several recordings, so that a table fits 80 columns."""

PATIENCE = 2.0
"""Seconds after which it is said that meshes are read, and between two such lines."""

MOST_COLUMNS = 2
"""Recordings that have a column each; of more the mean is shown."""


def output_console() -> Console:
    """Standard output; plain text where it is no terminal."""
    return Console(file=sys.stdout, width=_width(sys.stdout), highlight=False)


def error_console() -> Console:
    """Standard error."""
    return Console(file=sys.stderr, width=_width(sys.stderr), highlight=False)


def _width(stream: TextIO) -> int | None:
    """Columns of a stream: of a terminal its own, in a pipe what `COLUMNS` says."""
    asked = os.environ.get("COLUMNS", "")
    if stream.isatty():
        return None
    return int(asked) if asked.isdecimal() and int(asked) > 0 else WIDTH_IN_A_PIPE


def print_error(error: ArmidError) -> None:
    """One message: what was asked and found, what is possible, what to do."""
    console = error_console()
    console.print(f"[bold red]error[/] {escape(error.problem)}")
    if error.possible:
        console.print(f"[dim]possible:[/] {escape(error.possible)}")
    if error.remedy:
        console.print(f"[bold]hint:[/] {escape(error.remedy)}")


def print_findings(findings: Sequence[Finding], *, shapes: bool = False) -> None:
    """Findings, one line each and each once, errors first, behind what is on standard output by now.

    Args:
        findings: What was noticed.
        shapes: Whether the command has to do with the space that bodies take; else `SHAPES` are not told.
    """
    sys.stdout.flush()
    console = error_console()
    colours = {"error": "red", "warning": "yellow", "info": "dim"}
    told = [finding for finding in dict.fromkeys(findings) if shapes or finding.code not in SHAPES]
    for finding in sorted(told, key=lambda finding: list(colours).index(finding.severity)):
        where = f"{finding.channel}: " if finding.channel else ""
        stop = "; " if finding.remedy and finding.evidence[-1:] not in (".", ";") else " "
        text = stop.join(part for part in (where + finding.evidence, hint(finding.remedy)) if part)
        colour = colours[finding.severity]
        console.print(f"[{colour}]{finding.severity}[/] [{colour}]{finding.code}[/] {escape(text)}")


@contextmanager
def progress(*, quiet: bool = False) -> Generator[Tell]:
    """A bar on standard error while work goes on; nothing where nobody watches."""
    console = error_console()
    if quiet or not console.is_terminal:
        yield lambda stage, share: None
        return
    bar = Progress(
        TextColumn("{task.description:<12}"), BarColumn(), TimeElapsedColumn(), console=console, transient=True
    )
    with bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, share: bar.update(task, description=stage, completed=share)


@contextmanager
def print_missing_meshes(*, quiet: bool = False) -> Generator[None]:
    """Say on standard error which mesh is read, where that takes longer than `PATIENCE` and somebody watches."""
    from armid.excitation.collision.coal import telling_of_meshes

    console, began, said, count = error_console(), time.monotonic(), 0.0, 0

    def tell(path: str) -> None:
        nonlocal said, count
        count, since = count + 1, time.monotonic() - began
        if since - said > PATIENCE:
            said = since
            console.print(
                f"[dim]reading meshes, once for every file: {count - 1} read, now {escape(Path(path).name)}[/]"
            )

    with telling_of_meshes(tell if console.is_terminal and not quiet else lambda path: None):
        yield


def validation_table(
    validation: Validation, training: Sequence[Score], units: Sequence[str], before: Sequence[Score] = ()
) -> Table:
    """Torque errors, joint by joint; `before` are those of an earlier run on the same recordings."""
    same = len(set(units)) == 1
    title = f"Torque error, RMS{f' in {units[0]}' if same else ''}"
    table = Table(title=title, header_style="bold", show_edge=False, pad_edge=False)
    table.add_column("#", justify="right")
    table.add_column("joint", overflow="fold")
    held = validation.recordings
    several = [*_columns("train", training), *_columns("validation", held), *_columns("earlier run", before)]
    for name, _ in several:
        table.add_column(name, justify="right")
    judged = held or tuple(training)
    for name in ("CAD/\nURDF", "relative\nRMS", "peak", "in\nband"):
        table.add_column(name, justify="right")
    described = [score.prior_rms for score in judged if score.prior_rms is not None]
    for j, joint in enumerate(validation.joints):
        table.add_row(
            str(j + 1),
            escape(joint) + ("" if same else f" [dim]{units[j]}[/]"),
            *(_number(rms[j]) for _, rms in several),
            _number(_together(described)[j]) if described else "-",
            _number(100 * _worst([score.relative[j] for score in judged]), 1, " %"),
            _number(_worst([score.peak[j] for score in judged])),
            _number(-100 * _worst([-score.coverage95[j] for score in judged]), 0, " %"),
        )
    table.caption = _legend(training, held, before)
    table.caption_justify = "left"
    return table


def _legend(training: Sequence[Score], held: Sequence[Score], before: Sequence[Score]) -> str:
    """Of which recordings the columns are, and what they mean."""
    names = names_apart([score.path for score in (*training, *held, *before)])
    parts: list[str] = []
    for title, scores in (("train", training), ("validation", held)):
        listed = [escape(names[score.path]) for score in scores if score.path]
        numbered = [f"{SHORT.get(title, title)} {k + 1}: {name}" for k, name in enumerate(listed)]
        if len(listed) > 1:
            parts.append(", ".join(numbered) if len(listed) <= MOST_COLUMNS else f"{title}: root mean square of all")
        elif listed:
            parts.append(f"{title}: {listed[0]}")
    judged, kind = (held, "validation") if held else (training, "training")
    of = f"the {len(judged)} {kind} recordings" if len(judged) > 1 else f"{kind}"
    worst = ", the worst of each joint" if len(judged) > 1 else ""
    parts.append(
        f"CAD/URDF (the description by itself), relative RMS (over the torque's standard deviation), "
        f"peak and share of rows in the 95 % band are of {of}{worst}"
    )
    return "; ".join(parts)


def _together(errors: Sequence[Array]) -> Array:
    """Root mean square over recordings."""
    return np.sqrt(np.mean(np.square(errors), axis=0))


def _worst(values: Sequence[float]) -> float:
    """The largest that is known; NaN where none is."""
    return max((value for value in values if math.isfinite(value)), default=math.nan)


def _columns(name: str, scores: Sequence[Score]) -> list[tuple[str, Array]]:
    """Titles and errors of a column for each recording, or of one for all."""
    if len(scores) > MOST_COLUMNS:
        return [(f"{name},\n{len(scores)} runs", _together([score.rms for score in scores]))]
    short = SHORT.get(name, name)
    return [(f"{short}\n{k + 1}" if len(scores) > 1 else name, score.rms) for k, score in enumerate(scores)]


def _number(value: float, decimals: int = 3, unit: str = "") -> str:
    """A number, or a dash where there is none."""
    return f"{value:.{decimals}f}{unit}" if math.isfinite(value) else "-"


def print_methods(found: MethodTable, units: Sequence[str]) -> None:
    """Every method beside the others, and what kept those from an estimate that have none."""
    console = output_console()
    unit = f" in {units[0]}" if len(set(units)) == 1 else ""
    table = Table(title=f"Methods: torque error of all joints together, RMS{unit}", header_style="bold")
    table.add_column("method")
    for name in ("training", "held-out", "dropped", "physical", "smallest λ", "time"):
        table.add_column(name, justify="right")
    for each in found.scores:
        bodies = each.certificate
        physical = (
            "-" if bodies is None else "yes" if bodies.feasible else f"{100 * bodies.relative_distance:.2g} % off"
        )
        table.add_row(
            each.method,
            *(_number(float(np.linalg.norm(error))) for error in (each.training, each.unseen)),
            str(each.dropped or "-"),
            physical,
            "-" if each.eigenvalue is None else f"{each.eigenvalue:.1e}",
            f"{each.seconds:.3f} s",
        )
    table.caption = (
        f"held-out: {found.note}; physical: whether bodies with these base parameters exist; λ: of the "
        "pseudo-inertias of the estimated bodies"
    )
    table.caption_justify = "left"
    console.print(table)
    for each in found.scores:
        if each.failure:
            console.print(f"  {each.method}: {escape(each.failure)}")


def print_verdict(console: Console, validation: Validation) -> None:
    """The verdict with the number of checks that hold, and each of them, those that do not hold first."""
    colour = {"pass": "green", "fail": "red"}.get(validation.verdict, "yellow")
    held = sum(check.ok for check in validation.checks)
    of = f" ({held} of {len(validation.checks)} checks hold)" if validation.checks else ""
    console.print(f"verdict on held-out motion: [bold {colour}]{validation.verdict}[/]{of}")
    checks = Table.grid(padding=(0, 1))
    for check in sorted(validation.checks, key=lambda check: check.ok):
        mark = "[green]ok[/]" if check.ok else "[red]fail[/]"
        relation = f"{check.value:.3g} {'≤' if check.ok else '>'} {check.bound:.3g}"
        checks.add_row("", mark, relation, escape(check.name))
    if validation.checks:
        console.print(checks)
    if validation.verdict == "not judged":
        console.print('  no recording was kept for it: --validate RECORDING, or role = "validate" in the study')
