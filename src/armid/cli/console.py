"""What people see: tables on standard output, progress and messages on standard error."""

from __future__ import annotations

import math
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from armid.errors import ArmidError, Finding
from armid.estimation.estimate import Estimate
from armid.estimation.friction import Ladder
from armid.estimation.standard_fit import StandardFit
from armid.study.compare import MethodTable
from armid.study.identify import Progress as Tell
from armid.validation.predict import Score, Validation
from armid.values import Array

__all__ = [
    "error_console",
    "estimate_table",
    "ladder_table",
    "output_console",
    "print_error",
    "print_findings",
    "print_methods",
    "print_verdict",
    "progress",
    "status_line",
    "validation_table",
]

WIDTH_IN_A_PIPE = 120

FEWEST_DECIMALS, MOST_DECIMALS = 3, 9

SHAPES = ("mesh-missing", "visual-left-out")
"""Findings about the shapes of an arm, which say nothing of its dynamics."""

MOST_COLUMNS = 2
"""Recordings that have a column each; of more the mean is shown."""


def output_console() -> Console:
    """Standard output; plain text where it is no terminal."""
    return Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH_IN_A_PIPE, highlight=False)


def error_console() -> Console:
    """Standard error."""
    return Console(file=sys.stderr, width=None if sys.stderr.isatty() else WIDTH_IN_A_PIPE, highlight=False)


def print_error(error: ArmidError) -> None:
    """One message: what was asked and found, what is possible, what to do."""
    console = error_console()
    console.print(f"[bold red]error[/] {escape(error.problem)}")
    if error.possible:
        console.print(f"[dim]possible[/] {escape(error.possible)}")
    if error.remedy:
        console.print(f"[bold]do[/] {escape(error.remedy)}")


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
        text = stop.join(part for part in (where + finding.evidence, finding.remedy) if part)
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


def estimate_table(estimate: Estimate) -> Table:
    """Base parameters in the form of the thesis's Table 4.1, with intervals."""
    fit, ends = estimate.fit, estimate.intervals
    decimals = [_decimals(0.5 * (high - low)) for low, high in ends]
    table = Table(
        title=f"{estimate.robot}: {len(fit.names)} base parameters, {estimate.method}",
        caption="* σ % above ten times the smallest: known worse than others, or near zero, as the interval tells",
        header_style="bold",
    )
    for name in ("parameter", "value", "unit", "σ %", "95 % interval"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    units = dict(zip(estimate.base.names, estimate.base.units, strict=True))
    for k, name in enumerate(fit.names):
        relative = fit.relative_deviation[k]
        table.add_row(
            escape(name),
            f"{fit.values[k]:.{decimals[k]}f}",
            units[name.split("[", 1)[0]],
            f"{_percent(relative)}{'*' if fit.poorly_identified[k] else ' '}",
            f"{ends[k, 0]:.{decimals[k]}f} … {ends[k, 1]:.{decimals[k]}f}",
        )
    return table


def _decimals(half_width: float) -> int:
    """Decimals that show two digits of an interval's half width, but no fewer than Table 4.1 has."""
    if not 0.0 < half_width < math.inf:
        return FEWEST_DECIMALS
    return min(max(FEWEST_DECIMALS, 1 - math.floor(math.log10(half_width))), MOST_DECIMALS)


def _percent(relative: float) -> str:
    """Two decimals, as in Table 4.1, three digits where these say nothing; above a thousand it is only large."""
    if not relative < 1000.0:
        return "> 999"
    return f"{relative:.2f}" if relative >= 0.1 else f"{relative:.3g}"


def validation_table(
    validation: Validation, training: Sequence[Score], units: Sequence[str], before: Sequence[Score] = ()
) -> Table:
    """Torque errors, joint by joint; `before` are those of an earlier run on the same recordings."""
    same = len(set(units)) == 1
    table = Table(title=f"Torque error, RMS{f' in {units[0]}' if same else ''}", header_style="bold")
    table.add_column("joint")
    held = validation.recordings
    several = [*_columns("train", training), *_columns("unseen", held), *_columns("earlier run", before)]
    for name, _ in several:
        table.add_column(name, justify="right")
    last = (held or tuple(training))[-1]
    for name in ("nominal", "of torque", "peak", "in band"):
        table.add_column(name, justify="right")
    for j, joint in enumerate(validation.joints):
        table.add_row(
            escape(joint) + ("" if same else f" [dim]{units[j]}[/]"),
            *(_number(rms[j]) for _, rms in several),
            "-" if last.prior_rms is None else _number(last.prior_rms[j]),
            _number(100 * last.relative[j], 1, " %"),
            _number(last.peak[j]),
            _number(100 * last.coverage95[j], 0, " %"),
        )
    table.caption = (
        "nominal: the description alone; of torque: over its standard deviation; in band: rows inside the 95 % band"
    )
    table.caption_justify = "left"
    return table


def _columns(name: str, scores: Sequence[Score]) -> list[tuple[str, Array]]:
    """Titles and errors of a column for each recording, or of one for all."""
    if len(scores) > MOST_COLUMNS:
        mean = np.sqrt(np.mean([score.rms**2 for score in scores], axis=0))
        return [(f"{name}, {len(scores)} runs", mean)]
    return [(f"{name} {k + 1}" if len(scores) > 1 else name, score.rms) for k, score in enumerate(scores)]


def _number(value: float, decimals: int = 3, unit: str = "") -> str:
    """A number, or a dash where there is none."""
    return f"{value:.{decimals}f}{unit}" if math.isfinite(value) else "-"


def status_line(standard: StandardFit) -> str:
    """What the data say of the standard parameters, in one line, and the prior that says the rest."""
    kinds = ("identified", "prior-dominated", "not identifiable")
    counts = ", ".join(f"{standard.status.count(kind)} {kind}" for kind in kinds)
    prior = standard.prior
    weight = f", weight {prior.weight:.3g}: {prior.how}" if prior.weight else ""
    return f"of {len(standard.names)} standard parameters {counts}; prior {prior.kind}{weight}"


def ladder_table(ladder: Ladder, joints: Sequence[str]) -> Table:
    """Friction that was chosen for each joint, and what it gains on motion that was left out."""
    table = Table(title="Friction chosen by motion that was left out", header_style="bold")
    table.add_column("joint")
    table.add_column("error, of that without", justify="right")
    table.add_column("added")
    for j, name in enumerate(joints):
        chosen = [each.candidate for each in ladder.evidence if each.chosen and each.joint == name]
        gain = f"{ladder.ratio[j]:.2f} ± {ladder.deviation[j]:.2f}"
        table.add_row(name, gain, escape("; ".join(chosen) or "-"))
    said = "± standard error from the scatter between stretches of motion; these made the choice, so it is optimistic"
    table.caption = " ".join(filter(None, ((said + ".") if ladder.evidence else "", ladder.why)))
    table.caption_justify = "left"
    return table


def print_methods(found: MethodTable, units: Sequence[str]) -> None:
    """Every method beside the others, and what kept those from an estimate that have none."""
    console = output_console()
    unit = f" in {units[0]}" if len(set(units)) == 1 else ""
    table = Table(title=f"Methods: torque error of all joints together, RMS{unit}", header_style="bold")
    table.add_column("method")
    for name in ("train", "unseen", "dropped", "physical", "smallest λ", "time"):
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
        f"unseen: {found.note}; physical: whether bodies with these base parameters exist; λ: of the "
        "pseudo-inertias of the estimated bodies"
    )
    table.caption_justify = "left"
    console.print(table)
    for each in found.scores:
        if each.failure:
            console.print(f"  {each.method}: {escape(each.failure)}")


def print_verdict(console: Console, validation: Validation) -> None:
    """The verdict and the checks that it is made of."""
    colour = {"pass": "green", "fail": "red"}.get(validation.verdict, "yellow")
    console.print(f"verdict on unseen motion: [bold {colour}]{validation.verdict}[/]")
    for check in validation.checks:
        mark = "[green]ok[/]  " if check.ok else "[red]fail[/]"
        relation = f"{check.value:.3g} {'≤' if check.ok else '>'} {check.bound:.3g}"
        console.print(f"  {mark} {relation:<16} {escape(check.name)}")
    if validation.verdict == "not judged":
        console.print('  keep a recording for it: --validate RECORDING, or role = "validate" in the study')
