"""Preflight report of a design, as text and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from armid.errors import Finding
from armid.excitation.certification import Margin
from armid.study.plans.design import Designed
from armid.study.records import finding_record

__all__ = ["findings_of", "report_record", "report_text"]

MOST_LINES = 12
"""Parameters and pairs that the text shows; the JSON has all of them."""

MARKS = {"pass": "✓", "fail": "✗", "not checked": "–"}
"""Before each verdict."""


def findings_of(designed: Designed) -> tuple[Finding, ...]:
    """Findings of the description and of the design, each once."""
    return tuple(dict.fromkeys((*designed.problem.goal.model.robot.findings, *designed.findings)))


def report_record(designed: Designed) -> dict[str, Any]:
    """The contents of `preflight.json`."""
    report = designed.preflight
    expected = report.expected
    return {
        "verdict": report.verdict,
        "said": report.sentence,
        "collisions": f"not checked: {report.unchecked}" if report.unchecked else "checked",
        "limits": [
            {
                "limit": m.limit,
                "joint": m.label,
                "value": m.value,
                "bound": m.bound,
                "unit": m.unit,
                "time": m.time,
                "share": m.share,
                "certified_share": m.certified,
            }
            for m in report.margins
        ],
        "approaches": [
            {"pair": a.pair, "distance": a.distance, "time": a.time, "asked": a.asked} for a in report.approaches
        ],
        "skipped_pairs": [
            {"pair": each.pair, "touching": None if each.reason else each.share, "reason": each.reason or "touching"}
            for each in report.skipped
        ],
        "condition": expected.condition,
        "log_det": expected.log_det,
        "base_parameters": [
            {"name": name, "unit": unit, "deviation": deviation}
            for name, unit, deviation in zip(expected.names, expected.units, expected.deviation, strict=True)
        ],
        "torque_deviation": expected.torque,
        "findings": [finding_record(finding) for finding in findings_of(designed)],
    }


def report_text(designed: Designed, *, findings: bool = True) -> str:
    """The report for people.

    Args:
        designed: The design.
        findings: Whether findings are appended; on a screen they are printed separately.
    """
    report, goal, plan = designed.preflight, designed.problem.goal, designed.plan
    series, expected = plan.excitation, report.expected
    times = "once" if plan.repetitions == 1 else f"{plan.repetitions} times"
    leads_text = f"; {plan.duration:.1f} s with the ways to and from it" if plan.lead_in + plan.lead_out else ""
    lines = [
        f"{MARKS[report.verdict]} {report.sentence}",
        "",
        f"{series.robot}: {series.harmonics} harmonics over {series.period:g} s, {times}{leads_text}",
        f"designed for {goal.criterion}; condition number {expected.condition:.2f}, "
        f"log-determinant of the Fisher information {expected.log_det:.2f}",
        "",
        "limits (share of the limit on a grid of 1 kHz, and certified between its points)",
        *(_limit_line(m, designed) for m in report.margins if m.limit != "collision"),
    ]
    if report.approaches:
        lines += ["", "closest approaches (what each pair should keep)"]
        lines += [
            f"  {a.pair:<40}{1000 * a.distance:8.0f} mm at {a.time:6.2f} s  ({1000 * a.asked:.0f} mm)"
            for a in report.approaches[:MOST_LINES]
        ]
        if len(report.approaches) > MOST_LINES:
            lines.append(f"  … {len(report.approaches) - MOST_LINES} more pairs are further apart")
    if report.skipped:
        left = "; ".join(each.account for each in report.skipped)
        lines += ["", f"not looked at, as they touch in most poses (share of poses) or were left out by hand: {left}"]
    lines += _expected_lines(designed)
    if findings:
        lines += ["", *(_finding_line(finding) for finding in findings_of(designed))]
    return "\n".join(lines).rstrip() + "\n"


def _limit_line(margin: Margin, designed: Designed) -> str:
    """Line for one limit; for positions with the range."""
    when = "" if np.isnan(margin.time) else f" at {margin.time:6.2f} s"
    shares = f"{100 * margin.share:6.1f} %  {100 * margin.certified:6.1f} %{when}"
    spread = designed.spread(margin)
    if spread is None:
        value = f"{margin.value:>10.4f} of {margin.bound:>9.4f} {margin.unit:<7}"
    else:
        low, high, lower, upper = spread
        value = f"{low:.4f}…{high:.4f} of {lower:.4f}…{upper:.4f} {margin.unit}  "
    return f"  {margin.limit:<13}{margin.label:<24}{value}{shares}"


def _expected_lines(designed: Designed) -> list[str]:
    """Lines with the standard deviations that the recording will give."""
    goal, expected = designed.problem.goal, designed.preflight.expected
    noise = ", ".join(f"{x:g}" for x in goal.noise)
    lines = [
        "",
        f"predicted standard deviations, for uncorrelated torque noise of {noise} (N·m or N) at {goal.rate:g} Hz",
    ]
    order = np.argsort(-expected.deviation)
    for k in order[:MOST_LINES]:
        lines.append(f"  {expected.names[k]:<12}{expected.deviation[k]:12.3g} {expected.units[k]}")
    if len(order) > MOST_LINES:
        lines.append(f"  … {len(order) - MOST_LINES} more are smaller; preflight.json has all")
    torque = ", ".join(f"{x:.3g}" for x in expected.torque)
    lines.append(f"  of the torque predicted afterwards: {torque} (N·m or N, joint by joint)")
    return lines


def _finding_line(finding: Finding) -> str:
    """Line with a finding and its remedy."""
    where = f"{finding.channel}: " if finding.channel else ""
    stop = "; " if finding.remedy and finding.evidence[-1:] not in (".", ";") else " "
    return f"{finding.severity}: {stop.join(part for part in (where + finding.evidence, finding.remedy) if part)}"
