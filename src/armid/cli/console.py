"""Text output: tables on standard output, progress and messages on standard error."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TextIO

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from armid.checked_array import Array
from armid.cli.remedy_hints import hint
from armid.errors import ArmidError, Finding
from armid.notebook_display import names_apart
from armid.remedy import Remedy
from armid.study.compare_methods import MethodTable
from armid.study.progress import Progress as ReportProgress
from armid.validation.torque_validation import Check, Score, Validation

WIDTH_IN_A_PIPE = 120
"""Width of output that does not go to a terminal, unless the environment variable `COLUMNS` is set [characters]."""

SHAPE_FINDINGS = (
    "bodies-from-visuals",
    "bodies-unknown",
    "markers-unchecked",
    "mesh-missing",
    "shape-unknown",
    "visual-left-out",
    "visual-missing",
)
"""Codes of findings about the shapes of an arm; shapes have no effect on its dynamics."""

SHORT_FORMS = {
    "columns-guessed": "Columns and units were guessed from the names of the columns; armid doctor lists them.",
}
"""Short texts, by the code of a finding. They replace the texts of findings of severity `info` that list all columns;
the page of a run gives the whole text."""

REPEATED = 2
"""Largest number of `info` findings with the same code that are all printed; of more, only the first is printed."""

SHORT_TITLES = {"validation": "valid.", "earlier run": "earlier"}
"""Short column titles for tables with a column for each recording, which then fit into 80 characters."""

MESH_MESSAGE_INTERVAL = 2.0
"""Time until the first message that meshes are being read, and between two such messages [s]."""

OPTION = re.compile(r"(?<!\S)--[a-z]|\barmid [a-z]|\b[a-z_]+ = \S")
"""Pattern of an option, a command or a key of a study in a remedy."""

MAX_RECORDING_COLUMNS = 2
"""Largest number of recordings that have one column each in a table of torque errors. More recordings share one
column with the root mean square of their errors."""


class _Console(Console):
    """Console that leaves a pipe without a reader to the command line, which has an exit code for it."""

    def on_broken_pipe(self) -> None:
        """Raise the error again, which the console would turn into an exit code of its own."""
        raise BrokenPipeError


def output_console() -> Console:
    """Console on standard output, which writes plain text if standard output is not a terminal."""
    return _Console(file=sys.stdout, width=_width(sys.stdout), highlight=False)


def error_console() -> Console:
    """Console on standard error."""
    return _Console(file=sys.stderr, width=_width(sys.stderr), highlight=False)


def _width(stream: TextIO) -> int | None:
    """Width of a stream that is not a terminal [characters]; `None` for a terminal, whose width is measured."""
    requested = os.environ.get("COLUMNS", "")
    if stream.isatty():
        return None
    return int(requested) if requested.isdecimal() and int(requested) > 0 else WIDTH_IN_A_PIPE


def print_error(error: ArmidError) -> None:
    """Print an error: the problem, the possible values, and the remedy."""
    console = error_console()
    console.print(f"[bold red]error[/] {escape(error.problem)}")
    if error.possible:
        console.print(f"[dim]possible:[/] {escape(error.possible)}")
    if error.remedy:
        console.print(f"[bold]hint:[/] {escape(error.remedy)}", soft_wrap=to_paste(error.remedy))


def print_findings(findings: Sequence[Finding], *, shapes: bool = False, whole: bool = False) -> None:
    """Prints findings, errors first, without duplicates, after flushing standard output.

    A remedy that the user can copy is printed below the finding, in lines that are not wrapped. If several findings
    have the same remedy, the remedy is printed once, below all these findings.

    Args:
        findings: Findings of the command.
        shapes: If true, also print `SHAPE_FINDINGS`; set by commands that check for collisions.
        whole: If true, also print the details of the findings in `SHORT_FORMS`; set by --verbose.
    """
    sys.stdout.flush()
    console = error_console()
    colours = {"error": "red", "warning": "yellow", "info": "dim"}
    chosen = [finding for finding in findings if shapes or finding.code not in SHAPE_FINDINGS]
    printed = list(dict.fromkeys(chosen if whole else map(_shortened, chosen)))
    if not whole:
        printed = _folded(printed)
    groups: dict[tuple[str, str, int], list[Finding]] = {}
    for k, finding in enumerate(sorted(printed, key=lambda finding: list(colours).index(finding.severity))):
        alone = 0 if to_paste(hint(finding.remedy)) else k + 1
        groups.setdefault((finding.severity, str(finding.remedy), alone), []).append(finding)
    for group in groups.values():
        remedy = hint(group[0].remedy)
        below = to_paste(remedy)
        for finding in group:
            prefix = f"{finding.channel}: " if finding.channel else ""
            separator = "; " if remedy and not below and finding.evidence[-1:] not in (".", ";") else " "
            text = separator.join(part for part in (prefix + finding.evidence, "" if below else remedy) if part)
            colour = colours[finding.severity]
            console.print(f"[{colour}]{finding.severity}[/] [{colour}]{finding.code}[/] {escape(text)}")
        if below:
            print_to_paste(console, remedy)


def _shortened(finding: Finding) -> Finding:
    """Finding for the terminal; a finding whose code is in `SHORT_FORMS` gets the short text."""
    if finding.severity != "info" or finding.code not in SHORT_FORMS:
        return finding
    return replace(finding, channel="", evidence=min(SHORT_FORMS[finding.code], finding.evidence, key=len), remedy="")


def _folded(findings: Sequence[Finding]) -> list[Finding]:
    """Findings in which long groups are shortened: the first one of the group, and one that names the others.

    A group consists of the findings of severity `info` with the same code; it is long if it has more than `REPEATED`.
    Groups with a remedy that the user can copy are not shortened.
    """
    groups: dict[str, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(f"{finding.severity} {finding.code}", []).append(finding)
    result: list[Finding] = []
    for group in groups.values():
        keys = any(to_paste(hint(each.remedy)) for each in group)
        if group[0].severity != "info" or len(group) <= REPEATED or keys:
            result.extend(group)
            continue
        first, others = group[0], [Path(each.channel).name for each in group[1:] if each.channel]
        named = f": {', '.join(dict.fromkeys(others))}" if others else ""
        result.extend((first, replace(first, channel="", evidence=f"{len(group) - 1} more{named}.", remedy="")))
    return result


def to_paste(remedy: str) -> bool:
    """True if a remedy contains lines of a study or options, which must not be wrapped."""
    parts = remedy.parts if isinstance(remedy, Remedy) else Remedy.read(remedy).parts
    return any(not isinstance(part, str) for part in parts) or OPTION.search(remedy) is not None


def print_to_paste(console: Console, remedy: str) -> None:
    """Print a remedy in its own lines, without wrapping."""
    for line in remedy.splitlines():
        console.print(f"  {line}", style="bold", soft_wrap=True, markup=False)


@contextmanager
def progress(*, quiet: bool = False) -> Generator[ReportProgress]:
    """Progress bar on standard error; no bar if `quiet` or if standard error is not a terminal."""
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
    """Prints on a terminal the name of the mesh being read, at most once per `MESH_MESSAGE_INTERVAL`."""
    from armid.excitation.collision.coal import telling_of_meshes

    console, start, last_message, count = error_console(), time.monotonic(), 0.0, 0

    def report_mesh(path: str) -> None:
        nonlocal last_message, count
        count, elapsed = count + 1, time.monotonic() - start
        if elapsed - last_message > MESH_MESSAGE_INTERVAL:
            last_message = elapsed
            console.print(
                f"[dim]reading meshes, once for every file: {count - 1} read, now {escape(Path(path).name)}[/]"
            )

    with telling_of_meshes(report_mesh if console.is_terminal and not quiet else lambda path: None):
        yield


def validation_table(
    validation: Validation, training: Sequence[Score], units: Sequence[str], before: Sequence[Score] = ()
) -> Table:
    """Table of the torque errors of each joint; `before`: errors of an earlier run on the same recordings."""
    same_unit = len(set(units)) == 1
    title = f"Torque error, RMS{f' in {units[0]}' if same_unit else ''}"
    table = Table(title=title, header_style="bold", show_edge=False, pad_edge=False)
    table.add_column("#", justify="right")
    table.add_column("joint", overflow="fold")
    held_out = validation.recordings
    error_columns = [
        *_columns("train", training),
        *_columns("validation", held_out),
        *_columns("earlier run", before),
    ]
    for name, _ in error_columns:
        table.add_column(name, justify="right")
    judged = held_out or tuple(training)
    shares = _partly_used(judged)
    for name in ("CAD/\nURDF", "relative\nRMS", "peak", "cover-\nage", *(("rows\nused",) if shares else ())):
        table.add_column(name, justify="right")
    description_rms = [score.prior_rms for score in judged if score.prior_rms is not None]
    for j, joint in enumerate(validation.joints):
        table.add_row(
            str(j + 1),
            escape(joint) + ("" if same_unit else f" [dim]{units[j]}[/]"),
            *(_number(rms[j]) for _, rms in error_columns),
            _number(_root_mean_square(description_rms)[j]) if description_rms else "-",
            _number(100 * _largest([score.relative[j] for score in judged]), 1, " %"),
            _number(_largest([score.peak[j] for score in judged])),
            _number(-100 * _largest([-score.coverage95[j] for score in judged]), 0, " %"),
            *((_number(-100 * _largest([-share[j] for share in shares]), 0, " %"),) if shares else ()),
        )
    table.caption = _legend(training, held_out, before)
    table.caption_justify = "left"
    return table


def _legend(training: Sequence[Score], held_out: Sequence[Score], before: Sequence[Score]) -> str:
    """Caption of the table of torque errors: the recordings of the columns, and the meaning of each column."""
    names = names_apart([score.path for score in (*training, *held_out, *before)])
    parts: list[str] = []
    for title, scores in (("train", training), ("validation", held_out)):
        listed = [escape(names[score.path]) for score in scores if score.path]
        numbered = [f"{SHORT_TITLES.get(title, title)} {k + 1}: {name}" for k, name in enumerate(listed)]
        if len(listed) > 1:
            parts.append(
                ", ".join(numbered)
                if len(listed) <= MAX_RECORDING_COLUMNS
                else f"{title}: root mean square of the errors on all recordings"
            )
        elif listed:
            parts.append(f"{title}: {listed[0]}")
    judged, kind = (held_out, "validation") if held_out else (training, "training")
    recordings = f"the {len(judged)} {kind} recordings" if len(judged) > 1 else f"{kind}"
    aggregate = ", the worst value of each joint" if len(judged) > 1 else ""
    parts.append(
        "CAD/URDF (RMS error with the parameters of the description), relative RMS (RMS error divided by the "
        "standard deviation of the measured torque), peak (largest error) and coverage (share of rows inside the "
        f"95 % prediction interval) are of {recordings}{aggregate}"
    )
    if _partly_used(judged):
        parts.append(
            "rows used: share of the rows in which the state of hysteresis is known; all errors are of these rows, "
            "and can be compared only with errors of other runs on the same rows"
        )
    return "; ".join(parts)


def _partly_used(scores: Sequence[Score]) -> list[Array]:
    """For each recording, share (n,) of its rows that the errors include; empty if the errors include all rows."""
    shares = [score.share for score in scores if score.share is not None]
    return shares if any((share < 1.0).any() for share in shares) else []


def _root_mean_square(errors: Sequence[Array]) -> Array:
    """Root mean square of the errors of several recordings, for each joint, shape (n,)."""
    return np.sqrt(np.mean(np.square(errors), axis=0))


def _largest(values: Sequence[float]) -> float:
    """Largest finite value; NaN if there is none."""
    return max((value for value in values if math.isfinite(value)), default=math.nan)


def _columns(name: str, scores: Sequence[Score]) -> list[tuple[str, Array]]:
    """Title and RMS errors (n,) of each column: a column for each recording, or one for the RMS of many of them."""
    if len(scores) > MAX_RECORDING_COLUMNS:
        return [(f"{name},\n{len(scores)} runs", _root_mean_square([score.rms for score in scores]))]
    short = SHORT_TITLES.get(name, name)
    return [(f"{short}\n{k + 1}" if len(scores) > 1 else name, score.rms) for k, score in enumerate(scores)]


def _number(value: float, decimals: int = 3, unit: str = "") -> str:
    """Number as text; a dash if it is not finite."""
    return f"{value:.{decimals}f}{unit}" if math.isfinite(value) else "-"


def print_methods(comparison: MethodTable, units: Sequence[str]) -> None:
    """Prints a table of all estimation methods, and the reason for each method that failed."""
    console = output_console()
    unit = f" in {units[0]}" if len(set(units)) == 1 else ""
    table = Table(title=f"Methods: torque error of all joints together, RMS{unit}", header_style="bold")
    table.add_column("method")
    for name in ("training", "held-out", "dropped", "physical", "smallest λ", "time"):
        table.add_column(name, justify="right")
    for score in comparison.scores:
        physical = (
            "-"
            if score.consistent is None
            else "yes"
            if score.consistent
            else f"{100 * score.relative_distance:.2g} % off"
        )
        table.add_row(
            score.method,
            *(_number(float(np.linalg.norm(error))) for error in (score.training, score.unseen)),
            str(score.dropped or "-"),
            physical,
            "-" if score.eigenvalue is None else f"{score.eigenvalue:.1e}",
            f"{score.seconds:.3f} s",
        )
    table.caption = (
        f"held-out: {comparison.note}; dropped: number of parameters set to zero; physical: yes if bodies with these "
        "base parameters exist, otherwise the relative distance to the nearest parameters of such bodies; λ: "
        "smallest eigenvalue of the pseudo-inertias of the estimated bodies"
    )
    table.caption_justify = "left"
    console.print(table)
    for score in comparison.scores:
        if score.failure:
            console.print(f"  {score.method}: {escape(score.failure)}")


def print_verdict(console: Console, validation: Validation) -> None:
    """Prints the verdict, the number of passed checks, and all checks of the verdict, failed checks first."""
    colour = {"pass": "green", "fail": "red"}.get(validation.verdict, "yellow")
    passed = sum(check.ok for check in validation.checks)
    count = f" ({passed} of {len(validation.checks)} checks passed)" if validation.checks else ""
    subject = validation.subject
    console.print(f"verdict on {subject}: [bold {colour}]{validation.verdict}[/]{count}")
    _print_checks(console, validation.checks)
    if not validation.recordings:
        console.print(
            '  no validation recording: give one with --validate RECORDING, or role = "validate" in the study'
        )


def print_contradictions(console: Console, contradictions: Sequence[Check]) -> None:
    """Prints the failed verdict on the recordings with its checks; prints nothing without failed checks."""
    if contradictions:
        console.print("verdict on the recordings: [bold red]fail[/]")
        _print_checks(console, contradictions)


def _print_checks(console: Console, checks: Sequence[Check]) -> None:
    """Prints the checks of a verdict, failed checks first."""
    table = Table.grid(padding=(0, 1))
    for check in sorted(checks, key=lambda check: check.ok):
        mark = "[green]ok[/]" if check.ok else "[red]fail[/]"
        relation = f"{check.value:.3g} {'≤' if check.ok else '>'} {check.bound:.3g}"
        table.add_row("", mark, relation, escape(check.name))
    if checks:
        console.print(table)
