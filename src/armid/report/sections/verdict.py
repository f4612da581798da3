"""Section of the verdict: reliable results, doubtful results, and next steps."""

from __future__ import annotations

import numpy as np

from armid.report.data.findings import serious
from armid.report.data.number_format import share, short
from armid.report.data.page_data import PageData
from armid.report.data.trust import forbids_simulation, intervals_hold, judge_trust
from armid.report.heading import commands_of
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell

FIRST = 5
"""Number of sentences in each column that are not folded, so that the numbers below stay visible."""

SENTENCES = {
    "pass": "Every check on validation motion passed.",
    "fail": "Not every check on validation motion passed.",
    "not judged": "There is no validation recording, so the model is not judged.",
}

BADGES = {"pass": "✓ pass", "fail": "✗ fail", "not judged": "– not judged"}

PASSED_LEFT_OUT = "There is no validation recording; every check on left-out training data passed."

FAILED_WITHOUT_VALIDATION = "There is no validation recording, and a check of the training recordings failed."

CONTRADICTED = "the findings contain an error, so the model may be wrong as a whole."

UNREAL = "no real body has these parameters. Do not use them in a simulation or an export."


def show_verdict(page_data: PageData) -> Section:
    """Section of the verdict with its checks and the main numbers."""
    content = {
        **_badge(page_data),
        "judgement": judge_trust(page_data),
        "first": FIRST,
        "figures": _figures(page_data),
        "commands": commands_of(page_data),
    }
    rows = [
        (
            TableCell(each.name),
            TableCell(short(each.value), each.value),
            TableCell(short(each.bound), each.bound),
            TableCell("holds" if each.ok else "fails", kind="" if each.ok else "poor"),
        )
        for each in page_data.validation.checks
    ]
    columns = (Column("check", words=True), Column("value"), Column("bound"), Column("", words=True))
    table = Table("checks", "Checks of the verdict", columns, rows, folded=True)
    return Section("Verdict", content, (table,) if rows else ())


def _badge(page_data: PageData) -> dict[str, str]:
    """Colour, badge and sentence for the verdict of a run.

    If the verdict is not `fail`, but the run has an error or impossible bodies, they replace the verdict.
    """
    verdict = page_data.validation.verdict
    sentence = SENTENCES.get(verdict, "")
    if verdict != "not judged" and not page_data.validation.recordings:
        sentence = PASSED_LEFT_OUT if verdict == "pass" else FAILED_WITHOUT_VALIDATION
    errors = bool(serious(page_data.run.estimate.findings, "error"))
    if verdict == "fail" or not (errors or forbids_simulation(page_data)):
        colour = verdict if verdict in BADGES else "not judged"
        return {"colour": colour.replace(" ", "-"), "badge": BADGES[colour], "sentence": sentence}
    badge, reason = ("✗ error found", CONTRADICTED) if errors else ("✗ not for simulation", UNREAL)
    return {"colour": "fail", "badge": badge, "sentence": f"{sentence.removesuffix('.')}; {reason}"}


def _figures(page_data: PageData) -> list[tuple[str, str, str]]:
    """Main numbers of a run, each with its unit and its meaning."""
    fit, unit = page_data.run.estimate.fit, effort_unit(page_data)
    figures: list[tuple[str, str, str]] = []
    error = "RMS error, root of the sum of squares over joints" if len(page_data.joints) > 1 else "RMS error"
    held_out = page_data.validation_rms()
    if np.isfinite(held_out).any():
        figures.append((short(float(np.linalg.norm(held_out[np.isfinite(held_out)]))), unit, f"validation {error}"))
    training = float(np.linalg.norm(fit.residual_rms))
    figures.append((short(training), unit, f"training {error}"))
    coverage = page_data.validation_column(lambda score: score.coverage95)
    if np.isfinite(coverage).any():
        figures.append((share(float(np.nanmean(coverage))), "", "of held-out rows inside 95 % prediction intervals"))
    if page_data.validation.left_out is not None:
        expected = page_data.validation.left_out.expected
        low, high = (float(np.linalg.norm(each)) for each in (expected.low, expected.high))
        figures.append((f"{short(low)} to {short(high)}", unit, f"expected {error} on another recording (90 %)"))
    if not intervals_hold(page_data):
        return figures
    low, high = page_data.run.estimate.intervals.T
    significant = int(np.sum((low > 0.0) | (high < 0.0)))
    figures.append((f"{significant} of {len(fit.names)}", "", "parameters whose interval excludes zero"))
    return figures
