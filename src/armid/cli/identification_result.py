"""Printed result of an identification: verdict, torque errors, summary of parameters, next commands."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.markup import escape

from armid.cli.commands.doctor import doctor
from armid.cli.commands.report import PAGE
from armid.cli.console import SHAPE_FINDINGS, output_console, print_verdict, validation_table
from armid.cli.parameter_tables import estimate_table, folded_line, friction_selection_table, print_links, status_line
from armid.estimation.link_properties import link_table

if TYPE_CHECKING:
    from armid.checked_array import Array
    from armid.errors import Finding
    from armid.estimation.fit_result import Fit
    from armid.study.identify import Result
    from armid.validation.torque_validation import Validation

COVARIANCE_SOURCES = {
    "white": "the variance of the residuals, which are assumed to be uncorrelated",
    "period": "the scatter between periods",
    "spectral": "the spectrum of the residuals",
    "block": "the scatter between blocks",
    "recursive": "the innovations of the recursive estimate",
}
"""Text that names the source of the covariance, by kind of covariance."""


def intervals_text(fit: Fit, gain_deviation: Array, keys: str = "drive_gain_deviation") -> str:
    """Line with the source of the intervals and the reason for its choice, and a line about uncertain drive gains.

    Args:
        fit: The estimate.
        gain_deviation: Relative standard deviation of the drive gain of each joint, zero if it is exact, shape (n,).
        keys: Names of the key of the study, and of the option, that state the deviation.
    """
    source = f"intervals from {COVARIANCE_SOURCES[fit.covariance_kind]}: {fit.report.why}"
    if not gain_deviation.any():
        return source
    ends = dict.fromkeys((100 * float(gain_deviation.min()), 100 * float(gain_deviation.max())))
    deviation = " to ".join(f"{float(f'{end:.3g}'):g}" for end in ends)
    return f"{source}\nthe deviation of the drive gains, {deviation} %, widens the intervals ({keys})"


def print_result(result: Result, *, verbose: bool = False) -> None:
    """Print the verdict, the torque errors, and the number of parameters, or all parameters if `verbose`."""
    console, estimate = output_console(), result.estimate
    fit = estimate.fit
    console.print(f"[bold]{escape(estimate.robot)}[/]: ", end="")
    print_verdict(console, result.validation)
    if result.validation.verdict == "pass":
        for line in _warning_lines(estimate.findings, verbose=verbose):
            console.print(line)
    units = [joint.effort_unit for joint in result.robot.joints]
    console.print(validation_table(result.validation, result.training, units))
    if result.validation.left_out is not None:
        console.print(_expected_line(result.validation, units))
    if result.friction_selection is not None:
        console.print(friction_selection_table(result.friction_selection, result.robot))
        console.print(_method_line(result))
    if verbose:
        console.print(estimate_table(estimate, result.robot.joint_names))
    else:
        console.print(
            f"{folded_line(estimate)}; --verbose or {PAGE} lists them; the number in a name is the number # of the "
            "joint"
        )
    print_links(console, link_table(result.model, estimate))
    if fit.standard is not None:
        console.print(status_line(fit.standard))
    console.print(
        f"condition number {fit.condition:.2f}, with columns of unit length {fit.scaled_condition:.2f}; "
        f"{int(fit.rows.max())} rows\n{intervals_text(fit, result.information.scale_deviation)}\n"
        f"{_assumption(result)}\n"
        f"{estimate.seconds:.2f} s from recordings to result"
    )


def _expected_line(validation: Validation, units: Sequence[str]) -> str:
    """Line with the RMS error expected on another recording, and the joints whose error is outside its interval."""
    assert validation.left_out is not None
    expected = validation.left_out.expected
    low, rms, high = (float(np.linalg.norm(each)) for each in (expected.low, expected.rms, expected.high))
    unit = f" {units[0]}" if len(set(units)) == 1 else ""
    line = (
        f"expected on another recording of such a motion: RMS error {rms:.3g}{unit}, 90 % interval {low:.3g} to "
        f"{high:.3g} (root of the sum of squares over the joints; from the left-out {validation.left_out.kind} and "
        "the uncertainty of the estimate)"
    )
    if not validation.recordings:
        return line
    errors = np.array([each.rms for each in validation.recordings])
    joints = np.array(validation.joints)
    with np.errstate(invalid="ignore"):
        above, below = joints[(errors > expected.high).any(axis=0)], joints[(errors < expected.low).all(axis=0)]
    parts = [f"above the interval on {', '.join(above)}"] if len(above) else []
    if len(below):
        parts.append(
            f"below the interval on {', '.join(below)}, where less has changed than usual between recordings"
        )
    known = np.isfinite(errors)
    if not parts:
        within = (~known | (errors >= expected.low)).all() and known.any(axis=0).all()
        parts.append("inside the interval on every joint" if within else "not above the interval on any joint")
    return f"{line}; validation: {escape('; '.join(parts))}"


def _assumption(result: Result) -> str:
    """Line with the assumption under which the intervals are valid."""
    other = "" if result.friction_selection is not None else "; --terms auto selects among more friction laws"
    return f"the intervals are valid if the torque terms of the model, including friction, are right{other}"


def _warning_lines(findings: Sequence[Finding], *, verbose: bool) -> list[str]:
    """Lines with the codes of the warnings: first the printed warnings, then those that only the page explains."""
    codes = list(dict.fromkeys(each.code for each in findings if each.severity == "warning"))
    printed = [code for code in codes if verbose or code not in SHAPE_FINDINGS]
    others = [code for code in codes if code not in printed]
    lines = [f" [yellow]with warnings[/], see their lines below: {', '.join(printed)}"] if printed else []
    if others:
        lines.append(
            f" with warnings about shapes, which do not affect the result; --verbose and {PAGE} explain them: "
            f"{', '.join(others)}"
        )
    return lines


def _method_line(result: Result) -> str:
    """Line with the estimation method after friction selection, the reason for it, and the weight of the prior."""
    from armid.study.config import PLAIN_METHOD

    method = result.estimate.method
    suitable = result.friction_selection is not None and method == result.friction_selection.method
    reason = f", which suits the selected friction ({PLAIN_METHOD} if the terms are given)" if suitable else ""
    has_prior = any(finding.code == "prior-weight" for finding in result.estimate.findings)
    weight = result.friction_selection.weight_for(method) if result.friction_selection and has_prior else None
    prior = (
        ""
        if weight is None
        else (
            f"; its prior has the weight of {weight:.3g} independent samples, chosen together with the friction terms"
        )
    )
    return f"estimated by {method}{reason}{prior}"


def print_next(
    result: Result, folder: Path, *, page: bool, replaced: bool = False, inputs: Sequence[str] = ()
) -> None:
    """Print the folder of the run, its page, and possible next commands.

    Args:
        result: Result of the identification.
        folder: The run's folder.
        page: True if the HTML page of the run was written.
        replaced: True if an earlier run in this folder was replaced.
        inputs: The study, or the arm and its recordings, as given on the command line.
    """
    from armid.cli.remedy_hints import given_options
    from armid.report.heading import export_command

    run = shlex.quote(str(folder))
    lines = [f"run written to {folder}{', replacing the earlier run there' if replaced else ''}"]
    if page:
        lines.append(f"open {folder / PAGE}")
    steps: list[tuple[str, str]] = []
    if not page:
        steps.append((f"armid report {run}", "a page about this run"))
    if not result.validation.recordings:
        steps.append((f"armid validate {run} RECORDING", "torque error on a recording not used for training"))
    if result.validation.verdict == "fail" and inputs:
        words = [*map(shlex.quote, inputs), *given_options(signature(doctor).parameters)]
        steps.append((f"armid doctor {' '.join(words)}", "faults of the recordings; exit code 1 if there are any"))
    steps.append(export_command(run, result.estimate, result.robot, result.study.robot.description))
    if result.validation.recordings:
        steps.append((f"armid validate {run} RECORDING", "torque error on a further recording"))
    steps.append((f"armid preview {run}", "the recorded motion of the arm"))
    width = max(len(command) for command, _ in steps)
    lines += ["next:", *(f"  {command:{width}}   {purpose}" for command, purpose in steps)]
    sys.stdout.write("\n" + "\n".join(lines) + "\n")
