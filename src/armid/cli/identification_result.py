"""An identification on the screen: the verdict, torque errors, parameters folded, and what to do next."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape

from armid.cli.commands.report import PAGE
from armid.cli.console import output_console, print_verdict, validation_table
from armid.cli.parameter_tables import estimate_table, folded_line, friction_selection_table, print_links, status_line
from armid.estimation.link_properties import link_table

if TYPE_CHECKING:
    from armid.estimation.fit import Fit
    from armid.study.identify import Result

__all__ = ["intervals_line", "print_next", "print_result"]

KINDS = {
    "white": "the variance of the residuals, taken as uncorrelated",
    "period": "the scatter between periods",
    "spectral": "the spectrum of the residuals",
    "block": "the scatter between blocks",
    "recursive": "the innovations of the recursive estimate",
}
"""What a kind of covariance is made of, in words."""


def intervals_line(fit: Fit) -> str:
    """Return what intervals were made from, and why."""
    return f"intervals from {KINDS[fit.covariance_kind]}: {fit.report.why}"


def print_result(result: Result, *, verbose: bool = False) -> None:
    """Verdict and torque error first; parameters in one line, or with `verbose` in full."""
    console, estimate = output_console(), result.estimate
    fit = estimate.fit
    console.print(f"[bold]{escape(estimate.robot)}[/]: ", end="")
    print_verdict(console, result.validation)
    units = [joint.effort_unit for joint in result.robot.joints]
    console.print(validation_table(result.validation, result.training, units))
    if result.ladder is not None:
        console.print(friction_selection_table(result.ladder, result.robot))
        console.print(_method_said(result))
    if verbose:
        console.print(estimate_table(estimate, result.robot.joint_names))
    else:
        console.print(
            f"{folded_line(estimate)}; --verbose or {PAGE} lists them, each named after its joint's number #"
        )
    print_links(console, link_table(result.model, estimate))
    if fit.standard is not None:
        console.print(status_line(fit.standard))
    console.print(
        f"condition number {fit.condition:.2f}, with columns of unit length {fit.scaled_condition:.2f}; "
        f"{int(fit.rows.max())} rows\n{intervals_line(fit)}\n"
        f"{estimate.seconds:.2f} s from recordings to result"
    )


def _method_said(result: Result) -> str:
    """Tell how the estimate that follows chosen friction was made, where that is other than without."""
    from armid.study.config import AUTOMATIC_METHOD, PLAIN_METHOD

    method = result.estimate.method
    default = method == AUTOMATIC_METHOD
    why = f", the default where friction is chosen ({PLAIN_METHOD} where it is named)" if default else ""
    has_prior = any(finding.code == "prior-weight" for finding in result.estimate.findings)
    weight = result.ladder.prior_weight if result.ladder and has_prior else None
    prior = (
        ""
        if weight is None
        else f"; the prior of its bodies weighs {weight:.3g} independent samples, as chosen with the friction"
    )
    return f"estimated by {method}{why}{prior}"


def print_next(
    result: Result, folder: Path, *, page: bool, replaced: bool = False, asked: Sequence[str] = ()
) -> None:
    """Print where the run is, its page, and commands that go on with it.

    Args:
        result: What was identified.
        folder: The run's folder.
        page: Whether its page was written.
        replaced: Whether another run was there.
        asked: The study, or the arm and recordings, as they were asked for.
    """
    run = shlex.quote(str(folder))
    lines = [f"run written to {folder}{', in place of the one there' if replaced else ''}"]
    if page:
        lines.append(f"open {folder / PAGE}")
    steps: list[tuple[str, str]] = []
    if not page:
        steps.append((f"armid report {run}", "a page about it"))
    if result.validation.verdict == "not judged":
        steps.append((f"armid validate {run} RECORDING", "torque error on a recording that did not train it"))
    if result.validation.verdict == "fail" and asked:
        steps.append((f"armid doctor {' '.join(map(shlex.quote, asked))}", "faults of the recordings"))
    if result.estimate.fit.standard is None:
        steps.append((f"armid export {run} --to c", "the model as source code; descriptions need --method physical"))
    else:
        form = "mjcf" if Path(result.study.robot.description).suffix == ".xml" else "urdf"
        steps.append((f"armid export {run} --to {form}", "the model as a robot description, or code: --to c"))
    if result.validation.verdict != "not judged":
        steps.append((f"armid validate {run} RECORDING", "torque error on a further recording"))
    steps.append((f"armid preview {run}", "the recorded motion of the arm"))
    width = max(len(command) for command, _ in steps)
    lines += ["next:", *(f"  {command:{width}}   {what}" for command, what in steps)]
    sys.stdout.write("\n" + "\n".join(lines) + "\n")
