"""What people see: tables on standard output, progress and messages on standard error."""

from __future__ import annotations

import math
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from armid.errors import ArmidError, Finding
from armid.estimation.estimate import Estimate
from armid.study.identify import Progress as Tell
from armid.validation.predict import Score, Validation

__all__ = [
    "error_console",
    "estimate_table",
    "output_console",
    "print_error",
    "print_findings",
    "print_verdict",
    "progress",
    "validation_table",
]

WIDTH_IN_A_PIPE = 120


def output_console() -> Console:
    """Standard output; plain text where it is no terminal."""
    return Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH_IN_A_PIPE, highlight=False)


def error_console() -> Console:
    """Standard error."""
    return Console(file=sys.stderr, width=None if sys.stderr.isatty() else WIDTH_IN_A_PIPE, highlight=False)


def print_error(error: ArmidError) -> None:
    """One message: what was asked and found, what is possible, what to do."""
    console = error_console()
    console.print(f"[bold red]error[/] {_escaped(error.problem)}")
    if error.possible:
        console.print(f"[dim]possible[/] {_escaped(error.possible)}")
    if error.remedy:
        console.print(f"[bold]do[/] {_escaped(error.remedy)}")


def print_findings(findings: Sequence[Finding]) -> None:
    """Warnings and notes, one line each."""
    console = error_console()
    colours = {"error": "red", "warning": "yellow", "info": "dim"}
    for finding in findings:
        where = f"{finding.channel}: " if finding.channel else ""
        text = " ".join(part for part in (where + finding.evidence, finding.remedy) if part)
        console.print(f"[{colours[finding.severity]}]{finding.code}[/] {_escaped(text)}")


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
    table = Table(
        title=f"{estimate.robot}: {len(fit.names)} base parameters, {estimate.method}",
        caption="* poorly identified: σ % above ten times the smallest",
        header_style="bold",
    )
    for name in ("parameter", "value", "unit", "σ %", "95 % interval"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    units = dict(zip(estimate.base.names, estimate.base.units, strict=True))
    for k, name in enumerate(fit.names):
        relative = fit.relative_deviation[k]
        table.add_row(
            name,
            f"{fit.values[k]:.4g}",
            units[name.split("[", 1)[0]],
            f"{relative:.3g}{'*' if fit.poorly_identified[k] else ' '}" if math.isfinite(relative) else "-",
            f"{ends[k, 0]:.4g} … {ends[k, 1]:.4g}",
        )
    return table


def validation_table(validation: Validation, training: Sequence[Score], units: Sequence[str]) -> Table:
    """Torque errors, joint by joint."""
    table = Table(title="Torque error (RMS)", header_style="bold")
    table.add_column("joint")
    several = [(f"train {k + 1}" if len(training) > 1 else "train", score) for k, score in enumerate(training)]
    held = validation.recordings
    several += [(f"unseen {k + 1}" if len(held) > 1 else "unseen", score) for k, score in enumerate(held)]
    for name, _ in several:
        table.add_column(name, justify="right")
    last = (held or tuple(training))[-1]
    for name in ("description alone", "share of torque", "peak", "in 95 % band"):
        table.add_column(name, justify="right")
    for j, joint in enumerate(validation.joints):
        table.add_row(
            f"{joint} [dim]{units[j]}[/]",
            *(f"{score.rms[j]:.3f}" for _, score in several),
            "-" if last.prior_rms is None else f"{last.prior_rms[j]:.3f}",
            f"{100 * last.relative[j]:.1f} %",
            f"{last.peak[j]:.3f}",
            f"{100 * last.coverage95[j]:.0f} %",
        )
    return table


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")


def print_verdict(console: Console, validation: Validation) -> None:
    """The verdict and the checks that it is made of."""
    colour = {"pass": "green", "fail": "red"}.get(validation.verdict, "yellow")
    console.print(f"verdict on unseen motion: [bold {colour}]{validation.verdict}[/]")
    for check in validation.checks:
        mark = "[green]ok[/]  " if check.ok else "[red]fail[/]"
        console.print(f"  {mark} {_escaped(check.name)}: {check.value:.3g} against {check.bound:.3g}")
    if validation.verdict == "not judged":
        console.print('  keep a recording for it: --validate RECORDING, or role = "validate" in the study')
